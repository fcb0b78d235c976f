//! A queue of work for a session, done in order on a thread of its own.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

use engine::Error;

use crate::status::{Fault, SVBRDF_BUSY, SVBRDF_CANCELLED};
use crate::threads::{self, SVBRDF_THREAD_PHOTOS};

type Job = Box<dyn FnOnce() + Send>;

/// Largest number of jobs that wait or run: each holds a photo.
pub(crate) const PLACES: usize = 3;

/// A place in a queue, free again when dropped.
pub(crate) struct Place(Arc<AtomicUsize>);

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Release);
    }
}

#[derive(Default)]
enum State {
    #[default]
    NotStarted,
    Running(Sender<Job>, JoinHandle<()>),
    Closed,
}

/// Starts its thread when first needed.
#[derive(Default)]
pub(crate) struct Queue {
    taken: Arc<AtomicUsize>,
    state: Mutex<State>,
}

impl Queue {
    /// A place for one piece of work, if there is one.
    pub(crate) fn place(&self) -> Result<Place, Fault> {
        let more = |taken| (taken < PLACES).then_some(taken + 1);
        match self.taken.fetch_update(Ordering::Acquire, Ordering::Relaxed, more) {
            Ok(_) => Ok(Place(self.taken.clone())),
            Err(_) => {
                let message = format!("{PLACES} photos are waiting to be taken in");
                Err(Fault::new(SVBRDF_BUSY, message))
            }
        }
    }

    /// Puts a piece of work at the end. Once this has returned `Ok`, it will run.
    pub(crate) fn put(&self, job: impl FnOnce() + Send + 'static) -> Result<(), Fault> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let State::NotStarted = *state {
            let (sender, jobs) = channel();
            let thread =
                Builder::new().name("svbrdf-photos".into()).spawn(move || run(&jobs)).map_err(
                    |e| Error::Internal(format!("cannot start the thread that takes photos: {e}")),
                )?;
            *state = State::Running(sender, thread);
        }
        match &*state {
            // The thread ends after the sender only.
            State::Running(jobs, _) => jobs.send(Box::new(job)).map_err(|_| {
                Error::Internal("the thread that takes photos has ended".into()).into()
            }),
            _ => Err(Fault::new(SVBRDF_CANCELLED, "cancelled")),
        }
    }

    /// Closes the queue. Its thread runs the remaining work and ends. Returns its handle, if it was started.
    pub(crate) fn close(&self) -> Option<JoinHandle<()>> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        match std::mem::replace(&mut *state, State::Closed) {
            State::Running(_, thread) => Some(thread),
            _ => None,
        }
    }
}

fn run(jobs: &Receiver<Job>) {
    threads::started(SVBRDF_THREAD_PHOTOS);
    jobs.iter().for_each(|job| job());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_done_in_order_and_all_of_it() {
        let queue = Queue::default();
        let (done, results) = channel();
        for i in 0..5 {
            let done = done.clone();
            queue.put(move || done.send(i).unwrap()).unwrap();
        }
        let thread = queue.close().unwrap();
        assert_eq!(queue.put(|| ()).unwrap_err().status, SVBRDF_CANCELLED);
        thread.join().unwrap();
        assert_eq!(results.try_iter().collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        assert!(queue.close().is_none());
    }

    #[test]
    fn places_are_few_and_come_back() {
        let queue = Queue::default();
        let places: Vec<_> = (0..PLACES).map(|_| queue.place().unwrap()).collect();
        assert_eq!(queue.place().err().unwrap().status, SVBRDF_BUSY);
        drop(places);
        assert!(queue.place().is_ok());
    }
}
