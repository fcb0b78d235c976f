"""Evaluate the networks: photo network, auto-encoder, latent fit.

    evaluate.py --autoencoder autoencoder.pt --photo photo.pt \\
        --materials validation-folder [--fit 1 2 5] [--rates 0.03] [--iterations 200]

With ``--packs`` instead of ``--materials`` the held-out materials of the packs
are used (for choosing the recipe; validation materials are for reporting).
Errors are RMSE: unit normal, kd, ks (linear), roughness, and renderings of novel
views clipped to [0, 1].
"""

import argparse
import math
import os

import numpy as np
import torch
from torch.nn import functional as F

from data import MaterialPool, load_material
from networks import PhotoNetwork
from renderer import (
    LOG_OFFSET,
    decode_maps,
    photo_configurations,
    render,
)
from schedule import load_ema
from train_autoencoder import AutoEncoder
from train_photo import photo_input


def unit_normal(slope):
    inv = torch.rsqrt((slope**2).sum(-3, keepdim=True) + 1)
    return torch.cat([slope * inv, inv], -3)


def novel_configurations(count, seed=100):
    """Distant views and lights over the hemisphere up to 70 degrees."""
    rng = np.random.default_rng(seed)

    def points():
        z = rng.uniform(math.cos(math.radians(70)), 1, count)
        phi = rng.uniform(0, 2 * math.pi, count)
        s = np.sqrt(1 - z * z)
        return torch.tensor(np.stack([s * np.cos(phi), s * np.sin(phi), z], 1) * 50, dtype=torch.float32)

    return points(), points()


def errors(pred, truth, views=40):
    """RMSE per material: dict of [B] tensors."""
    a, b = decode_maps(pred), decode_maps(truth)
    rms = lambda x, y: ((x - y) ** 2).mean((1, 2, 3)).sqrt()
    out = {
        "normal": rms(unit_normal(a[0]), unit_normal(b[0])),
        "diffuse": rms(a[1], b[1]),
        "specular": rms(a[2], b[2]),
        "roughness": rms(a[3], b[3]),
    }
    camera, light = novel_configurations(views)
    total = torch.zeros(len(pred))
    for c, l in zip(camera, light):
        c, l = c.expand(len(pred), 1, 3), l.expand(len(pred), 1, 3)
        d = render(pred, c, l).clamp(0, 1) - render(truth, c, l).clamp(0, 1)
        total += (d**2).mean((1, 2, 3, 4))
    out["render"] = (total / views).sqrt()
    return out


def show(label, e):
    print(f"{label:38s} " + " ".join(f"{k} {v.mean():.4f}" for k, v in e.items()), flush=True)


def validation_materials(folder, size=256):
    """Centre crops [B, 9, size, size] of materials resampled to twice that
    (smaller ones: whole)."""
    names, maps = [], []
    for name in sorted(os.listdir(folder)):
        path = os.path.join(folder, name)
        if not os.path.isdir(path):
            continue
        e = load_material(path)
        side = min(e.shape[1:])
        e = e[:, :side, :side]
        target = 2 * size if side >= 2 * size else size
        e = F.interpolate(e[None], (target, target), mode="bilinear", antialias=True)[0]
        o = (target - size) // 2
        maps.append(e[:, o : o + size, o : o + size].clamp(-1, 1))
        names.append(name)
    return names, torch.stack(maps)


def held_out_materials(packs, count=12, size=256, seed=5):
    """Augmented maps of held-out training materials [count, 9, size, size]."""
    pool = MaterialPool(packs, subset="held_out")
    torch.manual_seed(seed)
    return pool.batch(count, size, np.random.default_rng(seed), blended=0.0)


def capture(truth, frames, seed=3):
    """A hand-held capture: the first photo near the top view, the others up
    to 45 degrees off. Returns radiance [B, N, 3, S, S] (clamped to 1, a little
    noise), camera, light [B, N, 3]."""
    torch.manual_seed(seed)
    batch = len(truth)
    top = photo_configurations(batch, top_fraction=1.1)
    cams, lights = [top[0]], [top[1]]
    for _ in range(frames - 1):
        c, l = photo_configurations(batch, top_fraction=0.3)
        cams.append(c)
        lights.append(l)
    camera, light = torch.stack(cams, 1), torch.stack(lights, 1)
    x = torch.cat([render(truth, camera[:, i : i + 1], light[:, i : i + 1]) for i in range(frames)], 1)
    x = x + 0.01 * x.clamp(0, 1).sqrt() * torch.randn_like(x) + 0.002 * torch.randn_like(x)
    return x.clamp(0, 1), camera, light


def start_maps(photo, radiance, camera, light):
    """Maps of the photo network from all photos [B, N, 3, S, S], clamped to 1."""
    batch, count = radiance.shape[:2]
    weight = torch.ones_like(radiance[:, :, :1])
    saturated = (radiance >= 1).float().mean(2, keepdim=True)
    flat = [x.flatten(0, 1) for x in (radiance, weight, saturated, camera, light)]
    with torch.no_grad():
        return photo(photo_input(*flat).unflatten(0, (batch, count)))


