//! The fit of a session, driven by the session's thread or by its caller.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TryRecvError};
use web_time::Instant;

use super::board::Update;
use super::intake::own_power;
use super::state::{SavedProgress, StateWriter, write_estimation};
use super::{Progress, Revision};
use crate::estimate::{
    Budget, Change, Estimation, Evidence, Exposure, Meter, Place, Residual, first_maps,
};
use crate::observation::{Falloff, Observation};
use crate::threads::Pool;
use crate::{Error, Result, Svbrdf};

/// What callers and the worker share.
pub(super) struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    pub(super) paused: AtomicBool,
    pub(super) cancelled: AtomicBool,
}

/// Results so far.
pub(super) struct State {
    pub(super) maps: Option<Arc<Svbrdf>>,
    /// What was found of exposure and flash with these maps.
    pub(super) exposure: Exposure,
    pub(super) progress: Progress,
    /// Accepted photographs the worker has taken over.
    pub(super) fitted: usize,
    /// How long the fit may work.
    pub(super) budget: Budget,
    /// Whether the budget ended the fit before its time.
    pub(super) cut: bool,
    /// Set for ever by a fault of the worker.
    pub(super) failed: Option<String>,
    pub(super) revision: Revision,
}

impl State {
    /// Publishes maps.
    pub(super) fn publish(&mut self, maps: Arc<Svbrdf>) {
        self.maps = Some(maps);
        self.revision.maps += 1;
    }
}

impl Shared {
    pub(super) fn new() -> Self {
        let progress = Progress {
            frames: 0,
            fraction: 0.0,
            loss_before: 0.0,
            loss: 0.0,
            seconds_left: None,
            settled: true,
            phase: None,
        };
        Self {
            state: Mutex::new(State {
                maps: None,
                exposure: Exposure::default(),
                progress,
                fitted: 0,
                budget: Budget::default(),
                cut: false,
                failed: None,
                revision: Revision::default(),
            }),
            changed: Condvar::new(),
            paused: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
        }
    }

    /// The state. A panic elsewhere never locks callers out: faults are kept in `failed`.
    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes those who wait. Taking the lock makes sure that none of them is between looking at a
    /// flag and going to sleep.
    pub(super) fn notify(&self) {
        self.lock().revision.state += 1;
        self.changed.notify_all();
    }

    /// Blocks until `reached` holds (true), or until the deadline (false).
    pub(super) fn wait_until(
        &self,
        deadline: Option<Instant>,
        reached: impl Fn(&State) -> bool,
    ) -> Result<bool> {
        let mut state = self.lock();
        loop {
            if let Some(message) = &state.failed {
                return Err(Error::Internal(message.clone()));
            }
            if reached(&state) {
                return Ok(true);
            }
            if self.cancelled.load(Ordering::Relaxed) {
                return Err(Error::Cancelled);
            }
            let left = deadline.map(|d| d.saturating_duration_since(Instant::now()));
            state = match left {
                None => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
                Some(Duration::ZERO) => return Ok(false),
                Some(left) => {
                    let woken = self.changed.wait_timeout(state, left);
                    woken.unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    }

    fn fail(&self, message: String) {
        self.lock().failed = Some(message);
        self.notify();
    }
}

/// A photograph for the estimate; the first one brings the maps to start from.
pub(super) struct NewFrame {
    pub(super) observation: Observation,
    pub(super) start: Option<Arc<Svbrdf>>,
    /// What is known better of earlier ones.
    pub(super) updates: Vec<Update>,
    /// Earlier ones lie so far elsewhere now that the maps so far are no start any more.
    pub(super) restart: bool,
}

/// A photograph to be taken back.
pub(super) struct Removal {
    pub(super) index: usize,
    /// What the others need to go with what is known without it, one entry each.
    pub(super) updates: Vec<Option<Update>>,
    /// Whether the power of the light is to be that of the first one left.
    pub(super) power: bool,
    /// Gets that power.
    pub(super) reply: Sender<Option<[f32; 3]>>,
}

/// Messages to the worker.
pub(super) enum Command {
    /// A new photograph.
    Frame(Box<NewFrame>),
    /// Add the fit to a saved session and hand that back.
    Save(StateWriter, Sender<StateWriter>),
    /// Take a photograph back and begin anew.
    Remove(Box<Removal>),
    /// Tell how the maps explain each photograph.
    Residuals(Sender<Vec<Residual>>),
    /// Tell what is known of how far the maps may be off.
    Evidence(Sender<Result<Evidence>>),
    /// Tell by how much a photograph from each of some places lowers the expected error.
    Outlook(Vec<Place>, Sender<Result<Vec<f64>>>),
    /// Look at the flags again.
    Wake,
}

/// Shortest time between two published sets of maps.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(200);
/// The same in units of the time that it took to make the latest.
const PUBLISH_SHARE: u32 = 20;

/// What a turn may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Work {
    /// The next message, waited for where there is nothing else to do; else a step.
    Wait,
    /// The next message; where there is none, a step.
    Step,
    /// The next message.
    Messages,
}

/// What a turn has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    /// A message was taken or a step done.
    Worked,
    /// There was nothing to do.
    Idle,
    /// The session was cancelled or dropped, or has failed: there is no further turn.
    Ended,
}

/// The estimate with all that it takes to go on with it, turn by turn.
pub(super) struct Fit {
    worker: Worker,
    pool: Arc<Pool>,
    estimation: Estimation,
    meter: Meter,
}

impl Fit {
    pub(super) fn new(
        shared: Arc<Shared>,
        commands: Receiver<Command>,
        pool: Arc<Pool>,
        estimation: Estimation,
        meter: Meter,
    ) -> Self {
        let worker = Worker {
            shared,
            commands,
            published: Instant::now(),
            interval: PUBLISH_INTERVAL,
            busy: !estimation.is_done(),
        };
        Self { worker, pool, estimation, meter }
    }

