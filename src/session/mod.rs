//! A capture in progress: push photographs, take maps at any time.

use std::sync::Arc;

use glam::DVec3;

use crate::calibration::Target;
use crate::frame::Photo;
use crate::geometry::{Camera, Pose};
use crate::observation::Falloff;
use crate::{Rejection, Result, Svbrdf};

/// How maps are found from photographs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Latent code of the auto-encoder, then per-texel refinement.
    #[default]
    Deep,
    /// Inverse rendering directly on the maps from the same start: the baseline.
    Classic,
}

/// What the photographs show, fixed for a session.
#[derive(Debug, Clone, PartialEq)]
pub enum Scene {
    /// Photographs of a board round the sample.
    Board {
        /// The printed board.
        target: Target,
        /// Intrinsics of all photographs.
        camera: Camera,
        /// Flash position in the camera frame, mm; `None`: at the camera's centre.
        flash_offset_mm: Option<DVec3>,
    },
    /// Photographs already rectified to the top view, camera and light given with each.
    Rectified {
        /// Strength of the light over distance; inverse-square without a power takes
        /// pi * (first camera's distance)².
        falloff: RectifiedFalloff,
    },
}

/// Light of rectified photographs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RectifiedFalloff {
    /// As given.
    Given(Falloff),
    /// Inverse square with `power_mm2 = pi * (first camera's distance)²`.
    InverseSquareAuto,
}

/// Options of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Width and height of the sample, mm.
    pub sample_mm: [f32; 2],
    /// Texels along each side of the maps: 256, 512, 1024 or 2048.
    pub resolution: usize,
    /// Method.
    pub method: Method,
    /// Whether the per-texel refinement runs after the latent fit.
    pub refine: bool,
    /// Threads of the fit; 0: one per core, at most 4.
    pub threads: usize,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            sample_mm: [100.0, 100.0],
            resolution: 256,
            method: Method::Deep,
            refine: true,
            threads: 0,
            seed: 0,
        }
    }
}

/// What became of a photograph.
#[derive(Debug, Clone, PartialEq)]
pub enum Pushed {
    /// It takes part in the fit from now on.
    Accepted(Accepted),
    /// It was not used; nothing changed.
    Rejected(Rejection),
}

/// An accepted photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Accepted {
    /// Number of accepted photographs before this one.
    pub index: usize,
    /// Pose of the board; `None` for rectified photographs.
    pub pose: Option<Pose>,
    /// Reprojection error, px; `None` for rectified photographs.
    pub reprojection_rms_px: Option<f64>,
    /// Seconds from the call of push to maps being available.
    pub maps_seconds: f64,
}

/// State of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Accepted photographs.
    pub frames: usize,
    /// Share of the work on the photographs so far that is done, 0 to 1.
    pub fraction: f32,
    /// Mean log-L1 before the fit of the latest photograph.
    pub loss_before: f32,
    /// Mean log-L1 now.
    pub loss: f32,
    /// Estimated seconds left, if known.
    pub seconds_left: Option<f32>,
    /// Whether the fit has finished on all photographs so far.
    pub settled: bool,
}

/// A capture in progress. All methods may be called from any thread.
pub struct Session {}

impl Session {
    /// Starts a session with its worker thread and the embedded models.
    ///
    /// # Errors
    /// When a setting is out of range or a model is damaged.
    pub fn new(_scene: Scene, _settings: Settings) -> Result<Self> {
        todo!()
    }

    /// Calibrates, rectifies and adds a photograph of a board. When this returns, maps that know
    /// of it are available; the fit goes on on the session's thread.
    ///
    /// # Errors
    /// On misuse only: a photograph that cannot be used is `Ok(Pushed::Rejected)`.
    pub fn push(&self, _photo: &Photo) -> Result<Pushed> {
        todo!()
    }

    /// Adds a photograph that is already rectified, with camera and light positions in mm.
    ///
    /// # Errors
    /// As [`Session::push`].
    pub fn push_rectified(
        &self,
        _photo: &Photo,
        _camera_mm: [f32; 3],
        _light_mm: [f32; 3],
    ) -> Result<Pushed> {
        todo!()
    }

    /// The maps as they are now.
    ///
    /// # Errors
    /// Before the first photograph was accepted.
    pub fn snapshot(&self) -> Result<Arc<Svbrdf>> {
        todo!()
    }

    /// State of the fit.
    pub fn progress(&self) -> Progress {
        todo!()
    }

    /// Blocks until the fit has settled on all photographs so far, or is cancelled.
    ///
    /// # Errors
    /// When the fit failed or was cancelled.
    pub fn wait(&self) -> Result<()> {
        todo!()
    }

    /// Light position in the camera frame as used, mm.
    pub fn flash_offset_mm(&self) -> DVec3 {
        todo!()
    }

    /// Ambient light as a share of the flash's at the sample's centre.
    pub fn ambient_fraction(&self) -> f32 {
        todo!()
    }

    /// Holds the fit after the step in progress.
    pub fn pause(&self) {
        todo!()
    }

    /// Goes on after [`Session::pause`].
    pub fn resume(&self) {
        todo!()
    }

    /// Ends the fit after the step in progress; maps stay available, pushes are refused.
    pub fn cancel(&self) {
        todo!()
    }
}
