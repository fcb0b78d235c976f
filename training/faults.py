"""What real flash photographs have that a rendering of the maps has not.

:func:`photograph` renders encoded maps and degrades the picture, in the order in
which nature does: lobe of the material, light of the scene, optics, sensor, file,
and what the capture does not know about all that. Everything is drawn from one
generator, within :class:`Ranges`; ``Ranges.none()`` is the clean rendering.

Radiance is that of renderer.py (pi * NoL * BRDF: 1 for white paint that faces the
light); lengths are half widths of the sample, pixels are texels.
"""

import math
from dataclasses import dataclass, fields, replace

import torch
from torch.nn import functional as F

from renderer import decode_maps, in_window, render

# Rec. 601 luma and chroma, which JPEG files are coded in
YCC = ((0.299, 0.587, 0.114), (-0.168736, -0.331264, 0.5), (0.5, -0.418688, -0.081312))
# Annex K of ITU-T T.81: quantisation of luma and chroma at quality 50
LUMA_TABLE = (
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56,
    14, 17, 22, 29, 51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92,
    49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
)  # fmt: skip
CHROMA_TABLE = (
    17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99, 99, 99,
    47, 66, 99, 99, 99, 99, 99, 99, *(99,) * 32,
)  # fmt: skip


@dataclass(frozen=True)
class Ranges:
    """How often each fault occurs and how large it is. ``*_chance`` is a share of
    photographs; a pair is the ends of a uniform distribution, or with "log" of one
    of the logarithm; ``*_sigma`` is a standard deviation."""

    # material: exponent of the lobe's denominator (GGX: 2), same roughness or same half width
    lobe_chance: float = 0.4
    lobe_exponent: tuple = (1.5, 2.5)
    lobe_same_width: float = 0.5
    # scene: light from all around as a share of the flash; pattern of the flash, relative
    ambient_chance: float = 0.35
    ambient: tuple = (0.0, 0.05)
    ambient_tint: float = 0.15
    pattern_sigma: float = 0.04
    lobed_chance: float = 0.2
    lobed: tuple = (0.02, 0.15)
    # what the capture knows: flash (half widths, log) and camera (share of its distance)
    flash_chance: float = 1.0
    flash_offset: tuple = (0.01, 0.25)
    camera_sigma: float = 0.004
    # optics: Gaussian blur and registration, texels
    blur_chance: float = 0.5
    blur: tuple = (0.2, 0.9)
    shift_chance: float = 0.4
    shift: float = 0.5
    warp: float = 0.25
    # exposure and white balance: of a capture with a board, and of one without
    gain_sigma: float = 0.05
    unknown_gain_chance: float = 0.25
    unknown_gain: tuple = (0.6, 1.6)
    white_balance_sigma: float = 0.015
    # sensor: noise at white and at black; where it clips (radiance, log), or by the clipped share (log)
    shot_noise: tuple = (0.0, 0.02)
    read_noise: tuple = (0.0, 0.004)
    clip_chance: float = 0.75
    clip: tuple = (0.5, 7.8)
    clip_low_chance: float = 0.5
    clip_low: tuple = (0.5, 1.3)
    clip_share_chance: float = 0.3
    clip_share: tuple = (0.001, 0.3)
    # saturation that nothing marks: files that a tone curve ends below their largest value
    unmarked_chance: float = 0.2
    # file: residual exponent and shoulder of the tone curve, JPEG quality
    tone_chance: float = 0.5
    tone_sigma: float = 0.08
    shoulder: tuple = (0.0, 0.8)
    jpeg_chance: float = 0.4
    jpeg_quality: tuple = (70.0, 97.0)
    # texels without data, and photographs of little weight
    hole_chance: float = 0.2
    faint_chance: float = 0.2
    faint: tuple = (0.3, 1.0)

    @classmethod
    def none(cls):
        """No fault at all."""
        off = {f.name: 0.0 for f in fields(cls) if f.name.endswith(("_chance", "_sigma"))}
        return replace(cls(), **off, shot_noise=(0.0, 0.0), read_noise=(0.0, 0.0))


