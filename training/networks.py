"""The networks: SVBRDF encoder and decoder, photo network, and the paper's
own (large) auto-encoder. All tensors are NCHW; see renderer.py for the maps."""

import torch
from torch import nn
from torch.nn import functional as F

SLOPE = 0.2
STRIDE = 16


def _act():
    return nn.LeakyReLU(SLOPE)


class Residual(nn.Module):
    """x + conv(lrelu(x)) or x + conv(lrelu(conv(lrelu(x)))), 3x3."""

    def __init__(self, channels, depth=2):
        super().__init__()
        layers = []
        for _ in range(depth):
            layers += [_act(), nn.Conv2d(channels, channels, 3, 1, 1)]
        self.body = nn.Sequential(*layers)
        with torch.no_grad():
            self.body[-1].weight.mul_(0.3)

    def forward(self, x):
        return x + self.body(x)


class Encoder(nn.Module):
    """Encoded maps [B, 9, H, W] -> code [B, C, H/16, W/16], unit variance."""

    def __init__(self, code=128, widths=(48, 96, 160)):
        super().__init__()
        a, b, c = widths
        self.body = nn.Sequential(
            nn.Conv2d(9, a, 4, 4),
            Residual(a, 1),
            _act(),
            nn.Conv2d(a, b, 4, 2, 1),
            Residual(b, 2),
            _act(),
            nn.Conv2d(b, c, 4, 2, 1),
            Residual(c, 2),
            _act(),
            nn.Conv2d(c, code, 3, 1, 1),
        )
        self.norm = nn.BatchNorm2d(code, affine=False, momentum=0.02)

    def forward(self, x):
        z = self.body(x)
        return self.norm(z.float())

    def folded(self):
        """Copy of the layers with the normalisation folded into the last one."""
        import copy

        body = copy.deepcopy(self.body)
        last = body[-1]
        scale = torch.rsqrt(self.norm.running_var + self.norm.eps)
        with torch.no_grad():
            last.weight.mul_(scale[:, None, None, None])
            last.bias.sub_(self.norm.running_mean).mul_(scale)
        return body


class Decoder(nn.Module):
    """Code [B, C, h, w] -> encoded maps [B, 9, 16 h, 16 w].

    Kept as a plain list of operations so that export is a walk over it.
    """

    def __init__(self, code=128, widths=(128, 80, 48)):
        super().__init__()
        a, b, c = widths
        self.code = code
        spec = [
            ("conv", code, a),
            ("save",),
            ("leaky_relu",),
            ("conv", a, a),
            ("add",),
            ("leaky_relu",),
            ("conv_transpose", a, b),
            ("save",),
            ("leaky_relu",),
            ("conv", b, b),
            ("add",),
            ("leaky_relu",),
            ("conv_transpose", b, c),
            ("leaky_relu",),
            ("conv_transpose", c, 36),
            ("depth_to_space", 2),
            ("tanh",),
        ]
        self.spec = spec
        self.layers = nn.ModuleList()
        for s in spec:
            if s[0] == "conv":
                self.layers.append(nn.Conv2d(s[1], s[2], 3, 1, 1))
            elif s[0] == "conv_transpose":
                self.layers.append(nn.ConvTranspose2d(s[1], s[2], 4, 2, 1))
            else:
                self.layers.append(nn.Identity())

    def forward(self, z):
        stack = []
        x = z
        for s, layer in zip(self.spec, self.layers):
            op = s[0]
            if op in ("conv", "conv_transpose"):
                x = layer(x)
            elif op == "leaky_relu":
                x = F.leaky_relu(x, SLOPE)
            elif op == "save":
                stack.append(x)
            elif op == "add":
                x = x + stack.pop()
            elif op == "depth_to_space":
                x = F.pixel_shuffle(x, s[1])
            elif op == "tanh":
                x = torch.tanh(x.float())
        return x


