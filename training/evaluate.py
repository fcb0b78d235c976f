"""Evaluate the networks: photo network, auto-encoder, latent fit.

    evaluate.py --photo photo.pt --materials validation-folder [--captures 4] [--faults]
        [--autoencoder autoencoder.pt [--fit 1 2 5] [--rates 0.03] [--iterations 200]]

``--models`` takes the exported photo network instead of a checkpoint. With
``--packs`` instead of ``--materials`` the held-out materials of the packs
are used (for choosing the recipe; validation materials are for reporting).
Errors are RMSE: unit normal, kd, ks (linear), roughness, and renderings of novel
views clipped to [0, 1]; and the mean square of normals (all three components).
"""

import argparse
import math
import os

import numpy as np
import torch
from torch.nn import functional as F

from data import MaterialPool, load_material
from import_weights import load_exported
from renderer import (
    LOG_OFFSET,
    decode_maps,
    photo_configurations,
    render,
)
from schedule import load_ema, load_photo_network
from train_autoencoder import AutoEncoder
from train_photo import make_example, photo_input


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
    out["normal²"] = 3 * out["normal"] ** 2
    return out


def relief(pred, truth):
    """Correlation of slopes with the true ones and their amplitude relative to these, of
    deviations from the material's mean: dict of [B] tensors."""
    centred = lambda e: e[:, :2] - e[:, :2].mean((2, 3), keepdim=True)
    a, b = centred(pred), centred(truth)
    rms = lambda x: (x**2).mean((1, 2, 3)).sqrt()
    return {
        "correlation": (a * b).mean((1, 2, 3)) / (rms(a) * rms(b)).clamp_min(1e-9),
        "amplitude": rms(a) / rms(b).clamp_min(1e-9),
    }


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


def network_input(radiance, camera, light):
    """Photos [B, N, 3, S, S] clamped to 1, with geometry [B, N, 3], as the photo network takes them."""
    batch, count = radiance.shape[:2]
    weight = torch.ones_like(radiance[:, :, :1])
    saturated = (radiance >= 1).float().mean(2, keepdim=True)
    flat = [x.flatten(0, 1) for x in (radiance, weight, saturated, camera, light)]
    return photo_input(*flat).unflatten(0, (batch, count))


def start_maps(photo, radiance, camera, light):
    """Maps of the photo network from all photos [B, N, 3, S, S], clamped to 1."""
    with torch.no_grad():
        return photo(network_input(radiance, camera, light))


def half_turn(x, odd):
    """Planes [..., C, H, W] of the sample turned by 180 degrees; ``odd`` change their sign."""
    x = torch.flip(x, (-2, -1)).clone()
    x[..., odd, :, :] *= -1
    return x


def first_maps(photo, planes):
    """Maps and logarithm of their standard deviations (or None) from network input
    [B, 1, C, S, S], as the library makes them: the mean of both orientations."""
    straight, log_sigma = photo.predict(planes)
    turned, _ = photo.predict(half_turn(planes, [3, 4, 6, 7]))
    return 0.5 * (straight + half_turn(turned, [0, 1])), log_sigma


def evaluate_photo(photo, truth, names, captures, faulty, each):
    """Errors of first maps from single photographs, means over several captures; and
    how often the true maps lie within one and two predicted standard deviations."""
    total, within = {}, []
    with torch.no_grad():
        for seed in range(3, 3 + captures):
            torch.manual_seed(seed)
            planes = make_example(truth) if faulty else network_input(*capture(truth, 1, seed))
            maps, log_sigma = first_maps(photo, planes)
            for k, v in {**errors(maps, truth), **relief(maps, truth)}.items():
                total[k] = total.get(k, 0) + v / captures
            if log_sigma is not None:
                z = (maps - truth).abs() * torch.exp(-log_sigma)
                within.append(torch.stack([(z < 1).float().mean((0, 2, 3)), (z < 2).float().mean((0, 2, 3))]))
    show("photo network" + (", faulty photographs" if faulty else ""), total)
    if each:
        for i, n in enumerate(names):
            show("  " + n[:34], {k: v[i : i + 1] for k, v in total.items()})
    if within:
        one, two = torch.stack(within).mean(0)
        groups = {"slopes": slice(0, 2), "diffuse": slice(2, 5), "specular": slice(5, 8), "roughness": slice(8, 9)}
        text = [f"{k} {one[g].mean():.2f}, {two[g].mean():.2f}" for k, g in groups.items()]
        print("within one, two sigma: " + "; ".join(text))


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