class Draws:
    """Random numbers of a batch, one per photograph: [B, channels, 1, 1]."""

    def __init__(self, batch, device, generator=None):
        self.batch, self.device, self.generator = batch, device, generator

    def uniform(self, ends=(0.0, 1.0), channels=1):
        u = torch.rand(self.batch, channels, 1, 1, device=self.device, generator=self.generator)
        return ends[0] + (ends[1] - ends[0]) * u

    def log_uniform(self, ends, channels=1):
        return self.uniform((math.log(ends[0]), math.log(ends[1])), channels).exp()

    def normal(self, channels=1):
        return torch.randn(self.batch, channels, 1, 1, device=self.device, generator=self.generator)

    def chance(self, p):
        return self.uniform() < p

    def field(self, size, cells, channels=1):
        """Smooth fields [B, channels, *size], roughly standard normal."""
        n = torch.randn(self.batch, channels, cells, cells, device=self.device, generator=self.generator)
        return F.interpolate(n, size, mode="bicubic", align_corners=True)

    def white(self, like):
        return torch.randn(like.shape, device=self.device, generator=self.generator)


# ------------------------------------------------------------ material


def same_width_roughness(roughness, exponent):
    """Roughness at which a lobe of ``exponent`` falls to half its height where GGX of
    ``roughness`` does: with a = roughness², sin² of that angle is
    (2^(1/exponent) - 1) a² / (1 - a²)."""
    a2 = roughness**4
    sin2 = (math.sqrt(2) - 1) * a2 / (1 - a2).clamp_min(1e-3)
    a2 = sin2 / (sin2 + 2 ** (1 / exponent) - 1)
    return (a2**0.25).clamp(0.02, 1.0)


def draw_lobe(e, draws, ranges):
    """Maps to photograph in place of ``e``, and the exponent of the lobe [B, 1, 1, 1]."""
    exponent = torch.where(draws.chance(ranges.lobe_chance), draws.uniform(ranges.lobe_exponent), 2.0)
    slope, kd, ks, roughness = decode_maps(e)
    narrow = draws.chance(ranges.lobe_same_width)
    roughness = torch.where(narrow, same_width_roughness(roughness, exponent), roughness)
    return torch.cat([e[:, :8], 2 * roughness - 1], 1), exponent


# --------------------------------------------------------------- scene


def light_scene(radiance, e, draws, ranges):
    """Ambient light as a uniform dome adds it, and a flash pattern that is not round."""
    size = radiance.shape[-2:]
    _, kd, ks, _ = decode_maps(e)
    amount = torch.where(draws.chance(ranges.ambient_chance), draws.uniform(ranges.ambient), 0.0)
    tint = (1 + ranges.ambient_tint * draws.normal(3)).clamp_min(0.3)
    radiance = radiance + amount * (kd + ks) * tint
    pattern = ranges.pattern_sigma * draws.field(size, 3)
    lobed = torch.where(draws.chance(ranges.lobed_chance), draws.uniform(ranges.lobed), 0.0)
    phase, turn = draws.uniform((0, 2 * math.pi)), draws.uniform((0, 2 * math.pi))
    x = torch.linspace(-1, 1, size[1], device=e.device)
    y = torch.linspace(1, -1, size[0], device=e.device)[:, None]
    along = x * phase.cos() + y * phase.sin()
    return radiance * torch.exp(pattern + lobed * torch.cos(math.pi * along + turn))


def told_positions(camera, light, draws, ranges):
    """Camera and flash [B, 3] as the capture believes them to be."""
    far = camera.norm(dim=-1, keepdim=True)
    told = camera + ranges.camera_sigma * far * draws.normal(3)[..., 0, 0]
    size = torch.where(draws.chance(ranges.flash_chance), draws.log_uniform(ranges.flash_offset), 0.0)
    moved = light + (told - camera) + (size * draws.normal(3))[..., 0, 0]
    low = light.new_tensor([-1e9, -1e9, 0.05])
    return torch.maximum(told, low), torch.maximum(moved, low)


# -------------------------------------------------------------- optics


def blur(picture, sigma):
    """Gaussian blur of each picture by ``sigma`` [B, 1, 1, 1] texels (at most 1)."""
    batch, channels = picture.shape[:2]
    t = torch.arange(-3, 4, device=picture.device, dtype=picture.dtype)
    kernel = torch.exp(-0.5 * (t / sigma.view(-1, 1).clamp_min(1e-3)) ** 2)
    kernel = (kernel / kernel.sum(1, keepdim=True)).repeat_interleave(channels, 0)
    flat = picture.reshape(1, batch * channels, *picture.shape[-2:])
    flat = F.conv2d(F.pad(flat, (3, 3, 0, 0), mode="replicate"), kernel[:, None, None, :], groups=batch * channels)
    flat = F.conv2d(F.pad(flat, (0, 0, 3, 3), mode="replicate"), kernel[:, None, :, None], groups=batch * channels)
    return flat.view(picture.shape)


