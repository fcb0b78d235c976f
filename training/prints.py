"""Procedural materials whose colours do not tell their relief: prints and laminates,
nearly flat however busy their pattern; foil and metallic ink; leather that is dyed
through, so that its grain shows by shading and gloss alone. Generators as in
procedural.py."""

import numpy as np

from relief import log_uniform
from textures import dielectric, grid, hue, metal_f0, noise, paint, slopes, smoothstep, worley


def zones(size, rng):
    """A pattern of 2 to 5 inks: number of the ink at each texel, int array [S, S]."""
    x, y = grid(size)
    count, kind = int(rng.integers(2, 6)), rng.integers(6)
    n = int(rng.integers(2, 16))
    if kind == 0:  # stripes, straight or wavy
        v = x * n * count + rng.choice([0.0, 0.6]) * noise(size, rng, 2.2, low=1, high=8)
        return np.floor(v).astype(int) % count
    if kind == 1:  # checks or diamonds
        i, j = np.floor(x * n * count), np.floor(y * n * count)
        return ((i + j if rng.random() < 0.5 else i * j) % count).astype(int)
    if kind == 2:  # dots of several sizes
        f1, _, ident = worley(size, rng, 2 * n, rng.uniform(0, 1))
        radius = rng.uniform(0.1, 0.45, int(ident.max()) + 1)[ident]
        ink = rng.integers(1, count, int(ident.max()) + 1)[ident]
        return np.where(f1 < radius, ink, 0)
    if kind == 3:  # mosaic, camouflage
        _, _, ident = worley(size, rng, n + 2, 1.0, rng.uniform(0, 1.5))
        return rng.integers(0, count, int(ident.max()) + 1)[ident]
    if kind == 4:  # contours of a smooth picture
        f = noise(size, rng, rng.uniform(1.6, 2.6), low=1, high=rng.uniform(8, 60))
        return np.floor(np.clip((f + 2) / 4, 0, 0.999) * count).astype(int)
    # lines of print: blocks in rows
    rows = 8 * n
    j = np.floor(y * rows).astype(int)
    word = noise(size, rng, 1.0, (1, 0.02), low=10) > rng.uniform(-0.5, 0.8)
    ink = rng.integers(1, count, rows)[j % rows]
    return np.where(word & (j % 2 == 0), ink, 0)


def sheet(size, rng):
    """Slopes of a sheet, board or laminate: next to flat."""
    s = slopes(noise(size, rng, rng.uniform(0.4, 1.2), low=10), log_uniform(rng, 0.003, 0.05))
    return s + slopes(noise(size, rng, 2.5, low=1, high=8), log_uniform(rng, 0.002, 0.03))


def printed(size, rng):
    """Print on paper, card, foil or plastic; laminates of wood and stone."""
    inks = zones(size, rng)
    count = int(inks.max()) + 1
    kd = np.stack([hue(rng, (0.01, 0.85)) for _ in range(count)], 1)[:, inks]
    if rng.random() < 0.4:  # photograph-like detail within inks
        kd = kd * np.clip(1 + rng.uniform(0.05, 0.35) * noise(size, rng, rng.uniform(0.8, 2), low=2), 0.2, 1.8)
    base = rng.uniform(0.08, 0.8)
    even = rng.random() < 0.6  # under one lacquer
    rough = base + (0 if even else 1) * rng.normal(0, 0.12, count).astype(np.float32)[inks]
    ks = dielectric(rng)[:, None, None] * np.ones((3, size, size), np.float32)
    return sheet(size, rng), kd, ks, rough + 0.02 * noise(size, rng, 1.5)


def foil(size, rng):
    """Metallic print and foil stamping: some inks are metal, brushed or plain, and others are not."""
    inks = zones(size, rng)
    count = int(inks.max()) + 1
    shares = np.where(rng.random(count) < 0.5, rng.uniform(0.4, 1.0, count), 0.0)
    shares[rng.integers(count)] = rng.uniform(0.5, 1.0)
    metal = shares.astype(np.float32)[inks]
    ink = np.stack([hue(rng, (0.01, 0.8)) for _ in range(count)], 1)[:, inks]
    one = metal_f0(rng)
    f0 = np.stack([one if rng.random() < 0.6 else metal_f0(rng) for _ in range(count)], 1)[:, inks]
    ks = dielectric(rng)[:, None, None] * (1 - metal) + f0 * metal * rng.uniform(0.4, 1.0)
    kd = ink * (1 - metal) + 0.04 * f0 * metal
    grain = noise(size, rng, 0.6, (1.0, rng.uniform(0.02, 0.1)), low=6)
    rough = rng.uniform(0.15, 0.7, count).astype(np.float32)[inks] + rng.uniform(0, 0.05) * grain * (metal > 0)
    s = sheet(size, rng) + slopes(grain, rng.uniform(0, 0.08)) * (metal > 0)
    if rng.random() < 0.4:  # stamped
        s = s + slopes(metal * 1.0, rng.uniform(0.01, 0.1))
    return s, kd, ks, rough


def hide(size, rng):
    """Grained leather, dyed through and finished: creases of several sizes under an even colour."""
    cells = int(rng.integers(20, 80))
    h = np.zeros((size, size), np.float32)
    for scale, weight in ((1.0, 1.0), (2.2, 0.5), (0.35, rng.uniform(0, 0.8))):
        many, warp, aspect = max(4, int(cells * scale)), rng.uniform(0.2, 1.2), rng.uniform(0.5, 2.0)
        f1, f2, _ = worley(size, rng, many, 1.0, warp, aspect)
        h = h + weight * smoothstep(0, rng.uniform(0.25, 0.8), f2 - f1)
    wrinkles = noise(size, rng, 1.8, (1, rng.uniform(0.25, 1)), low=2, high=40) * rng.uniform(1.5, 5)
    h = h - rng.uniform(0, 1.0) * (1 - np.abs(np.tanh(wrinkles)))
    if rng.random() < 0.5:  # pores
        p, _, _ = worley(size, rng, 2 * cells, 1.0)
        h = h - rng.uniform(0.1, 0.6) * smoothstep(0.25, 0.08, p)
    depth = (h.max() - h) / max(float(np.ptp(h)), 1e-3)
    base = hue(rng, (0.01, 0.5), (0.0, 0.85), h=rng.choice([0.02, 0.05, 0.08, rng.random()]))
    tone = np.clip(1 + 0.04 * noise(size, rng, 0.6) + 0.06 * noise(size, rng, 2, low=1), 0.5, 1.5)
    kd = paint(base, tone * (1 - rng.uniform(0, 0.2) * depth))
    rough = rng.uniform(0.22, 0.65) + rng.uniform(0, 0.15) * depth + 0.02 * noise(size, rng, 1.5)
    ks = dielectric(rng)[:, None, None] * (1 - rng.uniform(0, 0.3) * depth)
    return slopes(h, log_uniform(rng, 0.06, 0.4)), kd, ks, rough


# Generators and how often each is drawn
FAMILIES = {"printed": (printed, 5), "foil": (foil, 4), "hide": (hide, 6)}
