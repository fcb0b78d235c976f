"""Differentiable Cook-Torrance renderer of flat materials (PyTorch, batched).

Conventions
-----------
* The sample is the rectangle [-1, 1]² (units of half its width); X right,
  Y up, Z out of the surface. Image row 0 is the +Y edge, column 0 the -X edge;
  texels share the rectangle equally.
* Encoded maps ``[..., 9, H, W]`` in [-1, 1]:
  0-1 slope / 2 (slope = n.x / n.z, n.y / n.z), 2-4 diffuse kd = ((e + 1) / 2)²,
  5-7 specular F0 ks = ((e + 1) / 2)², 8 roughness = (e + 1) / 2. Linear RGB.
* Radiance is normalised by irradiance: ``R = pi * NoL * BRDF`` (no falloff).
"""

import math

import torch

CHANNELS = 9
MAX_SLOPE = 2.0
MIN_ROUGHNESS = 0.02
MIN_COSINE = 1e-3
LOG_OFFSET = 0.01


def decode_maps(e):
    """Encoded maps [..., 9, H, W] -> (slope [..., 2, H, W], kd [..., 3, H, W],
    ks [..., 3, H, W], roughness [..., 1, H, W])."""
    slope = MAX_SLOPE * e[..., 0:2, :, :]
    kd = ((e[..., 2:5, :, :] + 1) * 0.5) ** 2
    ks = ((e[..., 5:8, :, :] + 1) * 0.5) ** 2
    roughness = (e[..., 8:9, :, :] + 1) * 0.5
    return slope, kd, ks, roughness


def encode_maps(slope, kd, ks, roughness):
    """Inverse of :func:`decode_maps`, clamped to the representable range."""
    return torch.cat(
        [
            (slope / MAX_SLOPE).clamp(-1, 1),
            kd.clamp(0, 1).sqrt() * 2 - 1,
            ks.clamp(0, 1).sqrt() * 2 - 1,
            roughness.clamp(0, 1) * 2 - 1,
        ],
        dim=-3,
    )


def texel_grid(height, width, device=None):
    """Texel centres (x [1, W], y [H, 1]) on the sample [-1, 1]²."""
    x = (torch.arange(width, device=device, dtype=torch.float32) + 0.5) * (2.0 / width) - 1
    y = 1 - (torch.arange(height, device=device, dtype=torch.float32) + 0.5) * (2.0 / height)
    return x[None, :], y[:, None]


def directions(points, height, width):
    """Unit vectors from every texel to ``points`` [..., 3] as a tuple of
    three tensors [..., H, W]."""
    x, y = texel_grid(height, width, points.device)
    dx = points[..., 0, None, None] - x
    dy = points[..., 1, None, None] - y
    dz = points[..., 2, None, None]
    inv = torch.rsqrt(dx * dx + dy * dy + dz * dz)
    return dx * inv, dy * inv, dz * inv


def in_window(points, centre, scale):
    """Positions [B, 3] in half widths of a sample -> in half widths of a square
    part of it with ``centre`` [B, 2] and half width ``scale``."""
    return torch.cat([points[:, :2] - centre, points[:, 2:]], 1) / scale


def lobe_scale(a2, exponent):
    """pi c of the distribution of normals c / ((a² - 1) cos² + 1)^exponent, whose
    projected integral over the hemisphere is 1 (GTR; exponent 2 is GGX, where it is a²)."""
    a2, m = a2.clamp_max(0.999), exponent - 1
    return m * (1 - a2) / (a2 ** (-m) - 1)


def render(e, camera, light, exponent=None):
    """Render encoded maps under several configurations.

    e: [B, 9, H, W]; camera, light: [B, L, 3] positions in half widths;
    exponent [B, 1, 1, 1]: of the lobe's denominator (None: GGX, which has 2).
    Returns linear radiance [B, L, 3, H, W], unclamped.
    """
    height, width = e.shape[-2:]
    slope, kd, ks, roughness = decode_maps(e)
    inv = torch.rsqrt(slope[:, 0:1] ** 2 + slope[:, 1:2] ** 2 + 1)  # [B, 1, H, W]
    nx, ny, nz = slope[:, 0:1] * inv, slope[:, 1:2] * inv, inv
    vx, vy, vz = directions(camera, height, width)  # [B, L, H, W]
    lx, ly, lz = directions(light, height, width)
    hx, hy, hz = vx + lx, vy + ly, vz + lz
    hinv = torch.rsqrt(hx * hx + hy * hy + hz * hz)
    voh = ((vx * hx + vy * hy + vz * hz) * hinv).clamp_min(MIN_COSINE)
    noh = ((nx * hx + ny * hy + nz * hz) * hinv).clamp_min(MIN_COSINE)
    nov = (nx * vx + ny * vy + nz * vz).clamp_min(MIN_COSINE)
    nol = (nx * lx + ny * ly + nz * lz).clamp_min(MIN_COSINE)

    r = roughness.clamp_min(MIN_ROUGHNESS)  # [B, 1, H, W]
    r2 = r * r
    a2 = r2 * r2
    q = noh * noh * (a2 - 1) + 1
    k = r2 * 0.5
    # D G / (4 NoL NoV), without the colour
    distribution = a2 / (q * q) if exponent is None else lobe_scale(a2, exponent) * q ** (-exponent)
    lobe = distribution / (4 * math.pi * (nol * (1 - k) + k) * (nov * (1 - k) + k))
    fresnel = torch.exp2((-5.55473 * voh - 6.98316) * voh)
    kd, ks = kd[:, None], ks[:, None]  # [B, 1, 3, H, W]
    f = ks + (1 - ks) * fresnel[:, :, None]
    return math.pi * nol[:, :, None] * (kd / math.pi + lobe[:, :, None] * f)


