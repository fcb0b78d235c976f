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
//! [`ToneCurve`](crate::frame::ToneCurve): with the same light on black, gray and white, and white under light that falls off,
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

mod examination;
mod exposure;
mod fit;
mod light;
mod lobe;
mod model;
mod patches;
mod radiometry;
mod squares;
mod turned;

use glam::DVec3;

use crate::Rejection;
use crate::calibration::Target;
use crate::frame::{Photo, Surround};
use crate::geometry::{Camera, Pose};

use light::Light;
use model::{Ink, Problem, Sample, Shot};

pub(crate) use examination::{Examination, LitPlaces, examine};
pub use lobe::Lobe;
pub use radiometry::{Photometry, Radiometry, Vignetting};
pub(crate) use squares::edited;
pub use squares::{Spread, Square, Squares};

/// Prior of the ambient's share of the irradiance: a room's lights against a flash nearby.
const AMBIENT_SIGMA: f64 = 0.1;
/// Share of the ambient above which the flash counts as missing, and the largest that is tried.
const MAX_AMBIENT: f64 = 0.5;
const ANY_AMBIENT: f64 = 0.98;
/// How much better (misfit) a photograph must be explained by more ambient light than that.
const NO_FLASH_EVIDENCE: f64 = 9.0;
/// Share of white squares that are clipped which leaves too little to tell the light.
const MAX_CLIPPED: f32 = 0.4;
/// Standard deviation of a lens' or a flash's exponent below its mean, where the question is whether there is
/// a flash: below 0 there is hardly any.
const SOUND_LENS_SIGMA: f64 = 1.0;
/// Residual of log values (robust sigma) that no point light explains.
const MAX_SIGMA: f64 = 0.25;
/// Squares this close to the mirror direction (half vector to normal) may glare.
const GLARE_DEGREES: f64 = 8.0;
/// The same for printed ones, where a little glare weighs sixteen times.
const INK_GLARE_DEGREES: f64 = 16.0;
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

    /// What speaks against one photo's light, taken alone.
    pub(crate) fn fault(&self, squares: &Squares, pose: &Pose) -> Option<Rejection> {
        let frame = Frame { pose: *pose, squares: squares.clone() };
        (!self.shows_flash(&frame)).then(|| self.why_unlit(&frame))
    }

    /// Why a photo does not look lit by a flash.
    fn why_unlit(&self, frame: &Frame) -> Rejection {
        let alone = Self { frames: vec![frame.clone()], photometry: None, ..self.clone() };
        if !frame.pose.to_board(self.expected_offset()).is_finite()
            || frame.pose.to_board(self.expected_offset()).z <= 0.0
        {
            return Rejection::LightNotVisible;
        }
        let known = alone.estimate();
        let light = examine(&self.target, &[(frame.pose, &frame.squares)], &known).photos[0];
        if let Some(amplitude) = light.stripes {
            return Rejection::Flickers { amplitude: amplitude as f32 };
        }
        if frame.squares.clipped_share > MAX_CLIPPED {
            return Rejection::Clipped { share: frame.squares.clipped_share };
        }
        let tone = self.photometry.as_ref().map(|known| known.tone).unwrap_or_default();
        let earlier = self.frames.iter().map(|frame| &frame.squares);
        match edited(&frame.squares, earlier, &self.target, &tone) {
            Some([black, usual]) => Rejection::Edited { black, usual },
            None => Rejection::LightNotVisible,
        }
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
        let squares = Squares::measure(photo, &self.target, camera, pose, 0.0)?;
        self.push_squares(squares, pose)
    }

    /// Takes in squares measured before.
    ///
    /// # Errors
    /// [`Rejection::LightNotVisible`]; the calibrator is then as before.
    pub fn push_squares(&mut self, squares: Squares, pose: &Pose) -> Result<Radiometry, Rejection> {
        let frame = Frame { pose: *pose, squares };
        if !self.shows_flash(&frame) {
            return Err(self.why_unlit(&frame));
        }
        self.frames.push(frame);
        let photometry = self.estimate();
        let sigma = photometry.photo_sigma.last().copied().unwrap_or(f64::NAN);
        if sigma.is_nan() || sigma > MAX_SIGMA {
            let frame = self.frames.pop();
            return Err(frame.map_or(Rejection::LightNotVisible, |frame| self.why_unlit(&frame)));
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
        let shot = Shot { pose: frame.pose, turned: p.turned[index] };
        let flash_offset_mm = shot.offset(p.flash_offset_mm);
        let lobe = p.lobe.at(frame.pose.translation - flash_offset_mm);
        Some(Radiometry {
            gain: p.log_scale[index].map(|s| (-s).exp() / f64::from(frame.squares.exposure)),
            tone: p.tone,
            veil: p.veil,
            vignetting: p.vignetting,
            lobe: p.lobe,
            flash_offset_mm,
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
        let ambient_sigma = AMBIENT_SIGMA;
        Problem {
            reference_mm,
            offset_mm,
            offset_sigma_mm,
            ambient_sigma,
            ambient_max: MAX_AMBIENT,
            ..Problem::default()
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
        let log_around = |square: &Square| square.around.map(|v| f64::from(v).max(1e-9).ln());
        let count = frame.squares.squares.len().max(1) as f64;
        let means: [f64; Surround::SCALES.len()] = std::array::from_fn(|k| {
            frame.squares.squares.iter().map(|s| log_around(s)[k]).sum::<f64>() / count
        });
        let sample = move |square: &Square, ink: Ink, albedo: f64| {
            let board_mm = square.board_mm.extend(0.0);
            let half = (light - board_mm).normalize() + (camera - board_mm).normalize();
            let degrees = if ink == Ink::None { GLARE_DEGREES } else { INK_GLARE_DEGREES };
            let glares = half.normalize().z > degrees.to_radians().cos();
            let sigma = if glares { GLARE_SIGMA } else { 1.0 }
                * if ink == Ink::None { 1.0 } else { INK_SIGMA };
            let value = square.value.map(|v| v.map(f64::from));
            let surround = square.surround.map(f64::from);
            let log_around = log_around(square);
            let log_surround = std::array::from_fn(|k| log_around[k] - means[k]);
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
                    surround: surround[channel] / albedo,
                    log_surround,
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
        let shots = [Shot { pose: frame.pose, turned: false }];
        // No opinion on the ambient: a share between 0 and 1 is all that is known. No lens brightens the
        // border of a photo, and no flash.
        let problem = Problem {
            ambient_sigma: 1.0,
            exponent_sigma_below: SOUND_LENS_SIGMA,
            ..self.problem(light.length())
        };
        let leaves_room = |problem: &Problem| {
            let any = Problem { ambient_max: ANY_AMBIENT, ..*problem };
            let even = fit::solve(&samples, &shots, &any, None);
            if even.ambient_share.iter().all(|share| *share <= MAX_AMBIENT) {
                return even.sigma.is_finite();
            }
            let flash = fit::solve(&samples, &shots, problem, None);
            let sigma = even.sigma.max(fit::TONE_MIN_SIGMA);
            let misfit = |solution: &fit::Solution, problem: &Problem| {
                fit::misfit(&samples, &shots, problem, solution, sigma)
            };
            misfit(&flash, problem) - misfit(&even, &any) < NO_FLASH_EVIDENCE
        };
        // Tone mapping makes the light look more even than it is.
        leaves_room(&problem) || leaves_room(&problem.with_tone_curve())
    }

    /// Fits all photos.
    fn estimate(&self) -> Photometry {
        let reference_mm = self.frames[0].pose.to_board(self.expected_offset()).length();
        let samples: Vec<_> =
            self.frames.iter().enumerate().flat_map(|(i, f)| self.samples(i, f)).collect();
        let shots = self.frames.iter().map(|f| Shot { pose: f.pose, turned: false }).collect();
        let problem = self.problem(reference_mm);
        let Light { solution, ambient_raw, shots } = Light::of_capture(&samples, shots, &problem);
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
            log_gain: solution.log_gain,
            turned: shots.iter().map(|shot| shot.turned).collect(),
            veil: solution.veil[0],
            veil_sigma: solution.veil[1],
            local_tone: solution.local_tone[0],
            black_ratio: solution.black_ratio,
            sigma: solution.sigma,
            photo_sigma: solution.photo_sigma,
        }
    }
}

#[cfg(test)]
mod fault_tests;
#[cfg(test)]
pub(crate) mod tests;
#[cfg(test)]
mod tone_tests;
