"""The networks: SVBRDF encoder and decoder, photo network, completion network.
All tensors are NCHW; see renderer.py for the maps."""

import torch
from torch import nn
from torch.nn import functional as F

SLOPE = 0.2
STRIDE = 16


def _act():
    return nn.LeakyReLU(SLOPE)


def initialise(module, gain=1.0):
    """He initialisation for leaky ReLU, zero biases. A transposed 4x4 stride-2
    convolution sums 4 taps of every input channel."""
    with torch.no_grad():
        for m in module.modules():
            if isinstance(m, nn.Conv2d):
                fan = m.in_channels * m.kernel_size[0] * m.kernel_size[1]
            elif isinstance(m, nn.ConvTranspose2d):
                fan = m.in_channels * m.kernel_size[0] * m.kernel_size[1] // m.stride[0] ** 2
            else:
                continue
            m.weight.normal_(0, gain * (2 / (1 + SLOPE**2) / fan) ** 0.5)
            m.bias.zero_()


class Residual(nn.Module):
    """x + conv(lrelu(conv(lrelu(x)))), 3x3, ``inner`` channels between; or a
    single x + conv(lrelu(x)) if ``inner`` is 0. ``damp`` scales the branch."""

    def __init__(self, channels, inner=None, damp=0.2):
        super().__init__()
        inner = channels if inner is None else inner
        layers = [_act(), nn.Conv2d(channels, inner or channels, 3, 1, 1)]
        if inner:
            layers += [_act(), nn.Conv2d(inner, channels, 3, 1, 1)]
        self.body = nn.Sequential(*layers)
        self.damp = damp

    def start(self):
        """To be called after :func:`initialise`."""
        with torch.no_grad():
            self.body[-1].weight.mul_(self.damp)

    def forward(self, x):
        return x + self.body(x)


def start(module):
    initialise(module)
    for m in module.modules():
        if isinstance(m, Residual):
            m.start()


# Channels at 1/4, 1/8 and 1/16 of the resolution: auto-encoder
WIDTHS = (40, 64, 192)


class Encoder(nn.Module):
    """Encoded maps [B, 9, H, W] -> code [B, C, H/16, W/16], unit variance.

    A linear trunk of strided convolutions (started as a hierarchical principal
    component analysis, :func:`principal_start`) with nonlinear residuals.
    """

    def __init__(self):
        super().__init__()
        a, b, c = WIDTHS
        self.body = nn.Sequential(
            nn.Conv2d(9, a, 4, 4),
            Residual(a, 56, 0.0),
            nn.Conv2d(a, b, 4, 2, 1),
            Residual(b, 96, 0.0),
            nn.Conv2d(b, c, 4, 2, 1),
            Residual(c, 128, 0.0),
        )
        self.norm = nn.BatchNorm2d(c, affine=False, momentum=0.02)
        start(self)

    def forward(self, x):
        z = self.body(x)
        return self.norm(z.float())

    def folded(self):
        """The layers with the normalisation folded into the last trunk and
        residual convolutions; equal to forward in evaluation mode."""
        return FoldedEncoder(self)


class FoldedEncoder(nn.Module):
    """Encoder for export: code = scale * (trunk + branch) - shift, with the
    scale moved into the convolutions that produce trunk and branch."""

    def __init__(self, encoder):
        super().__init__()
        import copy

        self.body = copy.deepcopy(encoder.body)[:-1]
        self.branch = copy.deepcopy(encoder.body[-1].body)
        scale = torch.rsqrt(encoder.norm.running_var + encoder.norm.eps)
        with torch.no_grad():
            # the branch reads the unscaled trunk: scale its input back
            trunk, first, last = self.body[-1], self.branch[1], self.branch[-1]
            trunk.weight.mul_(scale[:, None, None, None])
            trunk.bias.mul_(scale)
            first.weight.div_(scale[None, :, None, None])  # lrelu commutes with a positive scale
            last.weight.mul_(scale[:, None, None, None])
            last.bias.sub_(encoder.norm.running_mean).mul_(scale)

    def forward(self, x):
        x = self.body(x)
        return x + self.branch(x)