    /// Takes turns until the last one.
    pub(super) fn run(mut self) {
        while self.turn(Work::Wait) != Turn::Ended {}
    }

    /// One turn; faults end up in [`State::failed`].
    pub(super) fn turn(&mut self, work: Work) -> Turn {
        let Self { worker, pool, estimation, meter } = self;
        let turn = catch_unwind(AssertUnwindSafe(|| worker.turn(work, pool, estimation, meter)));
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
        worker.shared.fail(message);
        Turn::Ended
    }
}

struct Worker {
    shared: Arc<Shared>,
    commands: Receiver<Command>,
    published: Instant,
    /// Time between two published sets of maps.
    interval: Duration,
    busy: bool,
}

impl Worker {
    fn turn(
        &mut self,
        work: Work,
        pool: &Pool,
        estimation: &mut Estimation,
        meter: &mut Meter,
    ) -> Result<Turn> {
        if self.shared.cancelled.load(Ordering::Relaxed) {
            return Ok(Turn::Ended);
        }
        let idle = !self.busy || self.shared.paused.load(Ordering::Relaxed);
        let command = if idle && work == Work::Wait {
            self.commands.recv().map_err(|_| TryRecvError::Disconnected)
        } else {
            self.commands.try_recv()
        };
        match command {
            Ok(Command::Frame(frame)) => self.add(pool, estimation, meter, *frame)?,
            Ok(Command::Save(state, reply)) => self.save(pool, estimation, meter, state, &reply),
            Ok(Command::Remove(removal)) => self.remove(pool, estimation, meter, *removal)?,
            Ok(Command::Residuals(reply)) => {
                let residuals = pool.install(|| estimation.residuals());
                // Without photographs there is nothing to tell; whoever asked may have gone.
                let _ = reply.send(residuals.unwrap_or_default());
            }
            Ok(Command::Evidence(reply)) => {
                // Whoever asked may have gone.
                let _ = reply.send(pool.install(|| estimation.evidence()));
            }
            Ok(Command::Outlook(places, reply)) => {
                let _ = reply.send(pool.install(|| estimation.outlook(&places)));
            }
            Ok(Command::Wake) => self.follow_budget(estimation, meter),
            Err(TryRecvError::Empty) if idle || work == Work::Messages => return Ok(Turn::Idle),
            Err(TryRecvError::Empty) => self.step(pool, estimation, meter)?,
            Err(TryRecvError::Disconnected) => return Ok(Turn::Ended),
        }
        Ok(Turn::Worked)
    }

