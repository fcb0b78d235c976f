//! A session as bytes, to go on with later or elsewhere.
//!
//! Stored: settings and scene, what is known of camera and light, every photograph with what was measured
//! in it, its part that may be rectified again and its rectified view, the latest maps, and the
//! estimate where the latest photograph came or, once settled, as it is. What the fit has done since is
//! done again, to the same bits.

mod check;
mod format;

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::format::{as_damage, damaged};
use super::capture::{Capture, Photograph};
use super::fit::{Fit, Milestone, Shared};
use super::reports::Progress;
use super::settings::{Scene, Settings};
use super::{RestoreOptions, Session, memory};
use crate::calibration::{CameraEstimate, PaperEstimate};
use crate::estimate::{Budget, EstimateOptions, Estimation, Exposure, Meter, SavedEstimate};
use crate::initial_estimate::Networks;
use crate::observation::Observation;
use crate::rectification::elevation::ElevationEstimate;
use crate::{Result, Svbrdf};

/// Most threads a saved session may ask for.
const MAX_THREADS: usize = 64;

/// What has to be known before anything large is read.
#[derive(Serialize, Deserialize)]
struct Head<'a> {
    settings: Cow<'a, Settings>,
    scene: Cow<'a, Scene>,
    budget: Budget,
    photographs: usize,
}

#[derive(Serialize, Deserialize)]
struct Body<'a> {
    capture: SavedCapture<'a>,
    fit: SavedFit<'a>,
}

#[derive(Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // there is one for each session
enum SavedCapture<'a> {
    Board {
        camera: Option<Cow<'a, CameraEstimate>>,
        paper: PaperEstimate,
        elevation: ElevationEstimate,
        photographs: Cow<'a, [Photograph]>,
    },
    Rectified {
        photographs: Cow<'a, [Observation]>,
    },
}

#[derive(Serialize, Deserialize)]
struct SavedFit<'a> {
    milestone: Milestone,
    loss_before: f32,
    /// The latest maps, and what was found of exposure and flash with them.
    maps: Option<Cow<'a, Svbrdf>>,
    exposure: Exposure,
}

impl Session {
    /// The session as bytes: settings, scene, budget, what is known of camera and light, the
    /// photographs as far as they are needed, the maps, and the estimate as it was when the latest photograph
    /// came, or settled. [`Session::restore`] does again what the fit has done since, and ends with the same
    /// bits as this session if the budget stays the same and is none of time.
    ///
    /// Waits for a push in progress and for a step of the fit, not for the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn save(&self) -> Result<Vec<u8>> {
        // No photograph may come between what the fit and the capture know.
        let taking = self.settled_capture()?;
        self.fit.shared.usable()?;
        let saved = taking.capture.clone();
        let (settings, scene) = (self.settings.clone(), self.scene.clone());
        self.fit.ask(move |fit| {
            let (budget, loss_before, maps, exposure) = {
                let state = fit.shared.lock();
                let (maps, exposure) = (state.maps.clone(), state.exposure.clone());
                (state.budget, state.progress.loss_before, maps, exposure)
            };
            let (settings, scene) = (Cow::Owned(settings), Cow::Owned(scene));
            let photographs = fit.estimation.frames();
            let head = Head { settings, scene, budget, photographs };
            let maps = maps.as_deref().map(Cow::Borrowed);
            let fit = SavedFit { milestone: fit.milestone(), loss_before, maps, exposure };
            format::write(&head, &Body { capture: SavedCapture::of(&saved), fit })
        })
    }

    /// Continues a session that [`Session::save`] wrote, with these networks. They may be others than
    /// before: the maps stay, and the fit continues from them.
    ///
    /// # Errors
    /// [`Error::State`](crate::Error::State) when the bytes are not what was written or of a newer
    /// version, [`Error::MemoryLimit`](crate::Error::MemoryLimit).
    pub fn restore(saved: &[u8], networks: Arc<Networks>, options: RestoreOptions) -> Result<Self> {
        let (head, rest) = format::read::<Head>(format::content(saved)?)?;
        let Head { settings, scene, budget, photographs } = head;
        let (mut settings, scene) = (settings.into_owned(), scene.into_owned());
        settings.check().and_then(|()| budget.check()).map_err(as_damage)?;
        check::scene(&scene)?;
        settings.threads = options.threads.unwrap_or(settings.threads).min(MAX_THREADS);
        settings.memory_limit_bytes = options.memory_limit_bytes;
        settings.driver = options.driver;
        memory::check(&settings, photographs.max(1), 0)?;
        let (Body { capture, fit }, rest) = format::read::<Body>(rest)?;
        let capture = capture.restored(scene.clone(), &settings)?;
        let observations = capture.observations();
        if observations.len() != photographs || !rest.is_empty() {
            return Err(damaged("photographs are missing, or there is more than a session"));
        }
        let pool = settings.pool()?;
        let shared = Arc::new(Shared::new());
        shared.lock().budget = budget;
        let task = settings.task(&scene);
        let fit = pool.install(|| {
            fit.restored(shared, pool.clone(), |estimate, maps| {
                let options = EstimateOptions::default();
                Estimation::restore(networks.clone(), task, options, estimate, observations, maps)
            })
        })?;
        Self::start(scene, settings, networks, capture, pool, fit)
    }
}

