//! From the board's squares in the photographs so far to absolute radiance.
//!
//! # Model
//! `value = exposure * scale * V * albedo * ((1 - q) g L + q)`, with `g = d_ref² NoL / d²` the
//! flash's irradiance relative to that at the reference distance, `L = cos^n` its lobe about an axis
//! parallel to the camera's, and `q` the ambient's share at the reference. Scale and `q` are per
//! channel, with a small correction of the scale per photo and channel; the lens' vignetting `V` is
//! shared by all photos and channels: `ln V = -(m u + k u²)`, `u = -ln cos` of the angle to the
//! optical axis. With `k = 0` this is `cos^m`, the natural fall-off, so that it extrapolates well
//! into the sample, round which the squares lie.
//!
//! White squares carry the scale. Black ones, whose albedo is known less well and whose toner may
//! glare, count little beside them, but they are what is left where whites clip, as in an exposure
//! for a dark sample: their true albedo is one more unknown per channel.
//!
//! Photographs that a camera has tone-mapped have one curve more, the same for all of a capture, see
//! [`ToneCurve`]: with the same light on black, gray and white, and white under light that falls off,
//! they tell it. It is looked for in all captures and believed where values cannot be linear.
//!
//! # What the squares can and cannot tell
//! * The lobe of a flash at the camera's centre is the same as vignetting. The further off the flash,
//!   the better they part; their product, which is all that a rectified photo needs, is known in
//!   either case.
//! * Scale and white albedo: albedos are relative to the target's `white_albedo`.
//! * Ambient light and `V` look alike in one frontal photo. Tilt and distance tell them apart; until
//!   they clearly do the ambient is taken as 0.
//! * A power of all values looks like a print whose blacks are off and a lens that falls off more:
//!   from one photo it is known no better than the print.

mod fit;
mod light;
mod lobe;
mod model;
mod squares;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::Rejection;
use crate::calibration::Target;
use crate::frame::{Photo, ToneCurve};
use crate::geometry::{Camera, Pose};

use light::Light;
use model::{Ink, Problem, Sample};

pub use lobe::Lobe;
pub(crate) use squares::patch_values;
pub use squares::{Square, Squares};

/// Prior of the ambient's share of the irradiance: a room's lights against a flash nearby.
const AMBIENT_SIGMA: f64 = 0.1;
/// Share of the ambient (less two standard deviations) above which the flash counts as missing.
const MAX_AMBIENT: f64 = 0.5;
/// Residual of log values (robust sigma) that no point light explains.
const MAX_SIGMA: f64 = 0.25;
/// Squares this close to the mirror direction (half vector to normal) may glare.
const GLARE_DEGREES: f64 = 8.0;
const GLARE_SIGMA: f64 = 4.0;
/// Standard deviation of a printed square relative to a white one's.
const INK_SIGMA: f64 = 5.0;

/// Flash position in the camera frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FlashOffset {
    /// Known, mm; zero for a light at the camera's centre.
    Known(DVec3),
    /// Estimated from the squares, with a Gaussian prior.
    Estimated {
        /// Where the flash is expected, mm.
        prior_mm: DVec3,
        /// Standard deviation of that per axis, mm; zero keeps an axis.
        sigma_mm: DVec3,
    },
}

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
    /// Response over the photo.
    pub vignetting: Vignetting,
    /// How the flash's intensity depends on direction.
    pub lobe: Lobe,
    /// Flash in the camera frame, mm.
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
    /// Whether a light and a lens may be like this.
    pub(crate) fn is_plausible(&self) -> bool {
        let Self { gain, tone, vignetting, lobe, flash_offset_mm, power_mm2, ambient, log_sigma } =
            self;
        let shape = [vignetting.exponent, vignetting.curvature, lobe.exponent];
        shape.iter().chain(&lobe.pattern).all(|v| v.is_finite())
            && gain.iter().all(|v| v.is_finite() && *v > 0.0)
            && flash_offset_mm.is_finite()
            && power_mm2.iter().all(|v| v.is_finite() && *v > 0.0)
            && ambient.iter().all(|v| v.is_finite())
            && (0.0..=f32::MAX).contains(log_sigma)
            && tone.is_plausible()
    }
}

/// What is known of light and camera from the photos so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Photometry {
    /// What undoes the camera's tone curve, all photos; of values that are linear the identity.
    pub tone: ToneCurve,
    /// Standard deviations of its logarithmic slopes; zero where values are linear.
    pub tone_sigma: [f64; 3],
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
    /// True over nominal albedo of the black squares, per channel.
    pub black_ratio: [f64; 3],
    /// Robust standard deviation of the squares' log values from the model.
    pub sigma: f64,
    /// The same for each photo; NaN for a photo without squares.
    pub photo_sigma: Vec<f64>,
}

