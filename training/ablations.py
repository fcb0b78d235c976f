"""Table of ablations: auto-encoders of train_paper.py, compared on known materials.

    ablations.py --photo photo.pt --materials FOLDER WORK...

Every WORK folder holds a training of train_paper.py with the same budget. For each: how well the
truth passes through the auto-encoder, and fits of its code (Adam, from the photo network's maps)
to several numbers of photos, at the best of a few rates. RMSE of renderings, as in evaluate.py.
"""

import argparse
import os

import torch
from torch.nn import functional as F

from evaluate import capture, errors, fit, start_maps, validation_materials
from paper_networks import PaperAutoEncoder
from renderer import render
from schedule import load_ema, load_photo_network


def load(folder):
    """Auto-encoder of a training; its kind is told from the weights."""
    path = os.path.join(folder, "paper.pt")
    weights = torch.load(path, map_location="cpu")["ema"]
    means = [name for name in weights if name.endswith("running_mean")]
    normalisation = {0: "none", 1: "last"}.get(len(means), "all")
    model = PaperAutoEncoder(normalisation, weights["encoder_body.body.0.weight"].shape[0] / 64)
    model, state = load_ema(model, path)
    model.requires_grad_(False)
    return model, state["step"]


def rendering_error(maps, truth):
    return float(errors(maps, truth)["render"].mean())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("works", nargs="+", metavar="WORK")
    parser.add_argument("--photo", required=True)
    parser.add_argument("--materials", required=True)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--photos", type=int, nargs="*", default=[1, 5])
    parser.add_argument("--rates", type=float, nargs="*", default=[0.01, 0.03, 0.1])
    parser.add_argument("--iterations", type=int, default=200)
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    photo, _ = load_photo_network(args.photo)
    photo.requires_grad_(False)
    _, truth = validation_materials(args.materials, 256)
    truth = F.interpolate(truth, (args.size, args.size), mode="area")
    draw = torch.compile(render, dynamic=False)
    captures = {n: capture(truth, n) for n in args.photos}
    starts = {n: start_maps(photo, *(x[:, :1] for x in c)) for n, c in captures.items()}
    print("| | encoded truth | encoded start | " + " | ".join(f"{n} photos | rate" for n in args.photos) + " |")
    print("|---" * (3 + 2 * len(args.photos)) + "|")
    for work in args.works:
        model, steps = load(work)
        through = lambda maps: rendering_error(model.decoder(model.encoder(maps)), truth)
        cells = [f"{through(truth):.4f}", f"{through(starts[args.photos[0]]):.4f}"]
        for n in args.photos:
            tried = []
            for rate in args.rates:
                maps, _ = fit(
                    model.encoder, model.decoder, starts[n], *captures[n], rate, args.iterations, draw=draw
                )
                tried.append((rendering_error(maps, truth), rate))
            best, rate = min(tried)
            cells += [f"{best:.4f}", f"{rate:g}"]
        print(f"| {os.path.basename(work)}, {steps} steps | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
