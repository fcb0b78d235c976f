"""Procedural materials whose relief is what is seen of them: masonry, cobbles,
timber, felt, foam, plaster, coarse cloth, cast and hammered metal with patina,
wrinkled leather. Generators as in procedural.py; slopes are 0.15 to 0.9 in the
root mean square, of all sizes from a few texels to a quarter of the tile."""

import numpy as np

from textures import dielectric, grid, hue, metal_f0, mix, noise, paint, slopes, smoothstep, worley


def log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def brick_cells(size, rng):
    """Bricks in running, stacked or irregular bond: (distance to the joint in
    heights of a brick, id of the brick)."""
    x, y = grid(size)
    rows = int(rng.integers(3, 14))
    columns = max(1, int(round(rows * rng.uniform(0.3, 0.8))))
    wob = rng.uniform(0, 0.25)
    v = y * rows + wob * 0.5 * noise(size, rng, 2.2, low=2, high=20)
    j = np.floor(v).astype(int) % rows
    shift = rng.random(rows) if rng.random() < 0.3 else 0.5 * (np.arange(rows) % 2) * (rng.random() < 0.85)
    u = x * columns + shift[j] + wob * 0.3 * noise(size, rng, 2.2, low=2, high=20)
    i = np.floor(u).astype(int) % columns
    fu = 0.5 - np.abs(u - np.floor(u) - 0.5)
    fv = 0.5 - np.abs(v - np.floor(v) - 0.5)
    # rounded corners: soft minimum of the two distances
    a, b = fu * rows / columns, fv
    k = 0.12
    d = -k * np.log(np.exp(-a / k) + np.exp(-b / k))
    return d, i + columns * j


def masonry(size, rng):
    """Bricks or natural stones with mortar."""
    if rng.random() < 0.55:
        d, ident = brick_cells(size, rng)
    else:
        f1, f2, ident = worley(size, rng, int(rng.integers(3, 12)), rng.uniform(0.6, 1), rng.uniform(0, 0.3), rng.uniform(0.6, 1.8))
        d = (f2 - f1) * 0.5
    joint = rng.uniform(0.02, 0.1)
    edge = rng.uniform(0.04, 0.22)
    rough_edge = 0.04 * noise(size, rng, 1.2, low=6)
    face = smoothstep(joint, joint + edge, d + rough_edge)
    solid = smoothstep(joint, joint + 0.03, d + rough_edge)
    count = int(ident.max()) + 1
    grain = noise(size, rng, rng.uniform(0.5, 1.3), low=8)
    chipped = noise(size, rng, 1.8, low=3, high=40)
    lift = rng.normal(0, 0.25, count).astype(np.float32)[ident]
    tilt = rng.normal(0, rng.uniform(0, 0.08), (2, count)).astype(np.float32)[:, ident] * solid
    h = face * (1 + lift) + rng.uniform(0, 0.25) * chipped * face
    s = slopes(h, log_uniform(rng, 0.15, 0.7)) + slopes(grain, rng.uniform(0.04, 0.3)) + tilt
    a = hue(rng, (0.04, 0.6), (0.1, 0.8), h=rng.choice([0.02, 0.04, 0.09, rng.random()]))
    b = a * rng.uniform(0.4, 1.8) if rng.random() < 0.7 else hue(rng, (0.04, 0.6), (0, 0.6))
    pick = rng.random(count).astype(np.float32)[ident]
    tone = np.clip(1 + 0.15 * grain + 0.15 * chipped, 0.3, 1.8)
    kd = mix(hue(rng, (0.06, 0.6), (0, 0.25)), mix(paint(a, tone), paint(b, tone), pick), solid)
    r = rng.uniform(0.55, 0.95) if rng.random() < 0.75 else rng.uniform(0.15, 0.5)
    rough = mix(rng.uniform(0.75, 1), r + 0.05 * grain + 0.1 * (pick - 0.5), solid)
    return s, np.clip(kd, 0, 0.9), paint(dielectric(rng), 0.6 + 0.4 * solid), rough


