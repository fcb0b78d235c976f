//! A capture in progress: push photographs, take maps at any time.

mod board;
mod confidence;
mod driving;
mod feedback;
mod hold;
mod intake;
mod memory;
mod observed;
mod outlook;
mod probe;
mod removal;
mod reports;
mod settings;
mod sight;
mod state;
mod survey;
mod taken;
mod worker;

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::Sender;
use glam::DVec3;
use web_time::Instant;

use self::driving::Engine;
pub use self::feedback::{Hint, NextView};
use self::intake::Intake;
use self::memory::Beside;
pub use self::memory::Held;
pub use self::reports::{
    Accepted, Assessed, BoardPose, FrameFit, Observed, Probe, ProbedLight, ProbedView, Progress,
    Pushed, Revision,
};
pub use self::settings::{Driver, RESOLUTIONS, RectifiedFalloff, RestoreOptions, Scene, Settings};
use self::sight::Known;
use self::state::StateWriter;
use self::survey::Surveys;
pub use self::survey::{Survey, SurveyedView};
use self::taken::Taken;
use self::worker::{Command, Fit, NewFrame, Shared};
use crate::calibration::PaperEstimate;
pub use crate::estimate::{Budget, Exposure, Method, Phase};
use crate::estimate::{EstimateOptions, Estimation, Meter, first_maps};
use crate::frame::{Photo, ToneCurve};
use crate::geometry::{Camera, Pose};
pub use crate::initial_estimate::Networks;
use crate::rectification::elevation::ElevationEstimate;
use crate::threads::Pool;
use crate::{Error, Rejection, Result, Svbrdf};

/// Most threads a saved session may ask for.
const MAX_THREADS: usize = 64;

/// A capture in progress. All methods may be called from any thread. The fit goes on on a thread
/// of the session's own, or in [`Session::step`].
pub struct Session {
    scene: Scene,
    settings: Settings,
    pool: Arc<Pool>,
    networks: Arc<Networks>,
    intake: Mutex<Intake>,
    /// What probes look with: replaced with every photograph, never waited for.
    known: Mutex<Option<Arc<Known>>>,
    surveys: Mutex<Surveys>,
    /// What is counted against the memory limit beside the session's own.
    beside: Arc<Beside>,
    shared: Arc<Shared>,
    commands: Sender<Command>,
    engine: Engine,
}

impl Session {
    /// Starts a session with its worker thread and the embedded models.
    ///
    /// # Errors
    /// When a setting is out of range or a model is damaged.
    #[cfg(feature = "embedded-models")]
    pub fn new(scene: Scene, settings: Settings) -> Result<Self> {
        Self::with_networks(scene, settings, Arc::new(Networks::embedded()?))
    }

