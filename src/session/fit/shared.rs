//! What callers and the fit share: results so far, and flags.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use web_time::Instant;

use crate::estimate::{Budget, Exposure};
use crate::session::reports::{Progress, Revision};
use crate::{Error, Result, Svbrdf};

/// What callers and the fit share.
pub(in crate::session) struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    pub(in crate::session) paused: AtomicBool,
    pub(in crate::session) cancelled: AtomicBool,
}

/// Results so far.
pub(in crate::session) struct State {
    pub(in crate::session) maps: Option<Arc<Svbrdf>>,
    /// What was found of exposure and flash with these maps.
    pub(in crate::session) exposure: Exposure,
    pub(in crate::session) progress: Progress,
    /// Accepted photographs the fit has taken over.
    pub(in crate::session) fitted: usize,
    /// How long the fit may work.
    pub(in crate::session) budget: Budget,
    /// Whether the budget ended the fit before its time.
    pub(in crate::session) cut: bool,
    /// Set for ever by a fault of the fit.
    pub(in crate::session) failed: Option<String>,
    pub(in crate::session) revision: Revision,
}

impl State {
    /// Publishes maps.
    pub(in crate::session) fn publish(&mut self, maps: Arc<Svbrdf>) {
        self.maps = Some(maps);
        self.revision.maps += 1;
    }
}

impl Shared {
    pub(in crate::session) fn new() -> Self {
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
    pub(in crate::session) fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes those who wait. Taking the lock makes sure that none of them is between looking at a
    /// flag and going to sleep.
    pub(in crate::session) fn notify(&self) {
        self.lock().revision.state += 1;
        self.changed.notify_all();
    }

    /// Blocks until `reached` holds (true), or until the deadline (false).
    pub(in crate::session) fn wait_until(
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

    /// Refuses calls on a session that failed or was cancelled.
    pub(in crate::session) fn usable(&self) -> Result<()> {
        if let Some(message) = &self.lock().failed {
            return Err(Error::Internal(message.clone()));
        }
        if self.cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        Ok(())
    }

    pub(super) fn fail(&self, message: String) {
        self.lock().failed = Some(message);
        self.notify();
    }
}
