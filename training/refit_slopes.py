"""Least squares for the slopes in the photo network's last layer.

    refit_slopes.py --photo photo.pt --packs real proc --out refitted.pt [--samples 200]

A network of a finite training, and one whose photographs have become harder since,
shows relief by more or less than it knows of it. With all other layers held, the
last one, a transposed convolution, is linear before its tanh: one Gauss-Newton step
over photographs of whole samples gives the slopes of least mean square error.
"""

import argparse

import numpy as np
import torch
from torch.nn import functional as F

from data import MaterialPool
from schedule import load_photo_network
from train_photo import FRAME, make_example

# Kernel index and offset of the input of the two taps of an even and an odd output row (or column)
TAPS = (((1, 0), (3, -1)), ((2, 0), (0, 1)))


def phase_inputs(features, row, column):
    """What the outputs (2 m + row, 2 n + column) are linear in: features [B, C, h, w]
    -> [B, 4 C, h, w], tap by tap."""
    height, width = features.shape[-2:]
    padded = F.pad(features, (1, 1, 1, 1))
    offsets = [(dy, dx) for _, dy in TAPS[row] for _, dx in TAPS[column]]
    return torch.cat([padded[:, :, 1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width] for dy, dx in offsets], 1)


class NormalEquations:
    """Of the four phases and two slopes; the bias, common to the phases, is held."""

    def __init__(self, layer):
        self.layer = layer
        size = 4 * layer.in_channels
        self.matrix = torch.zeros(2, 2, 2, size, size, dtype=torch.float64)
        self.vector = torch.zeros(2, 2, 2, size, dtype=torch.float64)

    def add(self, features, truth, share, rng):
        """``truth`` [B, 9, H, W]; of all texels a random ``share`` counts."""
        found = torch.tanh(self.layer(features))[:, :2]
        for row in (0, 1):
            for column in (0, 1):
                inputs = phase_inputs(features, row, column).permute(0, 2, 3, 1).flatten(0, 2)
                keep = torch.from_numpy(np.flatnonzero(rng.random(len(inputs)) < share))
                inputs = inputs[keep]
                y, x = (e[:, :2, row::2, column::2].permute(1, 0, 2, 3).flatten(1)[:, keep] for e in (found, truth))
                for c in (0, 1):
                    gain = 1 - y[c] ** 2
                    a = inputs * gain[:, None]
                    self.matrix[row, column, c] += (a.T @ a).double()
                    self.vector[row, column, c] += (a.T @ (x[c] - y[c])).double()

    def step(self, damping):
        """Adds the step of least squares to the layer; ``damping`` relative to the mean curvature."""
        channels = self.layer.in_channels
        for row in (0, 1):
            for column in (0, 1):
                kernel = [(ky, kx) for ky, _ in TAPS[row] for kx, _ in TAPS[column]]
                for c in (0, 1):
                    m, v = self.matrix[row, column, c], self.vector[row, column, c]
                    m = m + damping * m.diagonal().mean() * torch.eye(len(v), dtype=m.dtype)
                    step = torch.linalg.solve(m, v).float().view(4, channels)
                    for (ky, kx), s in zip(kernel, step):
                        self.layer.weight[:, c, ky, kx] += s


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photo", required=True, help="checkpoint")
    parser.add_argument("--packs", nargs="+", required=True)
    parser.add_argument("--out", required=True, help="checkpoint to write")
    parser.add_argument("--samples", type=int, default=200)
    parser.add_argument("--batch", type=int, default=4)
    parser.add_argument("--share", type=float, default=0.25, help="of the texels that count")
    parser.add_argument("--damping", type=float, default=1e-3)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)
    network, state = load_photo_network(args.photo)
    pool = MaterialPool(args.packs)
    equations = NormalEquations(network.out)
    with torch.no_grad():
        for _ in range(args.samples // args.batch):
            truth = pool.batch(args.batch, FRAME, rng)
            photos = make_example(truth)[:, 0]
            equations.add(network.last(*network.features(photos)), truth, args.share, rng)
        equations.step(args.damping)
    state = {k: state[k] for k in ("step", "samples", "licences", "options") if k in state}
    torch.save({**state, "ema": network.state_dict()}, args.out)


if __name__ == "__main__":
    main()