    fn add(
        &mut self,
        pool: &Pool,
        estimation: &mut Estimation,
        meter: &mut Meter,
        frame: NewFrame,
    ) -> Result<()> {
        let NewFrame { observation, start, updates, restart } = frame;
        pool.install(|| estimation.add(observation, start.as_deref(), &updates, restart))?;
        meter.reset();
        let mut state = self.shared.lock();
        state.fitted += 1;
        state.cut = false;
        state.progress.fraction = 0.0;
        state.progress.loss_before = estimation.loss();
        state.progress.loss = estimation.loss();
        drop(state);
        self.shared.notify();
        self.busy = true;
        Ok(())
    }

    /// Begins anew without a photograph.
    fn remove(
        &mut self,
        pool: &Pool,
        estimation: &mut Estimation,
        meter: &mut Meter,
        removal: Removal,
    ) -> Result<()> {
        let Removal { index, updates, power, reply } = removal;
        let fresh = estimation.afresh();
        let mut left = std::mem::replace(estimation, fresh).into_photographs();
        left.remove(index);
        let first_power = left.first().map(|first| own_power(first.view.camera_mm));
        let start = pool.install(|| -> Result<_> {
            for (observation, update) in left.iter_mut().zip(&updates) {
                if let Some(update) = update {
                    update.apply(observation);
                }
                if let Some(power_mm2) = first_power.filter(|_| power) {
                    observation.view.falloff = Falloff::InverseSquare { power_mm2 };
                }
            }
            let networks = estimation.networks().clone();
            let start = left.first().map(|first| first_maps(&networks, first)).transpose()?;
            let none: [Update; 0] = [];
            for (i, observation) in left.into_iter().enumerate() {
                let start = start.as_ref().filter(|_| i == 0);
                estimation.add(observation, start, &none, false)?;
            }
            Ok(start)
        })?;
        meter.reset();
        self.busy = !estimation.is_done();
        let mut state = self.shared.lock();
        state.maps = start.map(Arc::new);
        state.revision.maps += 1;
        state.exposure = Exposure::default();
        (state.fitted, state.cut) = (estimation.frames(), false);
        let loss = estimation.loss();
        state.progress = Progress {
            frames: estimation.frames(),
            fraction: 0.0,
            loss_before: loss,
            loss,
            seconds_left: None,
            settled: !self.busy,
            phase: None,
        };
        drop(state);
        // Whoever asked is told before those who wait for changes.
        let _ = reply.send(first_power);
        self.shared.notify();
        Ok(())
    }

    /// Writes the estimate as it is between two steps.
    fn save(
        &self,
        pool: &Pool,
        estimation: &Estimation,
        meter: &Meter,
        mut state: StateWriter,
        reply: &Sender<StateWriter>,
    ) {
        let progress = self.shared.lock().progress;
        let progress = SavedProgress {
            loss_before: progress.loss_before,
            seconds: meter.elapsed().as_secs_f32(),
            steps: meter.steps(),
        };
        pool.install(|| write_estimation(&mut state, estimation, &progress));
        // Whoever asked may have gone.
        let _ = reply.send(state);
    }

    /// Takes a changed budget over; a fit that was cut short may go on.
    fn follow_budget(&mut self, estimation: &mut Estimation, meter: &mut Meter) {
        let budget = self.shared.lock().budget;
        let changed = std::mem::replace(&mut meter.budget, budget) != budget;
        if self.busy {
            return;
        }
        self.busy = changed && estimation.extend(meter);
        let mut state = self.shared.lock();
        if self.busy {
            (state.cut, state.progress.settled) = (false, false);
        } else {
            state.progress.settled = state.fitted == state.progress.frames;
        }
        drop(state);
        self.shared.notify();
    }

    fn step(&mut self, pool: &Pool, estimation: &mut Estimation, meter: &mut Meter) -> Result<()> {
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
            // A photograph pushed meanwhile is still in the channel.
            state.progress.settled = state.fitted == state.progress.frames;
            state.progress.seconds_left = None;
        }
        drop(state);
        self.shared.notify();
        Ok(())
    }
}
