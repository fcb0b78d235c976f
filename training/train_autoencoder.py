"""Train the SVBRDF auto-encoder.

Loss: L1 of the encoded maps + log-L1 of random renderings (a part of them in
mirror configuration, a part as a hand-held flash photo) + smoothness of the
latent space lambda |D(z) - D(z + xi)|.
"""

import torch
from torch import nn

from data import MaterialPool, augment
from networks import Decoder, Encoder, principal_start
from photo_losses import CHANNEL_WEIGHT, rendering_loss
from renderer import random_configurations
from schedule import Run, arguments, mixed_precision


def losses(y, x, camera, light, weight):
    """Prediction and truth [B, 9, S, S] -> (weighted L1 of the maps, log-L1 of
    the renderings)."""
    return ((y - x).abs() * weight).mean(), rendering_loss(y, x, camera, light)


class AutoEncoder(nn.Module):
    def __init__(self):
        super().__init__()
        self.encoder = Encoder()
        self.decoder = Decoder()

    def forward(self, x, noise=0.0):
        """x [B, 9, S, S] -> (reconstruction, decode of the perturbed code)."""
        z = self.encoder(x)
        sigma = noise * torch.rand(z.shape[0], 1, 1, 1, device=z.device)
        y = self.decoder(torch.cat([z, z + sigma * torch.randn_like(z)]))
        return y.chunk(2)


def main():
    parser = arguments(__doc__, batch=16, lr=5e-4)
    parser.add_argument("--smoothness", type=float, default=0.2, help="lambda")
    parser.add_argument("--noise", type=float, default=0.5, help="largest standard deviation of xi")
    parser.add_argument("--render-weight", type=float, default=0.5)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    pool = MaterialPool(args.packs, args.device, real_share=args.real_share)
    model = AutoEncoder().to(args.device).to(memory_format=torch.channels_last).train()
    run = Run("autoencoder", model, args, licences=[pool.licences()])
    compute, change = losses, augment
    if not args.no_compile:
        compute, change = torch.compile(losses, dynamic=False), torch.compile(augment, dynamic=False)
    if run.step == 0:
        with torch.no_grad():
            maps = torch.cat([pool.batch(16, 128, run.rng) for _ in range(60)])
            principal_start(model.encoder, model.decoder, maps, torch.tensor(CHANNEL_WEIGHT))
    weight = torch.tensor(CHANNEL_WEIGHT, device=args.device).view(1, 9, 1, 1)
    while run.progress < 1:
        run.refresh(pool)
        fine = run.progress >= args.fine_from
        size, batch = (256, max(2, args.batch // 4)) if fine else (args.size, args.batch)
        with torch.no_grad():
            x = pool.batch(batch, size, run.rng, change)
        with mixed_precision(args.device):
            y, yn = model(x.to(memory_format=torch.channels_last), args.noise)
        y, yn = y.float().contiguous(), yn.float().contiguous()
        camera, light = random_configurations(batch, 1, args.views - 2, 1, args.device)
        maps, rendering = compute(y, x, camera, light, weight)
        smooth = ((y - yn).abs() * weight).mean()
        loss = maps + args.render_weight * rendering + args.smoothness * smooth
        run.update(
            loss, batch, {"maps": maps.detach(), "render": rendering.detach(), "smooth": smooth.detach()}
        )
    run.save()


if __name__ == "__main__":
    main()
