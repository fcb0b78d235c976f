"""Training data: packing of material folders, random crops, augmentation.

A *pack* is a folder with ``level512.npy`` and ``level256.npy`` (float16
[M, 9, S, S] encoded maps, see renderer.py) and ``meta.json``: under
``materials`` one entry per material (id, tier, licence, held_out), under
``licences`` how many materials each licence has. Tier ``A``: physical roughness
and F0; ``B``: spatial detail real, absolute roughness and F0 not; ``P``: procedural.
"""

import argparse
import collections
import csv
import hashlib
import json
import math
import os
import re
import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import torch
from torch.nn import functional as F

from renderer import MAX_SLOPE, decode_maps, encode_maps

SIZE = 512

# Licences under which derived weights carry no condition beyond attribution
PERMISSIVE = {"CC0-1.0", "CC-BY-3.0", "CC-BY-4.0", "project"}
# The licence of materials that this project generates
OWN_LICENCE = "project"


# --------------------------------------------------------------- licences


def is_permissive(licence):
    """Whether a licence text of a manifest is permissive. Of alternatives
    ("A or B") one suffices; of licences that differ by file ("A / B") all must
    be. Remarks in parentheses do not count."""
    text = re.sub(r"\(.*?\)", "", licence)
    needed = [part.strip() for part in text.split("/")]
    return all(any(one.strip() in PERMISSIVE for one in part.split(" or ")) for part in needed)


def count_licences(entries):
    """Number of materials by licence, most frequent first."""
    return dict(collections.Counter(e["licence"] for e in entries).most_common())


# ---------------------------------------------------------------- packing


def srgb_to_linear(v):
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def _image(folder, stem):
    from PIL import Image

    for ext in ("png", "jpg", "jpeg"):
        path = os.path.join(folder, f"{stem}.{ext}")
        if os.path.exists(path):
            image = np.asarray(Image.open(path))
            scale = 65535.0 if image.dtype == np.uint16 or image.dtype == np.int32 else 255.0
            return image.astype(np.float32) / scale
    raise FileNotFoundError(os.path.join(folder, stem + ".{png,jpg,jpeg}"))


def load_material(folder):
    """Folder with normal, diffuse, specular (sRGB) and roughness (linear)
    images -> encoded maps [9, H, W] float32."""
    normal = _image(folder, "normal")[..., :3] * 2 - 1
    # 8-bit normals: 128 stands for zero
    normal = np.where(np.abs(normal) < 0.5 / 127.5, 0, normal)
    z = np.maximum(normal[..., 2:3], 0.2)
    slope = normal[..., :2] / z
    kd = srgb_to_linear(_image(folder, "diffuse"))
    ks = srgb_to_linear(_image(folder, "specular"))
    roughness = _image(folder, "roughness")
    if kd.ndim == 2:
        kd = np.repeat(kd[..., None], 3, -1)
    if ks.ndim == 2:
        ks = np.repeat(ks[..., None], 3, -1)
    if roughness.ndim == 3:
        roughness = roughness[..., :1]
    else:
        roughness = roughness[..., None]
    to = lambda a: torch.from_numpy(np.ascontiguousarray(a[..., :3].transpose(2, 0, 1), dtype=np.float32))
    return encode_maps(to(slope), to(kd), to(ks), to(roughness))


