//! What a session calls.

use std::ffi::{c_char, c_void};

use crate::handles::svbrdf_session;
use crate::reports::svbrdf_progress;

/// How much a log line matters.
pub type svbrdf_log_level = u32;
/// A fault.
pub const SVBRDF_LOG_ERROR: svbrdf_log_level = 1;
/// A photo was rejected, or there is a hint about it.
pub const SVBRDF_LOG_WARNING: svbrdf_log_level = 2;
/// What happens.
pub const SVBRDF_LOG_INFO: svbrdf_log_level = 3;

/// Called with the state of the fit whenever it has changed; changes that come faster than the
/// callback returns are left out. See "Threads" at the top.
pub type svbrdf_progress_callback = Option<
    unsafe extern "C" fn(
        user_data: *mut c_void,
        session: *mut svbrdf_session,
        progress: *const svbrdf_progress,
    ),
>;

/// Called when newer maps can be taken with svbrdf_session_snapshot_maps(), at once for the first
/// photo, then a few times a second during a fit. See "Threads" at the top.
pub type svbrdf_maps_callback =
    Option<unsafe extern "C" fn(user_data: *mut c_void, session: *mut svbrdf_session)>;

/// Called with a line of text (UTF-8, without a line end, valid during the call) on the thread it
/// happens on: one inside a call of the session, or the session's callback thread.
pub type svbrdf_log_callback = Option<
    unsafe extern "C" fn(user_data: *mut c_void, level: svbrdf_log_level, message: *const c_char),
>;
