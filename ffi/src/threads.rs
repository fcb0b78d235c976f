//! The library's threads.

use std::ffi::c_void;
use std::sync::{Arc, PoisonError, RwLock};

use engine::threads::{Role, set_start_hook};

/// Role of a thread of the library. Values may be added.
pub type svbrdf_thread = u32;
/// Shares the work of fits and calls among the cores.
pub const SVBRDF_THREAD_WORK: svbrdf_thread = 1;
/// Steers the fit of a session.
pub const SVBRDF_THREAD_FIT: svbrdf_thread = 2;
/// Calls on_progress and on_maps of a session.
pub const SVBRDF_THREAD_CALLBACK: svbrdf_thread = 3;
/// Takes in the photos of svbrdf_session_add_photo_async(), and calls back.
pub const SVBRDF_THREAD_PHOTOS: svbrdf_thread = 4;

/// Called at the start of a thread, on it, before anything else.
pub type svbrdf_thread_hook =
    Option<unsafe extern "C" fn(user_data: *mut c_void, thread: svbrdf_thread)>;

/// A caller's function.
#[derive(Clone, Copy)]
struct Hook {
    call: unsafe extern "C" fn(user_data: *mut c_void, thread: svbrdf_thread),
    user_data: *mut c_void,
}

// SAFETY: the header tells callers that the hook comes on other threads, several at a time; the
// pointer is only handed back to them.
unsafe impl Send for Hook {}
// SAFETY: as above.
unsafe impl Sync for Hook {}

static HOOK: RwLock<Option<Hook>> = RwLock::new(None);

/// Calls the hook on a thread that has just started.
pub(crate) fn started(thread: svbrdf_thread) {
    // Copied: no lock is held while a callback runs.
    let hook = *HOOK.read().unwrap_or_else(PoisonError::into_inner);
    if let Some(hook) = hook {
        // SAFETY: the caller's function with the arguments that the header says.
        unsafe { (hook.call)(hook.user_data, thread) };
    }
}

/// Has every thread that the library starts from now on call the caller's function first.
pub(crate) fn set_hook(call: svbrdf_thread_hook, user_data: *mut c_void) {
    let hook = call.map(|call| Hook { call, user_data });
    *HOOK.write().unwrap_or_else(PoisonError::into_inner) = hook;
    set_start_hook(hook.map(|_| -> engine::threads::StartHook {
        Arc::new(|role| {
            started(match role {
                Role::Fit => SVBRDF_THREAD_FIT,
                _ => SVBRDF_THREAD_WORK,
            });
        })
    }));
}
