//! A session: add photographs, take maps at any time.
//!
//! A photograph goes one way. `capture` records its measurements and updates the estimates of earlier photographs.
//! `fit` receives it rectified, rectifies the earlier ones again with the new estimates, and publishes maps, which
//! callers may take at any time.

mod advice;
mod capture;
mod deviations;
mod diagnosis;
mod events;
mod fit;
mod hint;
mod memory;
mod preview;
mod queries;
mod reports;
mod settings;
mod state;
mod survey;

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use web_time::Instant;

use self::capture::{Board, Capture, Placed, Rectified, Taken};
use self::fit::{Fit, FitHandle};
pub use self::hint::{Group, Hint};
#[doc(hidden)]
pub use self::memory::Held;
use self::memory::Waiting;
pub use self::reports::{
    AcceptedPhoto, BoardPose, MapsWithUncertainty, Observed, Outcome, Probe, ProbedLight,
    ProbedView, Progress, Revision,
};
pub use self::settings::{Driver, RESOLUTIONS, RestoreOptions, Settings};
pub use self::survey::{NextView, Survey, SurveyedView};
pub use crate::assessment::PhotoFit;
pub use crate::estimate::{Budget, LightCorrection, Method, Phase, PhaseReport};
use crate::estimate::{EstimateOptions, Estimation, Meter, first_maps};
pub use crate::networks::Networks;
use crate::photo::Photo;
pub use crate::scene::{BoardScene, RectifiedFalloff, Scene};
use crate::threads::{Pool, lock};
use crate::{Error, Rejection, Result};

/// Turns photographs of one sample into maps. All methods may be called from any thread. The fit runs on
/// a thread of the session, or in [`Session::step`].
pub struct Session {
    scene: Scene,
    settings: Settings,
    pool: Arc<Pool>,
    networks: Arc<Networks>,
    /// Held while a photograph is added or removed. Locked before `capture`.
    intake: Mutex<()>,
    /// The record. Replaced with every photograph, so that its readers never wait.
    capture: Mutex<Arc<Capture>>,
    waiting: Waiting,
    fit: FitHandle,
}

impl Session {
    /// Starts a session with its fit and the embedded models.
    ///
    /// # Errors
    /// When a setting is out of range or a model is damaged.
    #[cfg(feature = "embedded-models")]
    pub fn new(scene: impl Into<Scene>, settings: Settings) -> Result<Self> {
        Self::with_networks(scene, settings, Arc::new(Networks::embedded()?))
    }