/// Collects white squares and estimates the light anew with every photo.
///
/// Cheap to clone: a caller that may reject a photo later pushes to a clone and keeps it on success.
#[derive(Debug, Clone)]
pub struct PhotometricCalibrator {
    target: Target,
    flash: FlashOffset,
    frames: Vec<Frame>,
    photometry: Option<Photometry>,
}

#[derive(Debug, Clone)]
struct Frame {
    pose: Pose,
    squares: Squares,
}

impl PhotometricCalibrator {
    /// Without photos.
    pub fn new(target: Target, flash: FlashOffset) -> Self {
        Self { target, flash, frames: Vec::new(), photometry: None }
    }

    /// Whether one photo's squares, taken alone, leave room for the flash.
    pub(crate) fn is_lit(&self, squares: &Squares, pose: &Pose) -> bool {
        self.shows_flash(&Frame { pose: *pose, squares: squares.clone() })
    }

    /// The same with photos measured before, which the next one is calibrated together with.
    pub(crate) fn with_photos(self, photos: impl IntoIterator<Item = (Pose, Squares)>) -> Self {
        let frames = photos.into_iter().map(|(pose, squares)| Frame { pose, squares }).collect();
        Self { frames, photometry: None, ..self }
    }

    /// Estimate from all photos, made now; `None` without any.
    pub(crate) fn estimated(&self) -> Option<Photometry> {
        (!self.frames.is_empty()).then(|| self.estimate())
    }

    /// Measures a photo and takes it in. Returns its radiometry; that of earlier photos changes
    /// too, see [`Self::radiometry`].
    ///
    /// # Errors
    /// [`Rejection::TooDark`], [`Rejection::Clipped`], [`Rejection::LightNotVisible`]; the
    /// calibrator is then as before.
    pub fn push(
        &mut self,
        photo: &Photo,
        camera: &Camera,
        pose: &Pose,
    ) -> Result<Radiometry, Rejection> {
        let squares = Squares::measure(photo, &self.target, camera, pose)?;
        self.push_squares(squares, pose)
    }

    /// Takes in squares measured before.
    ///
    /// # Errors
    /// [`Rejection::LightNotVisible`]; the calibrator is then as before.
    pub fn push_squares(&mut self, squares: Squares, pose: &Pose) -> Result<Radiometry, Rejection> {
        let frame = Frame { pose: *pose, squares };
        if !self.shows_flash(&frame) {
            return Err(Rejection::LightNotVisible);
        }
        self.frames.push(frame);
        let photometry = self.estimate();
        let sigma = photometry.photo_sigma.last().copied().unwrap_or(f64::NAN);
        if sigma.is_nan() || sigma > MAX_SIGMA {
            self.frames.pop();
            return Err(Rejection::LightNotVisible);
        }
        self.photometry = Some(photometry);
        self.radiometry(self.frames.len() - 1).ok_or(Rejection::LightNotVisible)
    }

    /// Replaces the poses of all photos, e.g. after the camera was calibrated better.
    ///
    /// # Panics
    /// When `poses` has not one pose per photo.
    pub fn set_poses(&mut self, poses: &[Pose]) {
        assert_eq!(poses.len(), self.frames.len(), "one pose per photo");
        for (frame, pose) in self.frames.iter_mut().zip(poses) {
            frame.pose = *pose;
        }
        if !self.frames.is_empty() {
            self.photometry = Some(self.estimate());
        }
    }

    /// Estimate from all photos so far; `None` before the first.
    pub fn photometry(&self) -> Option<&Photometry> {
        self.photometry.as_ref()
    }

    /// Radiometry of a photo as known now; `None` for a photo that was not pushed.
    pub fn radiometry(&self, index: usize) -> Option<Radiometry> {
        let (p, frame) = (self.photometry.as_ref()?, self.frames.get(index)?);
        let power = std::f64::consts::PI * p.reference_mm * p.reference_mm;
        // Direction of the sample's centre from the flash, camera frame.
        let lobe = p.lobe.at(frame.pose.translation - p.flash_offset_mm);
        Some(Radiometry {
            gain: p.log_scale[index].map(|s| (-s).exp() / f64::from(frame.squares.exposure)),
            tone: p.tone,
            vignetting: p.vignetting,
            lobe: p.lobe,
            flash_offset_mm: p.flash_offset_mm,
            power_mm2: [power as f32; 3],
            ambient: p.ambient.map(|v| (v / lobe) as f32),
            log_sigma: p.photo_sigma.get(index).map_or(0.0, |sigma| *sigma as f32),
        })
    }

