//! What is known of light, lens and values: of all photographs, and of one.

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

/// How a photo's values become radiance, and the light they were taken under.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Radiometry {
    /// Radiance in the units of [`View`](crate::observation::View) of a pixel value of 1 on the
    /// optical axis, per channel, the tone curve undone; includes the photo's exposure. Divide by the
    /// vignetting and the lobe.
    pub gain: [f64; 3],
    /// What the camera's tone curve has to be undone by before anything else.
    pub tone: ToneCurve,
    /// Share of each pixel's light that came from far round it, through a dirty lens; taken off before
    /// anything else. 0 with a tone curve.
    pub veil: f64,
    /// Response over the photo.
    pub vignetting: Vignetting,
    /// How the flash's intensity depends on direction.
    pub lobe: Lobe,
    /// Flash in the frame of this photo's camera, mm.
    pub flash_offset_mm: DVec3,
    /// Intensity per channel such that irradiance is `power_mm2 / d²`: pi * reference distance²
    /// for all photos of a capture.
    pub power_mm2: [f32; 3],
    /// Radiance of the uniform surround, units as above, raised by the lobe at the sample's centre:
    /// a [`View`](crate::observation::View) knows no lobe, so that values are divided by it.
    pub ambient: [f32; 3],
    /// Robust standard deviation of the logarithms of the photo's squares from this model, all inks: what
    /// light, lens, paper and file have that the model has not. 0 where there are no squares.
    pub log_sigma: f32,
}

impl Radiometry {
    /// Whether pixels mean something else with another one, beyond a factor.
    pub(crate) fn reads_otherwise(&self, other: &Self) -> bool {
        self.tone != other.tone || self.veil != other.veil
    }

    /// Whether a light and a lens may be like this.
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

/// What is known of light and camera from the photos so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Photometry {
    /// What undoes the camera's tone curve, all photos; of values that are linear the identity.
    pub tone: ToneCurve,
    /// Standard deviations of its logarithmic slopes; zero where values are linear.
    pub tone_sigma: [f64; 3],
    /// Share of light that a dirty lens scatters widely, all photos.
    pub veil: f64,
    /// Its standard deviation; zero where it is not seen.
    pub veil_sigma: f64,
    /// Exponent by which the camera has darkened places whose surroundings are bright, all photos.
    pub local_tone: f64,
    /// Response over the photo, all photos.
    pub vignetting: Vignetting,
    /// How the flash's intensity depends on direction.
    pub lobe: Lobe,
    /// Radiance of the surround per channel; as irradiance relative to the flash's, facing it at
    /// the reference distance, it is the same number. 0 where the photos cannot tell.
    pub ambient: [f64; 3],
    /// Estimate before that decision and its standard deviation, per channel.
    pub ambient_raw: [(f64, f64); 3],
    /// Flash in the camera frame, mm.
    pub flash_offset_mm: DVec3,
    /// Standard deviation of the offset, mm; zero where it is known.
    pub flash_offset_sigma_mm: DVec3,
    /// Reference distance, mm: from the first photo's light to the sample's centre.
    pub reference_mm: f64,
    /// Log of the value per exposure of a white surface of albedo 1 facing the flash on the axis
    /// at the reference distance: one for each photo and channel.
    pub log_scale: Vec<[f64; 3]>,
    /// How many times as bright as its exposure states each photo is, beside most of the others: natural
    /// logarithm, mean of the channels, and its standard deviation.
    pub log_gain: Vec<[f64; 2]>,
    /// Photos turned by 180 degrees after they were taken: their flash lies on the other side.
    pub turned: Vec<bool>,
    /// True over nominal albedo of the black squares, per channel.
    pub black_ratio: [f64; 3],
    /// Robust standard deviation of the squares' log values from the model.
    pub sigma: f64,
    /// The same for each photo; NaN for a photo without squares.
    pub photo_sigma: Vec<f64>,
}
