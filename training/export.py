"""Export trained weights to what the library embeds.

    encoder.onnx   maps  [1, 9, H, W]  -> code [1, C, H/16, W/16]
    photo.onnx     photo [1, 14, H, W] -> maps [1, 9, H, W], with --spread also
                   log_sigma [1, 9, H, W], the logarithm of their standard deviations
    completion.onnx  features [1, 43, H, W] -> moves [1, 9, H, W]
    decoder.bin    own container, see write_decoder
    *_test.bin     inputs and outputs computed here, to test other
                   implementations against
    manifest.json  names, checksums, prior statistics, licences of the materials

Auto-encoder, photo network and completion network, or some of them: the others in
the folder are left.

Weights are stored in 16 bits; the ONNX graphs cast them to float32 and compute
in float32. All test vectors are computed with the rounded weights.
"""

import argparse
import datetime
import hashlib
import io
import json
import os
import struct

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from evaluate import prior_statistics
from networks import PHOTO_CHANNELS, SLOPE, STRIDE, CompletionNetwork, OnePhoto, multiply_accumulates
from schedule import load_ema, load_photo_network
from train_autoencoder import AutoEncoder
from train_photo import make_example

ALLOWED_OPS = {
    "Add", "Cast", "Concat", "Constant", "Conv", "ConvTranspose", "GlobalAveragePool", "LeakyRelu", "Mul", "Tanh",
}


def round_to_half(module):
    """Round all weights to what float16 holds, in place."""
    with torch.no_grad():
        for p in module.parameters():
            p.copy_(p.half().float())
    return module


def contiguous(module):
    return module.to(memory_format=torch.contiguous_format)


def write_container(path, magic, header, data):
    """magic (8 bytes), u32 length of the JSON header, header, raw data."""
    text = json.dumps(header, separators=(",", ":")).encode()
    with open(path, "wb") as f:
        f.write(magic + struct.pack("<I", len(text)) + text + data)


def write_decoder(path, decoder):
    """Decoder as a list of layers and float16 tensors (offsets in elements)."""
    layers, tensors, offset = [], [], 0

    def store(t):
        nonlocal offset
        a = t.detach().contiguous().numpy().astype("<f2").ravel()
        tensors.append(a)
        offset += a.size
        return offset - a.size

    for s, layer in zip(decoder.spec, decoder.layers):
        entry = {"op": s[0]}
        if s[0] in ("conv", "conv_transpose"):
            if s[0] == "conv":
                entry["kernel"] = layer.kernel_size[0]
            entry.update({"in": s[1], "out": s[2], "weight": store(layer.weight), "bias": store(layer.bias)})
        elif s[0] == "depth_to_space":
            entry["block"] = s[1]
        layers.append(entry)
    header = {
        "format": "svbrdf-decoder/1",
        "code_channels": decoder.code,
        "stride": STRIDE,
        "leaky_slope": SLOPE,
        "layers": layers,
    }
    write_container(path, b"SVBRDFM1", header, np.concatenate(tensors).tobytes())


def write_vectors(path, arrays):
    """Named float32 arrays."""
    header, offset = {"tensors": []}, 0
    for name, a in arrays.items():
        header["tensors"].append({"name": name, "shape": list(a.shape), "offset": offset})
        offset += a.size
    data = b"".join(np.ascontiguousarray(a, dtype="<f4").tobytes() for a in arrays.values())
    write_container(path, b"SVBRDFT1", header, data)