def log_encode(x):
    """Linear radiance -> photo channel in [-1, 1] (saturating at 1)."""
    lo, hi = math.log(LOG_OFFSET), math.log(1 + LOG_OFFSET)
    return 2 * (torch.log(x.clamp(0, 1) + LOG_OFFSET) - lo) / (hi - lo) - 1


def log_l1(a, b):
    """Mean absolute difference of log(x + 0.01)."""
    return (torch.log(a + LOG_OFFSET) - torch.log(b + LOG_OFFSET)).abs().mean()


def render_loss(pred, target, camera, light):
    """Log-L1 between renderings of two stacks of encoded maps [B, 9, H, W]."""
    with torch.no_grad():
        reference = render(target, camera, light)
    return log_l1(render(pred, camera, light), reference)


def _log_distance(shape, device):
    """Distances with normally distributed logarithm (mean 0.5, std 0.75)."""
    return torch.exp(0.5 + 0.75 * torch.randn(shape, device=device)).clamp(0.6, 12.0)


def _cosine_direction(shape, device):
    u, phi = torch.rand(shape, device=device) * 0.98, 2 * math.pi * torch.rand(shape, device=device)
    s = u.sqrt()
    return torch.stack([s * phi.cos(), s * phi.sin(), (1 - u).sqrt()], -1)


def random_configurations(batch, independent=1, mirror=2, colocated=1, device=None):
    """Random (camera, light) positions [B, L, 3] for rendering losses.

    ``independent``: view and light cosine-weighted; ``mirror``: the light in
    the mirror direction of the view about a random point of the sample;
    ``colocated``: a hand-held camera with its flash close to the lens.
    """
    cams, lights = [], []
    n = independent
    if n:
        point = torch.cat([torch.rand(batch, n, 2, device=device) * 2 - 1, torch.zeros(batch, n, 1, device=device)], -1)
        cams.append(point + _cosine_direction((batch, n), device) * _log_distance((batch, n, 1), device))
        lights.append(point + _cosine_direction((batch, n), device) * _log_distance((batch, n, 1), device))
    n = mirror
    if n:
        point = torch.cat([torch.rand(batch, n, 2, device=device) * 2 - 1, torch.zeros(batch, n, 1, device=device)], -1)
        view = _cosine_direction((batch, n), device)
        cams.append(point + view * _log_distance((batch, n, 1), device))
        lights.append(point + view * view.new_tensor([-1.0, -1.0, 1.0]) * _log_distance((batch, n, 1), device))
    n = colocated
    if n:
        camera, light = photo_configurations(batch * n, device, top_fraction=0.4)
        cams.append(camera.view(batch, n, 3))
        lights.append(light.view(batch, n, 3))
    camera, light = torch.cat(cams, 1), torch.cat(lights, 1)
    low = camera.new_tensor([-1e9, -1e9, 0.05])
    return torch.maximum(camera, low), torch.maximum(light, low)


def photo_configurations(batch, device=None, top_fraction=0.7):
    """Camera and flash positions [B, 3] of hand-held photos: mostly near the
    top view, else up to 55 degrees off; 1.6 (the sample fills the picture) to
    8 half widths away (a board round it does); the flash 0-12 degrees from the
    camera, more often close to it."""
    top = torch.rand(batch, device=device) < top_fraction
    off = torch.where(top, 12 * torch.rand(batch, device=device) ** 0.7, 12 + 43 * torch.rand(batch, device=device))
    theta = off * (math.pi / 180)
    phi = 2 * math.pi * torch.rand(batch, device=device)
    distance = 1.6 * (8.0 / 1.6) ** torch.rand(batch, device=device)
    camera = torch.stack(
        [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], -1
    ) * distance[:, None]
    aim = (torch.rand(batch, 2, device=device) * 2 - 1) * 0.25
    camera = torch.cat([camera[:, :2] + aim, camera[:, 2:]], 1)
    offset = (12 * math.pi / 180) * torch.rand(batch, device=device) ** 1.5 * distance
    phi = 2 * math.pi * torch.rand(batch, device=device)
    light = camera + torch.stack(
        [offset * phi.cos(), offset * phi.sin(), 0.3 * offset * torch.randn(batch, device=device)], -1
    )
    return camera, light
