//! The estimate of a session, and its turns: a job of a caller or a step of the optimiser.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use crossbeam_channel::{Receiver, TryRecvError};
use web_time::Instant;

use super::shared::Shared;
use crate::assessment::Place;
use crate::estimate::{Estimation, LightCorrection, Meter, first_maps};
use crate::observation::Observation;
use crate::session::capture::{Conditions, Rectified, Wanted};
use crate::session::reports::Progress;
use crate::session::survey::{Candidate, NextView, Survey};
use crate::threads::Pool;
use crate::{Rejection, Result, Svbrdf};

/// A request of a caller, carried out between two steps.
pub type Job = Box<dyn FnOnce(&mut Fit) -> Result<()> + Send>;

/// Shortest time between two published sets of maps.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(200);
/// The same in units of the time that the latest maps took.
const PUBLISH_SHARE: u32 = 20;

/// Permitted work of a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// The next job, otherwise a step. Waits for a job if there is no step to do.
    Wait,
    /// The next job, otherwise a step.
    Step,
    /// The next job.
    Jobs,
}

/// Result of a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// A job or a step.
    Worked,
    /// Nothing was to be done.
    Idle,
    /// The session was cancelled, dropped, or has failed; no turn follows.
    Ended,
}

/// The estimate, the rectified photographs, and the state between turns.
pub struct Fit {
    pub shared: Arc<Shared>,
    pub pool: Arc<Pool>,
    pub estimation: Estimation,
    pub meter: Meter,
    published: Instant,
    /// Time between two published sets of maps.
    interval: Duration,
    busy: bool,
    /// The conditions of each rectified photograph; `None` for one that was added rectified. The estimate owns the
    /// photographs themselves.
    made: Vec<Option<Conditions>>,
}

impl Fit {
    /// The fit of an estimate. `made` has the conditions of its photographs.
    pub fn new(
        pool: Arc<Pool>,
        estimation: Estimation,
        made: Vec<Option<Conditions>>,
        meter: Meter,
    ) -> Self {
        let shared = Arc::default();
        let (published, interval) = (Instant::now(), PUBLISH_INTERVAL);
        let busy = !estimation.is_done();
        Self { shared, pool, estimation, meter, published, interval, busy, made }
    }

    /// The rectified photographs.
    pub fn observations(&self) -> Vec<Observation> {
        (0..self.made.len()).map(|index| self.estimation.observation(index)).collect()
    }

    /// A rectified photograph with its conditions.
    pub fn rectified(&self, index: usize) -> Rectified {
        let observation = self.estimation.observation(index);
        Rectified { conditions: self.made[index], observation }
    }

    /// The work on the latest photograph so far; none before the fit has finished, since it is repeated after
    /// restoring.
    pub fn meter(&self) -> Meter {
        if self.busy { Meter::new(self.meter.budget) } else { self.meter.clone() }
    }

    /// Publishes maps and state of a new or restored estimate. `next` is the view that probes refer to.
    pub fn show(
        &self,
        maps: Option<Svbrdf>,
        correction: LightCorrection,
        loss_before: f32,
        next: Option<NextView>,
    ) {
        let estimation = &self.estimation;
        let photos = estimation.photos();
        let mut state = self.shared.lock();
        if maps.is_some() || state.maps.is_some() {
            state.publish(maps.map(Arc::new));
        }
        (state.light_correction, state.fitted, state.cut) =
            (correction, photos, estimation.is_stopped_early());
        (state.survey, state.surveyed, state.next) = (None, None, next);
        state.progress = Progress {
            photos,
            loss_before,
            loss: estimation.loss(),
            settled: estimation.is_done(),
            ..Progress::default()
        };
        let share = if photos > 0 { estimation.fraction() } else { 0.0 };
        state.regroup(|group| group.anew(photos, share));
    }

    /// One turn. Errors and panics are kept in [`Shared`].
    pub fn turn(&mut self, jobs: &Receiver<Job>, work: Work) -> Turn {
        let turn = catch_unwind(AssertUnwindSafe(|| self.try_turn(jobs, work)));
        let message = match turn {
            Ok(Ok(turn)) => return turn,
            Ok(Err(error)) => error.to_string(),
            Err(panic) => panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("unknown panic")
                .to_owned(),
        };
        self.shared.lock().failed = Some(message);
        self.shared.notify();
        Turn::Ended
    }

    fn try_turn(&mut self, jobs: &Receiver<Job>, work: Work) -> Result<Turn> {
        if self.shared.cancelled.load(Ordering::Relaxed) {
            return Ok(Turn::Ended);
        }
        let idle = !self.busy || self.shared.paused.load(Ordering::Relaxed);
        let job = if idle && work == Work::Wait {
            jobs.recv().map_err(|_| TryRecvError::Disconnected)
        } else {
            jobs.try_recv()
        };
        match job {
            // The call that cancelled the session may occupy the threads of the pool.
            Ok(_) if self.shared.cancelled.load(Ordering::Relaxed) => return Ok(Turn::Ended),
            Ok(job) => job(self)?,
            Err(TryRecvError::Empty) if idle || work == Work::Jobs => return Ok(Turn::Idle),
            Err(TryRecvError::Empty) => self.step()?,
            Err(TryRecvError::Disconnected) => return Ok(Turn::Ended),
        }
        Ok(Turn::Worked)
    }

