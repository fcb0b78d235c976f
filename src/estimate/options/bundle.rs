//! Options of texels and what they share, fitted together.

use serde::{Deserialize, Serialize};

/// Options of the descent of texels together with what they share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BundleOptions {
    /// Damping of the first step, relative to the diagonal. Tuned.
    pub first_damping: f64,
    /// The least, and that with which it gives up. Tuned.
    pub damping: [f64; 2],
    /// What the damping is multiplied by after a step that helps. Tuned.
    pub ease: f64,
    /// The same after one that does not. Tuned.
    pub raise: f64,
    /// Fractions of a step of what is shared that are tried. Tuned.
    pub lengths: [f64; 2],
    /// Fractions of a texel's own step that are tried. Tuned.
    pub texel_lengths: [f64; 3],
    /// Longest step of a texel's coordinate, or of a group's. Tuned.
    pub max_step: f64,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self {
            first_damping: 1e-3,
            damping: [1e-6, 10.0],
            ease: 0.3,
            raise: 20.0,
            lengths: [1.0, 0.3],
            texel_lengths: [1.0, 0.3, 0.0],
            max_step: 0.2,
        }
    }
}
