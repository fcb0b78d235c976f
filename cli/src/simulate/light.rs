//! The light on the sample.

use glam::DVec3;

/// A flash in a room.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    /// Position of the flash, mm.
    pub place: DVec3,
    /// Unit vector in which it is strongest.
    pub axis: DVec3,
    /// The strength falls with this power of the cosine to the axis; 0: equal in all directions.
    pub exponent: f64,
    /// Intensity along the axis times mm².
    pub power_mm2: f64,
    /// Light of the room as a share of the flash's.
    pub room: f64,
}

impl Light {
    /// Irradiance by the flash at a point, on a surface that faces it.
    pub fn irradiance(&self, point: DVec3) -> f64 {
        let ray = point - self.place;
        let cosine = ray.normalize().dot(self.axis).max(0.0);
        self.power_mm2 * cosine.powf(self.exponent) / ray.length_squared()
    }
}
