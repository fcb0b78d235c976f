//! Options of the updates of the prior.

use serde::{Deserialize, Serialize};

/// Options of the groups of texels of like diffuse colour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroupOptions {
    /// Texels that found the groups. Tuned.
    pub samples: usize,
    /// Distance of root albedos at which a texel belongs to two groups alike. Tuned.
    pub reach: f32,
    /// Spread that a group has at least, roughness or root albedo. Tuned.
    pub min_spread: f32,
    /// Variance of the mean of a group that no texel tells. Tuned.
    pub doubt: f32,
    /// Texels that halve it. Tuned.
    pub doubt_texels: f32,
    /// Rounds of k-means. Converged.
    pub rounds: usize,
}

impl Default for GroupOptions {
    fn default() -> Self {
        Self {
            samples: 2048,
            reach: 0.06,
            min_spread: 0.04,
            doubt: 0.04,
            doubt_texels: 20.0,
            rounds: 10,
        }
    }
}

/// Options of the pooling of gloss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoolingOptions {
    /// Log residual that one photograph's model error and noise leave. Tuned.
    pub noise: f32,
    /// How far the maps may be off where nothing was seen: roughness, root of specular albedo.
    /// Tuned.
    pub deviation: [f32; 2],
}

impl Default for PoolingOptions {
    fn default() -> Self {
        Self { noise: 0.1, deviation: [0.25, 0.15] }
    }
}

/// Options of the material classes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClassOptions {
    /// Roughness of dielectrics that compete as well: matt ones have no highlight that would show
    /// them. Tuned.
    pub matt: [f32; 2],
    /// Root of their specular albedo. Derived: 4 %, that of most dielectrics.
    pub matt_root: f32,
    /// Texels along the longer side that are looked at, at most. Tuned.
    pub texels: usize,
    /// Texels that found the classes. Tuned.
    pub samples: usize,
    /// Precision, in those of the maps where nothing was seen, at which a texel's gloss is half
    /// trusted to be a class. Tuned.
    pub trust: f32,
    /// Steps of the solver for each class. Tuned.
    pub steps: usize,
    /// Scale of log residuals that model and noise leave. Tuned.
    pub noise: f32,
    /// Residuals of a texel that count as independent, for each photograph: half of what there are,
    /// for the solver has been free to explain some. Tuned.
    pub independent: f32,
    /// Cost that is expected of a texel without any misfit. Tuned.
    pub expected_cost: f32,
    /// Expected deviation of roots of diffuse albedos from the mean when the gloss changes. Tuned.
    pub diffuse_sigma: f32,
    /// Rounds of k-means. Converged.
    pub rounds: usize,
    /// Rounds of expectation maximisation. Converged.
    pub expectations: usize,
}

impl Default for ClassOptions {
    fn default() -> Self {
        Self {
            matt: [0.6, 0.85],
            matt_root: 0.2,
            texels: 128,
            samples: 8192,
            trust: 10.0,
            steps: 6,
            noise: 0.1,
            independent: 1.5,
            expected_cost: 1.0,
            diffuse_sigma: 0.25,
            rounds: 10,
            expectations: 20,
        }
    }
}

/// Options of the regression of slopes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SlopeOptions {
    /// Radii over which the maps' slopes are averaged, texels. Tuned.
    pub slope_radii: [usize; 3],
    /// Radii over which a colour is averaged before its gradient is taken. Tuned.
    pub colour_radii: [usize; 4],
    /// Albedo that keeps logarithms of dark colours finite. Tuned.
    pub dark: f32,
    /// Fraction of their own information by which coefficients are held at zero. Tuned.
    pub ridge: f64,
}

impl Default for SlopeOptions {
    fn default() -> Self {
        Self { slope_radii: [0, 1, 3], colour_radii: [0, 1, 2, 4], dark: 0.02, ridge: 1e-3 }
    }
}

/// Options of the widths that the material shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WidthOptions {
    /// Least fraction of a sigma that is left of it. Tuned.
    pub min_fraction: f64,
    /// A sigma at least, in units of what texels have in common with their neighbours: half of it
    /// takes relief of fine weaves for noise, twice of it leaves much noise. Tuned.
    pub min_common: f64,
    /// Rounds of the search for the most probable sigma. Converged: it moves by less than 1 % in
    /// further ones.
    pub rounds: usize,
    /// What photographs must tell of a parameter to count, in units of what the prior does. Tuned.
    pub min_information: f32,
    /// Least fraction of the prior's variance that photographs leave. Derived: rounding.
    pub min_open: f32,
    /// Photographs from which on they tell how much roughness varies: fewer take it for specular
    /// albedo. Tuned.
    pub roughness_from: usize,
}

impl Default for WidthOptions {
    fn default() -> Self {
        Self {
            min_fraction: 0.05,
            min_common: 2.0,
            rounds: 12,
            min_information: 1e-3,
            min_open: 1e-3,
            roughness_from: 3,
        }
    }
}

/// Options of the learned prior.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NetworkOptions {
    /// Texels along the longer side that the network sees, at most: what it was trained on.
    pub texels: usize,
    /// Bounds of a material's scales, sigmas. Training.
    pub scale: [f32; 2],
    /// Least steepness of a material. Training.
    pub min_slope: f32,
}

impl Default for NetworkOptions {
    fn default() -> Self {
        Self { texels: 256, scale: [0.02, 2.0], min_slope: 0.01 }
    }
}
