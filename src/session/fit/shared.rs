//! What callers and the fit share: results so far, and flags.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use web_time::Instant;

use super::group::Group;
use crate::estimate::{Budget, LightCorrection};
use crate::session::reports::{Progress, Revision};
use crate::session::survey::{NextView, Survey};
use crate::{Error, Result, Svbrdf};

/// What callers and the fit share.
#[derive(Default)]
pub struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    pub paused: AtomicBool,
    pub cancelled: AtomicBool,
}

/// Results so far.
#[derive(Default)]
pub struct State {
    pub maps: Option<Arc<Svbrdf>>,
    /// What the fit corrected of exposure and flash with these maps.
    pub light_correction: LightCorrection,
    pub progress: Progress,
    /// What its fraction is one of.
    pub group: Group,
    /// Accepted photographs the fit has taken over.
    pub fitted: usize,
    /// How long the fit may work.
    pub budget: Budget,
    /// Whether the budget ended the fit before its time.
    pub cut: bool,
    /// Set for ever by a fault of the fit.
    pub failed: Option<String>,
    pub revision: Revision,
    /// The latest survey; and photographs and whether the fit had settled when one was asked for.
    pub survey: Option<Arc<Survey>>,
    pub surveyed: Option<(usize, bool)>,
    /// What probes refer to.
    pub next: Option<NextView>,
}

impl State {
    /// Publishes maps.
    pub fn publish(&mut self, maps: Option<Arc<Svbrdf>>) {
        self.maps = maps;
        self.revision.maps += 1;
    }

    /// Whether the fit has taken all photographs over.
    pub fn is_current(&self) -> bool {
        self.fitted == self.progress.photos
    }

    /// Changes the reported group of photographs; returns whether its fraction changes.
    pub fn regroup(&mut self, change: impl FnOnce(&mut Group)) -> bool {
        let before = self.progress.fraction;
        change(&mut self.group);
        self.progress.fraction = self.group.fraction();
        self.progress.fraction != before
    }
}

impl Shared {
    /// The state. A panic elsewhere never locks callers out: faults are kept in `failed`.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes those who wait. Taking the lock makes sure that none of them is between looking at a
    /// flag and going to sleep.
    pub fn notify(&self) {
        self.lock().revision.state += 1;
        self.changed.notify_all();
    }

    /// Blocks until `reached` holds (true), or until the deadline (false).
    pub fn wait_until(
        &self,
        deadline: Option<Instant>,
        reached: impl Fn(&State) -> bool,
    ) -> Result<bool> {
        let mut state = self.lock();
        loop {
            if state.failed.is_none() && reached(&state) {
                return Ok(true);
            }
            self.check(&state)?;
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
    pub fn usable(&self) -> Result<()> {
        self.check(&self.lock())
    }

    fn check(&self, state: &State) -> Result<()> {
        match &state.failed {
            Some(message) => Err(Error::Internal(message.clone())),
            None if self.cancelled.load(Ordering::Relaxed) => Err(Error::Cancelled),
            None => Ok(()),
        }
    }
}
