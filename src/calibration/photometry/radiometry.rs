//! Estimated light, lens and scale, of a capture and of one photograph.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::lobe::Lobe;
use crate::photo::ToneCurve;

/// Relative response of the lens over the photo.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Vignetting {
    /// `m` of `ln V = -(m u + k u²)`, `u = -ln cos(angle to the optical axis)`.
    pub exponent: f64,
    /// `k`.
    pub curvature: f64,
}

impl Vignetting {
    /// Response at squared tangent `tan²(angle)`; 1 on the axis.
    pub fn at(&self, tan2: f64) -> f64 {
        let u = 0.5 * (1.0 + tan2).ln();
        (-u * (self.exponent + u * self.curvature)).exp()
    }
}

/// Conversion of a photo's values to radiance, and its light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Radiometry {
    /// Radiance per channel of a linearised pixel value of 1 on the optical axis, in the units of
    /// [`View`](crate::observation::View), including the photo's exposure. Divide by vignetting and lobe.
    pub gain: [f64; 3],
    /// The camera's tone curve, to undo first.
    pub tone: ToneCurve,
    /// Share of each pixel's light that a dirty lens scatters from far around it, to subtract
    /// first. 0 with a tone curve.
    pub veil: f64,
    /// Response over the photo.
    pub vignetting: Vignetting,
    /// Direction dependence of the flash's intensity.
    pub lobe: Lobe,
    /// Flash in the frame of this photo's camera, mm.
    pub flash_offset_mm: DVec3,
    /// Intensity per channel, for an irradiance of `power_mm2 / d²`: pi * reference distance² in
    /// all photos of a capture.
    pub power_mm2: [f32; 3],
    /// Radiance of the uniform surroundings in the same units, divided by the lobe at the sample's
    /// centre because a [`View`](crate::observation::View) has no lobe.
    pub ambient: [f32; 3],
    /// Robust standard deviation of the squares' log values from this model, all inks: the
    /// photometric residual of light, lens, paper and file. 0 without squares.
    pub log_sigma: f32,
}

impl Radiometry {
    /// Whether the conversion of pixels differs by more than a factor.
    pub(crate) fn reads_otherwise(&self, other: &Self) -> bool {
        self.tone != other.tone || self.veil != other.veil
    }

    /// Whether the values are possible (for saved data).
    pub(crate) fn is_plausible(&self) -> bool {
        let Self { gain, tone, vignetting, lobe, flash_offset_mm, .. } = self;
        let Self { power_mm2, ambient, log_sigma, veil, .. } = self;
        let shape = [vignetting.exponent, vignetting.curvature, lobe.exponent];
        shape.iter().chain(&lobe.pattern).all(|v| v.is_finite())
            && gain.iter().all(|v| v.is_finite() && *v > 0.0)
            && flash_offset_mm.is_finite()
            && power_mm2.iter().all(|v| v.is_finite() && *v > 0.0)
            && ambient.iter().all(|v| v.is_finite())
            && (0.0..=f32::MAX).contains(log_sigma)
            && tone.is_plausible()
            && (0.0..1.0).contains(veil)
    }
}

/// Light and camera estimated from all photos.
#[derive(Debug, Clone, PartialEq)]
pub struct Photometry {
    /// Inverse of the camera's tone curve, all photos; the identity for linear values.
    pub tone: ToneCurve,
    /// Standard deviations of its log slopes; zero for linear values.
    pub tone_sigma: [f64; 3],
    /// Share of light that a dirty lens scatters, all photos.
    pub veil: f64,
    /// Its standard deviation; zero if not significant.
    pub veil_sigma: f64,
    /// Exponent of darkening by bright surroundings, all photos.
    pub local_tone: f64,
    /// Index of the surroundings' scale for that, finest first.
    pub local_scale: usize,
    /// Response over the photo, all photos.
    pub vignetting: Vignetting,
    /// Direction dependence of the flash's intensity.
    pub lobe: Lobe,
    /// Radiance of the surroundings per channel. The same number is their irradiance relative to
    /// that of the flash, facing it at the reference distance. 0 if not significant.
    pub ambient: [f64; 3],
    /// Ambient estimate before the significance test, with its standard deviation, per channel.
    pub ambient_raw: [(f64, f64); 3],
    /// Flash in the camera frame, mm.
    pub flash_offset_mm: DVec3,
    /// Standard deviation of the offset, mm; zero if given.
    pub flash_offset_sigma_mm: DVec3,
    /// Reference distance, mm: from the light of the first photo to the sample's centre.
    pub reference_mm: f64,
    /// Log of the value per exposure of a white surface of albedo 1 facing the flash, on the axis
    /// at the reference distance, for each photo and channel.
    pub log_scale: Vec<[f64; 3]>,
    /// Natural log of each photo's brightness over that of its stated exposure, relative to most
    /// photos, mean of the channels, with its standard deviation.
    pub log_gain: Vec<[f64; 2]>,
    /// Photos turned by 180 degrees after capture: their flash lies on the opposite side.
    pub turned: Vec<bool>,
    /// True over nominal albedo of the black squares, per channel.
    pub black_ratio: [f64; 3],
    /// Robust standard deviation of the squares' log values from the model.
    pub sigma: f64,
    /// The same for each photo; NaN without squares.
    pub photo_sigma: Vec<f64>,
}
