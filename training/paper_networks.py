"""The (large) auto-encoder of Gao et al. 2019, for comparison. Tensors are NCHW."""

import torch
from torch import nn

from networks import SLOPE


def _paper_widths(inner, width):
    return [max(8, round(w * width)) for w in inner]


class PaperEncoder(nn.Module):
    """The encoder of Gao et al. 2019 (paper profile): 12 channels in (normal,
    kd, roughness x3, ks) -> [B, 512 width, H/32, W/32]. ``normalisation``: none,
    last (the paper's: no scale or bias) or all layers; ``width`` scales the number of channels."""

    def __init__(self, normalisation="last", width=1.0):
        super().__init__()
        widths = [12, *_paper_widths([64, 128, 256, 512, 512], width)]
        layers = []
        for i in range(5):
            layers.append(nn.Conv2d(widths[i], widths[i + 1], 4, 2, 1))
            if i < 4:
                if normalisation == "all":
                    layers.append(nn.BatchNorm2d(widths[i + 1]))
                layers.append(nn.LeakyReLU(SLOPE))
        self.body = nn.Sequential(*layers)
        self.norm = nn.Identity() if normalisation == "none" else nn.BatchNorm2d(widths[5], affine=False)

    def forward(self, x):
        return self.norm(self.body(x).float())


class PaperDecoder(nn.Module):
    """The decoder of Gao et al. 2019 (paper profile): [B, 512 width, h, w] -> 9
    channels [B, 9, 32 h, 32 w] through tanh."""

    def __init__(self, normalisation="last", width=1.0):
        super().__init__()
        widths = [*_paper_widths([512, 512, 256, 128, 64], width), 9]
        layers = []
        for i in range(5):
            layers += [nn.LeakyReLU(SLOPE), nn.ConvTranspose2d(widths[i], widths[i + 1], 4, 2, 1)]
            if normalisation == "all" and i < 4:
                layers.append(nn.BatchNorm2d(widths[i + 1]))
        self.body = nn.Sequential(*layers)

    def forward(self, z):
        return torch.tanh(self.body(z).float())


class PaperAutoEncoder(nn.Module):
    """Both, from and to encoded maps [B, 9, H, W]."""

    def __init__(self, normalisation="last", width=1.0):
        super().__init__()
        self.encoder_body = PaperEncoder(normalisation, width)
        self.decoder = PaperDecoder(normalisation, width)
        for m in self.modules():
            if isinstance(m, (nn.Conv2d, nn.ConvTranspose2d)):
                nn.init.normal_(m.weight, 0.0, 0.02)
                nn.init.zeros_(m.bias)

    def encoder(self, x):
        return self.encoder_body(paper_encoder_input(x))


def paper_encoder_input(e):
    """Encoded maps [B, 9, H, W] -> the paper encoder's 12 channels: unit
    normal, kd, roughness x3, ks, all in [-1, 1]."""
    slope = 2 * e[:, 0:2]
    inv = torch.rsqrt((slope**2).sum(1, keepdim=True) + 1)
    return torch.cat([slope * inv, inv, e[:, 2:5], e[:, 8:9].expand(-1, 3, -1, -1), e[:, 5:8]], 1)
