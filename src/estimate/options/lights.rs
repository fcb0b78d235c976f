//! Options of the lights.

use serde::{Deserialize, Serialize};

/// Options of the lights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightOptions {
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
    /// Mean residual of turned lights relative to that of held ones that turning must reach: with
    /// less, lights follow noise and what the model cannot say. Tuned.
    pub evidence: f64,
}

impl Default for LightOptions {
    fn default() -> Self {
        Self {
            independent_texels: 1000.0,
            direction_sigma: 0.05,
            min_direction_sigma: 0.003,
            ambient_sigma: 0.05,
            mirrored_sigma: 0.15,
            flatness: [0.005, 0.12],
            evidence: 0.6,
        }
    }
}
