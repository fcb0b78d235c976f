//! Prior of a camera.

use crate::geometry::Camera;
use crate::photo::Photo;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// fx, fy, cx, cy, k1, k2, p1, p2, k3.
pub(super) const INTRINSICS: usize = 9;
pub(super) type Intrinsics = SVector<f64, INTRINSICS>;

/// Main cameras of phones have 24 to 28 mm (36 mm film); wider and longer lenses are common too.
const FOCAL_PER_SIDE: f64 = 0.75;
const LOG_FOCAL_SIGMA: f64 = 0.15;
/// Relative standard deviation of a focal length in a file's metadata.
const METADATA_SIGMA: f64 = 0.04;
const FILM_DIAGONAL_MM: f64 = 43.267;
/// Pixels of current sensors are square.
const LOG_ASPECT_SIGMA: f64 = 0.002;
/// Offset of the principal point from the centre, part of the long side.
const CENTRE_SIGMA: f64 = 0.012;
/// Radial terms: relative displacement at the picture's corner.
const RADIAL_SIGMA: [f64; 3] = [0.2, 0.1, 0.05];
/// Tangential terms: tilt of the sensor, radians.
const TANGENTIAL_SIGMA: f64 = 0.001;
/// Smaller sigmas count as fixed where parameters are coupled.
const LOG_SIGMA_MIN: f64 = 1e-5;

/// Gaussian prior of the intrinsics.
///
/// A few photographs cannot determine all nine numbers, so each has a prior mean and deviation,
/// weighed against the corner noise. Undetermined numbers stay plausible, and the corners soon
/// outweigh the prior of the others. An infinite sigma leaves a number free; 0 fixes it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraPrior {
    /// Prior means and the picture's size.
    pub camera: Camera,
    /// Relative standard deviation of the focal length.
    pub focal_sigma: f64,
    /// Standard deviation of fx / fy relative to the prior mean.
    pub aspect_sigma: f64,
    /// Standard deviation of cx and cy, px.
    pub centre_sigma_px: f64,
    /// Standard deviation of k1, k2, p1, p2, k3.
    pub distortion_sigma: [f64; 5],
}

impl CameraPrior {
    /// Whether the values are possible (for saved data).
    pub(crate) fn is_plausible(&self) -> bool {
        let sigmas = [&self.focal_sigma, &self.aspect_sigma, &self.centre_sigma_px];
        let mut sigmas = sigmas.into_iter().chain(&self.distortion_sigma);
        self.camera.fault().is_none() && sigmas.all(|s| (0.0..=f64::MAX).contains(s))
    }

    /// Prior of an unknown camera of a given picture size: square pixels, central principal point,
    /// a phone's focal length within 15 %, little distortion.
    pub fn ordinary(width: u32, height: u32) -> Self {
        let (w, h) = (f64::from(width), f64::from(height));
        let long = w.max(h);
        let focal = FOCAL_PER_SIDE * long;
        let r2 = 0.25 * (w * w + h * h) / (focal * focal);
        let [k1, k2, k3] = RADIAL_SIGMA;
        Self {
            camera: Camera {
                width,
                height,
                fx: focal,
                fy: focal,
                cx: 0.5 * (w - 1.0),
                cy: 0.5 * (h - 1.0),
                distortion: [0.0; 5],
            },
            focal_sigma: LOG_FOCAL_SIGMA,
            aspect_sigma: LOG_ASPECT_SIGMA,
            centre_sigma_px: CENTRE_SIGMA * long,
            distortion_sigma: [
                k1 / r2,
                k2 / (r2 * r2),
                TANGENTIAL_SIGMA,
                TANGENTIAL_SIGMA,
                k3 / (r2 * r2 * r2),
            ],
        }
    }

    /// [`CameraPrior::ordinary`] for a photograph, with the focal length of its metadata if present. Metadata
    /// round it to whole millimetres, and refer to width or diagonal depending on the maker.
    pub fn of_photo(photo: &Photo) -> Self {
        let prior = Self::ordinary(photo.width(), photo.height());
        match photo.focal_35mm() {
            None => prior,
            Some(mm) => {
                let diagonal = f64::from(photo.width()).hypot(f64::from(photo.height()));
                prior.with_focal(f64::from(mm) * diagonal / FILM_DIAGONAL_MM, METADATA_SIGMA)
            }
        }
    }

