//! Settings of the library as a whole.

use std::ffi::c_void;

use crate::events;
use crate::log::{self, Sink, svbrdf_log_callback};
use crate::status::{entry, svbrdf_status};
use crate::threads::{self, svbrdf_thread_hook};

/// From now on, every thread that the library starts calls `hook` first, for example to set its
/// priority or quality of service; NULL ends that. Set it before the first session: sessions start
/// most of their threads in svbrdf_session_create(), and running threads do not call it. Exports,
/// renderings and reduced maps share threads that the first hook starts, or otherwise the first such
/// call. The hook should not call the library.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_set_thread_hook(
    hook: svbrdf_thread_hook,
    user_data: *mut c_void,
) -> svbrdf_status {
    entry(|| {
        threads::set_hook(hook, user_data);
        Ok(())
    })
}

/// From now on, `callback` is called with the log lines of all sessions, in addition to their on_log,
/// and with internal errors that belong to no session; NULL ends that. Lines come on many threads,
/// several at a time, among them those of a fit: `callback` must not call functions that wait for a fit, such as
/// svbrdf_session_wait() and svbrdf_session_destroy(). Lines that are being written during a change may still go to
/// the former callback.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_set_log_callback(
    callback: svbrdf_log_callback,
    user_data: *mut c_void,
) -> svbrdf_status {
    entry(|| {
        log::set_library_sink(Sink::new(callback, user_data));
        events::library_sink_changed();
        Ok(())
    })
}
