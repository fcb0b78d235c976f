//! Runs the fit on a thread of its own or in steps of the caller, and passes jobs to it.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use crossbeam_channel::{Receiver, Sender};
use web_time::Instant;

use super::shared::{Shared, State};
use super::turns::{Fit, Job, Turn, Work};
use crate::session::settings::Driver;
use crate::{Error, Result, threads};

/// A session's handle of its fit.
pub struct FitHandle {
    pub shared: Arc<Shared>,
    jobs: Sender<Job>,
    engine: Engine,
}

/// A fit and the jobs for it.
type Driven = Box<(Fit, Receiver<Job>)>;

/// The thread or callers that run the fit.
enum Engine {
    /// A thread; `None` once it was joined.
    Thread(Option<JoinHandle<()>>),
    /// Callers, one at a time; `None` once the fit has ended.
    Caller(Mutex<Option<Driven>>),
}

impl FitHandle {
    pub fn start(mut fit: Fit, driver: Driver) -> Result<Self> {
        let (jobs, received) = crossbeam_channel::unbounded();
        let shared = fit.shared.clone();
        let engine = match driver {
            Driver::Caller => Engine::Caller(Mutex::new(Some(Box::new((fit, received))))),
            Driver::Thread => {
                let thread = std::thread::Builder::new().name("svbrdf-fit".into());
                let subscriber = threads::Subscriber::current();
                let thread = thread.spawn(move || {
                    threads::started(threads::Role::Fit);
                    subscriber.follow(|| while fit.turn(&received, Work::Wait) != Turn::Ended {})
                });
                let fault = |e| Error::Internal(format!("cannot start the thread of the fit: {e}"));
                Engine::Thread(Some(thread.map_err(fault)?))
            }
        };
        Ok(Self { shared, jobs, engine })
    }

    /// A turn of a fit that callers drive, one caller at a time. `None` if the fit has a thread.
    fn turn(&self, work: Work) -> Option<Turn> {
        let Engine::Caller(fit) = &self.engine else { return None };
        let mut fit = threads::lock(fit);
        let turn = fit.as_mut().map_or(Turn::Ended, |driven| driven.0.turn(&driven.1, work));
        if turn == Turn::Ended {
            *fit = None;
        }
        Some(turn)
    }

    /// Continues a fit that its caller drives. Returns whether there may be more to do.
    pub fn step(&self) -> Result<bool> {
        self.shared.usable()?;
        match self.turn(Work::Step) {
            Some(Turn::Worked) => Ok(true),
            Some(Turn::Idle) => Ok(false),
            Some(Turn::Ended) => Err(self.why_ended()),
            None => Err(Error::argument(
                "driver",
                "the fit has a thread of its own; `Driver::Caller` is expected",
            )),
        }
    }

    /// Sends a job to the fit. Returns false if the fit has ended.
    pub fn send(&self, job: impl FnOnce(&mut Fit) -> Result<()> + Send + 'static) -> bool {
        let in_pool = move |fit: &mut Fit| {
            let pool = fit.pool.clone();
            pool.install(|| job(fit))
        };
        self.jobs.send(Box::new(in_pool)).is_ok()
    }

    /// Asks the fit a question, which it answers between two steps.
    ///
    /// # Errors
    /// When the fit has failed or was cancelled, and those of the answer.
    pub fn ask<A: Send + 'static>(
        &self,
        question: impl FnOnce(&mut Fit) -> Result<A> + Send + 'static,
    ) -> Result<A> {
        self.shared.usable()?;
        let (reply, answer) = crossbeam_channel::bounded(1);
        self.send(move |fit| {
            // The caller may have gone.
            let _ = reply.send(question(fit));
            Ok(())
        });
        self.receive(&answer)?
    }

    /// Waits for the answer of a job.
    ///
    /// # Errors
    /// When the fit has failed or was cancelled.
    pub fn receive<A>(&self, answer: &Receiver<A>) -> Result<A> {
        while self.turn(Work::Jobs) == Some(Turn::Worked) {}
        answer.recv().map_err(|_| self.why_ended())
    }

    fn why_ended(&self) -> Error {
        self.shared.usable().err().unwrap_or(Error::Cancelled)
    }

    /// Blocks until `reached` holds (true), or until the deadline (false). Continues the fit if the caller drives it.
    pub fn wait_until(
        &self,
        deadline: Option<Instant>,
        reached: impl Fn(&State) -> bool,
    ) -> Result<bool> {
        if matches!(self.engine, Engine::Thread(_)) {
            return self.shared.wait_until(deadline, reached);
        }
        loop {
            let seen = self.shared.lock().revision;
            if reached(&self.shared.lock()) {
                return Ok(true);
            }
            if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                return Ok(false);
            }
            if !self.step()? {
                // Paused: wait for a change by another thread.
                let changed = |state: &State| reached(state) || state.revision != seen;
                self.shared.wait_until(deadline, changed)?;
            }
        }
    }

    /// Has the fit check budget and flags.
    pub fn wake(&self) {
        // Not in the pool, whose threads may be occupied. A fit that has ended needs no waking.
        let _ = self.jobs.send(Box::new(|fit| {
            fit.follow_budget();
            Ok(())
        }));
        if matches!(self.engine, Engine::Caller(_)) {
            self.shared.notify();
        }
    }

    /// Ends the fit after the step in progress.
    pub fn cancel(&self) {
        self.shared.cancelled.store(true, Ordering::Relaxed);
        self.wake();
        self.shared.notify();
    }

    #[cfg(test)]
    pub fn has_ended(&self) -> bool {
        matches!(&self.engine, Engine::Thread(Some(thread)) if thread.is_finished())
    }
}

impl Drop for FitHandle {
    fn drop(&mut self) {
        self.cancel();
        if let Engine::Thread(thread) = &mut self.engine
            && let Some(thread) = thread.take()
        {
            // Faults of the fit were recorded in the state.
            let _ = thread.join();
        }
    }
}
