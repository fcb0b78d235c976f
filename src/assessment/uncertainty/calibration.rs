//! Calibration of standard deviations.

/// Number of terms in the logarithm of a standard deviation, see [`Evidence`](super::Evidence).
pub const TERMS: usize = 13;

/// Coefficients of the terms of [`Evidence`](super::Evidence) for each map (normal, diffuse, specular,
/// roughness). The sum of the products is the logarithm of the standard deviation: of each slope, of each
/// colour of an albedo, of roughness.
///
/// `training/calibrate_uncertainty.py` fitted them to records of `svbrdf-eval uncertainty --record`, after 1,
/// 2, 5 and 8 photographs: every eighth training material, rectified, with noise and ambient light but no
/// faults; and nine captures of training materials by `svbrdf simulate --real`, with boards and rectified.
/// They maximise the likelihood of Student's distribution with four degrees of freedom, scaled so that one
/// deviation holds for 69 % of the texels.
pub(super) const CALIBRATION: [[f32; TERMS]; 4] = [
    [0.385, 0.166, -0.588, 0.054, 0.319, 0.203, 0.345, -0.059, -0.046, 0.094, 0.180, -0.115, 0.170],
    [2.042, 0.689, -0.315, 0.345, 0.220, 0.347, 0.251, 0.688, -0.102, -0.173, 0.129, 0.509, -0.198],
    [
        0.529, 0.576, -0.487, 0.231, 0.162, 0.162, -0.043, -0.097, -1.757, 0.405, 0.256, 0.241,
        -0.268,
    ],
    [1.701, 1.062, -0.411, 0.215, 0.272, 0.250, -0.418, -0.009, 0.278, 0.057, 0.157, 0.240, 0.097],
];
