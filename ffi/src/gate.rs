//! Counts the callbacks that run, so that the end of a session can wait for them.

use std::sync::{Condvar, Mutex, PoisonError};
use std::thread::{self, ThreadId};

#[derive(Default)]
struct State {
    closed: bool,
    /// The thread of each callback that runs.
    running: Vec<ThreadId>,
}

/// Open until closed; no lock is held while a callback runs.
#[derive(Default)]
pub(crate) struct Gate {
    state: Mutex<State>,
    left: Condvar,
}

/// A callback that runs, until dropped.
pub(crate) struct Inside<'a>(&'a Gate);

impl Gate {
    /// Admits a callback on this thread; none once the gate is closed.
    pub(crate) fn enter(&self) -> Option<Inside<'_>> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.closed {
            return None;
        }
        state.running.push(thread::current().id());
        Some(Inside(self))
    }

    /// Admits nothing more, and waits for the callbacks on other threads.
    pub(crate) fn close(&self) {
        let this = thread::current().id();
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.closed = true;
        while state.running.iter().any(|thread| *thread != this) {
            state = self.left.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Drop for Inside<'_> {
    fn drop(&mut self) {
        let this = thread::current().id();
        let mut state = self.0.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(place) = state.running.iter().position(|thread| *thread == this) {
            state.running.swap_remove(place);
        }
        drop(state);
        self.0.left.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;

    #[test]
    fn closing_waits_for_callbacks_on_other_threads_only() {
        let (gate, ended) = (Gate::default(), AtomicBool::new(false));
        let (entered, inside) = channel();
        let own = gate.enter();
        thread::scope(|scope| {
            let (gate, ended) = (&gate, &ended);
            scope.spawn(move || {
                let _inside = gate.enter().unwrap();
                entered.send(()).unwrap();
                thread::sleep(Duration::from_millis(50));
                ended.store(true, Ordering::Release);
            });
            inside.recv().unwrap();
            gate.close();
            assert!(ended.load(Ordering::Acquire));
        });
        assert!(gate.enter().is_none());
        drop(own);
        gate.close();
    }
}
