//! Options of the updates of the prior.

use serde::{Deserialize, Serialize};

/// Options of groups of texels of like diffuse colour, and of the pooling of gloss in them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoolingOptions {
    /// Distance of root albedos at which a texel belongs to two groups alike. Tuned.
    pub reach: f32,
    /// Spread that a group has at least, roughness or root albedo. Tuned.
    pub min_spread: f32,
    /// How far the maps may be off where nothing was seen: roughness, root of specular albedo.
    /// Tuned.
    pub deviation: [f32; 2],
}

impl Default for PoolingOptions {
    fn default() -> Self {
        Self { reach: 0.06, min_spread: 0.04, deviation: [0.25, 0.15] }
    }
}

/// Options of the material classes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClassOptions {
    /// Roughness of dielectrics that compete as well: matt ones have no highlight that would show
    /// them. Tuned.
    pub matt: [f32; 2],
    /// Precision, in those of the maps where nothing was seen, at which a texel's gloss is half
    /// trusted to be a class. Tuned.
    pub trust: f32,
    /// Residuals of a texel that count as independent, for each photograph: half of what there are,
    /// for the solver has been free to explain some. Tuned.
    pub independent: f32,
    /// Expected deviation of roots of diffuse albedos from the mean when the gloss changes. Tuned.
    pub diffuse_sigma: f32,
}

impl Default for ClassOptions {
    fn default() -> Self {
        Self { matt: [0.6, 0.85], trust: 10.0, independent: 1.5, diffuse_sigma: 0.25 }
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
}

impl Default for WidthOptions {
    fn default() -> Self {
        Self { min_fraction: 0.05, min_common: 2.0 }
    }
}
