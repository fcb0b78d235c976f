"""Calibrates the stated deviations of maps: prints the numbers of src/estimate/uncertainty/calibration.rs.

    svbrdf-eval uncertainty --materials TRAIN --record a.f32
    svbrdf-eval uncertainty SIMULATED_CAPTURES --record b.f32
    python calibrate_uncertainty.py a.f32 b.f32

Needs numpy and scipy. Errors are taken for Student-distributed about zero; the logarithm of their
scale is a sum of terms. A scale at last lets one deviation hold for a given share of the texels.
"""

import argparse

import numpy as np
from scipy.optimize import minimize

TERMS = 13
HEAD = 4  # case, photographs, map, number of errors
MAPS = ["normal", "diffuse", "specular", "roughness"]


def read(path):
    """Rows of a record."""
    values = np.fromfile(path, dtype="<f4").astype(float)
    return values.reshape(-1, HEAD + TERMS + 3)


def fit(terms, errors, freedom, ridge):
    """Coefficients of the most likely scale."""
    mean, spread = terms.mean(0), terms.std(0) + 1e-9
    mean[0], spread[0] = 0.0, 1.0
    standard = (terms - mean) / spread
    errors = errors + 1e-5

    def cost(b):
        log_scale = standard @ b
        q = (errors / np.exp(log_scale)[:, None]) ** 2 / freedom
        value = log_scale + (freedom + 1) / 2 * np.log1p(q).mean(1)
        slope = 1 - ((freedom + 1) * q / (1 + q)).mean(1)
        pull = np.r_[0.0, b[1:]]
        return value.mean() + ridge * pull @ pull, standard.T @ slope / len(slope) + 2 * ridge * pull

    start = np.zeros(TERMS)
    start[0] = np.log(errors.mean())
    b = minimize(cost, start, jac=True, method="L-BFGS-B").x
    out = b / spread
    out[0] -= (out[1:] * mean[1:]).sum()
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("records", nargs="+")
    parser.add_argument("--share", type=float, default=0.69, help="of errors within one deviation")
    parser.add_argument("--freedom", type=float, default=4.0, help="degrees of freedom")
    parser.add_argument("--ridge", type=float, default=1e-2)
    arguments = parser.parse_args()
    rows = np.concatenate([read(path) for path in arguments.records])
    for index, name in enumerate(MAPS):
        of = rows[rows[:, 2] == index]
        count = int(of[0, 3])
        terms, errors = of[:, HEAD : HEAD + TERMS], of[:, HEAD + TERMS :][:, :count]
        b = fit(terms, errors, arguments.freedom, arguments.ridge)
        ratios = errors / np.exp(terms @ b)[:, None]
        b[0] += np.log(np.quantile(ratios, arguments.share))
        print(f"{name}: [{', '.join(f'{v:.3f}' for v in b)}],")


if __name__ == "__main__":
    main()