class PhotoNetwork(nn.Module):
    """Photo with geometry [B, 10, H, W] -> encoded maps [B, 9, H, W].

    U-Net from 1/2 to 1/32 resolution; the globally pooled bottleneck is fed
    back at three levels. H, W: multiples of 32.
    """

    def __init__(self, widths=(24, 48, 72, 128, 160)):
        super().__init__()
        a, b, c, d, e = widths
        self.down1 = nn.Conv2d(10, a, 4, 2, 1)  # 1/2
        self.down2 = nn.Conv2d(a, b, 4, 2, 1)  # 1/4
        self.down3 = nn.Conv2d(b, c, 4, 2, 1)  # 1/8
        self.res3 = Residual(c)
        self.down4 = nn.Conv2d(c, d, 4, 2, 1)  # 1/16
        self.res4 = Residual(d)
        self.down5 = nn.Conv2d(d, e, 4, 2, 1)  # 1/32
        self.res5 = Residual(e)
        self.global1 = nn.Conv2d(e, e, 1)
        self.global5 = nn.Conv2d(e, e, 1)
        self.global4 = nn.Conv2d(e, d, 1)
        self.global3 = nn.Conv2d(e, c, 1)
        self.mix5 = nn.Conv2d(e, e, 3, 1, 1)
        self.up4 = nn.ConvTranspose2d(e, d, 4, 2, 1)
        self.mix4 = Residual(d, 1)
        self.up3 = nn.ConvTranspose2d(d, c, 4, 2, 1)
        self.mix3 = Residual(c, 1)
        self.up2 = nn.ConvTranspose2d(c, b, 4, 2, 1)
        self.mix2 = Residual(b, 1)
        self.up1 = nn.ConvTranspose2d(b, a, 4, 2, 1)
        self.mix1 = nn.Conv2d(2 * a, a, 3, 1, 1)
        self.out = nn.ConvTranspose2d(a, 9, 4, 2, 1)

    def forward(self, photo):
        act = lambda x: F.leaky_relu(x, SLOPE)
        x1 = act(self.down1(photo))
        x2 = self.down2(x1)
        x3 = self.res3(self.down3(act(x2)))
        x4 = self.res4(self.down4(act(x3)))
        x5 = self.res5(self.down5(act(x4)))
        g = act(self.global1(F.adaptive_avg_pool2d(act(x5), 1)))
        y = act(x5 + self.global5(g))
        y = act(self.mix5(y) + x5)
        y = self.mix4(self.up4(y) + x4 + self.global4(g))
        y = self.mix3(self.up3(act(y)) + x3 + self.global3(g))
        y = self.mix2(self.up2(act(y)) + x2)
        y = act(self.up1(act(y)))
        y = act(self.mix1(torch.cat([y, x1], 1)))
        return torch.tanh(self.out(y).float())


class PaperEncoder(nn.Module):
    """The encoder of Gao et al. 2019 (paper profile): 12 channels in (normal,
    kd, roughness x3, ks) -> [B, 512, H/32, W/32]."""

    def __init__(self):
        super().__init__()
        widths = [12, 64, 128, 256, 512, 512]
        layers = []
        for i in range(5):
            layers.append(nn.Conv2d(widths[i], widths[i + 1], 4, 2, 1))
            if i < 4:
                layers.append(_act())
        self.body = nn.Sequential(*layers)
        self.norm = nn.BatchNorm2d(512, affine=False)

    def forward(self, x):
        return self.norm(self.body(x).float())


class PaperDecoder(nn.Module):
    """The decoder of Gao et al. 2019 (paper profile): [B, 512, h, w] -> 9
    channels [B, 9, 32 h, 32 w] through tanh."""

    def __init__(self):
        super().__init__()
        widths = [512, 512, 256, 128, 64, 9]
        layers = []
        for i in range(5):
            layers += [_act(), nn.ConvTranspose2d(widths[i], widths[i + 1], 4, 2, 1)]
        self.body = nn.Sequential(*layers)

    def forward(self, z):
        return torch.tanh(self.body(z).float())


def paper_encoder_input(e):
    """Encoded maps [B, 9, H, W] -> the paper encoder's 12 channels: unit
    normal, kd, roughness x3, ks, all in [-1, 1]."""
    slope = 2 * e[:, 0:2]
    inv = torch.rsqrt((slope**2).sum(1, keepdim=True) + 1)
    return torch.cat([slope * inv, inv, e[:, 2:5], e[:, 8:9].expand(-1, 3, -1, -1), e[:, 5:8]], 1)


def multiply_accumulates(module, *inputs):
    """MACs of the convolutions for the given inputs."""
    total = 0

    def hook(m, i, o):
        nonlocal total
        if isinstance(m, nn.Conv2d):
            total += o.numel() // o.shape[0] * m.in_channels * m.kernel_size[0] * m.kernel_size[1]
        else:
            total += i[0].numel() // i[0].shape[0] * m.out_channels * m.kernel_size[0] * m.kernel_size[1]

    handles = [
        m.register_forward_hook(hook)
        for m in module.modules()
        if isinstance(m, (nn.Conv2d, nn.ConvTranspose2d))
    ]
    with torch.no_grad():
        module(*inputs)
    for h in handles:
        h.remove()
    return total
