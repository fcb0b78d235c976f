"""Write materials as folders of PNG images of 256x256 texels, for
``svbrdf-eval fits`` to photograph: augmented crops of packs' training materials
(see data.py), and procedural ones; and licences.json, the number of materials by licence."""

import argparse
import json
import os

import numpy as np
import torch
from PIL import Image

from data import OWN_LICENCE, MaterialPool, augment
from procedural import FAMILIES, generate
from renderer import decode_maps

SIDE = 256


def srgb(v):
    return np.where(v <= 0.0031308, v * 12.92, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)


def write_material(folder, e):
    """Encoded maps [9, S, S]."""
    slope, kd, ks, roughness = (m.permute(1, 2, 0).numpy() for m in decode_maps(e))
    normal = np.concatenate([slope, np.ones_like(slope[..., :1])], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    os.makedirs(folder, exist_ok=True)
    images = {
        "normal": np.round(normal * 127.5 + 127.5),
        "diffuse": srgb(kd) * 255 + 0.5,
        "specular": srgb(ks) * 255 + 0.5,
        "roughness": roughness[..., 0] * 255 + 0.5,
    }
    for name, image in images.items():
        Image.fromarray(image.clip(0, 255).astype(np.uint8)).save(os.path.join(folder, f"{name}.png"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--packs", nargs="*", default=[])
    parser.add_argument("--out", required=True)
    parser.add_argument("--count", type=int, default=720, help="of packs")
    parser.add_argument("--procedural", type=int, default=130, help="procedural ones, every second augmented")
    parser.add_argument("--real-share", type=float, default=None, help="how often a real material of the packs is drawn")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)
    pool = MaterialPool(args.packs, real_share=args.real_share)
    for i in range(args.count):
        e = pool.batch(1, SIDE, rng, blended=float(i % 4 == 0))[0]
        write_material(os.path.join(args.out, f"pack-{args.seed}-{i:04}"), e)
    names = list(FAMILIES)
    for i in range(args.procedural):
        e = torch.from_numpy(generate(names[i % len(names)], SIDE, 910000 + 1000 * args.seed + i))[None]
        if i % 2:
            e = augment(e, torch.zeros(1, dtype=torch.bool))
        write_material(os.path.join(args.out, f"procedural-{args.seed}-{i:04}"), e[0])
    licences = pool.licences()
    licences[OWN_LICENCE] = licences.get(OWN_LICENCE, 0) + args.procedural
    with open(os.path.join(args.out, "licences.json"), "w") as f:
        json.dump(licences, f)


if __name__ == "__main__":
    main()
