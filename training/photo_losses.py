"""Losses of the photo network, of encoded maps [B, 9, H, W] against the truth.

Where the photograph does not decide, a regression network answers with the mean;
with absolute differences, with the median, which for relief is nearly flat. So
slopes and shading are compared by squares, and how much relief there is near a
texel is compared as such, wherever the network puts it.
"""

import math

import torch
from torch.nn import functional as F

from renderer import MAX_SLOPE, log_l1, render

# slopes are stored at half scale and vary less than the colours
CHANNEL_WEIGHT = (4.0, 4.0) + (1.0,) * 7
# Difference of encoded slopes up to which it is squared
SQUARED_UP_TO = 0.3
# Side of the neighbourhood in which relief is measured, texels, and slopes too small to matter
NEIGHBOURHOOD, LEAST_SLOPE = 15, 0.03


def maps_loss(y, x):
    """Weighted L1 of albedos and roughness; slopes by their square, beyond
    ``SQUARED_UP_TO`` linear."""
    weight = y.new_tensor(CHANNEL_WEIGHT).view(1, -1, 1, 1)
    d = (y - x).abs()
    slopes = d[:, :2]
    edge = SQUARED_UP_TO
    squared = torch.where(slopes < edge, 15 * slopes * slopes, 15 * edge * (2 * slopes - edge))
    return (torch.cat([squared, d[:, 2:]], 1) * weight).mean()


def unit_normals(e):
    """Unit normals [B, 3, H, W] of encoded maps."""
    slope = MAX_SLOPE * e[:, :2]
    z = torch.rsqrt((slope * slope).sum(1, keepdim=True) + 1)
    return torch.cat([slope * z, z], 1)


def distant_lights(batch, count, device):
    """Unit directions [B, L, 3] of lights 25 to 65 degrees off the top, one in
    each of ``count`` equal sectors, so that together they see every slope."""
    theta = torch.rand(batch, count, device=device) * math.radians(40) + math.radians(25)
    sector = torch.arange(count, device=device) + torch.rand(batch, 1, device=device)
    phi = sector * (2 * math.pi / count)
    return torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], -1)


def shading_loss(y, x, lights):
    """Mean square difference of the shading that white paint would have under
    distant lights [B, L, 3]: relief alone, whatever the albedo."""
    shade = lambda e: torch.einsum("blc,bchw->blhw", lights, unit_normals(e)).clamp_min(0)
    return ((shade(y) - shade(x)) ** 2).mean()


def relief(e):
    """Logarithm of the root mean square of slopes' deviations from their
    neighbourhood's mean [B, 1, H', W']."""
    slope = MAX_SLOPE * e[:, :2]
    pool = lambda v: F.avg_pool2d(v, NEIGHBOURHOOD, NEIGHBOURHOOD // 2)
    variance = (pool(slope * slope) - pool(slope) ** 2).sum(1, keepdim=True).clamp_min(0)
    return 0.5 * torch.log(variance + LEAST_SLOPE**2)


def amplitude_loss(y, x):
    """Mean absolute difference of the logarithm of :func:`relief`."""
    return (relief(y) - relief(x)).abs().mean()


def rendering_loss(y, x, camera, light):
    """Log-L1 between renderings for camera and light [B, L, 3]."""
    with torch.no_grad():
        reference = render(x, camera, light)
    return log_l1(render(y, camera, light), reference)


def photo_losses(y, x, camera, light, distant):
    """All of them: (maps, renderings, shading, amplitude)."""
    return maps_loss(y, x), rendering_loss(y, x, camera, light), shading_loss(y, x, distant), amplitude_loss(y, x)


def spread_loss(log_sigma, y, x):
    """Negative logarithm of the probability of the differences found, if they were
    normally distributed with the predicted standard deviations; without its
    constant. The maps themselves are not moved by it."""
    squared = (y.detach() - x) ** 2
    return (log_sigma + 0.5 * squared * torch.exp(-2 * log_sigma)).mean()