def to_onnx(path, module, example, input_name, *output_names):
    """Plain ONNX graph with dynamic height and width, float16 initialisers."""
    buffer = io.BytesIO()
    torch.onnx.export(
        module,
        (example,),
        buffer,
        input_names=[input_name],
        output_names=list(output_names),
        dynamic_axes={input_name: {2: "H", 3: "W"}, **{name: {2: "Ho", 3: "Wo"} for name in output_names}},
        opset_version=13,
        dynamo=False,
        do_constant_folding=True,
    )
    model = onnx.load_from_string(buffer.getvalue())
    graph = model.graph
    casts = []
    for tensor in graph.initializer:
        a = numpy_helper.to_array(tensor)
        if a.dtype != np.float32:
            continue
        name = tensor.name
        tensor.CopyFrom(numpy_helper.from_array(a.astype(np.float16), name + "_half"))
        casts.append(helper.make_node("Cast", [name + "_half"], [name], name="cast_" + name, to=TensorProto.FLOAT))
    nodes = casts + list(graph.node)
    del graph.node[:]
    graph.node.extend(nodes)
    for n in graph.node:
        n.doc_string = ""
    ops = {n.op_type for n in graph.node}
    if ops - ALLOWED_OPS:
        raise SystemExit(f"{path}: unexpected operators {sorted(ops - ALLOWED_OPS)}")
    del model.metadata_props[:]
    onnx.checker.check_model(model)
    onnx.save(model, path)
    return sorted(ops)