def evaluate_fits(args, autoencoder, photo, truth):
    """Errors of the auto-encoder and of latent fits; returns maps to be shown."""
    encoder, decoder = autoencoder.encoder, autoencoder.decoder
    with torch.no_grad():
        show("auto-encoder", errors(decoder(encoder(truth)), truth))
        start = start_maps(photo, *capture(truth, 1))
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
                    show(f"fit N={n} rate {rate:g} x {count}: loss {loss:.4f}", errors(maps, truth))
        images.append(maps)
    return images


def write_sheet(path, images):
    """Renderings of rows of maps, half the size, as PNG."""
    from PIL import Image

    c, l = torch.tensor([[[0.0, 0.0, 2.2]]]), torch.tensor([[[0.5, 0.4, 1.8]]])
    shown = lambda m: render(m, c.expand(len(m), -1, -1), l.expand(len(m), -1, -1))[:, 0].clamp(0, 1) ** (1 / 2.2)
    sheet = torch.cat([torch.cat(list(shown(m)), 2) for m in images], 1)
    sheet = F.interpolate(sheet[None], scale_factor=0.5, mode="area")[0]
    Image.fromarray((sheet.permute(1, 2, 0).numpy() * 255).astype(np.uint8)).save(path)


def load_photo(args):
    """Photo network of a checkpoint or of a models folder."""
    if args.models:
        return load_exported(args.models, "photo")[0].requires_grad_(False)
    photo, state = load_photo_network(args.photo)
    print(f"photo network: {state['step']} steps, {state['samples']} samples")
    return photo.requires_grad_(False)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--autoencoder")
    parser.add_argument("--photo", help="checkpoint")
    parser.add_argument("--models", help="folder with photo.onnx")
    parser.add_argument("--materials")
    parser.add_argument("--packs", nargs="*")
    parser.add_argument("--count", type=int, default=12, help="held-out materials")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--captures", type=int, default=1, help="single photographs of every material")
    parser.add_argument("--faults", action="store_true", help="also photographs with faults")
    parser.add_argument("--fit", type=int, nargs="*", default=[], help="numbers of photos to fit")
    parser.add_argument("--rates", type=float, nargs="*", default=[0.03])
    parser.add_argument("--iterations", type=int, nargs="*", default=[150])
    parser.add_argument("--residual", action="store_true")
    parser.add_argument("--each", action="store_true", help="print every material")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--sheet", help="PNG: truth, start and fit renderings")
    args = parser.parse_args()
    if bool(args.photo) == bool(args.models):
        parser.error("--photo or --models")
    torch.set_num_threads(args.threads)
    photo = load_photo(args)
    if args.materials:
        names, truth = validation_materials(args.materials, args.size)
    else:
        truth = held_out_materials(args.packs, args.count, args.size)
        names = [str(i) for i in range(len(truth))]
    for faulty in (False, True) if args.faults else (False,):
        evaluate_photo(photo, truth, names, args.captures, faulty, args.each)
    images = [truth, start_maps(photo, *capture(truth, 1))]
    if args.autoencoder:
        autoencoder, state = load_ema(AutoEncoder(), args.autoencoder)
        print(f"auto-encoder: {state['step']} steps, {state['samples']} samples")
        images = evaluate_fits(args, autoencoder.requires_grad_(False), photo, truth)
    if args.sheet:
        write_sheet(args.sheet, images)


if __name__ == "__main__":
    main()
