//! Options of the lights.

use serde::{Deserialize, Serialize};

/// Options of the lights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightOptions {
    /// Steps of a round, at most. Tuned.
    pub steps: usize,
    /// Texels a side that are looked at, at most. Tuned.
    pub texels: usize,
    /// Texels that count as independent, to weigh the sigmas against: errors of the model are alike
    /// all over a sample. Tuned.
    pub independent_texels: f64,
    /// Expected error of a light's direction, radians, at most: lights that turn out to be nearly
    /// right are held narrowly. Tuned.
    pub direction_sigma: f64,
    /// The same at least, however little lights have turned. Tuned.
    pub min_direction_sigma: f64,
    /// Expected ambient irradiance, as a fraction of the flash's. Tuned.
    pub ambient_sigma: f64,
    /// Expected logarithm of [`View::mirrored`](crate::observation::View::mirrored): less than of
    /// rooms, as texels share what the model cannot say of lobes. Tuned.
    pub mirrored_sigma: f64,
    /// Expected mean slope of a sample's piece: at least, and relative to the slopes' deviation.
    /// Tuned on training materials.
    pub flatness: [f64; 2],
    /// Longest step of a light, and longest turn, radians. Derived: the small-angle model.
    pub max_turn: [f64; 2],
    /// Largest ambient fraction. Derived: beyond it a capture is no flash capture.
    pub max_ambient: f64,
    /// Mean residual of turned lights relative to that of held ones that turning must reach: with
    /// less, lights follow noise and what the model cannot say. Tuned.
    pub evidence: f64,
    /// Mean residual that rounding of radiances to half floats leaves, at most. Derived.
    pub rounding: f64,
    /// Relative decrease of the cost of a step that is not worth another. Tuned.
    pub converged: f64,
    /// Changes of ambient light, of the logarithm of what is mirrored, and of the offset of the maps
    /// that are nothing. Tuned.
    pub still: [f64; 3],
    /// Steps with such changes after which held lights are found. Tuned.
    pub still_steps: usize,
}

impl Default for LightOptions {
    fn default() -> Self {
        Self {
            steps: 20,
            texels: 64,
            independent_texels: 1000.0,
            direction_sigma: 0.05,
            min_direction_sigma: 0.003,
            ambient_sigma: 0.05,
            mirrored_sigma: 0.15,
            flatness: [0.005, 0.12],
            max_turn: [0.06, 0.3],
            max_ambient: 0.4,
            evidence: 0.6,
            rounding: 2.5e-4,
            converged: 3e-4,
            still: [1e-4, 5e-3, 5e-4],
            still_steps: 2,
        }
    }
}
