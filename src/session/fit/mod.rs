//! The fit of a session: an estimate, and the jobs that it does between two steps.

mod driver;
mod shared;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use crossbeam_channel::{Receiver, TryRecvError};
use web_time::Instant;

use super::reports::Progress;
use crate::estimate::{Addition, Estimation, Exposure, Meter, first_maps};
use crate::observation::Observation;
use crate::threads::Pool;
use crate::{Result, Svbrdf};
pub(super) use driver::FitHandle;
pub(super) use shared::{Shared, State};

/// What a caller asks of the fit, done between two steps.
type Job = Box<dyn FnOnce(&mut Fit) -> Result<()> + Send>;

/// Shortest time between two published sets of maps.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(200);
/// The same in units of the time that it took to make the latest.
const PUBLISH_SHARE: u32 = 20;

/// What a turn may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Work {
    /// The next job, waited for where there is nothing else to do; else a step.
    Wait,
    /// The next job; where there is none, a step.
    Step,
    /// The next job.
    Jobs,
}

/// What a turn has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    /// A job or a step.
    Worked,
    /// There was nothing to do.
    Idle,
    /// The session was cancelled or dropped, or has failed: there is no further turn.
    Ended,
}

/// The estimate with all that it takes to go on with it, turn by turn.
pub(super) struct Fit {
    pub(super) shared: Arc<Shared>,
    pool: Arc<Pool>,
    pub(super) estimation: Estimation,
    pub(super) meter: Meter,
    published: Instant,
    /// Time between two published sets of maps.
    interval: Duration,
    busy: bool,
}

impl Fit {
    pub(super) fn new(
        shared: Arc<Shared>,
        pool: Arc<Pool>,
        estimation: Estimation,
        meter: Meter,
    ) -> Self {
        let (published, interval) = (Instant::now(), PUBLISH_INTERVAL);
        let busy = !estimation.is_done();
        Self { shared, pool, estimation, meter, published, interval, busy }
    }

    /// One turn; faults end up in [`State::failed`].
    fn turn(&mut self, jobs: &Receiver<Job>, work: Work) -> Turn {
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
            Ok(job) => {
                let pool = self.pool.clone();
                pool.install(|| job(self))?;
            }
            Err(TryRecvError::Empty) if idle || work == Work::Jobs => return Ok(Turn::Idle),
            Err(TryRecvError::Empty) => self.step()?,
            Err(TryRecvError::Disconnected) => return Ok(Turn::Ended),
        }
        Ok(Turn::Worked)
    }

    /// Adds a photograph, the first with the maps to start from.
    pub(super) fn add(&mut self, addition: Addition, start: Option<&Svbrdf>) -> Result<()> {
        self.estimation.add(addition, start)?;
        self.meter.reset();
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
    pub(super) fn begin_anew(&mut self, photographs: Vec<Observation>) -> Result<()> {
        let mut estimation = self.estimation.afresh();
        let first = photographs.first();
        let start = first.map(|first| first_maps(estimation.networks(), first)).transpose()?;
        for (i, observation) in photographs.into_iter().enumerate() {
            estimation.add(Addition::new(observation), start.as_ref().filter(|_| i == 0))?;
        }
        self.estimation = estimation;
        self.meter.reset();
        self.busy = !self.estimation.is_done();
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
    fn follow_budget(&mut self) {
        let budget = self.shared.lock().budget;
        let changed = std::mem::replace(&mut self.meter.budget, budget) != budget;
        if self.busy {
            return;
        }
        self.busy = changed && self.estimation.extend(&self.meter);
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
            self.busy = false;
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