def pebbles(size, rng):
    """Gravel, pebbles, bark-like lumps: rounded bodies of two sizes."""
    wet = rng.random() < 0.3
    cells = int(rng.integers(5, 26))
    f1, f2, ident = worley(size, rng, cells, 1.0, rng.uniform(0, 0.35), rng.uniform(0.6, 1.7))
    body = np.sqrt(np.clip(1 - (f1 / rng.uniform(0.6, 0.95)) ** 2, 0, 1)) * smoothstep(0, 0.3, f2 - f1)
    g1, g2, _ = worley(size, rng, cells * 3, 1.0, 0.3)
    small = np.sqrt(np.clip(1 - (g1 / 0.8) ** 2, 0, 1)) * smoothstep(0, 0.3, g2 - g1)
    count = int(ident.max()) + 1
    high = 0.5 + rng.random(count).astype(np.float32)[ident]
    h = np.maximum(body * high, 0.35 * small)
    grain = noise(size, rng, 1.0, low=10)
    s = slopes(h, log_uniform(rng, 0.2, 0.9)) + slopes(grain, rng.uniform(0, 0.2))
    a, b = hue(rng, (0.04, 0.6), (0, 0.5)), hue(rng, (0.04, 0.6), (0, 0.5))
    shade = np.clip(0.35 + 0.65 * h / h.max() + 0.12 * grain, 0.1, 1.5)
    kd = mix(paint(a, shade), paint(b, shade), rng.random(count).astype(np.float32)[ident])
    r = rng.uniform(0.08, 0.4) if wet else rng.uniform(0.55, 0.97)
    return s, kd * (0.5 if wet else 1), paint(dielectric(rng), 0.5 + 0.5 * smoothstep(0, 0.3, h)), r + 0.08 * grain


def timber(size, rng):
    """Weathered, sawn or brushed wood: grain in relief, cracks, knots."""
    x, y = grid(size)
    knots = noise(size, rng, 2.5, (0.3, 1), low=1, high=5)
    warp = x * rng.integers(4, 30) + rng.uniform(0.2, 1.4) * knots + 0.2 * noise(size, rng, 2, (0.2, 1), low=2)
    ring = 0.5 + 0.5 * np.sin(2 * np.pi * warp)
    ring = ring ** rng.uniform(0.5, 3)
    fibre = noise(size, rng, 0.7, (0.03, 1), low=10)
    crack = smoothstep(rng.uniform(1.3, 2.4), 3.0, noise(size, rng, 0.8, (0.03, 1), low=5))
    h = 0.6 * ring + rng.uniform(0.05, 0.3) * fibre - 1.5 * crack
    base = hue(rng, (0.05, 0.5), (0.05, 0.8), h=rng.uniform(0.03, 0.12))
    tone = np.clip(1 + 0.35 * (ring - 0.5) + 0.15 * fibre, 0.2, 2) * (1 - 0.8 * crack)
    painted = rng.random() < 0.25
    kd = paint(base, tone)
    rough = rng.uniform(0.5, 0.95) + 0.05 * fibre
    if painted:
        worn = smoothstep(-0.3, 0.5, noise(size, rng, 1.6, (0.3, 1), low=2) + ring - rng.uniform(0, 1))
        kd = mix(kd, hue(rng, (0.05, 0.8)), worn)
        rough = mix(rough, rng.uniform(0.2, 0.6), worn)
    if rng.random() < 0.5:
        s = slopes(h, log_uniform(rng, 0.1, 0.5))
    else:  # planks
        n = int(rng.integers(2, 8))
        gap = smoothstep(0.0, rng.uniform(0.02, 0.08), 0.5 - np.abs(x * n - np.floor(x * n) - 0.5))
        s = slopes(h, log_uniform(rng, 0.1, 0.4)) + slopes(gap, rng.uniform(0.05, 0.3))
        kd = kd * (0.2 + 0.8 * gap)
    return s, kd, dielectric(rng)[:, None, None] * (1 - 0.6 * crack), rough


