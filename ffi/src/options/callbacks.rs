//! What a session calls.

use std::ffi::c_void;

use crate::handles::svbrdf_session;
use crate::reports::svbrdf_progress;

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