    /// Starts a session with given networks, which several sessions may share.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn with_networks(
        scene: Scene,
        settings: Settings,
        networks: Arc<Networks>,
    ) -> Result<Self> {
        Self::with_options(scene, settings, networks, EstimateOptions::default())
    }

    /// The same with other options of the estimator, for evaluation: a restored session has the
    /// default ones.
    ///
    /// # Errors
    /// When a setting is out of range.
    #[doc(hidden)]
    pub fn with_options(
        scene: Scene,
        settings: Settings,
        networks: Arc<Networks>,
        options: EstimateOptions,
    ) -> Result<Self> {
        settings.check()?;
        memory::check(&settings, 1, 0)?;
        let intake = Intake::new(scene.clone())?;
        let pool = settings.pool()?;
        let task = settings.task(&scene);
        let estimation = Estimation::new(networks.clone(), task, options);
        let meter = Meter::new(Budget::default(), 0.0, 0);
        Self::start(scene, settings, networks, intake, pool, Shared::new(), estimation, meter)
    }

    fn start(
        scene: Scene,
        settings: Settings,
        networks: Arc<Networks>,
        intake: Intake,
        pool: Arc<Pool>,
        shared: Shared,
        estimation: Estimation,
        meter: Meter,
    ) -> Result<Self> {
        let shared = Arc::new(shared);
        let (commands, received) = crossbeam_channel::unbounded();
        let fit = Fit::new(shared.clone(), received, pool.clone(), estimation, meter);
        let engine = Engine::start(fit, settings.driver)?;
        let known = Mutex::new(intake.known(settings.sample_mm));
        let beside = Arc::new(Beside::default());
        beside.keep(intake.kept_bytes());
        let (intake, surveys) = (Mutex::new(intake), Mutex::default());
        Ok(Self {
            scene,
            settings,
            pool,
            networks,
            intake,
            known,
            surveys,
            beside,
            shared,
            commands,
            engine,
        })
    }

    /// The session as bytes: settings, scene, budget, what is known of camera and light, the
    /// photographs as far as they are needed, the maps, and the state of the fit. [`Session::restore`]
    /// continues in the same phase, to the same bits.
    ///
    /// Waits for a push in progress and for a step of the fit, not for the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn save(&self) -> Result<Vec<u8>> {
        // No photograph may come between what the fit and the intake know.
        let intake = self.intake.lock().unwrap_or_else(PoisonError::into_inner);
        self.usable()?;
        let (reply, answer) = crossbeam_channel::bounded(1);
        let mut state = StateWriter::new();
        let budget = self.shared.lock().budget;
        state::write_session(&mut state, &self.settings, &self.scene, &budget, &intake);
        match self.ask(Command::Save(state, reply), &answer) {
            Some(state) => Ok(state.finish()),
            None => Err(self.usable().err().unwrap_or(Error::Cancelled)),
        }
    }

    /// Continues a session that [`Session::save`] wrote, with these networks. They may be others than
    /// before: the maps stay, and the fit continues from them.
    ///
    /// # Errors
    /// [`Error::State`] when the bytes are not what was written or of a newer major version,
    /// [`Error::MemoryLimit`].
    pub fn restore(saved: &[u8], networks: Arc<Networks>, options: RestoreOptions) -> Result<Self> {
        let restored = state::read(saved, &networks, |settings, frames| {
            settings.threads = options.threads.unwrap_or(settings.threads).min(MAX_THREADS);
            settings.memory_limit_bytes = options.memory_limit_bytes;
            settings.driver = options.driver;
            memory::check(settings, frames.max(1), 0)?;
            settings.pool()
        })?;
        let state::Restored { settings, scene, budget, intake, estimation, progress, pool } =
            restored;
        let meter = Meter::new(budget, progress.seconds, progress.steps);
        let restored_maps = pool.install(|| estimation.maps()).ok();
        let shared = Shared::new();
        {
            let mut state = shared.lock();
            state.budget = budget;
            state.cut = estimation.is_cut();
            state.fitted = estimation.frames();
            state.progress = Progress {
                frames: estimation.frames(),
                fraction: estimation.fraction(),
                loss_before: progress.loss_before,
                loss: estimation.loss(),
                seconds_left: None,
                settled: estimation.is_done(),
                phase: None,
            };
            if let Some(maps) = restored_maps {
                state.publish(Arc::new(maps));
                state.exposure = estimation.exposure().clone();
            }
        }
        Self::start(scene, settings, networks, intake, pool, shared, estimation, meter)
    }

    /// The settings, as restored sessions have them from their saved state.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What the photographs show.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Limits the work on each photograph from now on. A fit that an earlier budget ended continues
    /// if this one allows it.
    ///
    /// # Errors
    /// When the seconds are not a number of at least 0.
    pub fn set_budget(&self, budget: Budget) -> Result<()> {
        budget.check()?;
        let mut state = self.shared.lock();
        let changed = std::mem::replace(&mut state.budget, budget) != budget;
        if changed && state.cut {
            // The worker finds out what is to do; who waits, waits for that.
            state.progress.settled = false;
        }
        drop(state);
        self.wake();
        Ok(())
    }

    /// Calibrates, rectifies and adds a photograph of a board. When this returns, the maps include the
    /// photograph; the fit continues on a thread of the session.
    ///
    /// # Errors
    /// On misuse, and when the memory limit is reached. A photograph that cannot be used is no error but
    /// [`Pushed::Rejected`].
    pub fn push(&self, photo: &Photo) -> Result<Pushed> {
        let Settings { sample_mm, resolution, .. } = self.settings;
        self.accept(photo, |intake| intake.take(photo, sample_mm, resolution))
    }

    /// Adds a photograph that is already rectified, with camera and light positions in mm.
    ///
    /// # Errors
    /// As [`Session::push`].
    pub fn push_rectified(
        &self,
        photo: &Photo,
        camera_mm: [f32; 3],
        light_mm: [f32; 3],
    ) -> Result<Pushed> {
        let Settings { sample_mm, resolution, .. } = self.settings;
        self.accept(photo, |intake| {
            intake.take_rectified(photo, camera_mm, light_mm, sample_mm, resolution)
        })
    }

    fn accept(
        &self,
        photo: &Photo,
        take: impl FnOnce(&mut Intake) -> Result<std::result::Result<Taken, Rejection>> + Send,
    ) -> Result<Pushed> {
        let begun = Instant::now();
        self.usable()?;
        if !photo.is_finite() {
            return Ok(Pushed::Rejected(Rejection::NotFinite));
        }
        // Photographs are taken in one after the other; a fit in progress is not disturbed.
        let mut intake = self.intake.lock().unwrap_or_else(PoisonError::into_inner);
        let intake = &mut *intake;
        let photographs = self.shared.lock().progress.frames + 1;
        let beside = memory::while_pushed(photo, intake.kept_bytes());
        self.check_memory(photographs, beside)?;
        let taken = match self.pool.install(|| take(intake))? {
            Ok(taken) => taken,
            Err(rejection) => return Ok(Pushed::Rejected(rejection)),
        };
        self.remember(intake);
        let first = self.shared.lock().maps.is_none();
        let start = if first {
            let maps = self.pool.install(|| first_maps(&self.networks, &taken.observation))?;
            Some(Arc::new(maps))
        } else {
            None
        };
        let index = {
            let mut state = self.shared.lock();
            if let Some(maps) = &start {
                state.publish(maps.clone());
            }
            let index = state.progress.frames;
            state.progress.frames += 1;
            state.progress.settled = false;
            index
        };
        self.shared.notify();
        let Taken { observation, updates, restart, .. } = taken;
        let frame = Box::new(NewFrame { observation, start, updates, restart });
        // Whoever saw the maps may have cancelled already: the photograph counts all the same.
        if self.commands.send(Command::Frame(frame)).is_err()
            && let Err(error @ Error::Internal(_)) = self.usable()
        {
            return Err(error);
        }
        Ok(Pushed::Accepted(Accepted {
            index,
            pose: taken.pose,
            reprojection_rms_px: taken.rms_px,
            maps_seconds: begun.elapsed().as_secs_f64(),
            hints: taken.hints,
        }))
    }

    /// Refuses calls on a session that failed or was cancelled.
    fn usable(&self) -> Result<()> {
        if let Some(message) = &self.shared.lock().failed {
            return Err(Error::Internal(message.clone()));
        }
        if self.shared.cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        Ok(())
    }

    /// The current maps.
    ///
    /// # Errors
    /// Before the first photograph was accepted.
    pub fn snapshot(&self) -> Result<Arc<Svbrdf>> {
        self.shared.lock().maps.clone().ok_or(Error::NoMaps)
    }

    /// Corrections that belong to the current maps: gain of each accepted photograph, exposure over
    /// distance, offset of the flash. None where a board determines them, and while they are unknown.
    pub fn exposure(&self) -> Exposure {
        self.shared.lock().exposure.clone()
    }

    /// State of the fit.
    pub fn progress(&self) -> Progress {
        self.shared.lock().progress
    }

    /// Blocks until the fit has settled on all photographs so far. Never returns while paused
    /// with work left. Goes on with the fit itself where the caller drives it.
    ///
    /// # Errors
    /// When the fit failed or was cancelled.
    pub fn wait(&self) -> Result<()> {
        self.go_on_until(None, |state| state.progress.settled).map(|_| ())
    }

    /// As [`Session::wait`], for at most `timeout`: whether the fit has settled.
    ///
    /// # Errors
    /// As [`Session::wait`].
    pub fn wait_timeout(&self, timeout: Duration) -> Result<bool> {
        self.go_on_until(Instant::now().checked_add(timeout), |state| state.progress.settled)
    }

    /// The internal error that ended the fit, if there was one. Every call that needs the fit returns it
    /// from then on.
    pub fn failure(&self) -> Option<String> {
        self.shared.lock().failed.clone()
    }

    /// Counters of changes of state and maps.
    pub fn revision(&self) -> Revision {
        self.shared.lock().revision
    }

    /// Blocks until something has changed since `seen`; the present counters.
    ///
    /// # Errors
    /// When the fit failed or was cancelled and nothing has changed since.
    pub fn wait_for_change(&self, seen: Revision) -> Result<Revision> {
        self.go_on_until(None, |state| state.revision != seen)?;
        Ok(self.revision())
    }

    /// The camera as used: given, or estimated from the photographs so far. `None` for rectified
    /// photographs, and while it is unknown.
    pub fn camera(&self) -> Option<Camera> {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner).camera()
    }

    /// Standard deviations of fx, fy, cx, cy (px), k1, k2, p1, p2, k3 of an estimated camera.
    pub fn camera_sigma(&self) -> Option<[f64; 9]> {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner).camera_sigma()
    }

    /// How the printed board differs from its plan (stretch, bow), as used, with standard deviations. As
    /// planned unless two photographs or more clearly say otherwise. `None` for rectified photographs.
    pub fn paper(&self) -> Option<PaperEstimate> {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner).paper()
    }

    /// Height of the sample's surface above the board, as used, with its standard deviation. 0 unless two
    /// photographs or more clearly say otherwise. If the scene states the height, it has no standard
    /// deviation. `None` for rectified photographs.
    pub fn elevation(&self) -> Option<ElevationEstimate> {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner).elevation()
    }

    /// Current estimates of the poses of the accepted photographs: later photographs improve what is known
    /// of paper and camera, and so the poses of earlier ones. Empty for rectified photographs.
    pub fn poses(&self) -> Vec<BoardPose> {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner).poses()
    }

    /// Light position in the camera frame as used, mm.
    pub fn flash_offset_mm(&self) -> DVec3 {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner).flash_offset_mm()
    }

    /// Ambient irradiance as a share of the flash's at the sample's centre, facing the flash at the
    /// first photograph's distance.
    pub fn ambient_fraction(&self) -> f32 {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner).ambient_fraction()
    }

    /// The inverse of the camera's tone curve: the identity for rectified photographs, and as long as
    /// values seem linear.
    pub fn tone_curve(&self) -> ToneCurve {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner).tone_curve()
    }

    /// Pauses the fit after the step in progress.
    pub fn pause(&self) {
        self.shared.paused.store(true, Ordering::Relaxed);
    }

    /// Continues after [`Session::pause`].
    pub fn resume(&self) {
        self.shared.paused.store(false, Ordering::Relaxed);
        self.wake();
    }

    /// Ends the fit after the step in progress. The maps stay available; pushes are refused.
    pub fn cancel(&self) {
        self.shared.cancelled.store(true, Ordering::Relaxed);
        self.wake();
        self.shared.notify();
    }

    fn wake(&self) {
        // A worker that has ended needs no waking.
        let _ = self.commands.send(Command::Wake);
        if self.settings.driver == Driver::Caller {
            self.shared.notify();
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.cancel();
        self.engine.join();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::Falloff;

    /// Who waits for maps may cancel as soon as they are there, before the push has returned.
    #[test]
    fn a_photograph_counts_that_was_being_taken_in_when_its_session_was_cancelled() {
        let falloff = RectifiedFalloff::Given(Falloff::None { power: [1.0; 3] });
        let settings = Settings { sample_mm: [100.0; 2], threads: 1, ..Settings::default() };
        let session = Session::new(Scene::Rectified { falloff }, settings).unwrap();
        let photo = Photo::from_linear(64, 64, vec![0.1; 3 * 64 * 64], 1.0, f32::INFINITY).unwrap();
        let pushed = session.accept(&photo, |intake| {
            session.cancel();
            while !session.engine.has_ended() {
                std::thread::yield_now();
            }
            intake.take_rectified(&photo, [0.0, 0.0, 150.0], [0.0, 0.0, 150.0], [100.0; 2], 256)
        });
        assert!(matches!(pushed, Ok(Pushed::Accepted(Accepted { index: 0, .. }))), "{pushed:?}");
        assert!(session.snapshot().is_ok());
        assert!(matches!(session.push(&photo), Err(Error::Cancelled)));
    }
}