def felt(size, rng):
    """Matted fibres without a weave, fleece, carpet: soft random relief, no gloss."""
    # fibres: stretched noise in several directions, none of them a lattice
    h = noise(size, rng, 1.0, low=8, high=rng.uniform(40, 150))
    for stretch in ((1.0, 0.15), (0.15, 1.0)):
        h = h + 0.7 * noise(size, rng, 0.8, stretch, low=20)
    clump = noise(size, rng, 1.6, low=3, high=30)
    h = h + rng.uniform(0, 2.5) * clump
    mottle = np.clip(1 + rng.uniform(0.02, 0.15) * h / h.std() + rng.uniform(0, 0.1) * clump, 0.2, 2)
    kd = paint(hue(rng, (0.03, 0.7)), mottle)
    if rng.random() < 0.4:  # melange of a second colour
        kd = mix(kd, hue(rng, (0.03, 0.7)), smoothstep(0.3, 1.5, noise(size, rng, 0.6, low=15)) * rng.uniform(0.2, 0.9))
    rough = rng.uniform(0.75, 1.0) + 0.03 * clump
    return slopes(h, log_uniform(rng, 0.1, 0.6)), kd, paint(dielectric(rng) * rng.uniform(0.4, 1.0), np.ones_like(h)), rough


def foam(size, rng):
    """Open or closed cells: foam, styrofoam, sponge, cork, pumice."""
    cells = int(rng.integers(10, 70))
    f1, f2, ident = worley(size, rng, cells, 1.0, 0.4)
    beads = rng.random() < 0.5
    h = smoothstep(0, rng.uniform(0.2, 0.6), f2 - f1)
    if not beads:
        depth = (rng.random(int(ident.max()) + 1) ** 2).astype(np.float32)[ident]
        h = -depth * smoothstep(rng.uniform(0.3, 0.7), 0.1, f1)
    grain = noise(size, rng, 0.8, low=20)
    s = slopes(h, log_uniform(rng, 0.1, 0.6)) + slopes(grain, rng.uniform(0, 0.15))
    shade = np.clip(1 + rng.uniform(0.1, 0.5) * (h - h.max()) + 0.05 * grain, 0.1, 1.3)
    kd = paint(hue(rng, (0.1, 0.9), (0, 0.6)), shade)
    return s, kd, paint(dielectric(rng), np.ones_like(h)), rng.uniform(0.5, 0.98) + 0.03 * grain


def plaster(size, rng):
    """Plaster, stucco, concrete, asphalt, trowel strokes, corrugated board."""
    kind = rng.integers(4)
    x, y = grid(size)
    grain = noise(size, rng, rng.uniform(0.3, 1.2), low=15)
    if kind == 0:
        h = noise(size, rng, rng.uniform(1.0, 2.0), low=3, high=80)
        h = np.abs(h) if rng.random() < 0.5 else h
    elif kind == 1:  # trowel strokes at two sizes
        a = noise(size, rng, 1.4, (1, rng.uniform(0.1, 0.4)), low=3)
        b = noise(size, rng, 1.4, (rng.uniform(0.1, 0.4), 1), low=3)
        h = mix(a, b, smoothstep(-0.2, 0.2, noise(size, rng, 2.4, low=1, high=8)))
    elif kind == 2:  # aggregate in a matrix
        f1, _, ident = worley(size, rng, int(rng.integers(20, 80)), 1.0, 0.4)
        h = smoothstep(0.6, 0.2, f1) * rng.random(int(ident.max()) + 1).astype(np.float32)[ident]
    else:  # corrugation
        n = int(rng.integers(4, 40))
        wave = np.sin(2 * np.pi * n * (x if rng.random() < 0.5 else y) + 0.3 * noise(size, rng, 2.2, low=1, high=10))
        h = np.sign(wave) * np.abs(wave) ** rng.uniform(0.3, 1.2)
    stain = noise(size, rng, 2.2, low=1)
    a = hue(rng, (0.05, 0.85), (0, 0.5))
    kd = paint(a, np.clip(1 + 0.1 * stain + rng.uniform(0, 0.1) * grain + rng.uniform(0, 0.1) * h, 0.2, 1.6))
    s = slopes(h, log_uniform(rng, 0.1, 0.7)) + slopes(grain, rng.uniform(0.02, 0.25))
    rough = rng.uniform(0.4, 0.98) + 0.04 * stain + 0.03 * grain
    return s, kd, dielectric(rng)[:, None, None] * np.ones((3, size, size), np.float32), rough


