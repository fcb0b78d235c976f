"""Procedural materials for what free material sets lack: leather, woven and
knitted fabric, plastics, painted, brushed, polished and rough metals, ceramics
with grout, varnished wood, paper, polished stone, patchworks; from relief.py strong
relief; from prints.py what is patterned and flat, or dyed through.

Every generator takes (size, rng) and returns (height or slope, kd, ks,
roughness) as float32 arrays; everything tiles. The whole module is numpy only.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import torch

import prints
import relief
from data import OWN_LICENCE, PackWriter
from renderer import encode_maps
from textures import dielectric, grid, hue, metal_f0, mix, noise, paint, slopes, smoothstep, worley

# ------------------------------------------------------------- generators


def leather(size, rng):
    cells = int(rng.integers(14, 60))
    f1, f2, ident = worley(size, rng, cells, 1.0, rng.uniform(0.2, 0.9), rng.uniform(0.6, 1.6))
    crease = smoothstep(0.0, rng.uniform(0.15, 0.4), f2 - f1)
    g1, g2, _ = worley(size, rng, cells * 3, 1.0, 0.5)
    fine = smoothstep(0, 0.4, g2 - g1)
    folds = noise(size, rng, 2.2, low=1, high=8)
    h = crease * (0.7 + 0.3 * fine) + 0.05 * noise(size, rng, 1.0, low=20) + 0.6 * folds * rng.random()
    if rng.random() < 0.4:  # pores
        p, _, _ = worley(size, rng, cells * 2, 1.0)
        h -= 0.5 * smoothstep(0.25, 0.05, p)
    base = hue(rng, (0.02, 0.45), (0.2, 0.85), h=rng.choice([0.05, 0.07, 0.03, rng.random()]))
    tone = 1 + 0.12 * noise(size, rng, 2.0, low=1) + 0.05 * noise(size, rng, 0.5)
    shade = (1 - rng.uniform(0.2, 0.7) * (1 - crease)) * np.clip(tone, 0.4, 1.6)
    r = rng.uniform(0.25, 0.65)
    rough = r + rng.uniform(0.1, 0.3) * (1 - crease) + 0.04 * noise(size, rng, 1.5)
    return slopes(h, rng.uniform(0.1, 0.5)), paint(base, shade), paint(dielectric(rng), 0.6 + 0.4 * crease), rough


def woven(size, rng):
    x, y = grid(size)
    n = int(rng.integers(10, 44)) * 2
    m = int(n * rng.uniform(0.6, 1.4)) // 2 * 2
    wob = rng.uniform(0, 0.25)
    u = x * n + wob * noise(size, rng, 2.0, (1, 0.3), low=2)
    v = y * m + wob * noise(size, rng, 2.0, (0.3, 1), low=2)
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    fu, fv = u - i - 0.5, v - j - 0.5
    kind = rng.integers(3)
    if kind == 0:
        over = (i + j) % 2 == 0
    elif kind == 1:
        over = (i + j) % 4 < 2
    else:
        over = (i * 2 + j) % 5 != 0
    warp = np.sqrt(np.clip(1 - (1.8 * fu) ** 2, 0, 1)) * (0.6 + 0.4 * np.cos(np.pi * fv))
    weft = np.sqrt(np.clip(1 - (1.8 * fv) ** 2, 0, 1)) * (0.6 + 0.4 * np.cos(np.pi * fu))
    h = np.where(over, np.maximum(warp, 0.45 * weft), np.maximum(weft, 0.45 * warp))
    fibre = np.where(over, noise(size, rng, 0.7, (1.0, 0.15), low=30), noise(size, rng, 0.7, (0.15, 1.0), low=30))
    a = hue(rng, (0.03, 0.7))
    b = a * rng.uniform(0.6, 1.3) if rng.random() < 0.5 else hue(rng, (0.03, 0.7))
    kd = mix(paint(a, np.ones_like(h)), paint(b, np.ones_like(h)), (~over).astype(np.float32))
    if rng.random() < 0.35:  # stripes or checks
        c = hue(rng, (0.03, 0.7))
        period = int(rng.integers(2, 9))
        stripes = (np.floor(x * period * 2) % 2 == 0) & (over | (rng.random() < 0.5))
        kd = mix(kd, c, stripes.astype(np.float32) * 0.9)
    kd = kd * np.clip((0.35 + 0.65 * h) * (1 + 0.1 * fibre + 0.1 * noise(size, rng, 2)), 0.1, 2)
    silk = rng.random() < 0.25
    r = rng.uniform(0.3, 0.5) if silk else rng.uniform(0.55, 0.95)
    rough = r + 0.05 * fibre + 0.1 * (1 - h)
    ks = dielectric(rng) * (2.0 if silk else rng.uniform(0.6, 1.2))
    return slopes(h * n / size * 6 + 0.04 * fibre, rng.uniform(0.2, 0.8)), kd, paint(ks, 0.4 + 0.6 * h), rough


def knit(size, rng):
    x, y = grid(size)
    n, m = int(rng.integers(8, 30)), int(rng.integers(10, 40))
    u = x * n + 0.06 * noise(size, rng, 2, low=2)
    fu = np.abs(u - np.floor(u) - 0.5) * 2
    v = y * m + rng.uniform(0.5, 1.1) * fu + 0.08 * noise(size, rng, 2, low=2)
    loop = np.abs(np.sin(np.pi * v)) ** 0.7
    body = np.clip(np.sin(np.pi * fu), 0, 1) ** 0.6
    h = loop * body
    fuzz = noise(size, rng, 0.5, low=40)
    a = hue(rng, (0.03, 0.7))
    kd = paint(a, np.clip((0.3 + 0.7 * h) * (1 + 0.12 * fuzz), 0.05, 2))
    if rng.random() < 0.4:
        rows = np.floor(y * rng.integers(2, 8) * 2) % 2
        kd = mix(kd, paint(hue(rng, (0.03, 0.7)), 0.3 + 0.7 * h), rows)
    rough = rng.uniform(0.65, 0.97) + 0.05 * fuzz
    return slopes(h + 0.06 * fuzz, rng.uniform(0.25, 0.8)), kd, paint(dielectric(rng) * rng.uniform(0.5, 1.1), 0.5 + 0.5 * h), rough


def moulded(size, rng):
    """A regular relief: ribs, dots, squares, diamonds; height in [0, 1]."""
    x, y = grid(size)
    n = int(rng.integers(4, 32))
    kind = rng.integers(5)
    u, v = x * n, y * n
    if kind == 3:
        u, v = u + v, u - v
    fu, fv = u - np.floor(u) - 0.5, v - np.floor(v) - 0.5
    soft = rng.uniform(0.03, 0.15)
    if kind == 0:
        d = np.abs(fu) * 2
    elif kind == 1:
        d = np.hypot(fu, fv) * 2
    else:
        d = np.maximum(np.abs(fu), np.abs(fv)) * 2
    if kind == 4:
        d = np.minimum(d, np.abs(fu + fv))
    e = rng.uniform(0.4, 0.85)
    return smoothstep(e + soft, e - soft, d)


def plastic(size, rng):
    kind = rng.integers(4)
    wave = noise(size, rng, 2.5, low=1, high=10)
    if kind == 0:
        s = slopes(wave, rng.uniform(0.0, 0.03)) + slopes(noise(size, rng, 0.5, low=60), rng.uniform(0, 0.02))
        relief = np.ones_like(wave)
    elif kind == 1:
        f1, f2, _ = worley(size, rng, int(rng.integers(30, 90)), 1.0, 0.5)
        relief = smoothstep(0, 0.5, f2 - f1)
        s = slopes(relief, rng.uniform(0.05, 0.35))
    elif kind == 2:
        relief = moulded(size, rng)
        s = slopes(relief, rng.uniform(0.1, 0.5)) + slopes(noise(size, rng, 0.5, low=60), rng.uniform(0, 0.05))
    else:
        relief = noise(size, rng, rng.uniform(0.3, 1.2), low=20, high=140)
        s = slopes(relief, rng.uniform(0.03, 0.3))
        relief = np.clip(0.5 + 0.3 * relief, 0, 1)
    a = hue(rng, (0.01, 0.8))
    kd = paint(a, 1 + 0.03 * noise(size, rng, 1.5))
    r = rng.uniform(0.06, 0.55)
    rough = r + rng.uniform(0, 0.15) * (1 - relief) + rng.uniform(0, 0.04) * noise(size, rng, 1.5)
    if rng.random() < 0.3:  # a second colour, inlaid
        mask = smoothstep(0.0, 0.05, noise(size, rng, 2.5, low=2, high=12) - rng.uniform(0, 1))
        kd = mix(kd, hue(rng, (0.01, 0.8)), mask)
        rough = mix(rough, rng.uniform(0.06, 0.6), mask)
    return s, kd, paint(dielectric(rng), np.ones_like(relief)), rough


def scratches(size, rng, count, length=0.4):
    """Random straight scratches a texel wide, [S, S] in [0, 1]."""
    canvas = np.zeros((size, size), np.float32)
    for _ in range(count):
        a, angle = rng.random(2) * size, rng.uniform(0, 2 * np.pi)
        b = a + size * length * rng.random() * np.array([np.cos(angle), np.sin(angle)])
        low = np.clip(np.floor(np.minimum(a, b)).astype(int) - 1, 0, size - 1)
        high = np.clip(np.ceil(np.maximum(a, b)).astype(int) + 2, 1, size)
        y, x = np.mgrid[low[1] : high[1], low[0] : high[0]].astype(np.float32)
        d = b - a
        t = np.clip(((x - a[0]) * d[0] + (y - a[1]) * d[1]) / max(float(d @ d), 1e-6), 0, 1)
        distance = np.hypot(x - a[0] - t * d[0], y - a[1] - t * d[1])
        part = canvas[low[1] : high[1], low[0] : high[0]]
        np.maximum(part, rng.uniform(0.3, 1) * np.clip(1.2 - distance, 0, 1), out=part)
    return canvas


def painted_metal(size, rng):
    peel = noise(size, rng, 1.0, low=15, high=70)
    s = slopes(peel, rng.uniform(0.01, 0.15))
    a = hue(rng, (0.02, 0.7))
    kd = paint(a, 1 + 0.04 * noise(size, rng, 2))
    ks = dielectric(rng)[:, None, None] * np.ones((3, size, size), np.float32)
    rough = rng.uniform(0.08, 0.5) + 0.03 * noise(size, rng, 1.5)
    if rng.random() < 0.35:  # metallic flakes under the clear coat
        _, _, ident = worley(size, rng, int(rng.integers(60, 160)), 1.0)
        tilt = rng.normal(0, rng.uniform(0.03, 0.15), (2, int(ident.max()) + 1)).astype(np.float32)
        s = s + tilt[:, ident]
        ks = ks + paint(a, 0.6 * np.ones_like(peel))
        kd = kd * 0.4
    chips = noise(size, rng, 1.8, low=2) + 0.5 * noise(size, rng, 0.8, low=10)
    level = rng.uniform(0.8, 3.0)
    mask = smoothstep(level, level + 0.12, chips)
    if rng.random() < 0.4:
        mask = np.maximum(mask, scratches(size, rng, int(rng.integers(5, 60))))
    s = s * (1 - mask) + slopes(-mask, 0.25 * float(np.sqrt(mask.mean())))
    if rng.random() < 0.5:
        under_kd, under_ks, under_r = np.full(3, 0.01, np.float32), metal_f0(rng), rng.uniform(0.2, 0.6)
    else:
        under_kd, under_ks, under_r = np.array([0.2, 0.07, 0.03], np.float32) * rng.uniform(0.3, 1.4), dielectric(rng), rng.uniform(0.7, 0.95)
    return s, mix(kd, under_kd, mask), mix(ks, under_ks, mask), mix(rough, under_r, mask)


def brushed_metal(size, rng):
    stretch = rng.uniform(0.01, 0.08)
    st = (1.0, stretch) if rng.random() < 0.5 else (stretch, 1.0)
    line = noise(size, rng, rng.uniform(0.1, 0.8), st, low=4)
    line2 = noise(size, rng, rng.uniform(0.3, 1.0), st, low=2)
    f0 = metal_f0(rng)
    s = slopes(line, rng.uniform(0.02, 0.3)) + slopes(noise(size, rng, 2.2, high=8), rng.uniform(0, 0.06))
    rough = rng.uniform(0.15, 0.55) + rng.uniform(0.02, 0.08) * line2 + rng.uniform(0, 0.05) * noise(size, rng, 2)
    ks = paint(f0, np.clip(1 + 0.05 * line2, 0.6, 1.3))
    return s, paint(f0, np.full((size, size), rng.uniform(0, 0.06), np.float32)), ks, rough


def metal(size, rng):
    """Cast, polished, hammered, corroded."""
    kind = rng.integers(4)
    f0 = metal_f0(rng)
    fine = noise(size, rng, rng.uniform(0.5, 1.5), low=8)
    s = slopes(fine, rng.uniform(0.0, 0.08 if kind == 0 else 0.3))
    rough = rng.uniform(0.06, 0.35) if kind == 0 else rng.uniform(0.2, 0.8)
    rough = rough + rng.uniform(0.01, 0.08) * noise(size, rng, 1.5)
    if kind == 1:
        f1, _, _ = worley(size, rng, int(rng.integers(6, 24)), 0.9, 0.3)
        s = s * 0.4 + slopes(f1**2, rng.uniform(0.08, 0.4))
    if kind == 2:
        relief = moulded(size, rng)
        s = s * 0.3 + slopes(relief, rng.uniform(0.1, 0.5))
    smudge = np.clip(noise(size, rng, 2, low=1), 0, 2) * rng.uniform(0, 0.15)
    rough = rough + smudge
    rough = rough + 0.25 * scratches(size, rng, int(rng.integers(0, 60))) * (rng.random() < 0.4)
    kd = paint(f0, np.full((size, size), rng.uniform(0, 0.05), np.float32))
    ks = paint(f0, 1 - 0.2 * smudge)
    if rng.random() < 0.45:  # rust or patina
        f = noise(size, rng, 1.6, low=2) + 0.4 * fine
        level = rng.uniform(-0.5, 2.0)
        mask = smoothstep(level, level + rng.uniform(0.1, 1.2), f)
        rust = hue(rng, (0.05, 0.3), (0.4, 0.9), h=rng.choice([0.05, 0.06, 0.45, rng.random()]))
        kd = mix(kd, paint(rust, np.clip(1 + 0.3 * fine, 0.2, 2)), mask)
        ks = mix(ks, dielectric(rng), mask)
        rough = mix(rough, rng.uniform(0.6, 0.97), mask)
        s = s + slopes(fine * mask, rng.uniform(0.05, 0.4))
    return s, kd, ks, rough


def ceramic(size, rng):
    x, y = grid(size)
    n = int(rng.integers(2, 12))
    kind = rng.integers(3)
    if kind == 2:  # irregular
        f1, f2, ident = worley(size, rng, n, 0.8)
        d = (f2 - f1) * 0.5
    else:
        m = n if kind == 0 else 2 * n
        v = y * m
        j = np.floor(v).astype(int)
        u = x * n + (0.5 * (j % 2) if kind == 1 else 0)
        i = np.floor(u).astype(int)
        d = np.minimum(0.5 - np.abs(u - i - 0.5), (0.5 - np.abs(v - j - 0.5)) * n / m)
        ident = (i % n) + n * j
    g = rng.uniform(0.01, 0.05)
    tile = smoothstep(g, g + 0.012, d)
    edge = smoothstep(g, g + rng.uniform(0.03, 0.12), d)
    count = int(ident.max()) + 1
    lum = 1 + rng.uniform(0, 0.3) * rng.standard_normal(count).astype(np.float32)
    a, b = hue(rng, (0.03, 0.8)), hue(rng, (0.03, 0.8))
    which = (rng.random(count) < rng.uniform(0, 0.5)).astype(np.float32)
    kd = mix(paint(a, np.ones_like(d)), b, which[ident]) * np.clip(lum[ident], 0.3, 1.6)
    kd = kd * np.clip(1 + rng.uniform(0, 0.25) * noise(size, rng, 1.8, low=2), 0.2, 2)
    grout = hue(rng, (0.05, 0.5), (0, 0.3))
    grain = noise(size, rng, 0.6, low=30)
    kd = mix(paint(grout, np.clip(1 + 0.2 * grain, 0.3, 2)), kd, tile)
    tilt = rng.normal(0, rng.uniform(0, 0.04), (2, count)).astype(np.float32)
    s = slopes(edge, rng.uniform(0.08, 0.4)) + tilt[:, ident] * tile
    s = s + slopes(noise(size, rng, 2.2, high=14), rng.uniform(0, 0.05)) * tile + slopes(grain, rng.uniform(0.05, 0.4)) * (1 - tile)
    glaze = rng.uniform(0.05, 0.3) if rng.random() < 0.75 else rng.uniform(0.3, 0.7)
    rough = mix(rng.uniform(0.65, 0.97), glaze + 0.03 * noise(size, rng, 1.8), tile)
    return s, kd, paint(dielectric(rng), 0.7 + 0.3 * tile), rough


def wood(size, rng):
    x, y = grid(size)
    planks = int(rng.integers(1, 8))
    j = np.floor(x * planks).astype(int)
    off = rng.random(planks)[j % planks]
    warp = noise(size, rng, 2.2, (0.25, 1), low=1, high=30)
    ring = np.sin(2 * np.pi * (x * rng.integers(3, 18) + off * 7 + rng.uniform(0.1, 0.8) * warp))
    streak = noise(size, rng, 0.8, (0.04, 1), low=6)
    pore = smoothstep(rng.uniform(1.0, 2.2), 2.8, noise(size, rng, 0.4, (0.06, 1), low=40))
    base = hue(rng, (0.06, 0.5), (0.4, 0.8), h=rng.uniform(0.04, 0.11))
    tone = 1 + 0.2 * ring * rng.random() + 0.12 * streak + 0.35 * (off - 0.5)
    dark = base * np.array([0.6, 0.5, 0.4], np.float32)
    kd = mix(paint(base, np.clip(tone, 0.2, 2)), dark, np.clip(0.5 * pore + 0.25 * (ring > 0.6), 0, 1))
    gap = smoothstep(0.0, 0.02, 0.5 - np.abs(x * planks - j - 0.5)) if planks > 1 else np.ones_like(x)
    kd = kd * (0.2 + 0.8 * gap)
    h = 0.3 * streak - pore + 0.2 * ring
    s = slopes(h, rng.uniform(0.01, 0.2)) + slopes(gap, rng.uniform(0, 0.15) if planks > 1 else 0)
    r = rng.uniform(0.08, 0.35) if rng.random() < 0.6 else rng.uniform(0.4, 0.8)
    rough = r + 0.15 * pore + 0.04 * streak + 0.03 * ring
    return s, kd, dielectric(rng)[:, None, None] * (0.5 + 0.5 * gap), rough


def paper(size, rng):
    fibre = noise(size, rng, rng.uniform(0.4, 1.2), low=10)
    base = hue(rng, (0.2, 0.9), (0.0, 0.4))
    kd = paint(base, np.clip(1 + 0.04 * fibre + 0.04 * noise(size, rng, 2), 0.3, 1.3))
    rough = rng.uniform(0.55, 0.98) + 0.03 * fibre
    h = fibre
    s = slopes(h, rng.uniform(0.02, 0.25))
    if rng.random() < 0.4:
        crumple, _, ident = worley(size, rng, int(rng.integers(4, 14)), 1.0, 0.8)
        tilt = rng.normal(0, rng.uniform(0.05, 0.2), (2, int(ident.max()) + 1)).astype(np.float32)
        s = s + tilt[:, ident]
    if rng.random() < 0.6:  # print, matt or glossy
        mask = (moulded(size, rng) if rng.random() < 0.5 else smoothstep(0, 0.08, noise(size, rng, 2, low=3)))
        kd = mix(kd, hue(rng, (0.01, 0.6)), 0.95 * mask)
        rough = mix(rough, rng.uniform(0.2, 0.9), mask)
    return s, kd, dielectric(rng)[:, None, None] * np.ones((3, size, size), np.float32), rough


def stone(size, rng):
    """Marble, granite, terrazzo; polished or honed."""
    a, b = hue(rng, (0.05, 0.8), (0, 0.4)), hue(rng, (0.02, 0.7), (0, 0.5))
    kind = rng.integers(3)
    w = noise(size, rng, 1.8, low=1)
    if kind == 0:
        vein = np.exp(-np.abs(np.sin(3 * w + 1.5 * noise(size, rng, 1.6, low=2))) * rng.uniform(2, 12))
        mask = vein
    elif kind == 1:
        _, _, ident = worley(size, rng, int(rng.integers(30, 110)), 1.0, 0.5)
        mask = rng.random(int(ident.max()) + 1).astype(np.float32)[ident] ** rng.uniform(0.5, 3)
    else:
        f1, f2, ident = worley(size, rng, int(rng.integers(8, 40)), 1.0, 0.3)
        pick = rng.random(int(ident.max()) + 1).astype(np.float32)
        mask = smoothstep(0.05, 0.12, f2 - f1) * pick[ident]
    kd = mix(paint(a, np.clip(1 + 0.15 * w, 0.2, 2)), b, np.clip(mask, 0, 1))
    polish = rng.random() < 0.6
    r = rng.uniform(0.05, 0.25) if polish else rng.uniform(0.4, 0.95)
    rough = r + rng.uniform(0, 0.12) * mask + 0.02 * w
    fine = noise(size, rng, 1.0, low=8)
    s = slopes(fine, rng.uniform(0, 0.02) if polish else rng.uniform(0.05, 0.5))
    return s, kd, dielectric(rng)[:, None, None] * np.ones((3, size, size), np.float32), rough


def patchwork(size, rng):
    """Cells with unrelated properties, or smooth gradients of all of them:
    keeps the maps from being predictable from one another."""
    if rng.random() < 0.6:
        f1, f2, ident = worley(size, rng, int(rng.integers(2, 9)), 1.0, rng.uniform(0, 0.6))
        count = int(ident.max()) + 1
        kd = np.stack([hue(rng, (0.01, 0.85)) for _ in range(count)], 1)[:, ident]
        is_metal = rng.random(count) < 0.35
        ks = np.stack([metal_f0(rng) if t else dielectric(rng) for t in is_metal], 1)[:, ident]
        kd = kd * np.where(is_metal[ident], 0.05, 1.0)
        rough = rng.uniform(0.06, 1, count).astype(np.float32)[ident]
        tilt = rng.normal(0, rng.uniform(0, 0.2), (2, count)).astype(np.float32)[:, ident]
        strength = rng.uniform(0, 0.4, count).astype(np.float32)[ident]
        s = tilt + slopes(noise(size, rng, rng.uniform(0.5, 2), low=8), 1.0) * strength
    else:
        f = [noise(size, rng, 2.5, low=1, high=6) for _ in range(4)]
        g = lambda k: 0.5 + 0.5 * np.tanh(f[k])
        kd = mix(paint(hue(rng, (0.02, 0.8)), np.ones_like(f[0])), hue(rng, (0.02, 0.8)), g(0))
        m = metal_f0(rng) if rng.random() < 0.5 else dielectric(rng) * 3
        ks = mix(paint(dielectric(rng), np.ones_like(f[0])), m, g(1))
        kd = kd * (1 - 0.9 * np.clip(ks.mean(0), 0, 1))
        rough = 0.06 + 0.9 * g(2)
        s = slopes(noise(size, rng, rng.uniform(0.5, 2), low=8), rng.uniform(0, 0.5)) * g(3)
    return s, kd, ks, rough


def plain(size, rng):
    """Nearly uniform materials of any gloss."""
    fine = noise(size, rng, rng.uniform(0.3, 2), low=4)
    is_metal = rng.random() < 0.3
    ks = metal_f0(rng) if is_metal else dielectric(rng) * np.exp(rng.uniform(0, 1.0))
    kd = hue(rng, (0.01, 0.85)) * (rng.uniform(0, 0.05) if is_metal else 1)
    one = np.ones((size, size), np.float32)
    return (
        slopes(fine, rng.uniform(0, 0.12)),
        paint(kd, one + 0.03 * noise(size, rng, 1)),
        paint(ks, one),
        rng.uniform(0.05, 1.0) + rng.uniform(0, 0.04) * fine,
    )


FAMILIES = {
    "leather": (leather, 5),
    "woven": (woven, 5),
    "knit": (knit, 3),
    "plastic": (plastic, 5),
    "painted-metal": (painted_metal, 4),
    "brushed-metal": (brushed_metal, 3),
    "metal": (metal, 6),
    "ceramic": (ceramic, 4),
    "wood": (wood, 4),
    "paper": (paper, 3),
    "stone": (stone, 4),
    "patchwork": (patchwork, 3),
    "plain": (plain, 3),
    **relief.FAMILIES,
    **prints.FAMILIES,
}


def generate(name, size, seed):
    """One material of a family -> encoded maps [9, size, size], float32 array."""
    rng = np.random.default_rng([seed, sum(map(ord, name))])
    s, kd, ks, rough = FAMILIES[name][0](size, rng)
    kd, ks = np.broadcast_to(kd, (3, size, size)), np.broadcast_to(ks, (3, size, size))
    ks = np.clip(ks, 0.01, 0.98)
    kd = np.clip(np.minimum(kd, 1 - ks), 0, 0.95)
    rough = np.clip(np.broadcast_to(rough, (size, size)), 0.05, 1)[None]
    to = lambda a: torch.from_numpy(np.ascontiguousarray(a, dtype=np.float32))
    e = encode_maps(to(np.clip(s, -2, 2)), to(kd), to(ks), to(rough))
    assert torch.isfinite(e).all(), (name, seed)
    return e.numpy()


def contact_sheet(path, columns=2, tile=64, seed=7):
    """A sheet of lit samples, ``columns`` of every family."""
    from PIL import Image

    from renderer import render

    rows = []
    for name in FAMILIES:
        for c in range(columns):
            e = torch.from_numpy(generate(name, 256, seed + c))[None]
            image = render(e, torch.tensor([[[0.1, 0.1, 2.2]]]), torch.tensor([[[-0.35, 0.3, 2.2]]]))[0, 0]
            image = torch.nn.functional.interpolate(image.clamp(0, 1)[None] ** (1 / 2.2), (tile, tile), mode="area")[0]
            rows.append(image)
    # one column per family
    sheet = torch.cat([torch.cat(rows[c :: columns], 2) for c in range(columns)], 1)
    image = Image.fromarray((sheet.permute(1, 2, 0).numpy() * 255).astype(np.uint8))
    image.quantize(192).save(path, optimize=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="pack folder to write")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--families", nargs="*", choices=list(FAMILIES), help="these only")
    parser.add_argument("--sheet", help="write a contact sheet (PNG) instead")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.sheet:
        contact_sheet(args.sheet, 4)
        return
    order = [n for n, (_, w) in FAMILIES.items() if not args.families or n in args.families for _ in range(w)]
    np.random.default_rng(0).shuffle(order)
    names = [order[i % len(order)] for i in range(args.count)]
    seeds = [args.seed * 100003 + i for i in range(args.count)]
    writer = PackWriter(args.out, args.count)
    with ProcessPoolExecutor(args.jobs) as pool:
        made = pool.map(generate, names, [args.size] * args.count, seeds, chunksize=4)
        for i, (name, maps) in enumerate(zip(names, made)):
            writer.add(f"{name}-{args.seed}-{i}", "P", OWN_LICENCE, torch.from_numpy(maps))
    writer.close()


if __name__ == "__main__":
    main()
