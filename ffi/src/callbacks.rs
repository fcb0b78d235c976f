//! The caller's functions: log, progress, maps.

use std::ffi::c_void;
use std::sync::{Mutex, PoisonError};

use crate::gate::Gate;
use crate::handles::svbrdf_session;
use crate::log::{self, Sink, svbrdf_log_level};
use crate::options::{svbrdf_maps_callback, svbrdf_progress_callback, svbrdf_session_options};
use crate::reports::svbrdf_progress;

/// The callbacks of a session.
pub(crate) struct Callbacks {
    on_progress: svbrdf_progress_callback,
    on_maps: svbrdf_maps_callback,
    log: Sink,
    /// The gate of the session's log lines; closed when the session is destroyed.
    pub(crate) logging: Gate,
    /// Lines for the callback thread.
    later: Mutex<Vec<(svbrdf_log_level, String)>>,
    user_data: *mut c_void,
}

// SAFETY: the header tells callers that callbacks come on other threads, several at a time for
// the log; the pointer is only handed back to them.
unsafe impl Send for Callbacks {}
// SAFETY: as above.
unsafe impl Sync for Callbacks {}

impl Callbacks {
    pub(crate) fn new(options: &svbrdf_session_options) -> Self {
        Self {
            on_progress: options.on_progress,
            on_maps: options.on_maps,
            log: Sink::new(options.on_log, options.user_data),
            logging: Gate::default(),
            later: Mutex::default(),
            user_data: options.user_data,
        }
    }

    /// Whether a thread is needed.
    pub(crate) fn notifies(&self) -> bool {
        self.on_progress.is_some() || self.on_maps.is_some() || self.logs()
    }

    /// Whether the session has a log.
    pub(crate) fn logs(&self) -> bool {
        self.log.is_some()
    }

    /// Writes a line to the session's log and the library's.
    pub(crate) fn log(&self, level: svbrdf_log_level, text: impl FnOnce() -> String) {
        // Calls on other threads may outlast the session, `user_data` need not.
        let inside = self.logging.enter();
        log::write_to(if inside.is_some() { self.log } else { Sink::NONE }, level, text);
    }

    /// Has the callback thread write a line.
    pub(crate) fn log_later(&self, level: svbrdf_log_level, text: String) {
        self.later.lock().unwrap_or_else(PoisonError::into_inner).push((level, text));
    }

    /// Writes the lines for the callback thread.
    pub(crate) fn log_now(&self) {
        let lines = std::mem::take(&mut *self.later.lock().unwrap_or_else(PoisonError::into_inner));
        for (level, text) in lines {
            self.log(level, || text);
        }
    }

    /// Says that there are newer maps.
    pub(crate) fn maps(&self, session: *mut svbrdf_session) {
        if let Some(call) = self.on_maps {
            // SAFETY: the caller's function with the arguments that the header says.
            unsafe { call(self.user_data, session) };
        }
    }

    /// Tells the state of the fit, if anybody listens.
    pub(crate) fn progress(
        &self,
        session: *mut svbrdf_session,
        progress: impl FnOnce() -> svbrdf_progress,
    ) {
        if let Some(call) = self.on_progress {
            let progress = progress();
            // SAFETY: as above; the struct lives during the call.
            unsafe { call(self.user_data, session, &raw const progress) };
        }
    }
}