def displace(picture, offset):
    """Picture [B, C, H, W] looked up ``offset`` [B, 2, H, W] texels to the right
    and downwards, bilinear."""
    height, width = picture.shape[-2:]
    x = torch.arange(width, device=picture.device, dtype=picture.dtype)
    y = torch.arange(height, device=picture.device, dtype=picture.dtype)[:, None]
    grid = torch.stack([(2 * (x + offset[:, 0]) + 1) / width - 1, (2 * (y + offset[:, 1]) + 1) / height - 1], -1)
    return F.grid_sample(picture, grid, mode="bilinear", padding_mode="border", align_corners=False)


def optics(picture, draws, ranges):
    """Registration error up to half a texel, smooth over the picture, and blur."""
    size = picture.shape[-2:]
    far = (2 * draws.uniform((0, 1), 2) - 1) * ranges.shift + ranges.warp * draws.field(size, 4, 2)
    far = far.clamp(-ranges.shift, ranges.shift)
    sigma = draws.uniform(ranges.blur)
    moved, blurred = draws.chance(ranges.shift_chance).flatten(), draws.chance(ranges.blur_chance).flatten()
    picture = picture.clone()
    if moved.any():
        picture[moved] = displace(picture[moved], far[moved])
    if blurred.any():
        picture[blurred] = blur(picture[blurred], sigma[blurred])
    return picture


# ------------------------------------------------------ sensor and file


def clip_level(radiance, draws, ranges):
    """Radiance at which the sensor saturates [B, 1, 1, 1]: anywhere from below white
    paint to far above, or such that a given share of the texels is clipped."""
    low = draws.chance(ranges.clip_low_chance)
    level = torch.where(low, draws.log_uniform(ranges.clip_low), draws.log_uniform(ranges.clip))
    share = draws.log_uniform(ranges.clip_share)
    brightest = radiance.amax(1).flatten(1).sort(1).values
    at = ((1 - share.flatten()) * (brightest.shape[1] - 1)).long()
    by_share = brightest.gather(1, at[:, None])[..., None, None].clamp_min(0.05)
    level = torch.where(draws.chance(ranges.clip_share_chance), by_share, level)
    return torch.where(draws.chance(ranges.clip_chance), level, 1e9)


def tone_curve(y, exponent, shoulder):
    """Residual tone curve of values in [0, 1]: power and shoulder, 0.18 (middle
    gray) kept."""
    f = lambda v: v**exponent * (1 + shoulder) / (1 + shoulder * v**exponent)
    gray = torch.full_like(exponent, 0.18)
    return f(y) * (gray / f(gray))


def _dct_matrix(device):
    k = torch.arange(8.0, device=device)
    m = torch.cos(math.pi * (2 * k[None] + 1) * k[:, None] / 16) * 0.5
    m[0] *= math.sqrt(0.5)
    return m