    /// Adds a photograph, the first with the maps to start from, and rectifies the earlier ones again. One that cannot
    /// be rectified under its new conditions stays as it was.
    pub fn add(
        &mut self,
        added: Rectified,
        earlier: Vec<Wanted>,
        restart: bool,
        start: Option<&Svbrdf>,
    ) -> Result<()> {
        // One by one, so that each old one is freed as it is replaced.
        for (index, wanted) in earlier.into_iter().enumerate() {
            let mut rectified = self.rectified(index);
            if rectified.remake(&wanted, false) == Ok(true) {
                self.made[index] = rectified.conditions;
                self.estimation.replace(index, rectified.observation)?;
            }
        }
        self.estimation.add(added.observation, restart, start)?;
        self.made.push(added.conditions);
        self.meter.reset();
        self.busy = true;
        let mut state = self.shared.lock();
        state.fitted += 1;
        state.cut = false;
        let loss = self.estimation.loss();
        state.progress = Progress { loss_before: loss, loss, ..state.progress };
        drop(state);
        self.shared.notify();
        Ok(())
    }

    /// Starts again without a photograph, with the others rectified as `wanted`. If one of them cannot be rectified,
    /// returns its present index and the rejection, and changes nothing.
    pub fn remove(
        &mut self,
        index: usize,
        wanted: &[Wanted],
        next: Option<NextView>,
    ) -> Result<std::result::Result<(), (usize, Rejection)>> {
        let mut left = Vec::with_capacity(wanted.len());
        for (other, wanted) in (0..self.made.len()).filter(|i| *i != index).zip(wanted) {
            let mut rectified = self.rectified(other);
            if let Err(rejection) = rectified.remake(wanted, true) {
                return Ok(Err((other, rejection)));
            }
            left.push(rectified);
        }
        let mut estimation = self.estimation.afresh();
        let first = left.first().map(|first| first_maps(estimation.networks(), &first.observation));
        let start = first.transpose()?;
        let mut made = Vec::with_capacity(left.len());
        for (i, Rectified { conditions, observation }) in left.into_iter().enumerate() {
            estimation.add(observation, false, start.as_ref().filter(|_| i == 0))?;
            made.push(conditions);
        }
        (self.estimation, self.made) = (estimation, made);
        self.meter.reset();
        self.busy = !self.estimation.is_done();
        self.show(start, LightCorrection::default(), self.estimation.loss(), next);
        Ok(Ok(()))
    }

    /// Estimates how much a photograph from each of some places would lower the expected error. Probes refer to the
    /// best place until the next photograph is added.
    pub fn survey(&mut self, candidates: &[Candidate], settled: bool) -> Result<Survey> {
        let place = |candidate: &Candidate| Place {
            camera_mm: candidate.camera_mm.as_vec3().to_array(),
            light_mm: candidate.light_mm.as_vec3().to_array(),
        };
        let places: Vec<Place> = candidates.iter().map(place).collect();
        let gains = self.estimation.outlook(&places)?;
        let survey = Survey::new(self.estimation.photos(), settled, candidates, &gains);
        let mut state = self.shared.lock();
        if state.progress.photos == survey.photos {
            state.next = survey.best().map(|best| best.view);
        }
        drop(state);
        Ok(survey)
    }

    /// Applies a changed budget. A fit that the budget had ended may continue.
    pub fn follow_budget(&mut self) {
        let budget = self.shared.lock().budget;
        let changed = self.meter.budget != budget;
        self.meter.budget = budget;
        if self.busy {
            return;
        }
        self.busy = changed && self.estimation.extend(&self.meter);
        let mut state = self.shared.lock();
        if self.busy {
            (state.cut, state.progress.settled) = (false, false);
            let share = self.estimation.fraction();
            let photos = state.fitted;
            state.regroup(|group| group.anew(photos, share));
        } else {
            state.progress.settled = state.is_current();
        }
        drop(state);
        self.shared.notify();
    }

    fn step(&mut self) -> Result<()> {
        let Self { pool, estimation, meter, .. } = self;
        meter.budget = self.shared.lock().budget;
        meter.start();
        let step = pool.install(|| estimation.step(meter));
        meter.stop();
        let step = step?;
        let publish = step.done || self.published.elapsed() >= self.interval;
        let begun = Instant::now();
        let maps = publish.then(|| pool.install(|| estimation.maps())).transpose()?;
        if publish {
            self.interval = PUBLISH_INTERVAL.max(begun.elapsed() * PUBLISH_SHARE);
        }
        let mut state = self.shared.lock();
        // A photograph was added meanwhile: the fraction of this work alone would be too high.
        let is_current = state.is_current();
        if is_current {
            state.regroup(|group| group.work(step.fraction));
        }
        state.progress.phase = if step.done { None } else { step.phase };
        state.progress.loss = step.loss;
        state.progress.seconds_left = (is_current && step.fraction > 0.02)
            .then(|| meter.elapsed().as_secs_f32() * (1.0 / step.fraction - 1.0));
        if let Some(maps) = maps {
            state.publish(Some(Arc::new(maps)));
            state.light_correction = estimation.light_correction().clone();
            self.published = Instant::now();
        }
        if step.done {
            self.busy = false;
            state.cut = estimation.is_stopped_early();
            // Photographs that were accepted meanwhile.
            let waiting = state.progress.photos - state.fitted;
            state.regroup(|group| group.settle(waiting));
            state.progress.settled = is_current;
            state.progress.seconds_left = None;
        }
        drop(state);
        self.shared.notify();
        Ok(())
    }
}
