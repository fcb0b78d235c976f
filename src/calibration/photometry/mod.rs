//! From the board's squares in all photographs to absolute radiance.
//!
//! # Model
//! `value = exposure * scale * V * albedo * ((1 - q) g L + q)`. `g = d_ref² NoL / d²` is the flash's
//! irradiance relative to that at the reference distance, `L = cos^n` its lobe about an axis parallel to the
//! camera's, and `q` the ambient share at the reference. Scale and `q` are per channel; each photo has a
//! small correction of the scale per channel. All photos and channels share the vignetting `V` of the lens:
//! `ln V = -(m u + k u²)`, `u = -ln cos` of the angle to the optical axis. At `k = 0` this is the natural
//! fall-off `cos^m`, which extrapolates well from the squares into the sample.
//!
//! White squares determine the scale. Black squares have a less certain albedo and their toner may
//! glare, so their weight is small. They remain usable where white clips, as in an exposure for a
//! dark sample; their true albedo is one more unknown per channel.
//!
//! Tone-mapped photographs have one more curve per capture, see [`ToneCurve`](crate::photo::ToneCurve).
//! Black, gray and white under equal light, and white under falling light, determine it. Every capture is
//! tested for it, and it is accepted where values cannot be linear.
//!
//! # Ambiguities
//! * The lobe of a flash at the camera's centre equals vignetting. They separate better the further
//!   off the flash is. Rectified photos need only their product, which is always determined.
//! * Scale and white albedo: albedos are relative to the target's `white_albedo`.
//! * Ambient light and `V` look alike in one frontal photo. Tilt and distance separate them;
//!   ambient light is 0 until it is significant.
//! * A power of all values resembles a print with wrong blacks and a lens with more fall-off: one
//!   photo determines it only as well as the print.

mod examination;
mod exposure;
mod fit;
mod lamp;
mod light;
mod lobe;
mod model;
mod patches;
mod radiometry;
mod residuals;
mod squares;
mod turned;

use glam::DVec3;

use crate::Rejection;
use crate::calibration::Target;
use crate::geometry::{Camera, Pose};
use crate::photo::{Photo, Surround};

use light::Light;
use model::{Ink, Problem, Sample, Shot};

pub(crate) use examination::{Examination, examine};
pub(crate) use lamp::LitPlaces;
pub use lobe::Lobe;
pub use radiometry::{Photometry, Radiometry, Vignetting};
pub(crate) use squares::edited;
pub use squares::{Spread, Square, Squares};

/// Prior of the ambient share: room light against a near flash.
const AMBIENT_SIGMA: f64 = 0.1;
/// Ambient share above which the flash counts as missing, and the largest share tried.
const MAX_AMBIENT: f64 = 0.5;
const ANY_AMBIENT: f64 = 0.98;
/// Misfit by which more ambient light than that must explain a photograph better.
const NO_FLASH_EVIDENCE: f64 = 9.0;
/// Misfit by which a flash with local tone mapping must explain a photograph better than even light.
const LOCAL_TONE_EVIDENCE: f64 = 30.0;
/// Share of clipped white squares that leaves the light undetermined.
const MAX_CLIPPED: f32 = 0.4;
/// Standard deviation of lens and flash exponents below their mean in the test for a flash; they
/// are hardly ever below 0.
const SOUND_LENS_SIGMA: f64 = 1.0;
/// Robust deviation of log values that no point light leaves.
const MAX_SIGMA: f64 = 0.25;
/// Squares this close to the mirror direction (half vector to normal) may glare.
const GLARE_DEGREES: f64 = 8.0;
/// The same for printed squares, where a little glare weighs sixteen times.
const INK_GLARE_DEGREES: f64 = 16.0;
const GLARE_SIGMA: f64 = 4.0;
/// Standard deviation of a printed square relative to a white one's.
const INK_SIGMA: f64 = 5.0;

/// Position of the flash in the camera frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FlashOffset {
    /// Known, mm; zero for a light at the camera's centre.
    Known(DVec3),
    /// Estimated from the squares, with a Gaussian prior.
    Estimated {
        /// Where the flash is expected, mm.
        prior_mm: DVec3,
        /// Standard deviation per axis, mm; zero fixes an axis.
        sigma_mm: DVec3,
    },
}

