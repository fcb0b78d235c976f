//! Uncertainty of the maps.

use std::ops::Range;

use serde::Serialize;

use crate::svbrdf::{LOBES, lobe};
use crate::{Error, Result};

/// Number of planes of the four maps.
const MAPS: usize = 4;

/// Standard deviations of the errors of the maps, per texel.
///
/// Four planes of `width * height` values, rows as in [`Svbrdf`](crate::Svbrdf): each slope of the
/// normal (tangent of a tilt), each channel of the diffuse and of the specular albedo (linear),
/// roughness. Materials with optional lobes have one more plane for each of [`Svbrdf::lobes`](crate::Svbrdf::lobes),
/// which is 0 for an absent lobe. About two thirds of all errors lie within one deviation, 19 of 20 within two.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    width: usize,
    height: usize,
    planes: Vec<f32>,
}

/// One number for each map; `None` for absent lobes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct MapDeviations {
    /// Standard deviation of each slope of the normal.
    pub normal: f32,
    /// Standard deviation of each colour of the diffuse albedo, linear.
    pub diffuse: f32,
    /// Standard deviation of each colour of the specular albedo, linear.
    pub specular: f32,
    /// Standard deviation of roughness.
    pub roughness: f32,
    /// Standard deviation of each number of anisotropy, [`lobe::ANISOTROPY_X`] and [`lobe::ANISOTROPY_Y`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub anisotropy: Option<f32>,
    /// Standard deviation of the weight of the coat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coat: Option<f32>,
    /// Standard deviation of the roughness of the coat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coat_roughness: Option<f32>,
    /// Standard deviation of each colour of the sheen, linear.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheen: Option<f32>,
    /// Standard deviation of the roughness of the sheen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheen_roughness: Option<f32>,
}

impl Uncertainty {
    /// Takes the four planes of the maps, then those of optional lobes: none, the four of anisotropy and coat, or
    /// eight, see [`Svbrdf::lobes`](crate::Svbrdf::lobes).
    ///
    /// # Errors
    /// If `planes` does not hold 4, 8 or 12 times `width * height` values, or one is negative or not a number.
    pub fn from_planes(width: usize, height: usize, planes: Vec<f32>) -> Result<Self> {
        let allowed = [0, lobe::SHEEN, LOBES].map(|lobes| (MAPS + lobes) * width * height);
        if width == 0 || height == 0 || !allowed.contains(&planes.len()) {
            let found = planes.len();
            let message =
                format!("{found} values given, 4, 8 or 12 times {width} * {height} expected");
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

    /// Deviations of one parameter of the optional lobes, see [`lobe`]: 0 if the lobe is absent, `None` if the
    /// material does not have the plane.
    pub fn lobe(&self, lobe: usize) -> Option<&[f32]> {
        self.planes.chunks_exact(self.width * self.height).nth(MAPS + lobe)
    }

    /// All planes, one after the other: those of the maps, then those of the optional lobes in the order of [`lobe`].
    pub fn planes(&self) -> &[f32] {
        &self.planes
    }

    /// Deviations of each map as a whole: root mean squares over the texels.
    pub fn of_maps(&self) -> MapDeviations {
        let square = |plane: &[f32]| {
            let sum: f64 = plane.iter().map(|v| f64::from(*v) * f64::from(*v)).sum();
            sum / plane.len() as f64
        };
        let rms = |plane: &[f32]| square(plane).sqrt() as f32;
        let of_lobes = |lobes: Range<usize>| {
            let count = lobes.len() as f64;
            let sum: f64 = lobes.filter_map(|i| self.lobe(i).map(square)).sum();
            (sum > 0.0).then(|| (sum / count).sqrt() as f32)
        };
        let of_lobe = |lobe: usize| of_lobes(lobe..lobe + 1);
        MapDeviations {
            normal: rms(self.normal()),
            diffuse: rms(self.diffuse()),
            specular: rms(self.specular()),
            roughness: rms(self.roughness()),
            anisotropy: of_lobes(lobe::ANISOTROPY_X..lobe::COAT),
            coat: of_lobe(lobe::COAT),
            coat_roughness: of_lobe(lobe::COAT_ROUGHNESS),
            sheen: of_lobes(lobe::SHEEN..lobe::SHEEN_ROUGHNESS),
            sheen_roughness: of_lobe(lobe::SHEEN_ROUGHNESS),
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
        assert_eq!(uncertainty.lobe(lobe::COAT), None);
        let MapDeviations { normal, diffuse, specular, roughness, .. } = uncertainty.of_maps();
        let expected = [0.1, 0.02f32.sqrt(), 0.3, 0.08f32.sqrt()];
        for (found, expected) in [normal, diffuse, specular, roughness].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
        assert!(Uncertainty::from_planes(2, 2, planes.clone()).is_err());
        let lobes = [0.3, 0.3, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0];
        let with_lobes = Uncertainty::from_planes(2, 1, [&planes[..], &lobes].concat()).unwrap();
        assert_eq!(with_lobes.lobe(lobe::ANISOTROPY_Y), Some(&[0.5, 0.5][..]));
        let of_maps = with_lobes.of_maps();
        assert!((of_maps.anisotropy.unwrap() - 0.17f32.sqrt()).abs() < 1e-6, "{of_maps:?}");
        assert_eq!(
            of_maps,
            MapDeviations { anisotropy: of_maps.anisotropy, ..uncertainty.of_maps() }
        );
        for wrong in [-0.1, f32::NAN, f32::INFINITY] {
            let mut planes = planes.clone();
            planes[3] = wrong;
            assert!(Uncertainty::from_planes(2, 1, planes).is_err(), "{wrong}");
        }
    }
}
