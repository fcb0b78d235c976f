//! Types of a session's callbacks.

use std::ffi::c_void;

use crate::handles::svbrdf_session;
use crate::reports::svbrdf_progress;

/// Called with the state of the fit whenever it has changed. Changes during a call are combined. See
/// "Threads" at the top.
pub type svbrdf_progress_callback = Option<
    unsafe extern "C" fn(
        user_data: *mut c_void,
        session: *mut svbrdf_session,
        progress: *const svbrdf_progress,
    ),
>;

/// Called when svbrdf_session_snapshot_maps() has newer maps: at once for the first photo, then a few
/// times a second during a fit. See "Threads" at the top.
pub type svbrdf_maps_callback =
    Option<unsafe extern "C" fn(user_data: *mut c_void, session: *mut svbrdf_session)>;