    fn problem(&self, reference_mm: f64) -> Problem {
        let (offset_mm, offset_sigma_mm) = match self.flash {
            FlashOffset::Known(offset) => (offset, DVec3::ZERO),
            FlashOffset::Estimated { prior_mm, sigma_mm } => (prior_mm, sigma_mm),
        };
        Problem {
            reference_mm,
            offset_mm,
            offset_sigma_mm,
            ambient_sigma: AMBIENT_SIGMA,
            tone_sigma: 0.0,
        }
    }

    fn expected_offset(&self) -> DVec3 {
        match self.flash {
            FlashOffset::Known(offset) => offset,
            FlashOffset::Estimated { prior_mm, .. } => prior_mm,
        }
    }

    fn samples(&self, index: usize, frame: &Frame) -> impl Iterator<Item = Sample> {
        let light = frame.pose.to_board(self.expected_offset());
        let camera = frame.pose.camera_centre();
        let exposure = f64::from(frame.squares.exposure);
        let (white_albedo, black_albedo) = (self.target.white_albedo, self.target.black_albedo);
        let sample = move |square: &Square, ink: Ink, albedo: f64| {
            let board_mm = square.board_mm.extend(0.0);
            let half = (light - board_mm).normalize() + (camera - board_mm).normalize();
            let glares = half.normalize().z > GLARE_DEGREES.to_radians().cos();
            let sigma = if glares { GLARE_SIGMA } else { 1.0 }
                * if ink == Ink::None { 1.0 } else { INK_SIGMA };
            let value = square.value.map(|v| v.map(f64::from));
            (0..3).filter_map(move |channel| {
                let value = value[channel]?;
                Some(Sample {
                    frame: index,
                    channel,
                    ink,
                    log_stored: (value * exposure).ln(),
                    log_value: (value / albedo).ln(),
                    board_mm,
                    sigma,
                })
            })
        };
        let ink = |white| if white { Ink::None } else { Ink::Black };
        let [_, patch, _] = self.target.patches();
        let gray = (Ink::Gray, self.target.patch_albedo(&patch));
        let gray = frame.squares.gray.iter().map(move |s| (s, gray.0, gray.1));
        let squares = frame.squares.squares.iter();
        let squares = squares
            .map(move |s| (s, ink(s.white), if s.white { white_albedo } else { black_albedo }));
        // An albedo of 0 says nothing about the light.
        let all = squares.chain(gray).filter(|(_, _, albedo)| *albedo > 0.0);
        all.flat_map(move |(square, ink, albedo)| sample(square, ink, albedo))
    }

    /// Whether one photo's squares, taken alone, leave room for the flash.
    fn shows_flash(&self, frame: &Frame) -> bool {
        let light = frame.pose.to_board(self.expected_offset());
        if !light.is_finite() || light.z <= 0.0 {
            return false;
        }
        let samples: Vec<_> = self.samples(0, frame).collect();
        // No opinion on the ambient: a share between 0 and 1 is all that is known.
        let problem = Problem { ambient_sigma: 1.0, ..self.problem(light.length()) };
        let leaves_room = |problem: &Problem| {
            let alone = fit::solve(&samples, &[frame.pose], problem);
            let least = (0..3).map(|c| alone.ambient_share[c] - 2.0 * alone.ambient_share_sigma[c]);
            alone.sigma.is_finite() && least.fold(f64::INFINITY, f64::min) < MAX_AMBIENT
        };
        // Tone mapping makes the light look more even than it is.
        leaves_room(&problem) || leaves_room(&problem.with_tone_curve())
    }

    /// Fits all photos.
    fn estimate(&self) -> Photometry {
        let reference_mm = self.frames[0].pose.to_board(self.expected_offset()).length();
        let samples: Vec<_> =
            self.frames.iter().enumerate().flat_map(|(i, f)| self.samples(i, f)).collect();
        let poses: Vec<_> = self.frames.iter().map(|f| f.pose).collect();
        let problem = self.problem(reference_mm);
        let Light { solution, ambient_raw } = Light::of_capture(&samples, &poses, &problem);
        let share = solution.ambient_share;
        Photometry {
            tone: solution.tone_curve(&samples),
            tone_sigma: std::array::from_fn(|k| solution.tone_covariance[k][k].sqrt()),
            vignetting: Vignetting { exponent: solution.exponent, curvature: solution.curvature },
            lobe: solution.lobe,
            ambient: share.map(|q| q / (1.0 - q)),
            ambient_raw,
            flash_offset_mm: solution.offset_mm,
            flash_offset_sigma_mm: solution.offset_sigma_mm,
            reference_mm,
            log_scale: solution
                .log_scale
                .iter()
                .map(|s| std::array::from_fn(|c| s[c] + (1.0 - share[c]).ln()))
                .collect(),
            black_ratio: solution.black_ratio,
            sigma: solution.sigma,
            photo_sigma: solution.photo_sigma,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
#[cfg(test)]
mod tone_tests;
