"""Recorded fits, which the completion network learns from.

``svbrdf-eval fits MATERIALS --out FITS`` writes, as half floats of 256x256
texels, ``NAME-COUNT.f16``: 72 planes and 9 numbers, and ``NAME-truth.f16``: 9
planes. Maps are *coordinates*: slopes, square roots of diffuse and specular
albedo, roughness. The planes:

    0-8    as refined
    9-17   the latent fit's
    18-26  mean of the refinement's prior
    27-71  covariance in sigmas of the prior, upper triangle by rows

The numbers are the sigmas of the prior.
"""

import glob
import os

import numpy as np
import torch

CHANNELS = 9
SIDE = 256
REFINED, ESTIMATE, MEAN, COVARIANCE, TRUTH = 0, 9, 18, 27, 72
PLANES = TRUTH + CHANNELS
# How features are scaled; as in src/completion.rs
LIMIT, MIDDLE, STRETCH, DIFFERENCE = 4.0, 0.4, 2.0, 0.3

_upper = [(i, j) for i in range(CHANNELS) for j in range(i, CHANNELS)]
PAIR = {pair: COVARIANCE + k for k, (i, j) in enumerate(_upper) for pair in ((i, j), (j, i))}


class Fits:
    """All records of some folders whose number of photographs is asked for."""

    def __init__(self, folders, counts):
        self.records = []
        for truth in sorted(t for f in folders for t in glob.glob(os.path.join(f, "*-truth.f16"))):
            maps = np.memmap(truth, np.float16, "r", shape=(CHANNELS, SIDE, SIDE))
            for count in counts:
                path = truth.replace("-truth.f16", f"-{count}.f16")
                if os.path.exists(path):
                    values = np.memmap(path, np.float16, "r")
                    planes = values[: TRUTH * SIDE * SIDE].reshape(TRUTH, SIDE, SIDE)
                    sigma = values[TRUTH * SIDE * SIDE :].astype(np.float32)
                    self.records.append((planes, maps, sigma, count))

    def __len__(self):
        return len(self.records)

    def whole(self, index):
        """(planes [1, 81, S, S], sigma [1, 9, 1, 1], count [1]) of one record."""
        return self.crops([index], [(0, 0)], SIDE)

    def batch(self, batch, size, rng):
        """The same of random crops, turned and mirrored, colours exchanged."""
        picks = rng.integers(0, len(self.records), batch)
        corners = rng.integers(0, SIDE - size + 1, (batch, 2))
        planes, sigma, count = self.crops(picks, corners, size)
        planes = turned(planes, int(rng.integers(4)), bool(rng.integers(2)))
        return *recoloured(planes, sigma, [int(c) for c in rng.permutation(3)]), count

    def crops(self, picks, corners, size):
        planes = np.empty((len(picks), PLANES, size, size), np.float16)
        for out, pick, (y, x) in zip(planes, picks, corners):
            record, truth = self.records[pick][:2]
            out[:TRUTH] = record[:, y : y + size, x : x + size]
            out[TRUTH:] = truth[:, y : y + size, x : x + size]
        sigma = torch.from_numpy(np.stack([self.records[p][2] for p in picks])).view(-1, CHANNELS, 1, 1)
        count = torch.tensor([float(self.records[p][3]) for p in picks])
        return torch.from_numpy(planes).float(), sigma, count


def turned(x, turns, flip):
    """Planes [B, 81, S, S] turned by quarters counter-clockwise and mirrored in
    X if ``flip``; slopes and their covariances follow."""
    x = torch.rot90(x, turns, (-2, -1))
    if flip:
        x = torch.flip(x, (-1,))
    x = x.clone(memory_format=torch.contiguous_format)

    def swap(i, j, sign):  # (x_i, x_j) = (sign x_j, x_i)
        x[:, i], x[:, j] = sign * x[:, j], x[:, i].clone()

    for _ in range(turns % 4):
        for i in (REFINED, ESTIMATE, MEAN, TRUTH):
            swap(i, i + 1, -1)
        swap(PAIR[0, 0], PAIR[1, 1], 1)
        x[:, PAIR[0, 1]].neg_()
        for j in range(2, CHANNELS):
            swap(PAIR[0, j], PAIR[1, j], -1)
    if flip:
        for i in (REFINED, ESTIMATE, MEAN, TRUTH):
            x[:, i].neg_()
        for j in range(1, CHANNELS):
            x[:, PAIR[0, j]].neg_()
    return x


