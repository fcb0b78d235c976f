"""Train the photo network: one to eight flash photos with their geometry -> maps.

Photos are rendered from random materials with random camera and flash positions,
with the faults of real ones (faults.py). Most of the training sees crops of
``--size`` texels out of samples of 256, with directions, highlights and texture of
the size that they have there; the rest (``--fine-from``) whole samples.
"""

import math
import os

import torch

from data import MaterialPool, augment
from faults import Ranges, photograph
from networks import PhotoNetwork, widen_photo_input
from photo_losses import distant_lights, photo_losses, spread_loss
from renderer import directions, log_encode, photo_configurations, random_configurations, render
from schedule import Run, arguments, load_ema, mixed_precision

# Largest radiance that the network tells from larger ones
BRIGHTEST = 100.0
# Texels a side of a sample, at which the library runs the network
FRAME = 256
# How many photos an example has when it has several, and how often
COUNTS = {2: 0.3, 3: 0.2, 4: 0.2, 6: 0.15, 8: 0.15}


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


def random_window(batch, size, device):
    """Which part of a sample a crop of ``size`` texels is: centre [B, 2] and scale
    (see renderer.in_window)."""
    scale = size / FRAME
    return (torch.rand(batch, 2, device=device) * 2 - 1) * (1 - scale), scale


def make_example(x, draw=render, count=1, ranges=None):
    """Maps [B, 9, H, W], of less than FRAME texels parts of a sample -> network input
    [B, count, PHOTO_CHANNELS, H, W] of random photos, most often the first near
    the top view."""
    batch, device = len(x), x.device
    centre, scale = random_window(batch, x.shape[-1], device)
    window = centre.repeat_interleave(count, 0), scale
    x = x.repeat_interleave(count, 0)
    first = photo_configurations(len(x), device)
    other = photo_configurations(len(x), device, top_fraction=0.25)
    is_first = (torch.arange(len(x), device=device) % count == 0)[:, None]
    camera, light = (torch.where(is_first, a, b) for a, b in zip(first, other))
    parts = photograph(x, camera, light, ranges or Ranges(), window, draw=draw)
    return photo_input(*parts).unflatten(0, (-1, count))


def example_shape(args, run):
    """Texels a side, materials and photos of the next batch: as costly whatever they are."""
    fine = run.progress >= args.fine_from
    size = FRAME if fine else args.size
    batch = max(2, args.batch * args.size**2 // FRAME**2) if fine else args.batch
    if run.rng.random() < args.single:
        return size, batch, 1
    count = int(run.rng.choice(list(COUNTS), p=list(COUNTS.values())))
    return size, max(1, 3 * batch // (2 * count)), count


def options():
    parser = arguments(__doc__, batch=16, lr=1.2e-3)
    parser.add_argument("--render-weight", type=float, default=0.5, help="of renderings in the loss")
    parser.add_argument("--shading-weight", type=float, default=4.0, help="of white shading in the loss")
    parser.add_argument("--amplitude-weight", type=float, default=0.005, help="of the amount of relief in the loss")
    parser.add_argument("--single", type=float, default=1.0, help="share of examples with one photo")
    parser.add_argument("--rounds", type=int, default=1, help="passes of the blocks at low resolution")
    parser.add_argument("--deep", action="store_true", help="residual blocks at 1/4 and 1/8 as well")
    parser.add_argument("--spread", action="store_true", help="predict standard deviations too")
    parser.add_argument("--init", help="checkpoint whose averaged weights to start from")
    parser.set_defaults(size=96)
    return parser.parse_args()


def main():
    args = options()
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    pool = MaterialPool(args.packs, args.device, real_share=args.real_share)
    model, licences = PhotoNetwork(spread=args.spread, rounds=args.rounds, deep=args.deep), [pool.licences()]
    if args.init and not os.path.exists(os.path.join(args.work, "photo.pt")):
        _, state = load_ema(model, args.init, widen_photo_input)
        licences.append(state.get("licences", {}))
    model = model.to(args.device).to(memory_format=torch.channels_last).train()
    run = Run("photo", model, args, licences=licences)
    draw, compute, change = render, photo_losses, augment
    if not args.no_compile:
        draw, compute, change = (torch.compile(f, dynamic=False) for f in (render, photo_losses, augment))
    while run.progress < 1:
        run.refresh(pool)
        size, batch, count = example_shape(args, run)
        with torch.no_grad():
            x = pool.batch(batch, size, run.rng, change, frame=FRAME)
            photos = make_example(x, draw, count)
        with mixed_precision(args.device):
            y, log_sigma = model.predict(photos)
        y = y.float().contiguous()
        camera, light = random_configurations(batch, 1, args.views - 2, 1, args.device)
        maps, rendering, shading, amplitude = compute(y, x, camera, light, distant_lights(batch, 4, args.device))
        loss = maps + args.render_weight * rendering + args.shading_weight * shading + args.amplitude_weight * amplitude
        values = {"maps": maps, "render": rendering, "shading": shading, "amplitude": amplitude}
        if log_sigma is not None:
            spread = spread_loss(log_sigma.float(), y, x)
            loss, values["spread"] = loss + 0.1 * spread, spread
        suffix = f"@{size}" + (f"x{count}" if count in (1, 8) else "xN")
        run.update(loss, batch, {k + suffix: v.detach() for k, v in values.items()})
    run.save()


if __name__ == "__main__":
    main()
