//! Options of the joint solve.

use serde::{Deserialize, Serialize};

/// Options of the joint solve: material classes, shared unknowns, and the candidates for the prior.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointOptions {
    /// The prior with too few photographs to leave one out: two.
    pub two_photographs: JointPrior,
    /// Candidate priors. The prior is the mean of those that predict photographs left out well.
    pub candidates: Vec<JointPrior>,
    /// Number of texels that count as independent, because errors of the model are alike all over a sample.
    /// It weighs shared unknowns against their priors. Tuned.
    pub independent_texels: f64,
    /// Largest number of classes of gloss. Round.
    pub classes: usize,
    /// Expected root of F0 and roughness of a material: F0 of a dielectric, .04, and the middle of the range.
    pub gloss: [f64; 2],
    /// Sigmas of a material's gloss round [`gloss`](Self::gloss). Round: metals and mirrors lie within 2.5.
    pub gloss_sigma: [f64; 2],
    /// Sigmas of shared unknowns.
    pub shared: SharedOptions,
}

/// Sigmas of unknowns that all texels share and the photographs do not state.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SharedOptions {
    /// Logarithm of a photograph's gain. Round.
    pub gain: f64,
    /// Exponent of exposure over distance. Round: wide.
    pub exponent: f64,
    /// Offset of the flash along each axis, mm. Round: the size of a phone.
    pub offset_mm: f64,
    /// Two angles of each light's rotation, radians; without a board, from [`turns_from`](Self::turns_from)
    /// photographs on. Tuned.
    pub turn: f64,
    /// Fewest photographs with light rotation: with fewer, lights follow noise. Tuned.
    pub turns_from: usize,
    /// Ambient irradiance as a fraction of the flash's; without a board. Tuned.
    pub ambient: f64,
    /// Logarithm of [`View::mirrored`](crate::observation::View::mirrored), the factor of reflected ambient
    /// light; with a board. Tuned.
    pub mirrored: f64,
    /// Both numbers of the anisotropy, [`lobe::ANISOTROPY_X`](crate::svbrdf::lobe::ANISOTROPY_X): of all
    /// texels, and of a class round these. Round.
    pub anisotropy: [f64; 2],
    /// Weight of a coat, about 1, and its roughness, about [`coat_roughness`](Self::coat_roughness). Round.
    pub coat: [f64; 2],
    /// Expected roughness of a coat. Round: a lacquer's.
    pub coat_roughness: f64,
    /// Each colour of a sheen, about .1, and its roughness, about .5. Round.
    pub sheen: [f64; 2],
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
            anisotropy: [1.0, 0.5],
            coat: [0.5, 0.15],
            coat_roughness: 0.2,
            sheen: [0.3, 0.2],
        }
    }
}

impl Default for JointOptions {
    fn default() -> Self {
        let classes = JointPrior::default();
        let free = JointPrior { slope: 0.1, specular: 0.1, roughness: 0.12, ..classes };
        let even =
            JointPrior { between_classes: 0.03, specular: 0.002, roughness: 0.001, ..classes };
        Self {
            two_photographs: JointPrior { between_classes: 0.3, diffuse: 0.1, ..classes },
            candidates: vec![
                classes,
                JointPrior { slope: 0.1, ..classes },
                free,
                JointPrior { relief: 0.0, ..even },
            ],
            independent_texels: 14.0,
            classes: 8,
            gloss: [0.2, 0.5],
            gloss_sigma: [0.3, 0.4],
            shared: SharedOptions::default(),
        }
    }
}

/// The prior of texels in the joint solve. Its numbers are round; predictions of photographs choose between
/// candidates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointPrior {
    /// Sigma of a class's gloss (root of specular albedo, roughness) round that of all classes.
    pub between_classes: f64,
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
    /// Scale of log residuals for noise and errors of the lobe: tails of highlights are 10 to 15 % off, alike
    /// over a sample.
    pub noise: f64,
    /// Number of directions of an anisotropic specular lobe: 0 (isotropic), 1 (alike for all texels) or 2.
    pub directions: usize,
    /// Whether all texels have a coat.
    pub coated: bool,
    /// Whether all texels have a sheen.
    pub sheen: bool,
}

impl Default for JointPrior {
    /// Classes of gloss on the learned slopes.
    fn default() -> Self {
        Self {
            between_classes: 0.1,
            relief: 1.0,
            slope: 0.01,
            diffuse: 0.3,
            specular: 0.02,
            roughness: 0.01,
            noise: 0.3,
            directions: 0,
            coated: false,
            sheen: false,
        }
    }
}

impl JointPrior {
    /// This prior with the optional lobes of another.
    pub(in crate::estimate) fn with_lobes_of(self, other: &Self) -> Self {
        let Self { directions, coated, sheen, .. } = *other;
        Self { directions, coated, sheen, ..self }
    }

    /// Number of parameters of the optional lobes.
    pub(in crate::estimate) fn lobe_parameters(&self) -> usize {
        2 * (self.directions + usize::from(self.coated)) + 4 * usize::from(self.sheen)
    }
}
