"""Loss curves of a work folder -> PNG."""

import argparse
import json
import os


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", default=os.environ.get("SVBRDF_WORK", "."))
    parser.add_argument("--out", required=True)
    args = parser.parse_args()
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2))
    for axis, name, title in zip(axes, ("autoencoder", "photo"), ("auto-encoder", "photo network")):
        with open(os.path.join(args.work, f"{name}.jsonl")) as f:
            rows = [json.loads(line) for line in f]
        # photo network: 1 photo, 8 photos, between
        keys = [k + n for k in ("maps", "render", "smooth") for n in ("", "1", "N", "8")]
        for key in keys:
            points = [(r["samples"] / 1000, r[key]) for r in rows if key in r]
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
