"""Loss curves of a work folder -> PNG."""

import argparse
import json
import math
import os


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", default=os.environ.get("SVBRDF_WORK", "."))
    parser.add_argument("--out", required=True)
    args = parser.parse_args()
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    titles = {"autoencoder": "auto-encoder", "photo": "photo network", "completion": "completion network"}
    logs = {name: os.path.join(args.work, f"{name}.jsonl") for name in titles}
    logs = {name: path for name, path in logs.items() if os.path.exists(path)}
    figure, axes = plt.subplots(1, len(logs), figsize=(4.5 * len(logs), 3.2), squeeze=False)
    for axis, (name, path) in zip(axes[0], logs.items()):
        title = titles[name]
        with open(path) as f:
            rows = [json.loads(line) for line in f]
        # photo network: by texels a side and number of photos
        counts = {"step", "samples", "minutes", "lr", "rate"}
        keys = sorted(set().union(*rows) - counts) if rows else []
        for key in keys:
            points = [(r["samples"] / 1000, r[key]) for r in rows if math.isfinite(r.get(key, math.inf))]
            if not points:
                continue
            x, y = zip(*points)
            mean, smooth = None, []
            for v in y:
                mean = v if mean is None else 0.9 * mean + 0.1 * v
                smooth.append(mean)
            axis.plot(x, smooth, label=key)
        axis.set_yscale("log")
        axis.set_title(title)
        axis.set_xlabel("thousand samples")
        axis.grid(alpha=0.3, which="both")
        axis.legend()
    figure.tight_layout()
    figure.savefig(args.out, dpi=80)


if __name__ == "__main__":
    main()
