//! The thread that fits.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, TryRecvError};
use rayon::ThreadPool;

use super::board::Update;
use super::fit::Fit;
use super::{Progress, Revision};
use crate::observation::Observation;
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
    pub(super) progress: Progress,
    /// Accepted photographs the worker has taken over.
    pub(super) fitted: usize,
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
        };
        Self {
            state: Mutex::new(State {
                maps: None,
                progress,
                fitted: 0,
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

/// Messages to the worker.
pub(super) enum Command {
    /// A new photograph; the first one brings the maps to start from.
    Frame { observation: Observation, start: Option<Arc<Svbrdf>>, updates: Vec<Update> },
    /// Look at the flags again.
    Wake,
}

/// Shortest time between two published sets of maps.
const PUBLISH_INTERVAL: Duration = Duration::from_millis(200);
/// The same in units of the time that it took to make the latest.
const PUBLISH_SHARE: u32 = 20;

/// Runs until the session is dropped; faults end up in [`State::failed`].
pub(super) fn run(shared: &Shared, commands: &Receiver<Command>, pool: &ThreadPool, fit: Fit) {
    match catch_unwind(AssertUnwindSafe(|| work(shared, commands, pool, fit))) {
        Ok(Ok(())) => {}
        Ok(Err(error)) => shared.fail(error.to_string()),
        Err(panic) => {
            let message = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("unknown panic");
            shared.fail(message.to_owned());
        }
    }
}

fn work(
    shared: &Shared,
    commands: &Receiver<Command>,
    pool: &ThreadPool,
    mut fit: Fit,
) -> Result<()> {
    let mut busy = false;
    let mut started = Instant::now();
    let mut published = Instant::now();
    let mut interval = PUBLISH_INTERVAL;
    loop {
        loop {
            if shared.cancelled.load(Ordering::Relaxed) {
                return Ok(());
            }
            let idle = !busy || shared.paused.load(Ordering::Relaxed);
            let command = if idle {
                commands.recv().map_err(|_| TryRecvError::Disconnected)
            } else {
                commands.try_recv()
            };
            match command {
                Ok(Command::Frame { observation, start, updates }) => {
                    pool.install(|| fit.add(observation, start, &updates))?;
                    let mut state = shared.lock();
                    state.fitted += 1;
                    state.progress.fraction = 0.0;
                    state.progress.loss_before = fit.loss();
                    state.progress.loss = fit.loss();
                    drop(state);
                    shared.notify();
                    busy = true;
                    started = Instant::now();
                }
                Ok(Command::Wake) => {}
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => return Ok(()),
            }
        }
        let step = pool.install(|| fit.step(&|| !shared.cancelled.load(Ordering::Relaxed)))?;
        let publish = step.done || published.elapsed() >= interval;
        let begun = Instant::now();
        let maps = if publish { Some(Arc::new(pool.install(|| fit.maps())?)) } else { None };
        if publish {
            interval = PUBLISH_INTERVAL.max(begun.elapsed() * PUBLISH_SHARE);
        }
        let mut state = shared.lock();
        state.progress.fraction = step.fraction;
        state.progress.loss = step.loss;
        state.progress.seconds_left = (step.fraction > 0.02)
            .then(|| started.elapsed().as_secs_f32() * (1.0 / step.fraction - 1.0));
        if let Some(maps) = maps {
            state.publish(maps);
            published = Instant::now();
        }
        if step.done {
            busy = false;
            // A photograph pushed meanwhile is still in the channel.
            state.progress.settled = state.fitted == state.progress.frames;
            state.progress.seconds_left = None;
        }
        drop(state);
        shared.notify();
    }
}