class Decoder(nn.Module):
    """Code [B, C, h, w] -> encoded maps [B, 9, 16 h, 16 w].

    Kept as a plain list of operations so that export is a walk over it.
    """

    def __init__(self):
        super().__init__()
        a, b, c = WIDTHS

        def residual(channels, inner):
            return [
                ("save",),
                ("leaky_relu",),
                ("conv", channels, inner),
                ("leaky_relu",),
                ("conv", inner, channels),
                ("add",),
            ]

        spec = (
            residual(c, 96)
            + [("conv_transpose", c, b)]
            + residual(b, 48)
            + [("conv_transpose", b, a)]
            + [("save",), ("leaky_relu",), ("conv", a, a), ("add",)]
            + [("conv_transpose", a, 36), ("depth_to_space", 2), ("tanh",)]
        )
        self.code = c
        self.spec = spec
        self.layers = nn.ModuleList()
        for s in spec:
            if s[0] == "conv":
                self.layers.append(nn.Conv2d(s[1], s[2], 3, 1, 1))
            elif s[0] == "conv_transpose":
                self.layers.append(nn.ConvTranspose2d(s[1], s[2], 4, 2, 1))
            else:
                self.layers.append(nn.Identity())
        initialise(self)
        with torch.no_grad():  # residual branches start at zero
            for i in range(1, len(spec)):
                if spec[i][0] == "add":
                    self.layers[i - 1].weight.zero_()

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