def verify(path, module, channels, name):
    """Compare with onnxruntime at several sizes; returns the largest error."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    worst = 0.0
    for h, w in ((64, 64), (256, 256), (128, 192)):
        x = torch.rand(1, channels, h, w) * 2 - 1
        with torch.no_grad():
            expected = module(x)
        found = session.run(None, {name: x.numpy()})
        expected = expected if isinstance(expected, tuple) else [expected]
        for got, wanted in zip(found, expected, strict=True):
            assert got.shape == wanted.shape, (got.shape, wanted.shape)
            worst = max(worst, float(np.abs(got - wanted.numpy()).max()))
    assert worst < 2e-3, worst
    return worst


def checksum(path):
    with open(path, "rb") as f:
        return hashlib.sha256(f.read()).hexdigest()


def export_autoencoder(args, path):
    """Encoder and decoder; their part of the manifest."""
    autoencoder, state = load_ema(AutoEncoder(), args.autoencoder)
    encoder = round_to_half(contiguous(autoencoder.encoder.folded()))
    decoder = round_to_half(contiguous(autoencoder.decoder))
    print("encoder", to_onnx(path("encoder.onnx"), encoder, torch.rand(1, 9, 64, 64), "maps", "code"))
    write_decoder(path("decoder.bin"), decoder)
    print("encoder error", verify(path("encoder.onnx"), encoder, 9, "maps"))

    # test vectors: smooth inputs in a plausible range
    maps = torch.tanh(nn.functional.interpolate(torch.randn(1, 9, 9, 9), (64, 64), mode="bicubic"))
    with torch.no_grad():
        write_vectors(path("encoder_test.bin"), {"maps": maps.numpy(), "code": encoder(maps).numpy()})
    code = torch.randn(1, decoder.code, 3, 4, requires_grad=True)
    out = decoder(code)
    gradient = torch.randn_like(out)
    out.backward(gradient)
    write_vectors(
        path("decoder_test.bin"),
        {
            "code": code.detach().numpy(),
            "maps": out.detach().numpy(),
            "maps_gradient": gradient.numpy(),
            "code_gradient": code.grad.numpy(),
        },
    )
    return {
        "code_channels": decoder.code,
        "stride": STRIDE,
        "mac_at_256": {
            "encoder": multiply_accumulates(encoder, torch.rand(1, 9, 256, 256)),
            "decoder": multiply_accumulates(decoder, torch.rand(1, decoder.code, 16, 16)),
        },
        "training": {"autoencoder": length(state)},
        "licences": {"autoencoder": state.get("licences", {})},
        "statistics": statistics(args, autoencoder=lambda truth: decoder(encoder(truth))),
    }


def export_photo(args, path):
    """Photo network; its part of the manifest."""
    network, state = load_photo_network(args.photo, None if args.spread else False)
    network = round_to_half(contiguous(network))
    photo = OnePhoto(network)
    spread = network.has_spread
    outputs = ["maps", "log_sigma"] if spread else ["maps"]
    print("photo", to_onnx(path("photo.onnx"), photo, torch.rand(1, PHOTO_CHANNELS, 64, 64), "photo", *outputs))
    print("photo error", verify(path("photo.onnx"), photo, PHOTO_CHANNELS, "photo"))
    x = torch.tanh(nn.functional.interpolate(torch.randn(1, PHOTO_CHANNELS, 5, 9), (32, 64), mode="bicubic"))
    with torch.no_grad():
        found = photo(x) if spread else [photo(x)]
    write_vectors(path("photo_test.bin"), {"photo": x.numpy(), **{n: y.numpy() for n, y in zip(outputs, found)}})
    return {
        "mac_at_256": {"photo": multiply_accumulates(photo, torch.rand(1, PHOTO_CHANNELS, 256, 256))},
        "training": {"photo": length(state)},
        "licences": {"photo": state.get("licences", {})},
        "networks": {"photo": network.options},
        # one photo, with the degradations of the training
        "statistics": statistics(args, photo=lambda truth: network(make_example(truth))),
    }


def length(state):
    """Of the training of a checkpoint, for the manifest."""
    return {"steps": state["step"], "samples": state["samples"]}


def statistics(args, **networks):
    return prior_statistics(args.packs, networks) if args.packs else {}


def export_completion(args, path):
    """Completion network; its part of the manifest."""
    network, state = load_ema(CompletionNetwork(), args.completion)
    network = round_to_half(contiguous(network))
    channels = network.down1.in_channels
    example = torch.rand(1, channels, 64, 64)
    print("completion", to_onnx(path("completion.onnx"), network, example, "features", "moves"))
    print("completion error", verify(path("completion.onnx"), network, channels, "features"))
    x = torch.tanh(nn.functional.interpolate(torch.randn(1, channels, 5, 9), (32, 64), mode="bicubic"))
    with torch.no_grad():
        write_vectors(path("completion_test.bin"), {"features": x.numpy(), "moves": network(x).numpy()})
    return {
        "mac_at_256": {"completion": multiply_accumulates(network, torch.rand(1, channels, 256, 256))},
        "training": {"completion": length(state)},
        "licences": {"completion": state.get("licences", {})},
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--autoencoder", help="checkpoint autoencoder.pt")
    parser.add_argument("--photo", help="checkpoint photo.pt")
    parser.add_argument("--completion", help="checkpoint completion.pt")
    parser.add_argument("--spread", action="store_true", help="standard deviations as a second output of photo.onnx")
    parser.add_argument("--out", required=True, help="models folder")
    parser.add_argument("--version", default=datetime.date.today().isoformat())
    parser.add_argument("--packs", nargs="*", default=[], help="packs whose held-out materials give the statistics")
    args = parser.parse_args()
    if not (args.autoencoder or args.photo or args.completion):
        parser.error("nothing to export")
    torch.manual_seed(0)
    torch.set_num_threads(2)
    os.makedirs(args.out, exist_ok=True)
    path = lambda name: os.path.join(args.out, name)

    manifest = {"format": "svbrdf-models/1", "profile": "phone"}
    if os.path.exists(path("manifest.json")):
        with open(path("manifest.json")) as f:
            manifest = json.load(f)
    manifest["version"] = args.version
    parts = [export_autoencoder(args, path)] if args.autoencoder else []
    parts += [export_photo(args, path)] if args.photo else []
    parts += [export_completion(args, path)] if args.completion else []
    for part in parts:
        for key, value in part.items():
            if not isinstance(value, dict):
                manifest[key] = value
            elif value:
                manifest.setdefault(key, {}).update(value)
    networks = ["decoder.bin", "encoder.onnx", "photo.onnx", "completion.onnx"]
    tests = ["decoder_test.bin", "encoder_test.bin", "photo_test.bin", "completion_test.bin"]
    files = [n for n in networks + tests if os.path.exists(path(n))]
    manifest["files"] = {n: {"sha256": checksum(path(n)), "bytes": os.path.getsize(path(n))} for n in files}
    with open(path("manifest.json"), "w") as f:
        json.dump(manifest, f, indent=2)
        f.write("\n")
    total = sum(manifest["files"][n]["bytes"] for n in networks if n in manifest["files"])
    print(f"networks: {total / 1e6:.2f} MB; MAC at 256x256: {manifest['mac_at_256']}")


if __name__ == "__main__":
    main()