def cloth(size, rng):
    """Coarse canvas, burlap, basket weave, twill and corduroy with wrinkles; threads
    of several texels so that each shows its own shading."""
    x, y = grid(size)
    n = int(rng.integers(8, 36)) * 2
    m = int(n * rng.uniform(0.7, 1.3)) // 2 * 2
    wob = rng.uniform(0.1, 0.4)
    u = x * n + wob * noise(size, rng, 2.0, (1, 0.3), low=2)
    v = y * m + wob * noise(size, rng, 2.0, (0.3, 1), low=2)
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    fu, fv = u - i - 0.5, v - j - 0.5
    kind = rng.integers(4)
    over = ((i // 2 + j // 2) % 2 == 0, (i + j) % 3 != 0, (i - j) % 4 < 2, (i + j) % 2 == 0)[kind]
    thick = 0.7 + 0.6 * rng.random(n + m).astype(np.float32)
    warp = np.sqrt(np.clip(1 - (2 * fu) ** 2, 0, 1)) * thick[i % n]
    weft = np.sqrt(np.clip(1 - (2 * fv) ** 2, 0, 1)) * thick[n + j % m]
    bulge = 0.5 + 0.5 * np.cos(np.pi * np.where(over, fv, fu))
    h = np.where(over, warp, weft) * bulge
    if rng.random() < 0.25:  # corduroy
        h = np.abs(np.sin(np.pi * x * (n // 2))) ** 0.7 + 0.15 * h
    ply = np.sin(2 * np.pi * (fu + fv) * rng.uniform(1, 3)) * (size / n > 10)
    fibre = noise(size, rng, 0.6, low=30)
    wrinkle = noise(size, rng, 2.3, (1, rng.uniform(0.2, 1)), low=1, high=12)
    a = hue(rng, (0.03, 0.75))
    b = a * rng.uniform(0.5, 1.5) if rng.random() < 0.6 else hue(rng, (0.03, 0.75))
    kd = mix(paint(a, np.ones_like(h)), paint(b, np.ones_like(h)), (~over).astype(np.float32))
    kd = kd * np.clip((0.3 + 0.7 * h) * (1 + 0.12 * fibre), 0.08, 1.6)
    s = slopes(h + 0.06 * ply + 0.05 * fibre, log_uniform(rng, 0.15, 0.8)) + slopes(wrinkle, rng.uniform(0, 0.15))
    rough = (rng.uniform(0.3, 0.5) if rng.random() < 0.15 else rng.uniform(0.6, 1.0)) + 0.1 * (1 - h) + 0.03 * fibre
    return s, np.clip(kd, 0, 0.9), paint(dielectric(rng) * rng.uniform(0.6, 1.6), 0.4 + 0.6 * np.clip(h, 0, 1)), rough


def ornament(size, rng):
    """Height of a cast, stamped or hammered surface."""
    x, y = grid(size)
    kind = rng.integers(4)
    if kind == 0:  # scrolls: level lines of smooth noise
        f = noise(size, rng, 2.6, low=1, high=rng.uniform(5, 14))
        return smoothstep(-0.3, 0.6, np.sin(f * rng.uniform(3, 9)))
    if kind == 1:  # hammer marks
        f1, f2, _ = worley(size, rng, int(rng.integers(6, 30)), 1.0, 0.3)
        return np.minimum(f1, 0.6) ** 2 * 2
    if kind == 2:  # tread plate: lens-shaped bars in two directions
        n = int(rng.integers(4, 16)) * 2
        u, v = x * n, y * n
        i, j = np.floor(u).astype(int), np.floor(v).astype(int)
        fu, fv = u - i - 0.5, v - j - 0.5
        sign = np.where((i + j) % 2 == 0, 1.0, -1.0)
        along, across = (fu + sign * fv) / 1.414, (fu - sign * fv) / 1.414
        return smoothstep(1.0, 0.6, (along / 0.6) ** 2 + (across / 0.16) ** 2)
    return np.abs(noise(size, rng, rng.uniform(1.6, 2.2), low=2, high=50))  # sand-cast, corroded


def cast(size, rng):
    """Bronze, brass, iron in relief: bright on the heights, patina, rust or dirt
    in the depths, and everything between dielectric and metal, with coloured F0."""
    h = ornament(size, rng)
    fine = noise(size, rng, 1.0, low=10)
    f0 = metal_f0(rng)
    if rng.random() < 0.5:  # bronzes: copper with some grey
        f0 = np.clip(np.array([0.85, 0.6, 0.38], np.float32) * rng.uniform(0.4, 1.1) + rng.uniform(-0.05, 0.1), 0.1, 0.95)
    level = rng.uniform(-0.6, 1.2)
    cover = smoothstep(level, level + rng.uniform(0.2, 1.2), 0.8 - h / max(h.max(), 1e-3) + 0.35 * noise(size, rng, 1.6, low=2))
    cover = cover * rng.uniform(0.3, 1.0)
    film = hue(rng, (0.02, 0.35), (0.2, 0.9), h=rng.choice([0.03, 0.06, 0.42, 0.48, rng.random()]))
    share = rng.uniform(0.0, 0.5) if rng.random() < 0.4 else 0.0  # finer than a texel: no pure metal anywhere
    metal = (1 - share) * (1 - cover)
    ks = paint(f0, metal) + paint(dielectric(rng), 1 - metal)
    kd = paint(film, np.clip(1 + 0.25 * fine, 0.3, 1.7) * (1 - metal)) + paint(f0, 0.03 * metal)
    r = rng.uniform(0.12, 0.5)
    rough = mix(r + 0.04 * fine, rng.uniform(0.5, 0.95), cover)
    s = slopes(h, log_uniform(rng, 0.12, 0.7)) + slopes(fine, rng.uniform(0, 0.2)) * (0.3 + 0.7 * cover)
    return s, kd, ks, rough


def wrinkled(size, rng):
    """Leather with folds and strong pebble grain, embossed vinyl, reptile scales."""
    cells = int(rng.integers(8, 50))
    f1, f2, ident = worley(size, rng, cells, rng.uniform(0.4, 1.0), rng.uniform(0.1, 0.8), rng.uniform(0.5, 1.8))
    pebble = smoothstep(0.0, rng.uniform(0.2, 0.8), f2 - f1) ** rng.uniform(0.6, 1.5)
    folds = 1 - np.abs(np.tanh(noise(size, rng, 1.8, (1, rng.uniform(0.3, 1)), low=2, high=30) * rng.uniform(1, 4)))
    fine = noise(size, rng, 0.8, low=30)
    h = pebble - rng.uniform(0, 1.5) * folds + 0.05 * fine
    base = hue(rng, (0.01, 0.6), (0.0, 0.85), h=rng.choice([0.03, 0.06, 0.08, rng.random()]))
    worn = smoothstep(0.5, 1.0, pebble) * rng.uniform(0, 0.5)
    kd = mix(paint(base, np.clip(0.55 + 0.45 * pebble + 0.08 * noise(size, rng, 2, low=1), 0.2, 1.4)), base * 1.5, worn)
    rough = rng.uniform(0.2, 0.7) + rng.uniform(0.05, 0.3) * (1 - pebble) + 0.03 * fine
    return slopes(h, log_uniform(rng, 0.12, 0.6)), np.clip(kd, 0, 0.9), paint(dielectric(rng) * rng.uniform(0.8, 1.5), 0.6 + 0.4 * pebble), rough


# Generators and how often each is drawn
FAMILIES = {
    "masonry": (masonry, 6),
    "pebbles": (pebbles, 3),
    "timber": (timber, 4),
    "felt": (felt, 3),
    "foam": (foam, 2),
    "plaster": (plaster, 4),
    "cloth": (cloth, 5),
    "cast": (cast, 6),
    "wrinkled": (wrinkled, 5),
}
