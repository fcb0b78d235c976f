//! Scene and settings of a session.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use glam::DVec3;

use crate::calibration::Target;
use crate::estimate::{Method, Task};
use crate::geometry::Camera;
use crate::observation::Falloff;
use crate::threads::Pool;
use crate::{Error, Result};

/// The content of the photographs, fixed for a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // there is one for each session
pub enum Scene {
    /// Photographs of a board round the sample.
    Board {
        /// The printed board.
        target: Target,
        /// Intrinsics of all photographs; `None`: estimated from the photographs so far, again with each
        /// new one. Earlier photographs are rectified again when the estimate moves them. For this the
        /// session keeps the part of each that shows the sample: about a third of a photograph that shows
        /// the whole board (12 MB of a 12-megapixel one). With a given camera it keeps the parts until it
        /// knows the sheet of paper and the sample's height, for seven photographs at most.
        camera: Option<Camera>,
        /// Flash position in the camera frame, mm; `None`: at the camera's centre until the
        /// photographs determine it.
        flash_offset_mm: Option<DVec3>,
        /// Height of the sample's surface above the printed side of the board, mm; `None`:
        /// estimated from two photographs or more, 0 unless they clearly contradict that.
        elevation_mm: Option<f64>,
    },
    /// Photographs already rectified to the top view, camera and light given with each.
    Rectified {
        /// Strength of the light over distance; inverse-square without a power takes
        /// pi * (first camera's distance)².
        falloff: RectifiedFalloff,
    },
}

impl Scene {
    /// Photographs of a board. Camera, flash and height of the sample are estimated unless the
    /// setters of [`BoardScene`] state them.
    pub fn board(target: Target) -> BoardScene {
        BoardScene { target, camera: None, flash_offset_mm: None, elevation_mm: None }
    }
}

/// Builds [`Scene::Board`]; made by [`Scene::board`].
#[derive(Debug, Clone, PartialEq)]
pub struct BoardScene {
    target: Target,
    camera: Option<Camera>,
    flash_offset_mm: Option<DVec3>,
    elevation_mm: Option<f64>,
}

impl BoardScene {
    /// States the intrinsics of all photographs.
    #[must_use]
    pub fn camera(self, camera: Camera) -> Self {
        Self { camera: Some(camera), ..self }
    }

    /// States the flash position in the camera frame, mm.
    #[must_use]
    pub fn flash_offset_mm(self, offset: DVec3) -> Self {
        Self { flash_offset_mm: Some(offset), ..self }
    }

    /// States the height of the sample's surface above the printed side of the board, mm.
    #[must_use]
    pub fn elevation_mm(self, height: f64) -> Self {
        Self { elevation_mm: Some(height), ..self }
    }
}

impl From<BoardScene> for Scene {
    fn from(board: BoardScene) -> Self {
        let BoardScene { target, camera, flash_offset_mm, elevation_mm } = board;
        Self::Board { target, camera, flash_offset_mm, elevation_mm }
    }
}

/// Light of rectified photographs.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub enum RectifiedFalloff {
    /// As given.
    Given(Falloff),
    /// Inverse square with `power_mm2 = pi * (first camera's distance)²`.
    #[default]
    InverseSquareAuto,
}

/// The thread that runs the fit of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Driver {
    /// A thread of the session's own.
    #[default]
    Thread,
    /// The caller's, in [`Session::step`](super::Session::step): for programs with a loop of their own
    /// and for platforms without threads. The maps are the same, bit for bit.
    Caller,
}

/// Options of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Most memory that the session may need by its own estimate, bytes; `None`: any amount. The
    /// networks, which sessions share, are not counted. Sessions and photographs that would need
    /// more are refused with [`Error::MemoryLimit`].
    #[serde(skip)]
    pub memory_limit_bytes: Option<u64>,
    /// The thread that runs the fit.
    #[serde(skip)]
    pub driver: Driver,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            sample_mm: [100.0, 100.0],
            resolution: 256,
            method: Method::Deep,
            refine: true,
            threads: 0,
            memory_limit_bytes: None,
            driver: Driver::Thread,
        }
    }
}

impl Settings {
    /// Checks ranges.
    pub(super) fn check(&self) -> Result<()> {
        if !RESOLUTIONS.contains(&self.resolution) {
            let message = format!("{} given; 256, 512, 1024 or 2048 expected", self.resolution);
            return Err(Error::argument("resolution", message));
        }
        if !self.sample_mm.iter().all(|v| v.is_finite() && *v > 0.0) {
            return Err(Error::argument("sample_mm", "two positive lengths in mm are expected"));
        }
        Ok(())
    }

    /// The task of the estimate.
    pub(super) fn task(&self, scene: &Scene) -> Task {
        let free_lights = matches!(scene, Scene::Rectified { .. });
        Task { method: self.method, refine: self.refine, free_lights }
    }

    /// The threads of the fit.
    pub(super) fn pool(&self) -> Result<Arc<Pool>> {
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        let threads = if self.threads == 0 { cores.min(4) } else { self.threads };
        Ok(Arc::new(Pool::new(threads)?))
    }
}

/// Options of the machine on which a saved session continues, see
/// [`Session::restore`](super::Session::restore).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RestoreOptions {
    /// Threads of the fit as in [`Settings::threads`]; `None`: as saved.
    pub threads: Option<usize>,
    /// As [`Settings::memory_limit_bytes`], which is not saved.
    pub memory_limit_bytes: Option<u64>,
    /// As [`Settings::driver`], which is not saved.
    pub driver: Driver,
}

/// Resolutions a session may have.
pub const RESOLUTIONS: [usize; 4] = [256, 512, 1024, 2048];
