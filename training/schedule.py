"""What all trainings share: learning-rate schedule, weight averaging,
checkpoints, logging."""

import argparse
import json
import math
import os
import random
import signal
import sys
import time

import numpy as np
import torch

from networks import PhotoNetwork


def arguments(description, batch, lr, packs=True):
    parser = argparse.ArgumentParser(description=description)
    if packs:
        parser.add_argument(
            "--packs", nargs="+", required=True, help="pack folders (see data.py, procedural.py); unfinished ones join later"
        )
        parser.add_argument("--real-share", type=float, default=None, help="how often a real material is drawn")
    parser.add_argument("--work", default=os.environ.get("SVBRDF_WORK", "."), help="folder of checkpoints and logs")
    parser.add_argument("--minutes", type=float, default=None, help="length of the whole run in training time")
    parser.add_argument("--steps", type=int, default=None, help="length of the whole run in steps (reproducible)")
    parser.add_argument("--batch", type=int, default=batch)
    parser.add_argument("--size", type=int, default=128, help="texels a side")
    parser.add_argument("--fine-from", type=float, default=1.0, help="progress in [0,1] from which 256x256 is used")
    parser.add_argument("--lr", type=float, default=lr)
    parser.add_argument("--warmup", type=int, default=300, help="steps of the linear warm-up")
    parser.add_argument("--views", type=int, default=3, help="renderings in the loss")
    parser.add_argument("--log-every", type=int, default=50, help="steps")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--no-compile", action="store_true")
    parser.add_argument("--ema", type=float, default=0.998)
    return parser


def mixed_precision(device):
    """bfloat16 where the device computes with it faster than with 32 bits."""
    kind = torch.device(device).type
    fast = kind == "cuda" or torch.ops.mkldnn._is_mkldnn_bf16_supported()
    return torch.autocast(kind, torch.bfloat16, enabled=fast)


def merge_licences(counts):
    """Materials by licence of a training and of the ones that it goes on from: of
    each licence the larger number, as they share materials."""
    names = sorted(set().union(*counts))
    return {n: max(c.get(n, 0) for c in counts) for n in names}


class Run:
    """State of a training run: step, spent time, EMA, checkpoint, log. Saved are
    NAME.pt, from which it goes on, and NAME-weights.pt, the averaged weights alone.
    ``licences``: numbers of materials by licence, of this run and of what its
    weights have seen before."""

    def __init__(self, name, model, args, betas=(0.9, 0.99), licences=()):
        self.name, self.model, self.args = name, model, args
        self.path = os.path.join(args.work, f"{name}.pt")
        self.log_path = os.path.join(args.work, f"{name}.jsonl")
        os.makedirs(args.work, exist_ok=True)
        self.optimizer = torch.optim.AdamW(model.parameters(), lr=args.lr, betas=betas, weight_decay=1e-4, fused=True)
        self.ema = {k: v.detach().clone().float() for k, v in model.state_dict().items()}
        self.step, self.samples, self.seconds = 0, 0, 0.0
        self.licences = merge_licences(list(licences))
        self.started = self.last_save = time.time()
        self.sums, self.count = {}, 0
        if os.path.exists(self.path):
            state = torch.load(self.path, map_location=args.device)
            model.load_state_dict(state["model"])
            self.optimizer.load_state_dict(state["optimizer"])
            self.ema = state["ema"]
            self.step, self.samples, self.seconds = state["step"], state["samples"], state["seconds"]
            self.licences = merge_licences([self.licences, state.get("licences", {})])
        random.seed(args.seed + self.step)
        torch.manual_seed(args.seed + self.step)
        self.rng = np.random.default_rng(args.seed + self.step)
        self.mark = time.time()
        self.stop = False
        signal.signal(signal.SIGTERM, self._terminate)

    def _terminate(self, *_):
        self.stop = True

    @property
    def progress(self):
        if self.args.steps:
            return self.step / self.args.steps
        return (self.seconds + time.time() - self.mark) / 60 / (self.args.minutes or 60)

    def learning_rate(self):
        """Linear warm-up, then cosine to 2 % of the peak."""
        p = min(1.0, self.progress)
        return self.args.lr * min(1.0, (self.step + 1) / self.args.warmup) * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * p)))

    def refresh(self, pool):
        """Let packs join that have been finished meanwhile."""
        if pool.waiting and self.step % 50 == 0:
            pool.refresh()
            self.licences = merge_licences([self.licences, pool.licences()])

    def update(self, loss, batch, values):
        """One optimiser step; ``values``: name -> detached tensor to log."""
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate()
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
        if norm.is_cuda:  # decided on the device: asking would wait for it
            self.optimizer.found_inf = (~torch.isfinite(norm)).float()
            self.optimizer.step()
        elif torch.isfinite(norm):
            self.optimizer.step()
        self.step += 1
        self.samples += batch
        decay = min(self.args.ema, (1 + self.step) / (20 + self.step))
        with torch.no_grad():
            now = {k: v.float() for k, v in self.model.state_dict().items() if v.dtype.is_floating_point}
            torch._foreach_lerp_([self.ema[k] for k in now], list(now.values()), 1 - decay)
        for k, v in values.items():  # tensors: a GPU need not be waited for
            total, count = self.sums.get(k, (0.0, 0))
            self.sums[k] = (total + v, count + 1)
        self.count += batch
        if self.stop:  # SIGTERM: save and leave
            self.save()
            sys.exit(0)
        if self.step % self.args.log_every == 0:
            now = time.time()
            row = {k: round(float(total) / count, 5) for k, (total, count) in sorted(self.sums.items())}
            row.update(
                step=self.step,
                samples=self.samples,
                minutes=round((self.seconds + now - self.mark) / 60, 2),
                lr=round(self.learning_rate(), 6),
                rate=round(self.count / (now - self.started), 1),
            )
            self.started = now
            with open(self.log_path, "a") as f:
                f.write(json.dumps(row) + "\n")
            self.sums, self.count = {}, 0
            if now - self.last_save > 150:
                self.save()

    def save(self):
        self.seconds += time.time() - self.mark
        self.mark = self.last_save = time.time()
        weights = dict(ema=self.ema, step=self.step, samples=self.samples, licences=self.licences)
        weights["options"] = getattr(self.model, "options", {})
        state = dict(
            model=self.model.state_dict(), optimizer=self.optimizer.state_dict(), seconds=self.seconds, **weights
        )
        for path, content in ((self.path, state), (self.path.replace(".pt", "-weights.pt"), weights)):
            torch.save(content, path + ".tmp")
            os.replace(path + ".tmp", path)


def load_ema(model, path, change=lambda weights: weights):
    """Load the averaged weights of a checkpoint, changed where asked, into a
    model; what the checkpoint lacks (a new head) is left as it is. Returns the
    model and the checkpoint (step, samples, licences)."""
    state = torch.load(path, map_location="cpu")
    reference = model.state_dict()
    weights = {k: v.to(reference[k].dtype) for k, v in change(state["ema"]).items()}
    model.load_state_dict({**reference, **weights})
    return model.eval(), state


def load_photo_network(path, spread=None):
    """Photo network of a checkpoint, as it was built, and the checkpoint.
    ``spread`` False: without its second head."""
    options = torch.load(path, map_location="cpu").get("options", {})
    if spread is False:
        options = {**options, "spread": False}
    network = PhotoNetwork(**options)
    wanted = network.state_dict()
    return load_ema(network, path, lambda weights: {k: v for k, v in weights.items() if k in wanted})
