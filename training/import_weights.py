"""Turn exported ONNX weights back into checkpoints, so that training can go on from them.

    import_weights.py --models ../models --network photo --out photo.pt

The graphs hold their weights in 16 bits; a checkpoint made here has just these values
as its averaged weights, no optimiser state, and no count of steps. Before it is
written, the network is compared with the test vectors of the models folder.
"""

import argparse
import json
import os
import struct

import numpy as np
import onnx
import torch
from onnx import numpy_helper

from networks import CompletionNetwork, OnePhoto, PhotoNetwork

# Checkpoint's network, graph, test vectors with the names of input and output
NETWORKS = {
    "photo": (PhotoNetwork, "photo.onnx", "photo_test.bin", "photo", "maps"),
    "completion": (CompletionNetwork, "completion.onnx", "completion_test.bin", "features", "moves"),
}
# Largest difference from the test vectors: sums of 32-bit values in another order
TOLERANCE = 1e-4


def read_vectors(path):
    """Arrays of a test-vector container (see export.write_vectors) by name."""
    with open(path, "rb") as f:
        data = f.read()
    if data[:8] != b"SVBRDFT1":
        raise SystemExit(f"{path}: not a container of test vectors")
    (length,) = struct.unpack("<I", data[8:12])
    header = json.loads(data[12 : 12 + length])
    values = np.frombuffer(data, "<f4", offset=12 + length)
    arrays = {}
    for t in header["tensors"]:
        size = int(np.prod(t["shape"]))
        arrays[t["name"]] = torch.from_numpy(values[t["offset"] : t["offset"] + size].reshape(t["shape"]).copy())
    return arrays


def read_weights(path):
    """State dict of an exported graph: 32-bit tensors by parameter name."""
    state = {}
    for tensor in onnx.load(path).graph.initializer:
        name = tensor.name.removesuffix("_half").removeprefix("network.")
        state[name] = torch.from_numpy(numpy_helper.to_array(tensor).astype(np.float32))
    return state


def read_manifest(models, key):
    """An object of a models folder's manifest, empty if there is none."""
    with open(os.path.join(models, "manifest.json")) as f:
        return json.load(f).get(key, {})


def load_exported(models, name):
    """Network ``name`` with the weights of a models folder, checked against
    that folder's test vectors."""
    kind, graph, vectors, source, target = NETWORKS[name]
    network = kind(**read_manifest(models, "networks").get(name, {}))
    network.load_state_dict(read_weights(os.path.join(models, graph)))
    network.eval()
    run = OnePhoto(network) if name == "photo" else network
    arrays = read_vectors(os.path.join(models, vectors))
    with torch.no_grad():
        difference = float((run(arrays[source]) - arrays[target]).abs().max())
    if not difference < TOLERANCE:
        raise SystemExit(f"{graph}: differs from its test vectors by {difference:.2g}")
    return network, difference


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", required=True, help="models folder")
    parser.add_argument("--network", choices=list(NETWORKS), default="photo")
    parser.add_argument("--out", required=True, help="checkpoint to write")
    args = parser.parse_args()
    network, difference = load_exported(args.models, args.network)
    state = {"ema": network.state_dict(), "step": 0, "samples": 0, "options": getattr(network, "options", {})}
    state["licences"] = read_manifest(args.models, "licences").get(args.network, {})
    torch.save(state, args.out)
    print(f"{args.network}: {sum(p.numel() for p in network.parameters())} weights, off the test vectors by {difference:.1e}")


if __name__ == "__main__":
    main()