def fit(encoder, decoder, start, radiance, camera, light, rate, iterations, residual=False,
        betas=(0.9, 0.99), final=0.1, draw=render, report=None):
    """Adam on the code from maps ``start``: cosine from ``rate`` to ``final``
    times it. ``residual``: add what the auto-encoder loses of the start."""
    with torch.no_grad():
        z = encoder(start)
        offset = start - decoder(z) if residual else 0.0
    z = z.clone().requires_grad_()
    optimizer = torch.optim.Adam([z], lr=rate, betas=betas)
    target = torch.log(radiance + LOG_OFFSET)
    for i in range(iterations):
        optimizer.param_groups[0]["lr"] = rate * (final + (1 - final) * 0.5 * (1 + math.cos(math.pi * i / iterations)))
        maps = (decoder(z) + offset).clamp(-1, 1)
        x = draw(maps, camera, light).clamp(0, 1)
        # mean over each material, summed over the batch: independent fits
        loss = (torch.log(x + LOG_OFFSET) - target).abs().mean((1, 2, 3, 4)).sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if report and (i + 1) in report:
            with torch.no_grad():
                report[i + 1]((decoder(z) + offset).clamp(-1, 1), float(loss) / len(z))
    with torch.no_grad():
        return (decoder(z) + offset).clamp(-1, 1), float(loss) / len(z)


def prior_statistics(packs, networks, count=48):
    """RMS errors of networks (name -> function of encoded maps) on held-out
    training-pool materials, per encoded channel and per natural parameter."""
    result = {"materials": count, "size": 256}
    pairs = {name: [] for name in networks}
    with torch.no_grad():
        for i in range(count // 8):
            truth = held_out_materials(packs, 8, 256, seed=1000 + i)
            for name, network in networks.items():
                pairs[name].append((network(truth), truth))
    for name, pair in pairs.items():
        a, b = torch.cat([p[0] for p in pair]), torch.cat([p[1] for p in pair])
        rms = lambda x, y: [round(float(v), 5) for v in ((x - y) ** 2).mean((0, 2, 3)).sqrt()]
        na, nb = decode_maps(a), decode_maps(b)
        flat = lambda x, y: round(float(((x - y) ** 2).mean().sqrt()), 5)
        result[name] = {
            "encoded_rms": rms(a, b),
            "slope_rms": flat(na[0], nb[0]),
            "diffuse_rms": flat(na[1], nb[1]),
            "specular_rms": flat(na[2], nb[2]),
            "roughness_rms": flat(na[3], nb[3]),
        }
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--autoencoder", required=True)
    parser.add_argument("--photo", required=True)
    parser.add_argument("--materials")
    parser.add_argument("--packs", nargs="*")
    parser.add_argument("--count", type=int, default=12, help="held-out materials")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--fit", type=int, nargs="*", default=[], help="numbers of photos to fit")
    parser.add_argument("--rates", type=float, nargs="*", default=[0.03])
    parser.add_argument("--iterations", type=int, nargs="*", default=[150])
    parser.add_argument("--residual", action="store_true")
    parser.add_argument("--each", action="store_true", help="print every material")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--sheet", help="PNG: truth, start and fit renderings")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    autoencoder, steps, samples = load_ema(AutoEncoder(), args.autoencoder)
    photo, photo_steps, photo_samples = load_ema(PhotoNetwork(), args.photo)
    for m in (autoencoder, photo):
        m.requires_grad_(False)
    encoder, decoder = autoencoder.encoder, autoencoder.decoder
    print(f"auto-encoder {steps} steps, {samples} samples; photo network {photo_steps} steps, {photo_samples} samples")
    if args.materials:
        names, truth = validation_materials(args.materials, args.size)
    else:
        truth = held_out_materials(args.packs, args.count, args.size)
        names = [str(i) for i in range(len(truth))]
    with torch.no_grad():
        show("auto-encoder", errors(decoder(encoder(truth)), truth))
        radiance, camera, light = capture(truth, 1)
        start = start_maps(photo, radiance, camera, light)
        e = errors(start, truth)
        show("photo network", e)
        if args.each:
            for i, n in enumerate(names):
                show("  " + n[:34], {k: v[i : i + 1] for k, v in e.items()})
        show("photo network, then auto-encoder", errors(decoder(encoder(start)), truth))
    images = [truth, start]
    for n in args.fit:
        radiance, camera, light = capture(truth, n)
        draw = torch.compile(render, dynamic=False)
        start = start_maps(photo, radiance, camera, light)
        show(f"photo network N={n}", errors(start, truth))
        for rate in args.rates:
            for count in args.iterations:
                maps, loss = fit(encoder, decoder, start, radiance, camera, light, rate, count, args.residual, draw=draw)
                with torch.no_grad():
                    e = errors(maps, truth)
                    show(f"fit N={n} rate {rate:g} x {count}: loss {loss:.4f}", e)
        images.append(maps)
    if args.sheet:
        from PIL import Image

        c, l = torch.tensor([[[0.0, 0.0, 2.2]]]), torch.tensor([[[0.5, 0.4, 1.8]]])
        rows = [torch.cat(list(render(m, c.expand(len(m), -1, -1), l.expand(len(m), -1, -1))[:, 0].clamp(0, 1) ** (1 / 2.2)), 2) for m in images]
        sheet = F.interpolate(torch.cat(rows, 1)[None], scale_factor=0.5, mode="area")[0]
        Image.fromarray((sheet.permute(1, 2, 0).numpy() * 255).astype(np.uint8)).save(args.sheet)


if __name__ == "__main__":
    main()