/// Collects the squares of photos and re-estimates the light from all of them.
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
    /// A calibrator without photos.
    pub fn new(target: Target, flash: FlashOffset) -> Self {
        Self { target, flash, frames: Vec::new(), photometry: None }
    }

    /// Fault of one photo's light, judged alone.
    pub(crate) fn fault(&self, squares: &Squares, pose: &Pose) -> Option<Rejection> {
        let frame = Frame { pose: *pose, squares: squares.clone() };
        (!self.shows_flash(&frame)).then(|| self.why_unlit(&frame))
    }

    /// The reason why a photo does not look lit by a flash.
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

    /// The calibrator with earlier photos, which the next one is calibrated with.
    pub(crate) fn with_photos(self, photos: impl IntoIterator<Item = (Pose, Squares)>) -> Self {
        let frames = photos.into_iter().map(|(pose, squares)| Frame { pose, squares }).collect();
        Self { frames, photometry: None, ..self }
    }

    /// Estimates from all photos; `None` without any.
    pub(crate) fn estimated(&self) -> Option<Photometry> {
        (!self.frames.is_empty()).then(|| self.estimate())
    }

    /// Measures and adds a photo. Returns its radiometry; that of earlier photos changes too, see
    /// [`Self::radiometry`].
    ///
    /// # Errors
    /// [`Rejection::TooDark`], [`Rejection::Clipped`], [`Rejection::LightNotVisible`]. The
    /// calibrator is then unchanged.
    pub fn push(
        &mut self,
        photo: &Photo,
        camera: &Camera,
        pose: &Pose,
    ) -> Result<Radiometry, Rejection> {
        let squares = Squares::measure(photo, &self.target, camera, pose, 0.0)?;
        self.push_squares(squares, pose)
    }

    /// Adds squares of a measured photo.
    ///
    /// # Errors
    /// [`Rejection::LightNotVisible`]. The calibrator is then unchanged.
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

    /// Latest estimate; `None` before the first photo.
    pub fn photometry(&self) -> Option<&Photometry> {
        self.photometry.as_ref()
    }

    /// Present radiometry of a photo; `None` if it was not added.
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
        // An albedo of 0 has no information about the light.
        let all = squares.chain(gray).filter(|(_, _, albedo)| *albedo > 0.0);
        all.flat_map(move |(square, ink, albedo)| sample(square, ink, albedo))
    }

    /// Whether the squares of one photo, judged alone, are compatible with a flash.
    fn shows_flash(&self, frame: &Frame) -> bool {
        let light = frame.pose.to_board(self.expected_offset());
        if !light.is_finite() || light.z <= 0.0 {
            return false;
        }
        let samples: Vec<_> = self.samples(0, frame).collect();
        let shots = [Shot { pose: frame.pose, turned: false }];
        // The ambient prior is flat between 0 and 1. Neither lens nor flash brightens the border of a photo.
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
        // Tone mapping makes the light look more even.
        leaves_room(&problem)
            || leaves_room(&problem.with_tone_curve())
            || is_locally_mapped(&samples, &shots, &problem)
    }

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
            local_scale: solution.local_scale,
            black_ratio: solution.black_ratio,
            sigma: solution.sigma,
            photo_sigma: solution.photo_sigma,
        }
    }
}

/// Whether a flash with local tone mapping explains the squares much better than any even light.
fn is_locally_mapped(samples: &[Sample], shots: &[Shot], problem: &Problem) -> bool {
    let even = Problem { ambient_max: ANY_AMBIENT, ..*problem };
    let solved = |problem: Problem| (fit::solve(samples, shots, &problem, None), problem);
    let (even, mapped) = (solved(even), |scale| solved(problem.with_local_tone(scale)));
    (0..Surround::SCALES.len()).map(mapped).any(|mapped| {
        let sigma = mapped.0.sigma.max(fit::TONE_MIN_SIGMA);
        let left = |(solution, problem): &(fit::Solution, Problem)| {
            fit::misfit(samples, shots, problem, solution, sigma)
        };
        light::is_local(&mapped.0) && left(&even) - left(&mapped) > LOCAL_TONE_EVIDENCE
    })
}

#[cfg(test)]
mod fault_tests;
#[cfg(test)]
pub(crate) mod tests;
#[cfg(test)]
mod tone_tests;
