"""Train the completion network on recorded fits (see fits.py).

The network answers by how many sigmas the mean of the refinement's prior should
move. Loss: distance from the truth, in sigmas, of the maps *refined round that
mean*, by the recorded covariance, so that it need not know what photographs
tell; + log-L1 of their renderings; + a twentieth of the distance of the means
themselves.
"""

import json
import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch

from fits import GROUPS, REFINED, TRUTH, Fits, encoded, features, followed, scales
from networks import CompletionNetwork
from renderer import log_l1, random_configurations, render
from schedule import Run, arguments, load_ema, mixed_precision

# Distance, in sigmas, below which the loss is quadratic
SOFT = 0.1
# Texels a side of what is rendered
RENDERED = 64


def distance(e):
    return torch.sqrt(e * e + SOFT * SOFT).mean()


def moves(network, x, sigma, count, scale):
    """By how many sigmas the network moves the means."""
    return scale * network(features(x, sigma, count, scale)).float()


def losses(network, x, sigma, count, views, rng):
    scale = scales(x, sigma)
    moved = moves(network, x, sigma, count, scale)
    refined, truth = followed(x, sigma, moved), x[:, TRUTH:]
    before = x[:, REFINED : REFINED + 9]
    unit = sigma * scale.sqrt()
    maps = distance((refined - truth) / unit)
    means = distance((before - truth + sigma * moved) / unit)
    side = min(RENDERED, x.shape[-1])
    top, left = (int(v) for v in rng.integers(0, x.shape[-1] - side + 1, 2))
    cut = lambda maps: encoded(maps)[..., top : top + side, left : left + side]
    camera, light = random_configurations(len(x), 1, views - 1, 0, x.device)
    with torch.no_grad():
        image = render(cut(truth), camera, light)
        off = (render(cut(before), camera, light).clamp(0, 1) - image.clamp(0, 1)).square().mean((1, 2, 3, 4)).sqrt()
    found = render(cut(refined), camera, light)
    logarithmic = log_l1(found, image)
    error = ((found.clamp(0, 1) - image.clamp(0, 1)).square().mean((1, 2, 3, 4)) + 1e-6).sqrt()
    return maps, means, logarithmic, (error / (off + 0.003)).mean()


def evaluate(network, fits):
    """Root-mean-square errors before and after, by the number of photographs."""
    torch.manual_seed(5)
    camera, light = random_configurations(1, 3, 5, 0)
    rows = {}
    with torch.no_grad():
        for index in range(len(fits)):
            x, sigma, count = fits.whole(index)
            truth = x[:, TRUTH:]
            after = followed(x, sigma, moves(network, x, sigma, count, scales(x, sigma)))
            row = []
            for maps in (x[:, REFINED : REFINED + 9], after):
                images = [render(encoded(m), camera, light).clamp(0, 1) for m in (maps, truth)]
                errors = [images[0] - images[1], *((maps - truth)[:, g] for g in GROUPS)]
                row.append([math.sqrt(float((e**2).mean())) for e in errors])
            rows.setdefault(int(count), []).append(row)
    names = ("render", "slopes", "roots of diffuse", "of specular", "roughness")
    for count, row in sorted(rows.items()):
        before, after = torch.tensor(row).mean(0)
        ratio = (torch.tensor(row)[:, 1] / torch.tensor(row)[:, 0]).log().mean(0).exp()
        text = [f"{n} {b:.4f} -> {a:.4f} ({r:.2f})" for n, b, a, r in zip(names, before, after, ratio)]
        print(f"{count} photographs: " + ", ".join(text), flush=True)


def main():
    parser = arguments(__doc__, batch=8, lr=1.5e-3, packs=False)
    parser.add_argument("--fits", nargs="+", required=True, help="folders of recorded fits")
    parser.add_argument("--held-out", nargs="*", default=[], help="the same of other materials, to be measured at the end")
    parser.add_argument("--materials", nargs="*", default=[], help="folders of fit_materials.py that were fitted: their licences")
    parser.add_argument("--counts", nargs="+", type=int, default=[2, 3, 5, 8, 12])
    parser.add_argument("--render-weight", type=float, default=0.3)
    parser.add_argument("--init", help="checkpoint whose averaged weights to start from")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    fits = Fits(args.fits, args.counts)
    print(len(fits), "fits")
    network = CompletionNetwork()
    if args.init and not os.path.exists(os.path.join(args.work, "completion.pt")):
        load_ema(network, args.init)
    network = network.to(args.device).to(memory_format=torch.channels_last).train()
    licences = []
    for folder in args.materials:
        with open(os.path.join(folder, "licences.json")) as f:
            licences.append(json.load(f))
    run = Run("completion", network, args, licences=licences)
    picks = np.random.default_rng([args.seed, run.step])

    def load():
        fine = run.progress >= args.fine_from
        return fits.batch(max(2, args.batch // 4) if fine else args.batch, 256 if fine else args.size, picks)

    # Records are read while the batch before is learnt from.
    with ThreadPoolExecutor(1) as reader:
        following = reader.submit(load)
        while run.progress < 1:
            x, sigma, count = (t.to(args.device) for t in following.result())
            following = reader.submit(load)
            with mixed_precision(args.device):
                maps, means, logarithmic, rendering = losses(network, x, sigma, count, args.views, run.rng)
            loss = maps + 0.05 * means + args.render_weight * (logarithmic + rendering)
            run.update(loss, len(x), {"maps": maps.detach(), "render": rendering.detach()})
    run.save()
    if args.held_out:
        network.load_state_dict(run.ema)
        evaluate(network.eval().cpu(), Fits(args.held_out, args.counts))


if __name__ == "__main__":
    main()
