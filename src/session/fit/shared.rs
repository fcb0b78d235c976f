//! State shared by callers and the fit: results so far, and flags.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use web_time::Instant;

use super::group::Group;
use crate::estimate::{Budget, LightCorrection};
use crate::session::reports::{Progress, Revision};
use crate::session::survey::{NextView, Survey};
use crate::{Error, Result, Svbrdf};

/// State shared by callers and the fit.
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
    /// The fit's correction of exposure and flash, with these maps.
    pub light_correction: LightCorrection,
    pub progress: Progress,
    /// The photographs whose work the fraction of `progress` measures.
    pub group: Group,
    /// Accepted photographs that the fit has received.
    pub fitted: usize,
    /// Limits of the work on each photograph.
    pub budget: Budget,
    /// Whether the budget ended the fit early.
    pub cut: bool,
    /// The fault that ended the fit; never cleared.
    pub failed: Option<String>,
    pub revision: Revision,
    /// The latest survey.
    pub survey: Option<Arc<Survey>>,
    /// Number of photographs at the latest request for a survey, and whether the fit had settled.
    pub surveyed: Option<(usize, bool)>,
    /// The view that probes refer to.
    pub next: Option<NextView>,
}

impl State {
    /// Publishes maps.
    pub fn publish(&mut self, maps: Option<Arc<Svbrdf>>) {
        self.maps = maps;
        self.revision.maps += 1;
    }

    /// Whether the fit has received all photographs.
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
    /// The state. A poisoned lock is ignored: faults are kept in `failed`.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes waiting callers. Taking the lock ensures that none of them is between its check of a flag and its sleep.
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
