//! Lines for the log: of the library as a whole, and of a session.

use std::ffi::{CString, c_char, c_void};
use std::sync::{PoisonError, RwLock};

/// Importance of a log line.
pub type svbrdf_log_level = u32;
/// An error.
pub const SVBRDF_LOG_ERROR: svbrdf_log_level = 1;
/// A photo was rejected or carries a hint.
pub const SVBRDF_LOG_WARNING: svbrdf_log_level = 2;
/// Information.
pub const SVBRDF_LOG_INFO: svbrdf_log_level = 3;

/// Called with a line of text (UTF-8, without a line end, valid during the call), on a thread inside a
/// call or on one of the session's callback threads.
pub type svbrdf_log_callback = Option<
    unsafe extern "C" fn(user_data: *mut c_void, level: svbrdf_log_level, message: *const c_char),
>;

/// A caller's function.
#[derive(Clone, Copy)]
pub(crate) struct Sink {
    call: svbrdf_log_callback,
    user_data: *mut c_void,
}

// SAFETY: the header tells callers that lines come on any thread, several at a time; the pointer is
// only handed back to them.
unsafe impl Send for Sink {}
// SAFETY: as above.
unsafe impl Sync for Sink {}

impl Sink {
    /// Takes nothing.
    pub(crate) const NONE: Self = Self { call: None, user_data: std::ptr::null_mut() };

    pub(crate) fn new(call: svbrdf_log_callback, user_data: *mut c_void) -> Self {
        Self { call, user_data }
    }

    fn write(self, level: svbrdf_log_level, line: &CString) {
        if let Some(call) = self.call {
            // SAFETY: the caller's function with the arguments that the header says.
            unsafe { call(self.user_data, level, line.as_ptr()) };
        }
    }
}

/// The receiver of the lines of the whole library.
static LIBRARY: RwLock<Sink> = RwLock::new(Sink::NONE);

/// Has the lines of the whole library go elsewhere.
pub(crate) fn set_library_sink(sink: Sink) {
    *LIBRARY.write().unwrap_or_else(PoisonError::into_inner) = sink;
}

/// Writes a line that belongs to no session.
pub(crate) fn write(level: svbrdf_log_level, text: impl FnOnce() -> String) {
    write_to(Sink::NONE, level, text);
}

/// Writes a line to a session's log and the library's.
pub(crate) fn write_to(session: Sink, level: svbrdf_log_level, text: impl FnOnce() -> String) {
    // Copied: no lock is held while a callback runs.
    let library = *LIBRARY.read().unwrap_or_else(PoisonError::into_inner);
    if session.call.is_some() || library.call.is_some() {
        let line = CString::new(text().replace('\0', " ")).unwrap_or_default();
        session.write(level, &line);
        library.write(level, &line);
    }
}
