//! Status codes, the message of the latest fault, and the barrier against panics.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use engine::{Error, StateFault};

use crate::log::{self, SVBRDF_LOG_ERROR};

/// Result of a call: 0 for success, negative for an error, positive for neither. Values may be
/// added.
pub type svbrdf_status = i32;

/// Success.
pub const SVBRDF_OK: svbrdf_status = 0;
/// The photo cannot be used; nothing changed. The report has the reason, and
/// svbrdf_last_error_message() a sentence for the user.
pub const SVBRDF_REJECTED: svbrdf_status = 1;
/// The given time has passed.
pub const SVBRDF_TIMEOUT: svbrdf_status = 2;
/// No photo has been accepted yet, so there are no maps.
pub const SVBRDF_NO_MAPS: svbrdf_status = 3;
/// Three photos are waiting already: try again when one has been answered.
pub const SVBRDF_BUSY: svbrdf_status = 4;
/// The material does not show this lobe, so that there is no such map: see svbrdf_maps_lobes().
pub const SVBRDF_NO_LOBE: svbrdf_status = 5;
/// An argument is NULL, not a number, out of range, or too small a buffer.
pub const SVBRDF_INVALID_ARGUMENT: svbrdf_status = -1;
/// The handle was destroyed, is NULL, or is of another kind.
pub const SVBRDF_INVALID_HANDLE: svbrdf_status = -2;
/// The session was cancelled.
pub const SVBRDF_CANCELLED: svbrdf_status = -3;
/// A file cannot be read or written.
pub const SVBRDF_IO: svbrdf_status = -4;
/// The models are damaged or do not fit this version.
pub const SVBRDF_BAD_MODEL: svbrdf_status = -5;
/// A struct asks for something that this version or this build does not have.
pub const SVBRDF_UNSUPPORTED: svbrdf_status = -6;
/// The bytes are not a saved session, or a damaged or truncated one.
pub const SVBRDF_BAD_STATE: svbrdf_status = -8;
/// More memory would be needed than svbrdf_session_options.memory_limit_bytes; nothing changed.
pub const SVBRDF_MEMORY_LIMIT: svbrdf_status = -9;
/// An error inside the library. The session in which it happened returns this from then on, except for
/// maps, progress and svbrdf_session_destroy().
pub const SVBRDF_FAILED: svbrdf_status = -7;

/// The reason for which a call failed.
#[derive(Debug)]
pub(crate) struct Fault {
    pub(crate) status: svbrdf_status,
    pub(crate) message: String,
}

impl Fault {
    pub(crate) fn new(status: svbrdf_status, message: impl Into<String>) -> Self {
        Self { status, message: message.into() }
    }

    /// The same fault with the name of the argument that it concerns.
    pub(crate) fn about(self, part: &str) -> Self {
        Self { message: format!("{part}: {}", self.message), ..self }
    }

    pub(crate) fn argument(message: impl Into<String>) -> Self {
        Self::new(SVBRDF_INVALID_ARGUMENT, message)
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        let status = match &error {
            Error::Io { .. } => SVBRDF_IO,
            Error::Image { .. } | Error::Field { .. } | Error::Argument { .. } => {
                SVBRDF_INVALID_ARGUMENT
            }
            Error::Model { .. } => SVBRDF_BAD_MODEL,
            // Written in a newer format.
            Error::State(StateFault::Newer { .. }) => SVBRDF_UNSUPPORTED,
            Error::State(_) => SVBRDF_BAD_STATE,
            Error::MemoryLimit { .. } => SVBRDF_MEMORY_LIMIT,
            Error::NoMaps => SVBRDF_NO_MAPS,
            Error::Cancelled => SVBRDF_CANCELLED,
            _ => SVBRDF_FAILED,
        };
        Self::new(status, error.to_string())
    }
}

thread_local! {
    static MESSAGE: RefCell<CString> = RefCell::default();
}

fn remember(message: &str) {
    let text = CString::new(message.replace('\0', " ")).unwrap_or_default();
    // Ignored on a thread that is ending.
    let _ = MESSAGE.try_with(|slot| *slot.borrow_mut() = text);
}

/// The text of a panic.
pub(crate) fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| panic.downcast_ref::<&str>().copied());
    format!("internal fault: {}", text.unwrap_or("unknown panic"))
}

/// Runs the body of an entry: faults and panics become a status and a message.
pub(crate) fn entry(body: impl FnOnce() -> Result<(), Fault>) -> svbrdf_status {
    let fault = match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => {
            remember("");
            return SVBRDF_OK;
        }
        Ok(Err(fault)) => fault,
        Err(panic) => {
            let fault = Fault::new(SVBRDF_FAILED, panic_text(&*panic));
            log::write(SVBRDF_LOG_ERROR, || fault.message.clone());
            fault
        }
    };
    remember(&fault.message);
    fault.status
}

/// The reason for which this thread's latest call failed, in English; empty after success. UTF-8, valid until the
/// thread's next call of the library. Never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_last_error_message() -> *const c_char {
    MESSAGE.try_with(|slot| slot.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// The name of a status in lower case, e.g. "invalid_argument"; "unknown" for other numbers.
/// Static, never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_status_name(status: svbrdf_status) -> *const c_char {
    match status {
        SVBRDF_OK => c"ok",
        SVBRDF_REJECTED => c"rejected",
        SVBRDF_TIMEOUT => c"timeout",
        SVBRDF_NO_MAPS => c"no_maps",
        SVBRDF_BUSY => c"busy",
        SVBRDF_NO_LOBE => c"no_lobe",
        SVBRDF_INVALID_ARGUMENT => c"invalid_argument",
        SVBRDF_INVALID_HANDLE => c"invalid_handle",
        SVBRDF_CANCELLED => c"cancelled",
        SVBRDF_IO => c"io",
        SVBRDF_BAD_MODEL => c"bad_model",
        SVBRDF_UNSUPPORTED => c"unsupported",
        SVBRDF_BAD_STATE => c"bad_state",
        SVBRDF_MEMORY_LIMIT => c"memory_limit",
        SVBRDF_FAILED => c"failed",
        _ => c"unknown",
    }
    .as_ptr()
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    fn message() -> String {
        // SAFETY: a C string of this thread, which makes no other call meanwhile.
        unsafe { CStr::from_ptr(svbrdf_last_error_message()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn panics_and_faults_become_status_and_message() {
        assert_eq!(entry(|| panic!("deliberate {}", 7)), SVBRDF_FAILED);
        assert_eq!(message(), "internal fault: deliberate 7");
        assert_eq!(entry(|| Err(Fault::argument("a\0b"))), SVBRDF_INVALID_ARGUMENT);
        assert_eq!(message(), "a b");
        std::thread::spawn(|| assert_eq!(message(), "")).join().unwrap();
        assert_eq!(entry(|| Ok(())), SVBRDF_OK);
        assert_eq!(message(), "");
    }
}
