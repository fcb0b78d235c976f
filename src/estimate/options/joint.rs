//! Options of the joint solve.

use serde::{Deserialize, Serialize};

/// Options of the joint solve: material classes, what all texels share, and how the prior is chosen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointOptions {
    /// The prior where photographs are too few to leave one out.
    pub few: JointPrior,
    /// The priors that predict photographs left out; the mean of those that predict well is used.
    pub candidates: Vec<JointPrior>,
    /// Texels that count as independent where something shared is weighed against its prior: errors of
    /// the model are alike all over a sample. Tuned.
    pub independent_texels: f64,
    /// Expected deviations of a class from [`class_mean`](Self::class_mean): root of F0, roughness.
    pub class_sigma: [f64; 2],
    /// Expected root of F0 and roughness of a class: a dielectric.
    pub class_mean: [f64; 2],
    /// Sigmas of what all texels share.
    pub shared: SharedOptions,
}

/// Sigmas of the numbers that all texels share, as far as the photographs do not state them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SharedOptions {
    /// Logarithm of a photograph's gain.
    pub gain: f64,
    /// Exponent of exposure over distance.
    pub exponent: f64,
    /// Offset of the flash along each axis, mm.
    pub offset_mm: f64,
    /// Two angles of each light, radians; without a board, from
    /// [`turns_from`](Self::turns_from) photographs on. Tuned.
    pub turn: f64,
    /// Photographs from which on lights turn: with fewer they follow noise. Tuned.
    pub turns_from: usize,
    /// Ambient irradiance as a fraction of the flash's; without a board. Tuned.
    pub ambient: f64,
    /// Logarithm of [`View::mirrored`](crate::observation::View::mirrored); with a board. Tuned.
    pub mirrored: f64,
}

impl Default for SharedOptions {
    fn default() -> Self {
        Self {
            gain: 0.05,
            exponent: 2.0,
            offset_mm: 30.0,
            turn: 0.2,
            turns_from: 8,
            ambient: 0.2,
            mirrored: 0.6,
        }
    }
}

impl Default for JointOptions {
    fn default() -> Self {
        let classes = JointPrior::default();
        let one = JointPrior { classes: 1, specular: 0.002, roughness: 0.001, ..classes };
        let free = JointPrior { slope: 0.1, specular: 0.1, roughness: 0.12, ..classes };
        Self {
            few: JointPrior { diffuse: 0.1, ..classes },
            candidates: vec![
                classes,
                one,
                JointPrior { slope: 0.1, ..classes },
                free,
                JointPrior { noise: 0.1, ..free },
                JointPrior { relief: 0.0, ..classes },
                JointPrior { relief: 0.0, ..one },
            ],
            independent_texels: 14.0,
            class_sigma: [0.3, 0.4],
            class_mean: [0.2, 0.5],
            shared: SharedOptions::default(),
        }
    }
}

/// The prior of texels in the joint solve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointPrior {
    /// Classes of gloss.
    pub classes: usize,
    /// Share of the learned slopes in the mean: 0 is a flat sheet.
    pub relief: f64,
    /// Sigma of slopes.
    pub slope: f64,
    /// Sigma of roots of diffuse albedo.
    pub diffuse: f64,
    /// Sigma of roots of specular albedo within a class.
    pub specular: f64,
    /// Sigma of roughness within a class.
    pub roughness: f64,
    /// Scale of log residuals, for noise and errors of the lobe together: tails of highlights are 10 to
    /// 15 % off, alike over a sample.
    pub noise: f64,
}

impl Default for JointPrior {
    /// Eight classes of gloss on the learned slopes.
    fn default() -> Self {
        Self {
            classes: 8,
            relief: 1.0,
            slope: 0.01,
            diffuse: 0.3,
            specular: 0.02,
            roughness: 0.01,
            noise: 0.3,
        }
    }
}
