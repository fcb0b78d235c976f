//! Specular lobes with other tails than GGX's.

use std::f64::consts::PI;

use serde::Serialize;
use svbrdf::reflectance::reflect;
use svbrdf::svbrdf::{CHANNELS, MIN_ROUGHNESS, channel};

/// Sum of a generalised Trowbridge-Reitz lobe (Burley, *Physically Based Shading at Disney*, 2012)
/// and a wider one of GGX.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Lobe {
    /// Exponent of the first; 2 is GGX.
    pub exponent: f64,
    /// Share of the second, 0 to 1.
    pub wide_share: f64,
    /// Roughness of the second relative to the first's.
    pub wide_roughness: f64,
}

impl Lobe {
    /// `BRDF * NoL` for parameters in the order of [`channel`] and unit vectors to light and
    /// camera.
    pub fn reflect(&self, material: &[f64; CHANNELS], light: [f64; 3], view: [f64; 3]) -> [f64; 3] {
        let whole = reflect(material, light, view);
        let mut rougher = *material;
        let roughness = &mut rougher[channel::ROUGHNESS];
        *roughness = (*roughness * self.wide_roughness).min(1.0);
        let wide = reflect(&rougher, light, view);
        let roughness = material[channel::ROUGHNESS].max(f64::from(MIN_ROUGHNESS));
        let cosine = half_cosine(material, light, view);
        let shape =
            distribution(cosine, roughness, self.exponent) / distribution(cosine, roughness, 2.0);
        std::array::from_fn(|c| {
            let c_diffuse = channel::DIFFUSE + c;
            let diffuse = material[c_diffuse] * whole.jacobian[c][c_diffuse];
            diffuse
                + (1.0 - self.wide_share) * shape * (whole.value[c] - diffuse)
                + self.wide_share * (wide.value[c] - diffuse)
        })
    }
}

/// Cosine between the normal and the half vector.
fn half_cosine(material: &[f64; CHANNELS], light: [f64; 3], view: [f64; 3]) -> f64 {
    let normal = glam::DVec3::new(material[channel::SLOPE_X], material[channel::SLOPE_Y], 1.0);
    let half = glam::DVec3::from(light) + glam::DVec3::from(view);
    normal.normalize().dot(half.normalize()).max(0.0)
}

/// Distribution of normals at cosine `nh`; its integral with the cosine over the hemisphere is 1.
fn distribution(nh: f64, roughness: f64, exponent: f64) -> f64 {
    // at 1 the lobe is constant and the scale below 0 / 0
    let alpha2 = roughness.powi(4).min(1.0 - 1e-6);
    let steep = exponent - 1.0;
    let scale = steep * (1.0 - alpha2) / (PI * (alpha2.powf(-steep) - 1.0));
    scale * (1.0 + nh * nh * (alpha2 - 1.0)).powf(-exponent)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoint rule in the squared cosine, in which the integrand of the narrowest lobe here (0.3)
    /// is smooth on a scale of alpha² = 0.008.
    #[test]
    fn distributions_integrate_to_one() {
        for exponent in [1.5, 2.0, 2.3] {
            for roughness in [0.3, 0.6, 1.0] {
                let steps = 200_000;
                let sum: f64 = (0..steps)
                    .map(|i| (f64::from(i) + 0.5) / f64::from(steps))
                    .map(|square| PI * distribution(square.sqrt(), roughness, exponent))
                    .sum();
                let integral = sum / f64::from(steps);
                assert!((integral - 1.0).abs() < 1e-4, "{exponent} {roughness}: {integral}");
            }
        }
    }

    fn material() -> [f64; CHANNELS] {
        [0.1, -0.2, 0.3, 0.2, 0.1, 0.04, 0.05, 0.06, 0.4]
    }

    fn direction(x: f64, y: f64) -> [f64; 3] {
        glam::DVec3::new(x, y, 1.0).normalize().to_array()
    }

    /// GGX alone is the library's renderer.
    #[test]
    fn a_lobe_of_exponent_2_is_ggx() {
        let lobe = Lobe { exponent: 2.0, wide_share: 0.0, wide_roughness: 1.5 };
        let (light, view) = (direction(0.3, 0.1), direction(-0.2, 0.4));
        let expected = reflect(&material(), light, view).value;
        for (value, expected) in lobe.reflect(&material(), light, view).iter().zip(expected) {
            assert!((value / expected - 1.0).abs() < 1e-9, "{value} {expected}");
        }
    }

    /// A second lobe lowers the peak and lifts the tail; a smaller exponent does so too.
    #[test]
    fn tails_grow_at_the_cost_of_the_peak() {
        let ggx = Lobe { exponent: 2.0, wide_share: 0.0, wide_roughness: 1.0 };
        let tailed = Lobe { wide_share: 0.2, wide_roughness: 1.8, ..ggx };
        let longer = Lobe { exponent: 1.7, ..ggx };
        let flat = { [0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.35] };
        let up = direction(0.0, 0.0);
        for other in [tailed, longer] {
            let ratio =
                |light| other.reflect(&flat, light, up)[0] / ggx.reflect(&flat, light, up)[0];
            assert!(ratio(up) < 0.95 && ratio(direction(1.2, 0.0)) > 1.2, "{other:?}");
        }
    }
}