    /// The same with given networks, which several sessions may share.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn with_networks(
        scene: impl Into<Scene>,
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
        scene: impl Into<Scene>,
        settings: Settings,
        networks: Arc<Networks>,
        options: EstimateOptions,
    ) -> Result<Self> {
        let scene = scene.into();
        settings.check()?;
        memory::check(&settings, 1, 0)?;
        let capture = Capture::new(scene.clone(), &settings)?;
        let pool = settings.pool()?;
        let task = settings.task(&scene);
        let estimation = Estimation::new(networks.clone(), task, options);
        let meter = Meter::new(Budget::default());
        let fit = Fit::new(pool.clone(), estimation, Vec::new(), meter);
        fit.show(None, LightCorrection::default(), 0.0, None);
        Self::start(scene, settings, networks, capture, pool, fit)
    }

    fn start(
        scene: Scene,
        settings: Settings,
        networks: Arc<Networks>,
        capture: Capture,
        pool: Arc<Pool>,
        fit: Fit,
    ) -> Result<Self> {
        let fit = FitHandle::start(fit, settings.driver)?;
        let capture = Mutex::new(Arc::new(capture));
        let (intake, waiting) = Default::default();
        Ok(Self { scene, settings, pool, networks, intake, capture, waiting, fit })
    }

    /// The record at this moment.
    fn capture(&self) -> Arc<Capture> {
        lock(&self.capture).clone()
    }

    /// A value of the board; `None` for rectified photographs.
    fn board<T>(&self, of: impl FnOnce(&Board) -> T) -> Option<T> {
        self.capture().board().map(of)
    }

    /// The settings; those of a restored session come from its saved state.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The content of the photographs.
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
        let mut shared = self.fit.shared.lock();
        let changed = std::mem::replace(&mut shared.budget, budget) != budget;
        // The fit decides whether work remains; waiting callers wait for its decision.
        shared.progress.settled &= !(changed && shared.cut);
        drop(shared);
        self.fit.wake();
        Ok(())
    }

    /// Announces the number of photographs still to come. From then on [`Progress::fraction`] is that of the work
    /// on all of them together and does not fall before they have come. Each photograph added counts as one of
    /// them, whether it is accepted or rejected. If the number changes, announce it again.
    ///
    /// Without an announcement the fraction is that of each photograph.
    pub fn announce(&self, photographs: usize) {
        let mut shared = self.fit.shared.lock();
        let settled = shared.progress.settled;
        let changed = shared.regroup(|group| group.announce(photographs, settled));
        drop(shared);
        if changed {
            self.fit.shared.notify();
        }
    }

    /// Counts a photograph as rejected whose fault is known without its pixels.
    pub fn reject(&self, why: Rejection) -> Outcome<AcceptedPhoto> {
        events::rejected(why);
        let changed = self.fit.shared.lock().regroup(fit::Group::reject);
        if changed {
            self.fit.shared.notify();
        }
        Outcome::Rejected(why)
    }

    /// Calibrates, rectifies and adds a photograph of a board. When this returns, the maps include the
    /// photograph; the fit continues on a thread of the session.
    ///
    /// # Errors
    /// On misuse, and when the memory limit is reached. A photograph that cannot be used is no error but
    /// [`Outcome::Rejected`].
    pub fn add_photo(&self, photo: &Photo) -> Result<Outcome<AcceptedPhoto>> {
        self.add(photo, None)
    }

    /// Adds a photograph that is already rectified, with camera and light positions in mm.
    ///
    /// # Errors
    /// As [`Session::add_photo`].
    pub fn add_rectified_photo(
        &self,
        photo: &Photo,
        camera_mm: [f32; 3],
        light_mm: [f32; 3],
    ) -> Result<Outcome<AcceptedPhoto>> {
        self.add(photo, Some(Placed { camera_mm, light_mm }))
    }

    fn add(&self, photo: &Photo, placed: Option<Placed>) -> Result<Outcome<AcceptedPhoto>> {
        let begun = Instant::now();
        self.fit.shared.usable()?;
        // Photographs are added one after the other; a running fit is not disturbed.
        let _intake = lock(&self.intake);
        match self.take(photo, &self.capture(), placed)? {
            Ok((capture, taken)) => {
                let accepted = self.accept(capture, taken, begun)?;
                events::accepted(&accepted);
                self.board(events::calibrated);
                Ok(Outcome::Accepted(accepted))
            }
            Err(rejection) => Ok(self.reject(rejection)),
        }
    }

    /// Calibrates and rectifies a photograph, if there is memory for it: the record with it, and the result.
    fn take(
        &self,
        photo: &Photo,
        known: &Capture,
        placed: Option<Placed>,
    ) -> Result<std::result::Result<(Capture, Taken), Rejection>> {
        if !photo.is_finite() {
            return Ok(Err(Rejection::NotFinite));
        }
        let photographs = self.fit.shared.lock().progress.photos + 1;
        let kept = known.board().map_or(0, Board::kept_bytes);
        self.check_memory(photographs, memory::while_pushed(photo, kept))?;
        self.pool.install(|| known.with(photo, placed))
    }

    /// The hints about the latest photograph of a capture.
    fn hints_of_latest(&self, capture: &Capture) -> Vec<Hint> {
        let hints = |board| self.pool.install(|| diagnosis::of_latest(board));
        capture.board().map(hints).unwrap_or_default()
    }

    fn accept(&self, capture: Capture, taken: Taken, begun: Instant) -> Result<AcceptedPhoto> {
        let Taken { rectified, pose, earlier, restart } = taken;
        let hints = self.hints_of_latest(&capture);
        let first = self.fit.shared.lock().maps.is_none();
        let start = || self.pool.install(|| first_maps(&self.networks, &rectified.observation));
        let start = if first { Some(Arc::new(start()?)) } else { None };
        let next = capture.board().and_then(Board::next_view);
        *lock(&self.capture) = Arc::new(capture);
        let index = {
            let mut shared = self.fit.shared.lock();
            if first {
                shared.publish(start.clone());
            }
            shared.next = next;
            (shared.progress.settled, shared.progress.seconds_left) = (false, None);
            shared.progress.photos += 1;
            shared.regroup(fit::Group::accept);
            shared.progress.photos - 1
        };
        self.fit.shared.notify();
        // A caller that saw the maps may have cancelled meanwhile. The photograph counts in any case.
        let add = move |fit: &mut Fit| fit.add(rectified, earlier, restart, start.as_deref());
        if !self.fit.send(add)
            && let Err(error @ Error::Internal(_)) = self.fit.shared.usable()
        {
            return Err(error);
        }
        Ok(AcceptedPhoto { index, pose, maps_seconds: begun.elapsed().as_secs_f64(), hints })
    }

    /// Calibrates and rectifies a photograph of a board with the present knowledge, without adding it.
    /// The maps should predict the result: it serves to measure them on photographs that they were not
    /// fitted to.
    ///
    /// # Errors
    /// As [`Session::add_photo`].
    pub fn observe(&self, photo: &Photo) -> Result<Outcome<Observed>> {
        self.look(photo, None)
    }

    /// As [`Session::observe`] for a photograph that is already rectified, with camera and light
    /// positions in mm.
    ///
    /// # Errors
    /// As [`Session::add_rectified_photo`].
    pub fn observe_rectified(
        &self,
        photo: &Photo,
        camera_mm: [f32; 3],
        light_mm: [f32; 3],
    ) -> Result<Outcome<Observed>> {
        self.look(photo, Some(Placed { camera_mm, light_mm }))
    }

    fn look(&self, photo: &Photo, placed: Option<Placed>) -> Result<Outcome<Observed>> {
        self.fit.shared.usable()?;
        let observed = self.take(photo, &self.capture(), placed)?.map(|(capture, taken)| {
            let Taken { rectified: Rectified { observation, .. }, pose, .. } = taken;
            Observed { observation, pose, hints: self.hints_of_latest(&capture) }
        });
        Ok(observed.into())
    }

    /// Removes an accepted photograph: the session, including its calibration, is as if it had never come.
    /// `index` counts the accepted photographs from 0; later ones move up by one. The fit starts again with
    /// the remaining photographs; when this returns, the maps are those from the first of them. Without any
    /// photograph left there are no maps.
    ///
    /// The others are calibrated again from their stored measurements and pixels. The maps are those of a session
    /// without the photograph, up to rounding errors; those of rectified photographs are the same to the bit. Once a
    /// session with a given camera has settled on paper and height of the sample (see [`Scene`]), these stay.
    ///
    /// Waits for a photograph that is being added, and for a step of the fit.
    ///
    /// # Errors
    /// [`Error::Argument`] for `index` when there is no such photograph, or when another one would have
    /// been rejected without it; when the session has failed or was cancelled. Nothing has changed then.
    pub fn remove_photo(&self, index: usize) -> Result<()> {
        self.fit.shared.usable()?;
        let _intake = lock(&self.intake);
        let photos = self.fit.shared.lock().progress.photos;
        if index >= photos {
            let message = format!("{index} given, but there are {photos} photographs");
            return Err(Error::argument("index", message));
        }
        let rejected = |(other, rejection): (usize, Rejection)| {
            let why = format!("photograph {other} cannot be used without it: {rejection}");
            Error::argument("index", why)
        };
        let left = self.pool.install(|| self.capture().without(index));
        let (left, wanted) = left.map_err(rejected)?;
        let next = left.board().and_then(Board::next_view);
        self.fit.ask(move |fit| fit.remove(index, &wanted, next))?.map_err(rejected)?;
        events::removed(index);
        *lock(&self.capture) = Arc::new(left);
        self.fit.shared.notify();
        Ok(())
    }

    /// Counts `bytes` of a photograph that a caller holds until it adds it as memory of this session. `photo_bytes` and
    /// `pixels` are those of the decoded photograph. The memory limit then also allows for adding the held photographs
    /// one by one, except for pixels that the session keeps of them. Does not wait.
    ///
    /// # Errors
    /// [`Error::MemoryLimit`].
    #[doc(hidden)]
    pub fn hold(&self, bytes: u64, photo_bytes: u64, pixels: u64) -> Result<Held> {
        let photos = self.fit.shared.lock().progress.photos;
        let kept = self.board(Board::kept_bytes).unwrap_or(0);
        self.waiting.hold(&self.settings, photos, kept, [bytes, photo_bytes, pixels])
    }

    /// Checks the memory limit, counting the photographs that callers hold.
    fn check_memory(&self, photographs: usize, beside: u64) -> Result<()> {
        memory::check(&self.settings, photographs, beside.saturating_add(self.waiting.bytes()))
    }

    /// Continues the fit of a session that its caller drives ([`Driver::Caller`]): receives a photograph,
    /// or does a step of the optimiser. Returns whether there may be more to do; otherwise the fit has
    /// settled or is paused. Other methods work between two steps, and from other threads.
    ///
    /// # Errors
    /// When the session has a thread of its own, has failed or was cancelled.
    pub fn step(&self) -> Result<bool> {
        self.fit.step()
    }

    /// Blocks until the fit has settled on all photographs so far. Never returns while paused
    /// with work left. Runs the fit itself if the caller drives it.
    ///
    /// # Errors
    /// When the fit failed or was cancelled.
    pub fn wait(&self) -> Result<()> {
        self.fit.wait_until(None, |shared| shared.progress.settled).map(|_| ())
    }

    /// As [`Session::wait`], for at most `timeout`: whether the fit has settled.
    ///
    /// # Errors
    /// As [`Session::wait`].
    pub fn wait_timeout(&self, timeout: Duration) -> Result<bool> {
        self.fit.wait_until(Instant::now().checked_add(timeout), |shared| shared.progress.settled)
    }

    /// Blocks until something has changed since `seen`; the present counters.
    ///
    /// # Errors
    /// When the fit failed or was cancelled and nothing has changed since.
    pub fn wait_for_change(&self, seen: Revision) -> Result<Revision> {
        self.fit.wait_until(None, |shared| shared.revision != seen)?;
        Ok(self.revision())
    }

    /// Pauses the fit after the step in progress.
    pub fn pause(&self) {
        if !self.fit.shared.paused.swap(true, Ordering::Relaxed) {
            events::paused();
        }
    }

    /// Continues after [`Session::pause`].
    pub fn resume(&self) {
        if self.fit.shared.paused.swap(false, Ordering::Relaxed) {
            events::resumed();
        }
        self.fit.wake();
    }

    /// Ends the fit after the step in progress. The maps stay available; further photographs are refused.
    pub fn cancel(&self) {
        if !self.fit.shared.cancelled.load(Ordering::Relaxed) {
            events::cancelled();
        }
        self.fit.cancel();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::Falloff;

    /// Another thread may cancel as soon as maps appear, before `add_photo` has returned.
    #[test]
    fn a_photograph_counts_that_was_being_taken_in_when_its_session_was_cancelled() {
        let falloff = RectifiedFalloff::Given(Falloff::None { power: [1.0; 3] });
        let settings = Settings { sample_mm: [100.0; 2], threads: 1, ..Settings::default() };
        let session = Session::new(Scene::Rectified { falloff }, settings).unwrap();
        let photo = Photo::from_linear(64, 64, vec![0.1; 3 * 64 * 64], 1.0, f32::INFINITY).unwrap();
        let mm = [0.0, 0.0, 150.0];
        let placed = Some(Placed { camera_mm: mm, light_mm: mm });
        let (capture, taken) = session.take(&photo, &session.capture(), placed).unwrap().unwrap();
        session.cancel();
        while !session.fit.has_ended() {
            std::thread::yield_now();
        }
        let accepted = session.accept(capture, taken, Instant::now());
        assert!(matches!(accepted, Ok(AcceptedPhoto { index: 0, .. })), "{accepted:?}");
        assert!(session.snapshot().is_ok());
        assert!(matches!(session.add_photo(&photo), Err(Error::Cancelled)));
    }
}
