//! The pattern of a flash.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Direction dependence of a flash's intensity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Lobe {
    /// `n` of `cos^n` of the angle between the direction from flash to surface and the camera's axis.
    pub exponent: f64,
    /// Deviation from rotational symmetry: `cos^n` is multiplied by `1 + p[0] (x² - y²) + p[1] 2 x
    /// y`, with `x` and `y` of the unit direction in the camera frame.
    pub pattern: [f64; 2],
}

impl Lobe {
    /// Lower limit of the pattern.
    pub(crate) const MIN_PATTERN: f64 = 0.2;

    /// Relative intensity in a direction, camera frame; 1 along the axis.
    pub fn at(&self, direction: DVec3) -> f64 {
        let DVec3 { x, y, z } = direction.normalize();
        let pattern = 1.0 + self.pattern[0] * (x * x - y * y) + self.pattern[1] * 2.0 * x * y;
        z.max(0.1).powf(self.exponent) * pattern.max(Self::MIN_PATTERN)
    }
}
