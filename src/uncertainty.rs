//! Uncertainty of the maps.

use crate::{Error, Result};

/// Standard deviations of the errors of the four maps, per texel.
///
/// Four planes of `width * height` values, rows as in [`Svbrdf`](crate::Svbrdf): each slope of the
/// normal (tangent of a tilt), each channel of the diffuse and of the specular albedo (linear),
/// roughness. About two thirds of all errors lie within one deviation, 19 of 20 within two.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    width: usize,
    height: usize,
    planes: Vec<f32>,
}

/// One number for each map.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MapDeviations {
    /// Of each slope of the normal.
    pub normal: f32,
    /// Of each colour of the diffuse albedo, linear.
    pub diffuse: f32,
    /// Of each colour of the specular albedo, linear.
    pub specular: f32,
    /// Of roughness.
    pub roughness: f32,
}

impl Uncertainty {
    /// Takes four planes.
    ///
    /// # Errors
    /// If `planes` does not hold `4 * width * height` values, or one is negative or not a number.
    pub fn from_planes(width: usize, height: usize, planes: Vec<f32>) -> Result<Self> {
        if width == 0 || height == 0 || planes.len() != 4 * width * height {
            let found = planes.len();
            let message = format!("{found} values given, 4 * {width} * {height} expected");
            return Err(Error::argument("planes", message));
        }
        if !planes.iter().all(|v| v.is_finite() && *v >= 0.0) {
            return Err(Error::argument("planes", "deviations of at least 0 are expected"));
        }
        Ok(Self { width, height, planes })
    }

    /// Texels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Deviations of each slope of the normal.
    pub fn normal(&self) -> &[f32] {
        self.plane(0)
    }

    /// Deviations of each colour of the diffuse albedo.
    pub fn diffuse(&self) -> &[f32] {
        self.plane(1)
    }

    /// Deviations of each colour of the specular albedo.
    pub fn specular(&self) -> &[f32] {
        self.plane(2)
    }

    /// Deviations of roughness.
    pub fn roughness(&self) -> &[f32] {
        self.plane(3)
    }

    /// All planes, one after the other.
    pub fn planes(&self) -> &[f32] {
        &self.planes
    }

    /// Deviations of each map as a whole: root mean squares over the texels.
    pub fn of_maps(&self) -> MapDeviations {
        let rms = |plane: &[f32]| {
            let sum: f64 = plane.iter().map(|v| f64::from(*v) * f64::from(*v)).sum();
            (sum / plane.len() as f64).sqrt() as f32
        };
        MapDeviations {
            normal: rms(self.normal()),
            diffuse: rms(self.diffuse()),
            specular: rms(self.specular()),
            roughness: rms(self.roughness()),
        }
    }

    fn plane(&self, i: usize) -> &[f32] {
        let n = self.width * self.height;
        &self.planes[i * n..(i + 1) * n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_checked_and_summed_up() {
        let planes = vec![0.1, 0.1, 0.0, 0.2, 0.3, 0.3, 0.4, 0.0];
        let uncertainty = Uncertainty::from_planes(2, 1, planes.clone()).unwrap();
        assert_eq!(uncertainty.diffuse(), [0.0, 0.2]);
        let MapDeviations { normal, diffuse, specular, roughness } = uncertainty.of_maps();
        let expected = [0.1, 0.02f32.sqrt(), 0.3, 0.08f32.sqrt()];
        for (found, expected) in [normal, diffuse, specular, roughness].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
        assert!(Uncertainty::from_planes(2, 2, planes.clone()).is_err());
        for wrong in [-0.1, f32::NAN, f32::INFINITY] {
            let mut planes = planes.clone();
            planes[3] = wrong;
            assert!(Uncertainty::from_planes(2, 1, planes).is_err(), "{wrong}");
        }
    }
}
