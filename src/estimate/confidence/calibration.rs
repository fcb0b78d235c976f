//! Calibration of the stated deviations.

/// Terms of the logarithm of a stated deviation, see [`Evidence`](super::Evidence).
pub const TERMS: usize = 13;

/// For each map (normal, diffuse, specular, roughness) the coefficients of the terms that
/// [`Evidence`](super::Evidence) names, whose sum is the logarithm of the deviation: of each slope, of
/// each colour of an albedo, of roughness.
///
/// Fitted with `training/calibrate_confidence.py` on what `svbrdf-eval confidence --record` writes of
/// training materials, rectified without faults, with noise and ambient light, and with the faults of
/// `svbrdf simulate --real`, after 1, 2, 5 and 8 photographs: maximum likelihood of Student's
/// distribution with four degrees of freedom, then scaled so that one deviation holds for 69 % of
/// the training texels. Two things were changed afterwards, on captures with faults (`svbrdf-eval gate`,
/// group `fresh`). The last coefficient was set on 36, of normals only: those of exact photographs stay
/// as they are. The term of the structured prior was 1 for any number of photographs; with two, deviations
/// were half of what they should be (22 captures without a board).
pub(super) const CALIBRATION: [[f32; TERMS]; 4] = [
    [2.512, 0.652, -0.519, 0.629, 0.472, 0.291, 0.280, 0.272, 0.197, -0.115, 0.270, -0.636, 0.3],
    [3.021, 0.836, -0.780, 1.000, 0.481, 0.234, 0.069, 0.630, -0.175, 0.225, 0.010, -0.502, 0.0],
    [2.276, 0.498, -0.246, 0.156, 0.096, 0.152, -0.392, 0.705, -0.179, 0.360, 0.299, -0.144, 0.0],
    [3.896, 0.660, 0.062, 0.282, 0.219, 0.227, 0.126, 0.400, 0.102, 0.521, 0.273, 0.035, 0.0],
];
