//! Ctrl-C, requests to terminate and terminals that are closed, which end a fit in order.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

#[cfg(unix)]
use signal_hook::consts::SIGHUP;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::failure::{Failure, Result};

#[cfg(unix)]
const SIGNALS: [i32; 3] = [SIGINT, SIGTERM, SIGHUP];
#[cfg(not(unix))]
const SIGNALS: [i32; 2] = [SIGINT, SIGTERM];

/// Whether the command has been asked to end.
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens to SIGINT, SIGTERM and SIGHUP from now on, the last unless `nohup` has it ignored. The first
    /// one is noted here; a second one ends the process at once with status 130.
    pub fn listen() -> Result<Self> {
        let asked = Arc::new(AtomicBool::new(false));
        // SIGINT is ignored in whatever scripts start in the background, which is to end by it all the same.
        let is_heard = |signal: &i32| [SIGINT, SIGTERM].contains(signal) || !is_ignored(*signal);
        for signal in SIGNALS.into_iter().filter(is_heard) {
            // In this order: the first signal finds the flag unset, and sets it.
            flag::register_conditional_shutdown(signal, 130, asked.clone())
                .and_then(|_| flag::register(signal, asked.clone()))
                .map_err(|e| Failure::Other(format!("signals cannot be listened to: {e}")))?;
        }
        Ok(Self(asked))
    }

    /// Whether a signal has come.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Whether a signal is ignored, if the system reports it.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}