impl<'a> SavedCapture<'a> {
    fn of(capture: &'a Capture) -> Self {
        match capture {
            Capture::Board(board) => Self::Board {
                camera: board.estimate().map(Cow::Borrowed),
                paper: board.paper(),
                elevation: board.elevation(),
                photographs: board.photographs().into(),
            },
            Capture::Rectified(rectified) => {
                Self::Rectified { photographs: rectified.photographs[..].into() }
            }
        }
    }

    fn restored(self, scene: Scene, settings: &Settings) -> Result<Capture> {
        let mut capture = Capture::new(scene, settings).map_err(as_damage)?;
        let resolution = settings.resolution;
        match (&mut capture, self) {
            (Capture::Rectified(rectified), Self::Rectified { photographs }) => {
                photographs.iter().try_for_each(|p| check::observation(p, resolution))?;
                rectified.photographs = photographs.into_owned();
            }
            (Capture::Board(board), Self::Board { camera, paper, elevation, photographs }) => {
                camera.iter().try_for_each(|camera| check::camera_estimate(camera))?;
                check::paper(&paper)?;
                check::height(&elevation)?;
                let estimated = board.camera().is_none();
                let known = camera.as_ref().map(|e| e.camera).or(board.camera());
                let size = known.map_or((0, 0), |c| (c.width, c.height));
                photographs.iter().try_for_each(|p| check::photograph(p, size, resolution))?;
                if camera.is_some() != (estimated && !photographs.is_empty())
                    || (estimated && photographs.iter().any(|p| p.part.is_none()))
                {
                    return Err(damaged("the photographs do not match the camera"));
                }
                let camera = camera.map(Cow::into_owned);
                board.resume(camera, paper, elevation, photographs.into_owned());
            }
            _ => return Err(damaged("the photographs do not match the scene")),
        }
        Ok(capture)
    }
}

impl SavedFit<'_> {
    fn restored(
        self,
        shared: Arc<Shared>,
        pool: Arc<crate::threads::Pool>,
        estimation: impl FnOnce(SavedEstimate, Option<Svbrdf>) -> Result<Estimation>,
    ) -> Result<Fit> {
        let Self { milestone, loss_before, maps, exposure } = self;
        let Milestone { estimate, budget, seconds, steps } = milestone;
        let exposure = exposure.believed().map_err(as_damage)?;
        budget.check().map_err(as_damage)?;
        if !loss_before.is_finite() || seconds.is_nan() {
            return Err(damaged("progress is not a number"));
        }
        let maps = maps.map(Cow::into_owned);
        let estimation = estimation(estimate, maps.clone()).map_err(as_damage)?;
        {
            let mut state = shared.lock();
            state.cut = estimation.is_cut();
            state.fitted = estimation.frames();
            state.progress = Progress {
                frames: estimation.frames(),
                fraction: estimation.fraction(),
                loss_before,
                loss: estimation.loss(),
                seconds_left: None,
                settled: estimation.is_done(),
                phase: None,
            };
            if let Some(maps) = maps {
                state.publish(Arc::new(maps));
                state.exposure = exposure;
            }
        }
        let meter = Meter::new(budget, seconds.max(0.0), steps);
        let mut fit = Fit::new(shared, pool, estimation, meter);
        fit.follow_budget();
        Ok(fit)
    }
}

#[cfg(test)]
mod tests;
