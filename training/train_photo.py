"""Train the photo network: one to eight flash photos with their geometry -> maps.

Photos are rendered from random materials with random (known) camera and flash
positions, then degraded: exposure error, ambient light, noise, blur,
saturation, holes without data.
"""

import math
import os

import torch
from torch.nn import functional as F

from data import MaterialPool, augment, smooth_noise
from networks import PhotoNetwork, widen_photo_input
from renderer import (
    decode_maps,
    directions,
    log_encode,
    photo_configurations,
    random_configurations,
    render,
)
from schedule import Run, arguments, load_ema
from train_autoencoder import CHANNEL_WEIGHT, losses

# Largest radiance that the network tells from larger ones
BRIGHTEST = 100.0


def photo_input(radiance, weight, saturated, camera, light):
    """radiance [B, 3, H, W] (irradiance-normalised), weight and share of
    saturated channels [B, 1, H, W], camera, light [B, 3] -> network input
    [B, PHOTO_CHANNELS, H, W]: logarithm of radiance up to 1, directions to the
    camera and to the light, weight, saturated share, logarithm of what is above 1."""
    height, width = radiance.shape[-2:]
    view = torch.stack(directions(camera, height, width), 1)
    incident = torch.stack(directions(light, height, width), 1)
    seen = weight > 0
    none = torch.zeros(1, device=radiance.device)
    x = torch.where(seen, log_encode(radiance), none - 1)
    excess = torch.where(seen, radiance.clamp(1, BRIGHTEST).log() / math.log(BRIGHTEST), none)
    return torch.cat([x, view, incident, weight, torch.where(seen, saturated, none), excess], 1)


def sensor_limit(u, v):
    """Where the sensor clips, of two uniform variables: a bit below to above a
    white diffuse surface for most photos, high or nowhere for the others."""
    low = 0.5 * 2.6**u
    high = 1.3 * 6.0**u
    return torch.where(v < 0.45, low, torch.where(v < 0.65, high, torch.full_like(u, 1e9)))


def degrade(radiance, e):
    """Clean renderings [B, 3, H, W] of maps e -> (radiance, weight, share of
    saturated channels) as a capture delivers them."""
    batch, _, height, width = radiance.shape
    device = radiance.device

    def rand(channels=1):
        return torch.rand(batch, channels, 1, 1, device=device)

    def randn(channels=1):
        return torch.randn(batch, channels, 1, 1, device=device)

    # errors of exposure and white balance
    radiance = radiance * torch.exp(0.05 * randn() + 0.015 * randn(3))
    # ambient light: what a uniform dome adds, up to 5 %
    _, kd, ks, _ = decode_maps(e)
    amount = torch.where(rand() < 0.35, 0.05 * rand(), torch.zeros(1, device=device))
    radiance = radiance + amount * (kd + ks) * (1 + 0.15 * randn(3)).clamp_min(0.3)
    # residual vignetting or fall-off
    radiance = radiance * torch.exp(0.04 * smooth_noise(batch, max(height, width), device, 3)[..., :height, :width])
    blur = (rand() < 0.3).float() * rand()
    radiance = torch.lerp(radiance, F.avg_pool2d(radiance, 3, 1, 1, count_include_pad=False), blur)
    shot = 0.02 * rand() * radiance.clamp(0, 1).sqrt() + 0.004 * rand()
    radiance = (radiance + shot * torch.randn_like(radiance)).clamp_min(0)
    limit = sensor_limit(rand(), rand())
    saturated = (radiance >= limit).float().mean(1, keepdim=True)
    # resampling spreads the mark to neighbours
    saturated = torch.where(rand() < 0.5, F.max_pool2d(saturated, 3, 1, 1), saturated)
    radiance = torch.minimum(radiance, limit)
    # holes, sometimes a whole band outside of the photo
    noise = smooth_noise(batch, max(height, width), device, 9)[..., :height, :width]
    level = torch.where(rand() < 0.2, 1.0 + 1.2 * rand(), 9 * torch.ones(1, device=device))
    weight = (noise < level).float()
    soft = torch.where(rand() < 0.2, 0.3 + 0.7 * rand(), torch.ones(1, device=device))
    return radiance, weight * soft, saturated


# How many photos an example has when it has several, and how often
COUNTS = {2: 0.3, 3: 0.2, 4: 0.2, 6: 0.15, 8: 0.15}


def photo_losses(y, x, camera, light, weight):
    """As for the auto-encoder, but errors of slopes count by their square below
    0.2, three times: the mean of what the slope may be, not its median, which
    is too flat."""
    maps, rendering = losses(y, x, camera, light, weight)
    d = (y[:, :2] - x[:, :2]).abs()
    slopes = torch.where(d < 0.1, 15 * d * d + 0.15, 3 * d) - d
    return maps + (slopes * weight[:, :2]).mean() * (2 / 9), rendering


def make_example(x, draw=render, count=1):
    """Maps [B, 9, H, W] -> network input [B, count, PHOTO_CHANNELS, H, W] of random
    photos, most often the first near the top view."""
    x = x.repeat_interleave(count, 0)
    first = photo_configurations(len(x), x.device)
    other = photo_configurations(len(x), x.device, top_fraction=0.25)
    is_first = (torch.arange(len(x), device=x.device) % count == 0)[:, None]
    camera, light = (torch.where(is_first, a, b) for a, b in zip(first, other))
    radiance = draw(x, camera[:, None], light[:, None])[:, 0]
    radiance, weight, saturated = degrade(radiance, x)
    return photo_input(radiance, weight, saturated, camera, light).unflatten(0, (-1, count))


def main():
    parser = arguments(__doc__, batch=16, lr=1.2e-3)
    parser.add_argument("--render-weight", type=float, default=0.5)
    parser.add_argument("--single", type=float, default=0.4, help="share of examples with one photo")
    parser.add_argument("--init", help="checkpoint whose averaged weights to start from")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    pool = MaterialPool(args.packs, args.device)
    model = PhotoNetwork()
    if args.init and not os.path.exists(os.path.join(args.work, "photo.pt")):
        load_ema(model, args.init, widen_photo_input)
    model = model.to(args.device).to(memory_format=torch.channels_last).train()
    run = Run("photo", model, args)
    draw, compute, change = render, photo_losses, augment
    if not args.no_compile:
        draw, compute, change = (torch.compile(f, dynamic=False) for f in (render, photo_losses, augment))
    weight = torch.tensor(CHANNEL_WEIGHT, device=args.device).view(1, 9, 1, 1)
    kind = torch.device(args.device).type
    while run.progress < 1:
        fine = run.progress >= args.fine_from
        size, batch = (256, max(2, args.batch // 4)) if fine else (args.size, args.batch)
        single = run.rng.random() < args.single
        count = 1 if single else int(run.rng.choice(list(COUNTS), p=list(COUNTS.values())))
        if count > 1:  # as costly as one photo each
            batch = max(1, 3 * batch // (2 * count))
        with torch.no_grad():
            x = pool.batch(batch, size, run.rng, change)
            photos = make_example(x, draw, count)
        with torch.autocast(kind, torch.bfloat16):
            y = model(photos)
        y = y.float().contiguous()
        camera, light = random_configurations(batch, 1, args.views - 2, 1, args.device)
        maps, rendering = compute(y, x, camera, light, weight)
        loss = maps + args.render_weight * rendering
        values = {"maps": maps.detach(), "render": rendering.detach()}
        values = {k + (str(count) if count in (1, 8) else "N"): v for k, v in values.items()}
        run.update(loss, batch, values)
    run.save()


if __name__ == "__main__":
    main()
