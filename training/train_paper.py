"""Train the auto-encoder of Gao et al. 2019 with the paper's losses, or an ablation of it.

Loss: L1 of the encoded maps + log-L1 of nine renderings (three independent, six mirror) + lambda
|D(z) - D(z + xi)|, lambda = 2, xi ~ N(0, 0.2). The defaults are the paper's; ``--width`` below 1
makes the network fit a small budget.
"""

import torch

from data import MaterialPool, augment
from paper_networks import PaperAutoEncoder
from photo_losses import rendering_loss
from renderer import random_configurations
from schedule import Run, arguments, mixed_precision

VARIANCE = 0.2


def variant_arguments(parser):
    parser.add_argument("--normalisation", choices=["none", "last", "all"], default="last")
    parser.add_argument("--width", type=float, default=1.0, help="number of channels, 1: the paper's")


def main():
    parser = arguments(__doc__, batch=64, lr=1e-4)
    variant_arguments(parser)
    parser.add_argument("--smoothness", type=float, default=2.0, help="lambda; 0: off")
    parser.add_argument("--losses", choices=["maps", "render", "both"], default="both")
    parser.set_defaults(size=256, views=9)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    pool = MaterialPool(args.packs, args.device)
    model = PaperAutoEncoder(args.normalisation, args.width)
    model = model.to(args.device).to(memory_format=torch.channels_last).train()
    run = Run("paper", model, args, betas=(0.5, 0.999), licences=[pool.licences()])
    rendering, change = rendering_loss, augment
    if not args.no_compile:
        rendering, change = torch.compile(rendering, dynamic=False), torch.compile(augment, dynamic=False)
    independent = args.views // 3
    while run.progress < 1:
        with torch.no_grad():
            x = pool.batch(args.batch, args.size, run.rng, change)
        with mixed_precision(args.device):
            z = model.encoder(x.to(memory_format=torch.channels_last))
            codes = [z, z + VARIANCE**0.5 * torch.randn_like(z)] if args.smoothness > 0 else [z]
            # one pass each, as batch statistics of perturbed codes would differ
            decoded = [model.decoder(code).float().contiguous() for code in codes]
        y = decoded[0]
        loss, values = 0.0, {}
        if args.losses != "render":
            values["maps"] = (y - x).abs().mean()
        if args.losses != "maps":
            camera, light = random_configurations(
                args.batch, independent, args.views - independent, 0, args.device
            )
            values["render"] = rendering(y, x, camera, light)
        if args.smoothness > 0:
            values["smooth"] = args.smoothness * (y - decoded[1]).abs().mean()
        loss = sum(values.values())
        run.update(loss, args.batch, {k: v.detach() for k, v in values.items()})
    run.save()


if __name__ == "__main__":
    main()
