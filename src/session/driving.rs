//! The fit on a thread of its own, or in steps of the caller's.

use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;

use crossbeam_channel::Receiver;
use web_time::Instant;

use super::worker::{Command, Fit, State, Turn, Work};
use super::{Driver, Session};
use crate::{Error, Result, threads};

/// What goes on with the fit.
pub(super) enum Engine {
    /// A thread; `None` once it was waited for.
    Thread(Option<JoinHandle<()>>),
    /// Callers, one at a time; `None` once the fit has ended.
    Caller(Mutex<Option<Box<Fit>>>),
}

impl Engine {
    pub(super) fn start(fit: Fit, driver: Driver) -> Result<Self> {
        if driver == Driver::Caller {
            return Ok(Self::Caller(Mutex::new(Some(Box::new(fit)))));
        }
        let thread = std::thread::Builder::new().name("svbrdf-fit".into()).spawn(move || {
            threads::started(threads::Role::Fit);
            fit.run();
        });
        match thread {
            Ok(thread) => Ok(Self::Thread(Some(thread))),
            Err(e) => Err(Error::Internal(format!("cannot start the thread of the fit: {e}"))),
        }
    }

    /// A turn of a fit that callers drive, after those of others; `None`: the fit has a thread.
    fn turn(&self, work: Work) -> Option<Turn> {
        let Self::Caller(fit) = self else { return None };
        let mut fit = fit.lock().unwrap_or_else(PoisonError::into_inner);
        let turn = fit.as_mut().map_or(Turn::Ended, |fit| fit.turn(work));
        if turn == Turn::Ended {
            *fit = None;
        }
        Some(turn)
    }

    /// Waits for the thread, which has been told to end.
    pub(super) fn join(&mut self) {
        if let Self::Thread(thread) = self
            && let Some(thread) = thread.take()
        {
            // Faults of the fit were recorded in the state.
            let _ = thread.join();
        }
    }

    #[cfg(test)]
    pub(super) fn has_ended(&self) -> bool {
        matches!(self, Self::Thread(Some(thread)) if thread.is_finished())
    }
}

impl Session {
    /// Goes on with the fit of a session that its caller drives ([`Driver::Caller`]), for one bit of
    /// work: takes over a photograph, or does a step of the optimiser. Returns whether there may be
    /// more to do; without, the fit has settled or is paused.
    ///
    /// Every other method works between two steps, and from other threads meanwhile. Without steps
    /// there are the maps of the latest photograph only, as [`Session::push`] leaves them.
    ///
    /// # Errors
    /// When the session has a thread of its own, has failed or was cancelled.
    pub fn step(&self) -> Result<bool> {
        self.usable()?;
        match self.engine.turn(Work::Step) {
            Some(Turn::Worked) => Ok(true),
            Some(Turn::Idle) => Ok(false),
            Some(Turn::Ended) => Err(self.usable().err().unwrap_or(Error::Cancelled)),
            None => Err(Error::argument(
                "driver",
                "the fit has a thread of its own; `Driver::Caller` is expected",
            )),
        }
    }

    /// Sends the fit a question, and waits for its answer; `None` where the fit has ended.
    pub(super) fn ask<A>(&self, question: Command, answer: &Receiver<A>) -> Option<A> {
        self.commands.send(question).ok()?;
        while self.engine.turn(Work::Messages) == Some(Turn::Worked) {}
        answer.recv().ok()
    }

    /// Blocks until `reached` holds (true), or until the deadline (false).
    pub(super) fn go_on_until(
        &self,
        deadline: Option<Instant>,
        reached: impl Fn(&State) -> bool,
    ) -> Result<bool> {
        if matches!(self.engine, Engine::Thread(_)) {
            return self.shared.wait_until(deadline, reached);
        }
        loop {
            let seen = self.revision();
            if reached(&self.shared.lock()) {
                return Ok(true);
            }
            if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                return Ok(false);
            }
            if !self.step()? {
                // Paused: until another thread changes something.
                let changed = |state: &State| reached(state) || state.revision != seen;
                self.shared.wait_until(deadline, changed)?;
            }
        }
    }
}
