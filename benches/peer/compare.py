"""The paper's optimiser in PyTorch against `svbrdf fit`: same photographs, same networks, one run.

    compare.py --svbrdf target/release/svbrdf --capture CAPTURE [--photos 5] [--threads 2]
               [--steps 4000] [--map-steps 200] [--reach 0.0113] [--curve curve.csv]

CAPTURE holds rectified photographs without fall-off (`"rectified": true`, `"falloff": "none"`).
The peer starts from the same photo network, encodes its maps, and runs Adam on the code (rate 1e-3,
beta1 0.5, 4000 steps), then on the maps (200 steps; rate 1e-3). With fewer `--steps` the schedule is
cut short, and the time of the whole is extrapolated from the time of a step; both are said. Losses of
both are computed here, by the same renderer: mean |log(x + 0.01) - log(photo + 0.01)| over what
is not clipped.

Ratios only: seconds depend on the machine and on what else runs there. Needs torch, onnxruntime,
pillow, OpenEXR.
"""

import argparse
import json
import os
import resource
import struct
import subprocess
import sys
import tempfile
import time

import numpy as np
import OpenEXR
import onnxruntime
import torch
from PIL import Image
from torch import nn
from torch.nn import functional as F

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "training"))
from renderer import LOG_OFFSET, encode_maps, render  # noqa: E402
from train_photo import photo_input  # noqa: E402

SIDE = 256
GAMMA = {"linear": 1.0, "gamma2.2": 2.2}


def load_photos(folder, count):
    """Radiance [1, N, 3, H, W], weight [1, N, 3, H, W], camera and light [1, N, 3] in half widths."""
    with open(os.path.join(folder, "capture.json")) as f:
        capture = json.load(f)
    if not capture.get("rectified") or capture.get("falloff") != "none":
        sys.exit("a capture of rectified photographs without fall-off is expected")
    half = capture["sample"]["width_mm"] / 2
    radiance, weight, camera, light = [], [], [], []
    for frame in capture["frames"][:count]:
        image = np.asarray(Image.open(os.path.join(folder, frame["image"])).convert("RGB"))
        if image.shape[:2] != (SIDE, SIDE):
            sys.exit(f"{frame['image']}: {SIDE}x{SIDE} px are expected")
        clipped = image >= 254
        linear = (image / 255.0) ** GAMMA[frame["encoding"]]
        radiance.append(linear.transpose(2, 0, 1))
        weight.append(1.0 - clipped.transpose(2, 0, 1))
        camera.append(np.array(frame["camera_mm"]) / half)
        light.append(np.array(frame["light_mm"]) / half)
    tensor = lambda a: torch.tensor(np.stack(a), dtype=torch.float32)[None]
    return tensor(radiance), tensor(weight), tensor(camera), tensor(light)