def principal_start(encoder, decoder, maps, weight):
    """Start both trunks as a hierarchical, whitened principal component
    analysis of training maps [N, 9, S, S]; weight [9] is the importance of the
    channels. Patches of 4x4, then 2x2 of those, then 2x2 again."""
    a, b, c = WIDTHS
    device = maps.device

    def basis(x, patch, count):
        p = F.unfold(x, patch, stride=patch).permute(0, 2, 1).reshape(-1, x.shape[1] * patch * patch)
        mean = p.mean(0)
        p = p - mean
        values, vectors = torch.linalg.eigh((p.T @ p / len(p)).double())
        values, vectors = values.flip(0)[:count].float(), vectors.flip(1)[:, :count].float()
        return mean, values.clamp_min(1e-6), vectors

    def project(x, mean, vectors, patch):
        shape = x.shape
        p = F.unfold(x, patch, stride=patch) - mean[None, :, None]
        return (vectors.T @ p).view(shape[0], -1, shape[2] // patch, shape[3] // patch)

    with torch.no_grad():
        w = weight.to(device).view(1, 9, 1, 1)
        mean_a, _, va = basis(maps * w, 4, a)
        xa = project(maps * w, mean_a, va, 4)
        mean_b, _, vb = basis(xa, 2, b)
        xb = project(xa, mean_b, vb, 2)
        mean_c, values, vc = basis(xb, 2, c)
        sigma = values.sqrt()

        trunk = [m for m in encoder.body if isinstance(m, nn.Conv2d)]
        trunk[0].weight.copy_(va.T.reshape(a, 9, 4, 4) * w)
        trunk[0].bias.copy_(-(va.T @ mean_a))
        for layer, mean, v in ((trunk[1], mean_b, vb), (trunk[2], mean_c, vc / sigma)):
            layer.weight.zero_()
            layer.weight[:, :, 1:3, 1:3] = v.T.reshape(v.shape[1], -1, 2, 2)
            layer.bias.copy_(-(v.T @ mean))

        up = [m for m in decoder.layers if isinstance(m, nn.ConvTranspose2d)]
        for layer, mean, v in ((up[0], mean_c, vc * sigma), (up[1], mean_b, vb)):
            layer.weight.zero_()
            layer.weight[:, :, 1:3, 1:3] = v.T.reshape(v.shape[1], -1, 2, 2)
            layer.bias.copy_(mean.view(-1, 4).mean(1))
        # 4x4 patches through a stride-2 layer and depth_to_space(2); the gain
        # makes up for the tanh
        gain = 1.15
        v = (va.T.reshape(a, 9, 4, 4) / w).view(a, 9, 2, 2, 2, 2)  # (c, Y, dy, X, dx)
        v = v.permute(0, 1, 3, 5, 2, 4).reshape(a, 36, 2, 2)  # (c dy dx, Y, X)
        up[2].weight.zero_()
        up[2].weight[:, :, 1:3, 1:3] = gain * v
        mean = (mean_a.view(1, 9, 4, 4) / w).mean((2, 3)).view(9, 1).expand(9, 4).reshape(36)
        up[2].bias.copy_(gain * mean)


# Planes of a photo with its geometry, see train_photo.photo_input
PHOTO_CHANNELS = 14


def widen_photo_input(state):
    """Weights of a photo network from when there were fewer planes: the new
    ones count for nothing to begin with."""
    weight = state["down1.weight"]
    missing = PHOTO_CHANNELS - weight.shape[1]
    return {**state, "down1.weight": F.pad(weight, (0, 0, 0, 0, 0, missing))}


class PhotoNetwork(nn.Module):
    """Photos with geometry [B, N, PHOTO_CHANNELS, H, W] -> encoded maps [B, 9, H, W].

    U-Net from 1/2 to 1/32 resolution; the globally pooled bottleneck is fed
    back at three levels. Every photo goes down alone; the features of all
    photos are pooled at each level, half of the channels by their maximum, half
    by their mean: any number of photos in any order. H, W: multiples of 32.

    With ``spread`` there is a second head, see :meth:`predict`. It learns from the
    features without changing them. ``rounds``: how often the residual blocks at
    1/16 and 1/32 are passed, with the same weights: more computation, not more to store.
    """

    # Logarithm of the standard deviation of an encoded map: middle and half the range
    LOG_SIGMA = (-2.5, 2.5)

    def __init__(self, widths=(24, 48, 72, 128, 160), spread=False, rounds=1, deep=False):
        super().__init__()
        self.options = {"widths": list(widths), "spread": spread, "rounds": rounds}
        if deep:
            self.options["deep"] = True
        self.has_spread, self.rounds, self.deep = spread, rounds, deep
        a, b, c, d, e = self.widths = widths
        self.down1 = nn.Conv2d(PHOTO_CHANNELS, a, 4, 2, 1)  # 1/2
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
        self.mix4 = Residual(d, 0)
        self.up3 = nn.ConvTranspose2d(d, c, 4, 2, 1)
        self.mix3 = Residual(c, 0)
        self.up2 = nn.ConvTranspose2d(c, b, 4, 2, 1)
        self.mix2 = Residual(b, 0)
        self.up1 = nn.ConvTranspose2d(b, a, 4, 2, 1)
        self.mix1 = nn.Conv2d(2 * a, a, 3, 1, 1)
        self.out = nn.ConvTranspose2d(a, 9, 4, 2, 1)
        if deep:  # at 1/4 and 1/8, down and up; the identity to begin with
            self.deep2, self.deep3 = Residual(b, damp=0.0), Residual(c, damp=0.0)
            self.deep_up3, self.deep_up2 = Residual(c, damp=0.0), Residual(b, damp=0.0)
        if spread:
            self.spread1 = nn.Conv2d(a, a, 3, 1, 1)
            self.spread = nn.ConvTranspose2d(a, 9, 4, 2, 1)
        start(self)
        with torch.no_grad():
            self.out.weight.mul_(0.3)
            if spread:
                self.spread.weight.mul_(0.1)

    def features(self, photo):
        """[B, PHOTO_CHANNELS, H, W] -> five levels [B, widths[i], H / 2^(i+1), W / 2^(i+1)]."""
        act = lambda x: F.leaky_relu(x, SLOPE)
        x1 = act(self.down1(photo))
        x2 = self.down2(x1)
        if self.deep:
            x2 = self.deep2(x2)
        x3 = self.res3(self.down3(act(x2)))
        if self.deep:
            x3 = self.deep3(x3)
        x4 = self.down4(act(x3))
        for _ in range(self.rounds):
            x4 = self.res4(x4)
        x5 = self.down5(act(x4))
        for _ in range(self.rounds):
            x5 = self.res5(x5)
        return x1, x2, x3, x4, x5

    def last(self, x1, x2, x3, x4, x5):
        """Pooled features -> features at half the resolution."""
        act = lambda x: F.leaky_relu(x, SLOPE)
        g = act(self.global1(F.adaptive_avg_pool2d(act(x5), 1)))
        y = act(x5 + self.global5(g))
        y = act(self.mix5(y) + x5)
        y = self.mix4(self.up4(y) + x4 + self.global4(g))
        y = self.mix3(self.up3(act(y)) + x3 + self.global3(g))
        if self.deep:
            y = self.deep_up3(y)
        y = self.mix2(self.up2(act(y)) + x2)
        if self.deep:
            y = self.deep_up2(y)
        y = act(self.up1(act(y)))
        return act(self.mix1(torch.cat([y, x1], 1)))

    def heads(self, y):
        """Features at half the resolution -> encoded maps [B, 9, H, W] and, of a
        network with ``spread``, the logarithm of their standard deviations."""
        maps = torch.tanh(self.out(y).float())
        if not self.has_spread:
            return maps, None
        middle, half = self.LOG_SIGMA
        x = F.leaky_relu(self.spread1(y.detach()), SLOPE)
        return maps, half * torch.tanh(self.spread(x).float()) + middle

    def forward(self, photos):
        return self.predict(photos)[0]

    def predict(self, photos):
        """Encoded maps and the logarithm of their standard deviations (None without ``spread``)."""
        batch, count = photos.shape[:2]
        flat = photos.flatten(0, 1).contiguous(memory_format=torch.channels_last)
        pooled = []
        for x in self.features(flat):
            if count > 1:
                half = x.shape[1] // 2
                x = x.unflatten(0, (batch, count))
                x = torch.cat([x[:, :, :half].amax(1), x[:, :, half:].mean(1)], 1)
            pooled.append(x)
        return self.heads(self.last(*pooled))


class OnePhoto(nn.Module):
    """PhotoNetwork for one photo [B, PHOTO_CHANNELS, H, W]: what the library runs.
    Of a network with ``spread`` the logarithm of the standard deviations is a second output."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, photo):
        maps, log_sigma = self.network.heads(self.network.last(*self.network.features(photo)))
        return maps if log_sigma is None else (maps, log_sigma)


class CompletionNetwork(nn.Module):
    """What a fit knows [B, 43, H, W] (fits.py) -> by how far the mean of its prior
    should move [B, 9, H, W], in the material's own scales, at most LIMIT.

    U-Net from 1/2 to 1/16 resolution; it starts by moving next to nothing. What
    kind of a material it is, the fit decides: there is no pooling over all texels.
    H, W: multiples of 16.
    """

    LIMIT = 2.0

    def __init__(self, widths=(24, 48, 64, 96)):
        super().__init__()
        a, b, c, d = widths
        self.down1, self.res1 = nn.Conv2d(43, a, 2, 2), Residual(a, 0)  # 1/2
        self.down2, self.res2 = nn.Conv2d(a, b, 4, 2, 1), Residual(b)  # 1/4
        self.down3, self.res3 = nn.Conv2d(b, c, 4, 2, 1), Residual(c)  # 1/8
        self.down4, self.res4 = nn.Conv2d(c, d, 4, 2, 1), Residual(d)  # 1/16
        self.up3, self.mix3 = nn.ConvTranspose2d(d, c, 4, 2, 1), Residual(c, 0)
        self.up2, self.mix2 = nn.ConvTranspose2d(c, b, 4, 2, 1), Residual(b, 0)
        self.up1, self.mix1 = nn.ConvTranspose2d(b, a, 4, 2, 1), Residual(a, 0)
        self.out = nn.ConvTranspose2d(a, 9, 4, 2, 1)
        start(self)
        with torch.no_grad():
            self.out.weight.mul_(0.02)

    def forward(self, x):
        act = lambda x: F.leaky_relu(x, SLOPE)
        x1 = self.res1(self.down1(x))
        x2 = self.res2(self.down2(act(x1)))
        x3 = self.res3(self.down3(act(x2)))
        x4 = self.res4(self.down4(act(x3)))
        y = self.mix3(self.up3(act(x4)) + x3)
        y = self.mix2(self.up2(act(y)) + x2)
        y = self.mix1(self.up1(act(y)) + x1)
        return self.LIMIT * torch.tanh(self.out(act(y)).float() * (1 / self.LIMIT))


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