    /// The prior with a known focal length and its relative standard deviation, e.g. 0.03 from metadata.
    pub fn with_focal(mut self, focal_px: f64, sigma: f64) -> Self {
        (self.camera.fx, self.camera.fy) = (focal_px, focal_px);
        self.focal_sigma = sigma;
        self
    }

    /// Whether the focal length comes from metadata or a calibration.
    pub fn is_stated(&self) -> bool {
        self.focal_sigma <= METADATA_SIGMA
    }

    /// A flat prior, for plain least squares as in OpenCV's `calibrateCamera`. It needs several
    /// photographs from different sides.
    pub fn none(width: u32, height: u32) -> Self {
        Self {
            focal_sigma: f64::INFINITY,
            aspect_sigma: f64::INFINITY,
            centre_sigma_px: f64::INFINITY,
            distortion_sigma: [f64::INFINITY; 5],
            ..Self::ordinary(width, height)
        }
    }

    /// Prior around an earlier calibration: 1 % of the focal length, which changes with focus, and
    /// half the ordinary deviation of the rest.
    pub fn around(camera: Camera) -> Self {
        let ordinary = Self::ordinary(camera.width, camera.height);
        Self {
            camera,
            focal_sigma: 0.01,
            aspect_sigma: 0.5 * LOG_ASPECT_SIGMA,
            centre_sigma_px: 0.5 * ordinary.centre_sigma_px,
            distortion_sigma: ordinary.distortion_sigma.map(|s| 0.25 * s),
        }
    }

    /// Whether the camera has no fault and no sigma is negative.
    pub(super) fn is_valid(&self) -> bool {
        let sigmas = [self.focal_sigma, self.aspect_sigma, self.centre_sigma_px];
        let sound = |s: &f64| *s >= 0.0;
        self.camera.fault().is_none()
            && sigmas.iter().all(sound)
            && self.distortion_sigma.iter().all(sound)
    }

    /// Which of fx, fy, cx, cy, k1, k2, p1, p2, k3 are free.
    pub(super) fn free(&self) -> [bool; INTRINSICS] {
        let mut free = [true; INTRINSICS];
        free[2..4].fill(self.centre_sigma_px > 0.0);
        for (free, sigma) in free[4..].iter_mut().zip(self.distortion_sigma) {
            *free = sigma > 0.0;
        }
        free
    }

    /// Deviations of a camera from the prior in standard deviations, each with its derivatives.
    pub(super) fn terms(&self, camera: &Camera) -> impl Iterator<Item = (f64, Intrinsics)> {
        let expected = &self.camera;
        let mean = 0.5 * ((camera.fx / expected.fx).ln() + (camera.fy / expected.fy).ln());
        let aspect = (camera.fx / expected.fx).ln() - (camera.fy / expected.fy).ln();
        let along = |x: f64, y: f64| {
            let mut row = Intrinsics::zeros();
            (row[0], row[1]) = (x / camera.fx, y / camera.fy);
            row
        };
        let focal = [
            (mean, along(0.5, 0.5), self.focal_sigma.max(LOG_SIGMA_MIN)),
            (aspect, along(1.0, -1.0), self.aspect_sigma.max(LOG_SIGMA_MIN)),
        ];
        let at = |camera: &Camera| {
            let [k1, k2, p1, p2, k3] = camera.distortion;
            [camera.cx, camera.cy, k1, k2, p1, p2, k3]
        };
        let (now, then) = (at(camera), at(expected));
        let (c, d) = (self.centre_sigma_px, self.distortion_sigma);
        let sigmas = [c, c, d[0], d[1], d[2], d[3], d[4]];
        let single = (0..7).map(move |i| {
            let mut row = Intrinsics::zeros();
            row[2 + i] = 1.0;
            (now[i] - then[i], row, sigmas[i])
        });
        focal
            .into_iter()
            .chain(single)
            .filter(|(_, _, sigma)| *sigma > 0.0 && sigma.is_finite())
            .map(|(value, row, sigma)| (value / sigma, row / sigma))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_give_the_focal_length() {
        let photo = Photo::from_linear(30, 40, vec![0.5; 3600], 1.0, 1.0).unwrap();
        assert_eq!(CameraPrior::of_photo(&photo).camera.fx, 30.0);
        let prior = CameraPrior::of_photo(&photo.with_focal_35mm(Some(26.0)));
        assert!((prior.camera.fy - 26.0 / 43.267 * 50.0).abs() < 1e-9);
        assert_eq!(prior.focal_sigma, 0.04);
    }
}