def _quantise(plane, table, quality):
    """Quantise the 8x8 cosine transform of planes [B, C, H, W] in 0..255."""
    batch, channels, height, width = plane.shape
    m = _dct_matrix(plane.device)
    scale = torch.where(quality < 50, 5000 / quality, 200 - 2 * quality).view(-1, 1, 1, 1, 1, 1)
    q = torch.tensor(table, device=plane.device, dtype=plane.dtype).view(1, 1, 1, 1, 8, 8)
    q = ((q * scale + 50) / 100).floor().clamp(1, 255)
    blocks = (plane - 128).view(batch, channels, height // 8, 8, width // 8, 8).transpose(3, 4)
    blocks = m.T @ (((m @ blocks @ m.T) / q).round() * q) @ m
    return blocks.transpose(3, 4).reshape(plane.shape) + 128


def jpeg(picture, quality):
    """8-bit JPEG (4:2:0) of pictures [B, 3, H, W] in [0, 1], already in the file's
    encoding; quality [B, 1, 1, 1] in 1..100. H, W: multiples of 16."""
    m = torch.tensor(YCC, device=picture.device, dtype=picture.dtype)
    ycc = torch.einsum("ij,bjhw->bihw", m, (picture * 255).round()) + picture.new_tensor([0, 128, 128]).view(1, 3, 1, 1)
    luma = _quantise(ycc[:, :1], LUMA_TABLE, quality)
    chroma = _quantise(F.avg_pool2d(ycc[:, 1:], 2), CHROMA_TABLE, quality)
    chroma = F.interpolate(chroma, scale_factor=2, mode="bilinear", align_corners=False)
    ycc = torch.cat([luma, chroma - 128], 1)
    return (torch.einsum("ij,bjhw->bihw", torch.linalg.inv(m), ycc).round() / 255).clamp(0, 1)


def to_srgb(x):
    return torch.where(x <= 0.0031308, 12.92 * x, 1.055 * x.clamp_min(1e-8) ** (1 / 2.4) - 0.055)


def from_srgb(x):
    return torch.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def developed(radiance, level, draws, ranges):
    """Tone curve and JPEG of photographs that saturate at ``level``."""
    exponent = torch.exp(ranges.tone_sigma * draws.normal())
    shoulder = draws.uniform(ranges.shoulder)
    toned = draws.chance(ranges.tone_chance).flatten()
    quality = draws.uniform(ranges.jpeg_quality)
    filed = draws.chance(ranges.jpeg_chance).flatten()
    # without saturation the file ends above the brightest texel
    end = torch.minimum(level, 1.1 * radiance.amax((1, 2, 3), keepdim=True)).clamp_min(1e-3)
    radiance = radiance.clone()
    if toned.any():
        y = (radiance[toned] / end[toned]).clamp(0, 1)
        radiance[toned] = end[toned] * tone_curve(y, exponent[toned], shoulder[toned])
    if filed.any():
        top = radiance[filed].amax((1, 2, 3), keepdim=True).maximum(end[filed])
        y = to_srgb((radiance[filed] / top).clamp(0, 1))
        radiance[filed] = top * from_srgb(jpeg(y, quality[filed]))
    return radiance


def sensor(radiance, draws, ranges):
    """Exposure, white balance, noise, saturation, file: (radiance, share of
    saturated channels [B, 1, H, W])."""
    gain = torch.exp(ranges.gain_sigma * draws.normal())
    unknown = draws.log_uniform(ranges.unknown_gain)
    gain = torch.where(draws.chance(ranges.unknown_gain_chance), unknown, gain)
    radiance = radiance * gain * torch.exp(ranges.white_balance_sigma * draws.normal(3))
    shot, read = draws.uniform(ranges.shot_noise), draws.uniform(ranges.read_noise)
    noise = shot * radiance.clamp(0, 1).sqrt() + read
    radiance = (radiance + noise * draws.white(radiance)).clamp_min(0)
    level = clip_level(radiance, draws, ranges)
    saturated = (radiance >= level).float().mean(1, keepdim=True)
    # resampling spreads the mark to neighbours
    spread = draws.chance(0.5 * (ranges.clip_chance > 0))
    saturated = torch.where(spread, F.max_pool2d(saturated, 3, 1, 1), saturated)
    saturated = torch.where(draws.chance(ranges.unmarked_chance), 0.0, saturated)
    return developed(torch.minimum(radiance, level), level, draws, ranges), saturated


def visibility(size, draws, ranges):
    """Weight [B, 1, H, W]: holes, sometimes a whole band outside of the photograph."""
    level = torch.where(draws.chance(ranges.hole_chance), draws.uniform((1.0, 2.2)), 9.0)
    soft = torch.where(draws.chance(ranges.faint_chance), draws.uniform(ranges.faint), 1.0)
    return (draws.field(size, 9) < level).float() * soft


def photograph(e, camera, light, ranges=None, window=None, generator=None, draw=render):
    """Photographs of encoded maps [B, 9, H, W] from camera and light [B, 3].

    ``window`` (centre [B, 2], scale): the maps are that part of a larger sample, in
    whose half widths the positions are given. Returns radiance [B, 3, H, W],
    weight and share of saturated channels [B, 1, H, W], and camera and light as
    the capture believes them, in half widths of the maps.
    """
    ranges = ranges or Ranges()
    draws = Draws(len(e), e.device, generator)
    inside = lambda p: in_window(p, *window) if window else p
    seen, exponent = draw_lobe(e, draws, ranges)
    radiance = draw(seen, inside(camera)[:, None], inside(light)[:, None], exponent)[:, 0]
    radiance = light_scene(radiance, e, draws, ranges)
    told_camera, told_light = told_positions(camera, light, draws, ranges)
    radiance, saturated = sensor(optics(radiance, draws, ranges), draws, ranges)
    weight = visibility(e.shape[-2:], draws, ranges)
    return radiance, weight, saturated, inside(told_camera), inside(told_light)