def recoloured(x, sigma, order):
    """Planes [B, 81, S, S] and sigmas [B, 9, 1, 1] with red, green and blue in
    another order."""
    own = [0, 1, *(2 + c for c in order), *(5 + c for c in order), 8]
    planes = [first + i for first in (REFINED, ESTIMATE, MEAN) for i in own]
    planes += [PAIR[own[i], own[j]] for i, j in _upper]
    planes += [TRUTH + i for i in own]
    return x[:, planes], sigma[:, own]


# Parameters that are measured together
GROUPS = [slice(0, 2), slice(2, 5), slice(5, 8), slice(8, 9)]
LEAST_SCALE, MOST_SCALE = 0.02, 2.0
LEAST_SLOPE = 0.01


def scales(x, sigma):
    """How far a material is off its prior's mean where photographs tell, by
    channel [B, 9, 1, 1], in sigmas: root mean square of each group."""
    off = ((x[:, REFINED:ESTIMATE] - x[:, MEAN:COVARIANCE]) / sigma) ** 2
    told = 1 - x[:, [PAIR[i, i] for i in range(CHANNELS)]].clamp(0, 1)
    parts = []
    for g in GROUPS:
        square = (told * off)[:, g].sum((1, 2, 3), keepdim=True) / (told[:, g].sum((1, 2, 3), keepdim=True) + 1e-3)
        parts.append(square.sqrt().clamp(LEAST_SCALE, MOST_SCALE).expand(-1, g.stop - g.start, -1, -1))
    return torch.cat(parts, 1)


def features(x, sigma, count, scale):
    """The network's input [B, 43, S, S]; ``scale`` as :func:`scales` gives it."""
    refined = x[:, REFINED:ESTIMATE]
    steepness = (refined[:, :2] ** 2).mean((1, 2, 3), keepdim=True).sqrt().clamp_min(LEAST_SLOPE)
    differences = [(x[:, i : i + CHANNELS] - refined) * (DIFFERENCE / (sigma * scale)) for i in (ESTIMATE, MEAN)]
    shown = [PAIR[i, i] for i in range(CHANNELS)] + [PAIR[0, 1]]
    whole = torch.cat([count.view(-1, 1, 1, 1), steepness, scale[:, [g.start for g in GROUPS]]], 1).log()
    planes = [refined[:, :2] / steepness, STRETCH * (refined[:, 2:] - MIDDLE), *differences, x[:, shown]]
    planes.append(whole.expand(-1, -1, *x.shape[-2:]))
    return torch.cat(planes, 1).clamp(-LIMIT, LIMIT)


def _product(x, v):
    out = torch.zeros_like(v)
    for i in range(CHANNELS):
        for j in range(CHANNELS):
            out[:, i].addcmul_(x[:, PAIR[i, j]], v[:, j])
    return out


class _Product(torch.autograd.Function):
    @staticmethod
    def forward(context, x, v):
        context.save_for_backward(x)
        return _product(x, v)

    @staticmethod
    def backward(context, gradient):
        (x,) = context.saved_tensors
        return None, _product(x, gradient.contiguous())  # symmetric


def followed(x, sigma, moved):
    """Coordinates [B, 9, S, S] of the maps refined round a mean that has moved
    by ``moved`` sigmas, to first order."""
    return x[:, REFINED:ESTIMATE] + sigma * _Product.apply(x, moved.float().contiguous())


def encoded(coordinates):
    """Coordinates -> encoded maps within their range (see renderer.py)."""
    slope = coordinates[:, :2].clamp(-2, 2) / 2
    roots = coordinates[:, 2:8].clamp(0, 1)
    roughness = coordinates[:, 8:].clamp(0.05, 1)
    return torch.cat([slope, 2 * roots - 1, 2 * roughness - 1], 1)
