"""Building blocks of procedural materials: tileable noise and cells, height to
slopes, random colours and metals. Fields are float32 arrays [S, S], colours [3] or
[3, S, S], linear RGB."""

import colorsys

import numpy as np


def grid(size):
    """Texel coordinates in [0, 1): (x to the right, y upwards), [size, size]."""
    t = (np.arange(size, dtype=np.float32) + 0.5) / size
    return np.meshgrid(t, t[::-1])


def noise(size, rng, beta=1.5, stretch=(1.0, 1.0), low=1.0, high=1e9):
    """Tileable noise of spectrum 1/f^beta between ``low`` and ``high`` cycles
    per tile, stretched along x or y; mean 0, standard deviation 1."""
    fy = np.fft.fftfreq(size)[:, None] * size * stretch[1]
    fx = np.fft.rfftfreq(size)[None, :] * size * stretch[0]
    f = np.hypot(fx, fy)
    with np.errstate(divide="ignore"):
        gain = np.where((f >= low * 0.5) & (f > 0), (np.maximum(f, low)) ** -beta, 0) * np.exp(-((f / high) ** 2))
    spectrum = np.fft.rfft2(rng.standard_normal((size, size)).astype(np.float32)) * gain
    out = np.fft.irfft2(spectrum, (size, size)).astype(np.float32)
    return out / max(1e-9, float(out.std()))


def worley(size, rng, cells, jitter=0.9, warp=0.0, aspect=1.0):
    """Tileable cellular pattern on a jittered grid: (distance to the nearest
    point, to the second nearest, in cell sizes; id of the nearest)."""
    x, y = grid(size)
    if warp:
        x = x + warp / cells * noise(size, rng, 2.0, low=2)
        y = y + warp / cells * noise(size, rng, 2.0, low=2)
    nx, ny = cells, max(1, int(round(cells * aspect)))
    px = 0.5 + jitter * (rng.random((ny, nx), dtype=np.float32) - 0.5)
    py = 0.5 + jitter * (rng.random((ny, nx), dtype=np.float32) - 0.5)
    gx, gy = x * nx, y * ny
    cx, cy = np.floor(gx).astype(int), np.floor(gy).astype(int)
    first = np.full(x.shape, 9.0, np.float32)
    second = first.copy()
    ident = np.zeros(x.shape, np.int64)
    for oy in (-1, 0, 1):
        for ox in (-1, 0, 1):
            jx, jy = (cx + ox) % nx, (cy + oy) % ny
            d = np.hypot(cx + ox + px[jy, jx] - gx, cy + oy + py[jy, jx] - gy)
            closer = d < first
            second = np.where(closer, first, np.minimum(second, d))
            ident = np.where(closer, jy * nx + jx, ident)
            first = np.where(closer, d, first)
    return first, second, ident


def smoothstep(low, high, x):
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def hue(rng, value=(0.05, 0.8), saturation=(0.0, 0.9), h=None):
    """Random linear RGB colour [3]."""
    c = colorsys.hsv_to_rgb(rng.random() if h is None else h % 1.0, rng.uniform(*saturation), 1.0)
    v = np.exp(rng.uniform(np.log(value[0]), np.log(value[1])))
    return np.array(c, np.float32) ** 1.5 * v


def paint(colour, field):
    """colour [3] times field [S, S] -> [3, S, S]."""
    return colour[:, None, None] * field[None]


def mix(a, b, mask):
    """Maps or colours a, b blended by mask [S, S]."""
    if np.ndim(a) == 1:
        a = a[:, None, None]
    if np.ndim(b) == 1:
        b = b[:, None, None]
    return a * (1 - mask) + b * mask


def slopes(height, rms=None):
    """Tileable height field -> slopes of the normal [2, S, S] (x right, y up):
    n.x/n.z = -dh/dx. ``rms``: scale to this root mean square."""
    dx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * 0.5
    dy = (np.roll(height, 1, 0) - np.roll(height, -1, 0)) * 0.5
    s = -np.stack([dx, dy])
    if rms is not None:
        s *= rms / max(1e-6, float(np.sqrt((s**2).sum(0).mean())))
    return s


def dielectric(rng):
    return np.full(3, np.clip(0.04 * np.exp(rng.normal(0, 0.2)), 0.02, 0.09), np.float32)


METALS = {
    "silver": (0.95, 0.93, 0.88),
    "aluminium": (0.91, 0.92, 0.92),
    "gold": (1.0, 0.71, 0.29),
    "copper": (0.95, 0.64, 0.54),
    "brass": (0.91, 0.78, 0.42),
    "bronze": (0.72, 0.54, 0.34),
    "iron": (0.56, 0.57, 0.58),
    "steel": (0.62, 0.60, 0.57),
    "titanium": (0.54, 0.50, 0.45),
    "chromium": (0.55, 0.56, 0.55),
    "tungsten": (0.50, 0.48, 0.45),
    "zinc": (0.66, 0.82, 0.87),
}


def metal_f0(rng):
    """F0 of a random metal, sometimes tinted (anodised) [3]."""
    c = np.array(METALS[list(METALS)[rng.integers(len(METALS))]], np.float32)
    if rng.random() < 0.15:
        c = c * hue(rng, (0.7, 1.0), (0.2, 0.8))
    return np.clip(c * rng.uniform(0.75, 1.02), 0.15, 0.98)
