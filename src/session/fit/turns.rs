//! The estimate and what is done with it, turn by turn: jobs, and steps between them.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TryRecvError};
use serde::{Deserialize, Serialize};
use web_time::Instant;

use super::shared::Shared;
use crate::assessment::Place;
use crate::estimate::{Addition, Estimation, LightCorrection, Meter, SavedEstimate, first_maps};
use crate::observation::Observation;
use crate::session::capture::Remake;
use crate::session::reports::Progress;
use crate::session::survey::{Candidate, NextView, Survey};
use crate::threads::Pool;
use crate::{Result, Svbrdf};

/// What a caller asks of the fit, done between two steps.
pub type Job = Box<dyn FnOnce(&mut Fit) -> Result<()> + Send>;

/// Shortest time between two published sets of maps.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(200);
/// The same in units of the time that it took to make the latest.
const PUBLISH_SHARE: u32 = 20;

/// What a turn may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// The next job, waited for where there is nothing else to do; else a step.
    Wait,
    /// The next job; where there is none, a step.
    Step,
    /// The next job.
    Jobs,
}

/// What a turn has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// A job or a step.
    Worked,
    /// There was nothing to do.
    Idle,
    /// The session was cancelled or dropped, or has failed: there is no further turn.
    Ended,
}

/// The estimate with all that it takes to go on with it, turn by turn.
pub struct Fit {
    pub shared: Arc<Shared>,
    pub pool: Arc<Pool>,
    pub estimation: Estimation,
    pub meter: Meter,
    published: Instant,
    /// Time between two published sets of maps.
    interval: Duration,
    busy: bool,
    /// Where what is in progress began; `None` where nothing is.
    begun: Option<Milestone>,
}

/// A place that the fit can be gone on from to the same bits: where a photograph has just come, or nothing is
/// left to do.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Milestone {
    pub estimate: SavedEstimate,
    pub meter: Meter,
}

impl Fit {
    pub fn new(pool: Arc<Pool>, estimation: Estimation, meter: Meter) -> Self {
        let shared = Arc::default();
        let (published, interval) = (Instant::now(), PUBLISH_INTERVAL);
        let (busy, begun) = (false, None);
        let mut fit = Self { shared, pool, estimation, meter, published, interval, busy, begun };
        fit.begin();
        fit
    }

    /// The latest milestone.
    pub fn milestone(&self) -> Milestone {
        self.begun.clone().unwrap_or_else(|| self.here())
    }

    /// The present as a milestone, which it has to be.
    fn here(&self) -> Milestone {
        Milestone { estimate: self.estimation.save(), meter: self.meter.clone() }
    }

    /// Goes on, if there is something to do.
    fn begin(&mut self) {
        self.busy = !self.estimation.is_done();
        self.begun = self.busy.then(|| self.here());
    }

    /// Shows maps and the state of an estimate that goes on with them. `next`: what probes refer to.
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

    /// One turn; faults end up in [`Shared`].
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
            // The session may be cancelled by a call that occupies the threads of the pool.
            Ok(_) if self.shared.cancelled.load(Ordering::Relaxed) => return Ok(Turn::Ended),
            Ok(job) => job(self)?,
            Err(TryRecvError::Empty) if idle || work == Work::Jobs => return Ok(Turn::Idle),
            Err(TryRecvError::Empty) => self.step()?,
            Err(TryRecvError::Disconnected) => return Ok(Turn::Ended),
        }
        Ok(Turn::Worked)
    }

    /// Adds a photograph, the first with the maps to start from, and rectifies earlier ones better: sends
    /// what becomes of these.
    pub fn add(
        &mut self,
        observation: Observation,
        remakes: Vec<Remake>,
        restart: bool,
        start: Option<&Svbrdf>,
        reply: &Sender<Vec<Remake>>,
    ) -> Result<()> {
        let mut all = Vec::with_capacity(remakes.len());
        // One after the other: the old ones are let go of as they are replaced.
        let replaced = remakes.into_iter().filter_map(|mut remake| {
            remake.make();
            let observation = || (remake.index, remake.rectified.observation().clone());
            let replaced = remake.refusal.is_none().then(observation);
            all.push(remake);
            replaced
        });
        self.estimation.add(Addition { observation, replaced, restart }, start)?;
        // The caller may no longer wait for the answer.
        let _ = reply.send(all);
        self.meter.reset();
        (self.busy, self.begun) = (true, Some(self.here()));
        let mut state = self.shared.lock();
        state.fitted += 1;
        state.cut = false;
        let loss = self.estimation.loss();
        state.progress = Progress { loss_before: loss, loss, ..state.progress };
        drop(state);
        self.shared.notify();
        Ok(())
    }

    /// Begins anew with these photographs.
    pub fn begin_anew(
        &mut self,
        photographs: Vec<Observation>,
        next: Option<NextView>,
    ) -> Result<()> {
        let mut estimation = self.estimation.afresh();
        let first = photographs.first();
        let start = first.map(|first| first_maps(estimation.networks(), first)).transpose()?;
        for (i, observation) in photographs.into_iter().enumerate() {
            estimation.add(Addition::new(observation), start.as_ref().filter(|_| i == 0))?;
        }
        self.estimation = estimation;
        self.meter.reset();
        self.begin();
        self.show(start, LightCorrection::default(), self.estimation.loss(), next);
        Ok(())
    }

    /// By how much a photograph from each of some places would lower the expected error; probes refer to the
    /// best of them until the next photograph comes.
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

    /// Takes a changed budget over; a fit that was cut short may go on.
    pub fn follow_budget(&mut self) {
        let budget = self.shared.lock().budget;
        let changed = self.meter.budget != budget;
        let here =
            (changed && !self.busy && self.estimation.is_stopped_early()).then(|| self.here());
        self.meter.budget = budget;
        if self.busy {
            return;
        }
        self.busy = changed && self.estimation.extend(&self.meter);
        self.begun = here.filter(|_| self.busy);
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
        // A photograph that was added meanwhile adds to this work: its progress is no longer reported.
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
            (self.busy, self.begun) = (false, None);
            state.cut = estimation.is_stopped_early();
            // A photograph that was added meanwhile is still on its way.
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
