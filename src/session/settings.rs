//! Settings of a session.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::estimate::{Method, Task};
use crate::scene::Scene;
use crate::threads::Pool;
use crate::{Error, Result};

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