class Decoder(nn.Module):
    """The decoder of `decoder.bin`."""

    def __init__(self, path):
        super().__init__()
        with open(path, "rb") as f:
            data = f.read()
        length = struct.unpack("<I", data[8:12])[0]
        header = json.loads(data[12 : 12 + length])
        values = np.frombuffer(data[12 + length :], "<f2").astype(np.float32)
        self.slope, self.stride = header["leaky_slope"], header["stride"]
        self.spec, self.layers = [], nn.ModuleList()
        for layer in header["layers"]:
            op = layer["op"]
            module = nn.Identity()
            if op in ("conv", "conv_transpose"):
                i, o, k = layer["in"], layer["out"], layer.get("kernel", 4)
                if op == "conv":
                    module = nn.Conv2d(i, o, k, 1, k // 2)
                else:
                    module = nn.ConvTranspose2d(i, o, 4, 2, 1)
                shape = module.weight.shape
                cut = lambda at, n: torch.tensor(values[at : at + n].copy())
                module.weight.data = cut(layer["weight"], i * o * k * k).reshape(shape)
                module.bias.data = cut(layer["bias"], o)
            self.spec.append(layer)
            self.layers.append(module)
        self.requires_grad_(False)
        self.to(memory_format=torch.channels_last)

    def forward(self, x):
        saved = []
        for layer, module in zip(self.spec, self.layers):
            op = layer["op"]
            if op == "leaky_relu":
                x = F.leaky_relu(x, self.slope)
            elif op == "save":
                saved.append(x)
            elif op == "add":
                x = x + saved.pop()
            elif op == "depth_to_space":
                x = F.pixel_shuffle(x, layer["block"])
            elif op == "tanh":
                x = torch.tanh(x)
            else:
                x = module(x)
        return x


def run_onnx(models, name, threads, value):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    path = os.path.join(models, name + ".onnx")
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    return torch.from_numpy(session.run(None, {session.get_inputs()[0].name: value.numpy()})[0])


def start_maps(models, threads, photos):
    """Encoded maps of the photo network for the first photograph."""
    radiance, weight, camera, light = (p[:, 0] for p in photos)
    seen, saturated = torch.ones_like(radiance[:, :1]), torch.zeros_like(radiance[:, :1])
    return run_onnx(models, "photo", threads, photo_input(radiance, seen, saturated, camera, light))


def loss_of(maps, photos):
    radiance, weight, camera, light = photos
    rendered = render(maps, camera, light)
    difference = torch.log(rendered.clamp_min(0) + LOG_OFFSET) - torch.log(radiance + LOG_OFFSET)
    return (weight * difference.abs()).sum() / weight.sum()


class Curve:
    """Loss over seconds of work: what is done to look at the loss does not count."""

    def __init__(self):
        self.rows, self.spent, self.begun = [], 0.0, time.perf_counter()

    def note(self, stage, step, loss):
        now = time.perf_counter()
        self.spent += now - self.begun
        self.rows.append((stage, step, self.spent, float(loss)))
        self.begun = time.perf_counter()

    def at(self, seconds):
        """Least loss reached within so many seconds."""
        losses = [row[3] for row in self.rows if row[2] <= seconds]
        return min(losses) if losses else self.rows[0][3]

    def until(self, loss):
        """Seconds until that loss was reached; None if never."""
        return next((row[2] for row in self.rows if row[3] <= loss), None)


def descend(values, maps_of, photos, steps, rate, stage, curve):
    values.requires_grad_(True)
    adam = torch.optim.Adam([values], lr=rate, betas=(0.5, 0.999))
    for step in range(1, steps + 1):
        adam.zero_grad()
        loss = loss_of(maps_of(values), photos)
        loss.backward()
        adam.step()
        if step % 10 == 0 or step == steps:
            curve.note(stage, step, loss.detach())
    return values.detach()


def peer(arguments, photos):
    curve = Curve()
    decoder = Decoder(os.path.join(arguments.models, "decoder.bin"))
    maps = start_maps(arguments.models, arguments.threads, photos)
    code = run_onnx(arguments.models, "encoder", arguments.threads, maps)
    with torch.no_grad():
        curve.note("start", 0, loss_of(decoder(code), photos))

    def timed(values, maps_of, steps, stage):
        """The result, and wall and processor seconds of a step."""
        begun, processor = curve.spent, time.process_time()
        values = descend(values, maps_of, photos, steps, 1e-3, stage, curve)
        processor = time.process_time() - processor
        return values, np.array([curve.spent - begun, processor]) / max(steps, 1)

    code, code_step = timed(code.clone(), decoder, arguments.steps, "code")
    maps, map_step = timed(decoder(code), lambda m: m.clamp(-1, 1), arguments.map_steps, "maps")
    with torch.no_grad():
        curve.note("end", 0, loss_of(maps.clamp(-1, 1), photos))
    return curve, code_step, map_step


def library(arguments, photos, steps=None, at_once=False):
    """Loss of the library's maps, wall and processor seconds of its whole process; ``steps``: its
    limit for each fit. A fit after each photograph, or one to all of them (``at_once``)."""
    with tempfile.TemporaryDirectory() as out:
        command = [arguments.svbrdf, "fit", arguments.capture, "--out", out, "--quiet"]
        command += ["--frames", str(arguments.photos), "--threads", str(arguments.threads)]
        command += [] if steps is None else ["--steps", str(steps)]
        command += ["--at-once"] if at_once else []
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(command, check=True)
        wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
        channels = OpenEXR.File(os.path.join(out, "maps.exr"), separate_channels=True).channels()
        plane = lambda name: torch.from_numpy(channels[name].pixels.astype(np.float32))
        stack = lambda name, letters: torch.stack([plane(f"{name}.{c}") for c in letters])
        normal = stack("normal", "XYZ")
        # Outside the networks' range of slopes, which the peer has to stay within.
        maps = encode_maps(
            normal[:2] / normal[2:].clamp_min(1e-3),
            stack("diffuse", "RGB"),
            stack("specular", "RGB"),
            plane("roughness.Y" if "roughness.Y" in channels else "roughness")[None],
        )
        maps[:2] = normal[:2] / normal[2:].clamp_min(1e-3) / 2
        processor = after.ru_utime - before.ru_utime
        return float(loss_of(maps[None], photos)), wall, processor, after.ru_maxrss / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--svbrdf", required=True)
    parser.add_argument("--capture", required=True)
    parser.add_argument("--models", default=os.path.join(ROOT, "models"))
    parser.add_argument("--photos", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--map-steps", type=int, default=200)
    parser.add_argument("--reach", type=float, help="loss of the peer's whole schedule, known from another run")
    parser.add_argument("--curve", help="file for the peer's losses")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)

    photos = load_photos(arguments.capture, arguments.photos)
    # Before and after the peer, so that a machine that slows down shows.
    runs = [library(arguments, photos)]
    curve, code_step, map_step = peer(arguments, photos)
    runs.append(library(arguments, photos))

    loss = runs[0][0]
    wall = sum(run[1] for run in runs) / len(runs)
    processor = sum(run[2] for run in runs) / len(runs)
    whole = 4000 * code_step + 200 * map_step
    complete = arguments.steps >= 4000 and arguments.map_steps >= 200
    extrapolated = "" if complete else ", extrapolated from the time of a step"
    print(f"{arguments.photos} photographs of {arguments.capture}, {arguments.threads} threads")
    print(f"library: loss {loss:.5f}, {wall:.2f} s wall ({runs[0][1]:.2f}, {runs[1][1]:.2f}), "
          f"{processor:.2f} s processor, files and start of the process included")
    print(f"peer: loss {curve.rows[-1][3]:.5f} after {arguments.steps} + {arguments.map_steps} steps; "
          f"{1e3 * code_step[0]:.1f} ms wall, {1e3 * code_step[1]:.1f} ms processor a step on the code, "
          f"{1e3 * map_step[0]:.1f} and {1e3 * map_step[1]:.1f} on the maps")
    print(f"the peer's whole schedule / library{extrapolated}: {whole[0] / wall:.0f} wall, "
          f"{whole[1] / processor:.0f} processor")
    equal = curve.until(loss)
    if equal is None:
        print(f"time at equal loss: the peer does not reach {loss:.5f} in these steps; its least is "
              f"{min(row[3] for row in curve.rows):.5f}")
    else:
        print(f"time at equal loss, peer / library: {equal / wall:.1f}")
    print(f"loss at the library's time, peer / library: {curve.at(wall) / loss:.2f}")
    reached = arguments.reach or curve.rows[-1][3]
    for at_once in (False, True):
        for steps in range(2, 49, 2):
            first = library(arguments, photos, steps, at_once)
            if first[0] <= reached:
                break
        else:
            print("with few steps the library does not reach the peer's last loss")
            continue
        second = library(arguments, photos, steps, at_once)
        wall, processor = (first[1] + second[1]) / 2, (first[2] + second[2]) / 2
        print(f"to the peer's last loss ({reached:.5f}), {'all photographs at once' if at_once else 'one by one'}, "
              f"{steps} steps a fit ({first[0]:.5f}, {wall:.2f} s wall, {processor:.2f} s processor), the peer's "
              f"whole schedule / library{extrapolated}: {whole[0] / wall:.0f} wall, {whole[1] / processor:.0f} processor")
    if arguments.curve:
        with open(arguments.curve, "w") as f:
            f.write("stage,step,seconds,loss\n")
            f.writelines(f"{s},{n},{t:.3f},{v:.6f}\n" for s, n, t, v in curve.rows)


if __name__ == "__main__":
    main()
