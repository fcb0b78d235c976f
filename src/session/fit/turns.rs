//! The estimate and what is done with it, turn by turn: jobs, and steps between them.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TryRecvError};
use serde::{Deserialize, Serialize};
use web_time::Instant;

use super::shared::Shared;
use crate::estimate::{Addition, Budget, Estimation, Exposure, Meter, SavedEstimate, first_maps};
use crate::observation::Observation;
use crate::session::capture::{Remade, Remake};
use crate::session::reports::Progress;
use crate::threads::Pool;
use crate::{Result, Svbrdf};

/// What a caller asks of the fit, done between two steps.
pub(super) type Job = Box<dyn FnOnce(&mut Fit) -> Result<()> + Send>;

/// Shortest time between two published sets of maps.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(200);
/// The same in units of the time that it took to make the latest.
const PUBLISH_SHARE: u32 = 20;

/// What a turn may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Work {
    /// The next job, waited for where there is nothing else to do; else a step.
    Wait,
    /// The next job; where there is none, a step.
    Step,
    /// The next job.
    Jobs,
}

/// What a turn has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    /// A job or a step.
    Worked,
    /// There was nothing to do.
    Idle,
    /// The session was cancelled or dropped, or has failed: there is no further turn.
    Ended,
}

/// The estimate with all that it takes to go on with it, turn by turn.
pub(in crate::session) struct Fit {
    pub(in crate::session) shared: Arc<Shared>,
    pub(super) pool: Arc<Pool>,
    pub(in crate::session) estimation: Estimation,
    pub(in crate::session) meter: Meter,
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
pub(in crate::session) struct Milestone {
    pub(in crate::session) estimate: SavedEstimate,
    /// The budget of then, and what was spent of it on the latest photograph.
    pub(in crate::session) budget: Budget,
    pub(in crate::session) seconds: f32,
    pub(in crate::session) steps: u32,
}

impl Fit {
    pub(in crate::session) fn new(
        shared: Arc<Shared>,
        pool: Arc<Pool>,
        estimation: Estimation,
        meter: Meter,
    ) -> Self {
        let (published, interval) = (Instant::now(), PUBLISH_INTERVAL);
        let busy = !estimation.is_done();
        let begun = None;
        let mut fit = Self { shared, pool, estimation, meter, published, interval, busy, begun };
        fit.begun = busy.then(|| fit.here());
        fit
    }

    /// The latest milestone.
    pub(in crate::session) fn milestone(&self) -> Milestone {
        self.begun.clone().unwrap_or_else(|| self.here())
    }

    /// The present as a milestone, which it has to be.
    fn here(&self) -> Milestone {
        let Meter { budget, .. } = self.meter;
        let (seconds, steps) = (self.meter.elapsed().as_secs_f32(), self.meter.steps());
        Milestone { estimate: self.estimation.save(), budget, seconds, steps }
    }

    /// One turn; faults end up in [`Shared`].
    pub(super) fn turn(&mut self, jobs: &Receiver<Job>, work: Work) -> Turn {
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
        self.shared.fail(message);
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
            // What cancels a session may come from a push that has the threads of the pool.
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
    pub(in crate::session) fn add(
        &mut self,
        observation: Observation,
        remakes: Vec<Remake>,
        restart: bool,
        start: Option<&Svbrdf>,
        reply: &Sender<Vec<Remade>>,
    ) -> Result<()> {
        let mut all = Vec::with_capacity(remakes.len());
        // One after the other: the old ones are let go of as they are replaced.
        let replaced = remakes.into_iter().filter_map(|remake| {
            let remade = remake.make();
            let observation = || (remade.index, remade.rectified.observation().clone());
            let replaced = remade.refusal.is_none().then(observation);
            all.push(remade);
            replaced
        });
        self.estimation.add(Addition { observation, replaced, restart }, start)?;
        // Whoever pushed may not wait for it any more.
        let _ = reply.send(all);
        self.meter.reset();
        self.begun = Some(self.here());
        let mut state = self.shared.lock();
        state.fitted += 1;
        state.cut = false;
        state.progress.fraction = 0.0;
        state.progress.loss_before = self.estimation.loss();
        state.progress.loss = self.estimation.loss();
        drop(state);
        self.shared.notify();
        self.busy = true;
        Ok(())
    }

    /// Begins anew with these photographs.
    pub(in crate::session) fn begin_anew(&mut self, photographs: Vec<Observation>) -> Result<()> {
        let mut estimation = self.estimation.afresh();
        let first = photographs.first();
        let start = first.map(|first| first_maps(estimation.networks(), first)).transpose()?;
        for (i, observation) in photographs.into_iter().enumerate() {
            estimation.add(Addition::new(observation), start.as_ref().filter(|_| i == 0))?;
        }
        self.estimation = estimation;
        self.meter.reset();
        self.busy = !self.estimation.is_done();
        self.begun = self.busy.then(|| self.here());
        let (frames, loss) = (self.estimation.frames(), self.estimation.loss());
        let mut state = self.shared.lock();
        state.maps = start.map(Arc::new);
        state.revision.maps += 1;
        state.exposure = Exposure::default();
        (state.fitted, state.cut) = (frames, false);
        state.progress = Progress {
            frames,
            fraction: 0.0,
            loss_before: loss,
            loss,
            seconds_left: None,
            settled: !self.busy,
            phase: None,
        };
        Ok(())
    }

    /// Takes a changed budget over; a fit that was cut short may go on.
    pub(in crate::session) fn follow_budget(&mut self) {
        let budget = self.shared.lock().budget;
        let changed = self.meter.budget != budget;
        let here = (changed && !self.busy && self.estimation.is_cut()).then(|| self.here());
        self.meter.budget = budget;
        if self.busy {
            return;
        }
        self.busy = changed && self.estimation.extend(&self.meter);
        self.begun = here.filter(|_| self.busy);
        let mut state = self.shared.lock();
        if self.busy {
            (state.cut, state.progress.settled) = (false, false);
        } else {
            state.progress.settled = state.fitted == state.progress.frames;
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
        let maps = if publish { Some(Arc::new(pool.install(|| estimation.maps())?)) } else { None };
        if publish {
            self.interval = PUBLISH_INTERVAL.max(begun.elapsed() * PUBLISH_SHARE);
        }
        let mut state = self.shared.lock();
        state.progress.fraction = step.fraction;
        state.progress.phase = if step.done { None } else { step.phase };
        state.progress.loss = step.loss;
        state.progress.seconds_left = (step.fraction > 0.02)
            .then(|| meter.elapsed().as_secs_f32() * (1.0 / step.fraction - 1.0));
        if let Some(maps) = maps {
            state.publish(maps);
            state.exposure = estimation.exposure().clone();
            self.published = Instant::now();
        }
        if step.done {
            (self.busy, self.begun) = (false, None);
            state.cut = estimation.is_cut();
            // A photograph pushed meanwhile is still on its way.
            state.progress.settled = state.fitted == state.progress.frames;
            state.progress.seconds_left = None;
        }
        drop(state);
        self.shared.notify();
        Ok(())
    }
}
