//! Calibration of the stated deviations.

/// Terms of the logarithm of a stated deviation, see [`Evidence`](super::Evidence).
pub const TERMS: usize = 13;

/// For each map (normal, diffuse, specular, roughness) the coefficients of the terms that
/// [`Evidence`](super::Evidence) names, whose sum is the logarithm of the deviation: of each slope, of
/// each colour of an albedo, of roughness.
///
/// Fitted with `training/calibrate_uncertainty.py` on what `svbrdf-eval uncertainty --record` writes of
/// every eighth training material, rectified, without faults and with noise and ambient light, and of nine captures
/// of training materials by `svbrdf simulate --real`, boards and rectified, after 1, 2, 5 and 8 photographs: maximum
/// likelihood of Student's distribution with four degrees of freedom, then scaled so that one deviation holds for 69 %
/// of the texels.
pub(super) const CALIBRATION: [[f32; TERMS]; 4] = [
    [0.385, 0.166, -0.588, 0.054, 0.319, 0.203, 0.345, -0.059, -0.046, 0.094, 0.180, -0.115, 0.170],
    [2.042, 0.689, -0.315, 0.345, 0.220, 0.347, 0.251, 0.688, -0.102, -0.173, 0.129, 0.509, -0.198],
    [
        0.529, 0.576, -0.487, 0.231, 0.162, 0.162, -0.043, -0.097, -1.757, 0.405, 0.256, 0.241,
        -0.268,
    ],
    [1.701, 1.062, -0.411, 0.215, 0.272, 0.250, -0.418, -0.009, 0.278, 0.057, 0.157, 0.240, 0.097],
];
