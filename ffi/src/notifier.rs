//! The thread that calls back, and the log.

use std::ffi::{CString, c_char, c_void};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::{Builder, JoinHandle};

use engine::Error;
use engine::session::Revision;

use crate::options::{
    SVBRDF_LOG_ERROR, svbrdf_log_callback, svbrdf_log_level, svbrdf_maps_callback,
    svbrdf_progress_callback, svbrdf_session_options,
};
use crate::session::Live;
use crate::status::Fault;

/// What a session calls.
pub(crate) struct Callbacks {
    on_progress: svbrdf_progress_callback,
    on_maps: svbrdf_maps_callback,
    on_log: svbrdf_log_callback,
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
            on_log: options.on_log,
            user_data: options.user_data,
        }
    }

    /// Whether a thread is needed.
    pub(crate) fn notifies(&self) -> bool {
        self.on_progress.is_some() || self.on_maps.is_some()
    }

    /// Writes a line to the log.
    pub(crate) fn log(&self, level: svbrdf_log_level, text: impl FnOnce() -> String) {
        if let Some(call) = self.on_log {
            let line = CString::new(text().replace('\0', " ")).unwrap_or_default();
            let message: *const c_char = line.as_ptr();
            // SAFETY: the caller's function with the arguments that the header says.
            unsafe { call(self.user_data, level, message) };
        }
    }
}

/// Starts the thread of a session's callbacks.
pub(crate) fn start(live: &Arc<Live>) -> Result<JoinHandle<()>, Fault> {
    let live = live.clone();
    Builder::new()
        .name("svbrdf-callback".into())
        .spawn(move || run(&live))
        .map_err(|e| Error::Internal(format!("no thread: {e}")).into())
}

fn run(live: &Live) {
    let mut seen = Revision::default();
    loop {
        let changed = live.session.wait_for_change(seen);
        if live.destroyed.load(Ordering::Acquire) {
            return;
        }
        let now = live.session.revision();
        if now.maps != seen.maps {
            maps(live);
        }
        progress(live);
        if let Err(fault) = changed {
            if !matches!(fault, Error::Cancelled) {
                live.callbacks.log(SVBRDF_LOG_ERROR, || fault.to_string());
            }
            return;
        }
        seen = now;
    }
}

fn maps(live: &Live) {
    if let Some(call) = live.callbacks.on_maps {
        // SAFETY: the caller's function with the arguments that the header says.
        unsafe { call(live.callbacks.user_data, live.handle()) };
    }
}

fn progress(live: &Live) {
    if let Some(call) = live.callbacks.on_progress
        && !live.destroyed.load(Ordering::Acquire)
    {
        let progress = live.progress();
        // SAFETY: as above; the struct lives during the call.
        unsafe { call(live.callbacks.user_data, live.handle(), &raw const progress) };
    }
}
