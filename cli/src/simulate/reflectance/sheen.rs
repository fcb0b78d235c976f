//! The sheen of cloth (Conty and Kulla 2017), with the visibility of Neubelt and Pettineo, as in
//! KHR_materials_sheen.

use std::f64::consts::PI;

use serde::Serialize;
use svbrdf::reflectance::sheen_albedo;

/// Least squared sine between half vector and normal.
const LEAST_SIN2: f64 = 1.0 / 128.0;

/// Sheen above the base and below a coat; the base is dimmed by what it reflects.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sheen {
    /// Linear, 0 to 1.
    pub colour: [f64; 3],
    /// Square root of alpha.
    pub roughness: f64,
}

impl Sheen {
    /// Reflection of white sheen times the cosine, for the cosines of light and view and the squared sine between
    /// half vector and normal.
    pub(super) fn white(&self, [l, v]: [f64; 2], sin2: f64) -> f64 {
        let exponent = self.roughness.powi(-2);
        let density = (2.0 + exponent) * sin2.max(LEAST_SIN2).powf(0.5 * exponent) / (2.0 * PI);
        density / (4.0 * (l + v - l * v)) * l
    }

    /// Share of the light that passes to the base and back.
    pub(super) fn passed(&self, [l, v]: [f64; 2]) -> f64 {
        let most = self.colour.into_iter().fold(0.0, f64::max);
        let [albedo, ..] = sheen_albedo(l.min(v), self.roughness);
        1.0 - most * albedo
    }
}