def to_square(e, size=SIZE):
    """Tile small or oblong (tileable) maps, then resample to size x size."""
    _, h, w = e.shape
    if h != w:
        side = max(h, w)
        e = e.repeat(1, max(1, side // h), max(1, side // w))
        side = min(e.shape[1:])
        e = e[:, :side, :side]
    if e.shape[1] * 2 <= size:
        e = e.repeat(1, size // e.shape[1], size // e.shape[2])
    return F.interpolate(e[None], (size, size), mode="bilinear", antialias=True, align_corners=False)[0].clamp(-1, 1)


def held_out(identifier, percent=6):
    """Stable choice of the held-out training materials (never trained on)."""
    return int(hashlib.sha256(identifier.encode()).hexdigest(), 16) % 100 < percent


class PackWriter:
    """Writes a pack of ``count`` materials."""

    def __init__(self, folder, count):
        os.makedirs(folder, exist_ok=True)
        self.folder = folder
        self.levels = {
            s: np.lib.format.open_memmap(
                os.path.join(folder, f"level{s}.npy"), "w+", np.float16, (count, 9, s, s)
            )
            for s in (SIZE, SIZE // 2)
        }
        self.meta = []

    def add(self, identifier, tier, licence, e):
        i = len(self.meta)
        self.levels[SIZE][i] = e.numpy()
        half = F.avg_pool2d(e[None], 2)[0]
        self.levels[SIZE // 2][i] = half.numpy()
        entry = {"id": identifier, "tier": tier, "licence": licence, "held_out": held_out(identifier)}
        self.meta.append(entry)

    def close(self):
        for level in self.levels.values():
            level.flush()
        with open(os.path.join(self.folder, "meta.json"), "w") as f:
            json.dump({"licences": count_licences(self.meta), "materials": self.meta}, f, indent=0)


def read_meta(folder):
    """Entries of the materials of a pack."""
    with open(os.path.join(folder, "meta.json")) as f:
        return json.load(f)["materials"]


def list_materials(materials, licences="all"):
    """Materials of a folder: (id, tier, licence) of the rows of its
    manifest.csv (columns id, licence, tier, ...). Rows without a licence are
    skipped, with ``licences`` "permissive" all others than permissive ones too.
    Without a manifest every sub-folder is taken as tier A of unknown licence."""
    manifest = os.path.join(materials, "manifest.csv")
    if os.path.exists(manifest):
        with open(manifest, newline="") as f:
            rows = [(r["id"], r.get("tier") or "A", (r.get("licence") or "").strip()) for r in csv.DictReader(f)]
        rows = [r for r in rows if r[2]]
    else:
        folders = (d for d in sorted(os.listdir(materials)) if os.path.isdir(os.path.join(materials, d)))
        rows = [(d, "A", "unknown") for d in folders]
    return [r for r in rows if licences == "all" or is_permissive(r[2])]


def load_square(folder):
    """Maps of a material folder as a pack holds them, array [9, SIZE, SIZE]."""
    torch.set_num_threads(1)
    return to_square(load_material(folder)).numpy()


def pack_folder(materials, out, licences="all", jobs=1):
    """Pack the materials of a folder that :func:`list_materials` gives, in ``jobs``
    processes; returns their number by licence."""
    rows = list_materials(materials, licences)
    if not rows:
        raise SystemExit(f"{materials}: no material with a {licences} licence")
    writer = PackWriter(out, len(rows))
    with ProcessPoolExecutor(jobs) as pool:
        loaded = pool.map(load_square, [os.path.join(materials, r[0]) for r in rows], chunksize=4)
        for row, maps in zip(rows, loaded):
            writer.add(*row, torch.from_numpy(maps))
    writer.close()
    return count_licences(writer.meta)


# ---------------------------------------------------------------- sampling


def rotate_flip(e, turns, flip):
    """Rotate maps [..., 9, S, S] by ``turns`` quarter turns counter-clockwise
    and mirror them in X if ``flip``; slopes follow."""
    e = torch.rot90(e, turns, (-2, -1))
    sx, sy = e[..., 0:1, :, :], e[..., 1:2, :, :]
    for _ in range(turns % 4):
        sx, sy = -sy, sx
    if flip:
        sx = -sx
    e = torch.cat([sx, sy, e[..., 2:, :, :]], -3)
    return torch.flip(e, (-1,)) if flip else e


def smooth_noise(batch, size, device, cells):
    """Smooth random field [B, 1, S, S], roughly standard normal."""
    n = torch.randn(batch, 1, cells, cells, device=device)
    return F.interpolate(n, (size, size), mode="bicubic", align_corners=True)


def waves(batch, size, device):
    """Slopes [B, 2, S, S] of a smooth height field, 0.01 to 0.15 on average."""
    share = torch.rand(batch, 1, 1, 1, device=device)
    height = share * smooth_noise(batch, size, device, 6) / 6 + (1 - share) * smooth_noise(batch, size, device, 15) / 15
    rise = lambda axis: torch.roll(height, -1, axis) - torch.roll(height, 1, axis)
    slope = F.pad(torch.cat([-rise(3), rise(2)], 1)[..., 1:-1, 1:-1], (1, 1, 1, 1), mode="replicate")
    level = torch.exp(torch.rand(batch, 1, 1, 1, device=device) * math.log(15.0)) * 0.01
    return slope * (level / (slope**2).mean((1, 2, 3), keepdim=True).sqrt())


def slice_crop(source, y, x, side, size, turns, flip):
    """Square of ``side`` texels of maps [9, S, S] at row y, column x, resampled to
    ``size``, rotated by quarter turns and mirrored: [9, size, size]."""
    e = source[:, y : y + side, x : x + side].float()
    if side != size:
        e = F.interpolate(e[None], (size, size), mode="bilinear", align_corners=False)[0]
    return rotate_flip(e, turns, flip)


def gather_crops(level, places, size):
    """What :func:`slice_crop` gives, for a whole batch on a GPU: level
    [M, 9, S, S], places [B, 6] (material, y, x, side, turns, flip) ->
    [B, 9, size, size]."""
    index, y, x, side, turns, flip = (p.view(-1, 1, 1) for p in places.to(level.device).unbind(1))
    t = torch.arange(size, device=level.device)
    row, column = t.view(1, -1, 1).expand(len(places), -1, size), t.view(1, 1, -1).expand(len(places), size, -1)
    column = torch.where(flip > 0, size - 1 - column, column)
    for turn in (1, 2, 3):
        turned = turns >= turn
        row, column = torch.where(turned, column, row), torch.where(turned, size - 1 - row, column)

    def taps(at, first):
        p = ((at + 0.5) * side / size - 0.5).clamp_min(0)
        low = p.floor().long().minimum(side - 1)
        return first + low, first + (low + 1).minimum(side - 1), (p - low)[..., None]

    (y0, y1, fy), (x0, x1, fx) = taps(row, y), taps(column, x)
    at = lambda r, c: level[index, :, r, c].float()
    e = torch.lerp(torch.lerp(at(y0, x0), at(y0, x1), fx), torch.lerp(at(y1, x0), at(y1, x1), fx), fy)
    e = e.permute(0, 3, 1, 2)
    sx, sy = e[:, 0], e[:, 1]
    for turn in (1, 2, 3):
        sx, sy = torch.where(turns >= turn, -sy, sx), torch.where(turns >= turn, sx, sy)
    return torch.cat([torch.where(flip > 0, -sx, sx)[:, None], sy[:, None], e[:, 2:]], 1)


class MaterialPool:
    """Materials of several packs: on a GPU in its memory (5.9 MB each), else mapped
    from the files. A folder whose pack is still being written joins with
    :meth:`refresh`. ``real_share``: how often a real material is drawn; None: as
    often as their number says."""

    WEIGHT = {"A": 2.0, "B": 1.0, "P": 1.3}

    def __init__(self, folders, device="cpu", subset="train", real_share=None):
        self.device = torch.device(device)
        self.waiting, self.subset, self.real_share = list(folders), subset, real_share
        self.entries = []  # (pack, index, meta)
        self.packs = []
        self.stacked = None
        self.refresh()

    def refresh(self):
        """Take in the packs that are complete by now."""
        ready = [f for f in self.waiting if os.path.exists(os.path.join(f, "meta.json"))]
        if not ready:
            if not self.packs:
                raise SystemExit(f"{', '.join(self.waiting)}: no pack")
            return
        for folder in ready:
            arrays = [np.load(os.path.join(folder, f"level{s}.npy"), mmap_mode="r") for s in (SIZE, SIZE // 2)]
            with warnings.catch_warnings():  # the files are mapped for reading only
                warnings.simplefilter("ignore")
                levels = [torch.from_numpy(a) for a in arrays]
            for i, m in enumerate(read_meta(folder)):
                if self.subset == "all" or (self.subset == "held_out") == m["held_out"]:
                    self.entries.append((len(self.packs), i, m))
            self.packs.append(levels)
            if self.device.type == "cuda":
                on_gpu = [level.to(self.device) for level in levels]
                old = self.stacked
                self.stacked = [torch.cat([o, n]) for o, n in zip(old, on_gpu)] if old else on_gpu
            self.waiting.remove(folder)
        starts = np.cumsum([0] + [len(p[0]) for p in self.packs])
        self.numbers = np.array([starts[pack] + i for pack, i, _ in self.entries])
        weight = np.array([self.WEIGHT[m["tier"]] for _, _, m in self.entries])
        real = np.array([m["tier"] != "P" for _, _, m in self.entries])
        if self.real_share is not None and 0 < real.sum() < len(real):
            weight[real] *= self.real_share / weight[real].sum()
            weight[~real] *= (1 - self.real_share) / weight[~real].sum()
        self.probability = weight / weight.sum()

    def __len__(self):
        return len(self.entries)

    def licences(self):
        """Number of materials by licence."""
        return count_licences([m for _, _, m in self.entries])

    def whole(self, index, size=256):
        """Maps of one material, unaugmented [9, size, size]."""
        pack, i, _ = self.entries[index]
        level, half = self.packs[pack]
        if size == SIZE // 2:
            return half[i].float()
        return F.interpolate(level[i : i + 1].float(), (size, size), mode="bilinear", antialias=True)[0]

    def places(self, picks, size, rng, frame):
        """Random crops of ``size`` texels out of samples of ``frame`` of the materials
        ``picks``: whether of the halved level [B], and [B, 6] of (material, y, x, side,
        turns, flip)."""
        n = len(picks)
        side = np.round(size * 2 ** rng.uniform(0, np.log2(SIZE / frame), n)).astype(int)
        halved = side >= 2 * size
        full, side = np.where(halved, SIZE // 2, SIZE), np.where(halved, side // 2, side)
        y, x = (np.floor(rng.random(n) * (full - side + 1)).astype(int) for _ in range(2))
        return halved, np.stack([self.numbers[picks], y, x, side, rng.integers(4, size=n), rng.integers(2, size=n)], 1)

    def crops(self, picks, size, rng, frame):
        """Random crops [B, 9, size, size] of the materials ``picks``."""
        halved, places = self.places(picks, size, rng, frame)
        if self.stacked is None:
            out = []
            for i, half, (_, *square, turns, flip) in zip(picks, halved, places.tolist()):
                pack, index, _ = self.entries[i]
                out.append(slice_crop(self.packs[pack][int(half)][index], *square, size, turns, flip))
            return torch.stack(out)
        out = torch.empty(len(picks), 9, size, size, device=self.device)
        for level in (0, 1):
            chosen = np.flatnonzero(halved == level)
            if len(chosen):
                table = torch.from_numpy(places[chosen])
                out[torch.from_numpy(chosen).to(self.device)] = gather_crops(self.stacked[level], table, size)
        return out

    def batch(self, batch, size, rng, change=None, blended=0.4, frame=None):
        """Augmented training batch [B, 9, size, size]; the first ``blended``
        part of it are blends of two materials. ``change``: the augmentation
        (a compiled :func:`augment`). ``frame``: the crops are parts of samples of
        so many texels, and have their texel size."""
        second = int(round(blended * batch))
        picks = rng.choice(len(self.entries), batch + second, p=self.probability)
        maps = self.crops(picks, size, rng, frame or size)
        b_like = torch.tensor([self.entries[i][2]["tier"] == "B" for i in picks], device=self.device)
        maps = (change or augment)(maps, b_like)
        if second == 0:
            return maps
        return torch.cat([blend_maps(maps[:second], maps[batch:]), maps[second:batch]])


def blend_maps(first, second, printed=0.2):
    """Blend pairs by a constant weight or along a random smooth mask; ``printed`` of
    them have the relief and roughness of the first and the colours of the second,
    so that colours need not tell relief."""
    batch, _, size, _ = first.shape
    device = first.device
    constant = torch.rand(batch, 1, 1, 1, device=device).expand(-1, 1, size, size)
    noise = smooth_noise(batch, size, device, 5) + 0.35 * smooth_noise(batch, size, device, 17)
    sharp = torch.exp(torch.rand(batch, 1, 1, 1, device=device) * 4.0)
    mask = torch.sigmoid(sharp * (noise + 0.6 * torch.randn(batch, 1, 1, 1, device=device)))
    pick = torch.rand(batch, 1, 1, 1, device=device) < 0.4
    alpha = torch.where(pick, constant, mask).expand(-1, first.shape[1], -1, -1)
    colours = torch.zeros(1, first.shape[1], 1, 1, device=device)
    colours[:, 2:8] = 1
    print_only = torch.rand(batch, 1, 1, 1, device=device) < printed
    return torch.lerp(first, second, torch.where(print_only, colours, alpha))


def augment(e, b_like):
    """Random changes of appearance. e [B, 9, S, S]; b_like [B] marks
    materials whose absolute roughness and F0 mean nothing."""
    batch, device = e.shape[0], e.device
    slope, kd, ks, roughness = decode_maps(e)

    def u(low, high, channels=1):
        return torch.rand(batch, channels, 1, 1, device=device) * (high - low) + low

    def g(sigma, channels=1):
        return torch.exp(sigma * torch.randn(batch, channels, 1, 1, device=device))

    def chance(p):
        return torch.rand(batch, 1, 1, 1, device=device) < p

    b_like = b_like.view(-1, 1, 1, 1)

    # normals
    slope = slope * torch.where(chance(0.7), g(0.45).clamp(0.25, 2.5), torch.ones(1, device=device))
    # patterned and nearly flat: polished, printed, laminated
    slope = slope * torch.where(chance(0.1), u(0.0, 0.25), torch.ones(1, device=device))
    # diffuse: saturation, hue, brightness
    lum = kd.mean(1, keepdim=True)
    recolour = chance(0.6)
    coloured = (lum + (kd - lum) * u(0.1, 1.7)).clamp_min(0) * g(0.35) * g(0.18, 3)
    kd = torch.where(recolour, coloured, kd).clamp(0.0, 0.95)
    # specular and roughness
    mean_s = ks.mean((1, 2, 3), keepdim=True).clamp_min(1e-3)
    contrast = u(0.3, 1.8)
    relative = (ks.mean(1, keepdim=True) / mean_s).clamp(0.05, 8) ** contrast
    dielectric = 0.04 * g(0.35)
    wide = torch.exp(u(float(np.log(0.03)), float(np.log(0.45))))
    target = torch.where(chance(0.65), dielectric, wide)
    tint = torch.where(chance(0.75), torch.ones(1, 3, 1, 1, device=device), g(0.2, 3))
    remapped = relative * target * tint
    ks = torch.where(b_like & chance(0.85), remapped, ks * torch.where(chance(0.5), g(0.2), torch.ones(1, device=device)))
    # turn some into metals: the diffuse colour (or a tint) becomes F0
    metal = torch.where(b_like, chance(0.13), chance(0.05))
    lum2 = kd.mean(1, keepdim=True).clamp_min(0.02)
    level = lum2.mean((2, 3), keepdim=True)
    metal_f0 = u(0.35, 0.95) * (1 + 0.6 * u(0, 1) * (lum2 / level - 1)) * (1 + u(0.0, 0.9) * (kd / lum2 - 1))
    ks = torch.where(metal, metal_f0, ks)
    kd = torch.where(metal, kd * u(0.0, 0.12), kd)
    # and some between: bronzed, dusty, or finer than a texel
    share = torch.where(~metal & chance(0.15), u(0.05, 0.7), torch.zeros(1, device=device))
    ks = torch.lerp(ks, metal_f0, share)
    kd = kd * (1 - share)
    ks = ks.clamp(0.01, 0.98)
    # the two albedos share one unit of energy
    kd = torch.minimum(kd, (1.0 - ks).clamp_min(0.0))
    mean_r = roughness.mean((1, 2, 3), keepdim=True)
    flip = torch.where(chance(0.15), -torch.ones(1, device=device), torch.ones(1, device=device))
    new_mean = torch.where(metal, u(0.12, 0.7), u(0.1, 0.95))
    remapped = new_mean + flip * g(0.4) * (roughness - mean_r)
    shifted = roughness + 0.08 * torch.randn(batch, 1, 1, 1, device=device)
    roughness = torch.where((b_like & chance(0.85)) | metal | chance(0.25), remapped, shifted).clamp(0.05, 1.0)
    # a glaze or varnish: smooth waves under an even gloss, so that highlights lie anywhere on the texture
    glazed = chance(0.13)
    smooth = u(0.06, 0.4) + u(0.0, 0.4) * (roughness - mean_r)
    roughness = torch.where(glazed, smooth, roughness).clamp(0.05, 1.0)
    slope = torch.where(glazed, u(0.1, 1.0) * slope + waves(batch, e.shape[-1], device), slope)
    return encode_maps(slope.clamp(-MAX_SLOPE, MAX_SLOPE), kd, ks, roughness)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--materials", default=os.environ.get("SVBRDF_MATERIALS"), required="SVBRDF_MATERIALS" not in os.environ)
    parser.add_argument("--out", required=True, help="pack folder to write")
    parser.add_argument(
        "--licences", choices=("all", "permissive"), default="all", help="permissive: CC0, CC-BY and this project's own"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    for licence, count in pack_folder(args.materials, args.out, args.licences, args.jobs).items():
        print(f"{count:5d} {licence}")


if __name__ == "__main__":
    main()
