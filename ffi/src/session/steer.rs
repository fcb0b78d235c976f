//! Pausing, cancelling and ending a session.

use std::sync::PoisonError;
use std::sync::atomic::Ordering;
use std::thread;

use crate::handles::svbrdf_session;
use crate::live::{SESSIONS, act};
use crate::status::{entry, svbrdf_status};

/// Holds the fit after the step in progress; photos are still taken in.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_pause(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.paused.store(true, Ordering::Relaxed);
        live.session.pause();
        Ok(())
    })
}

/// Goes on after svbrdf_session_pause().
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_resume(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.paused.store(false, Ordering::Relaxed);
        live.session.resume();
        Ok(())
    })
}

/// Ends the fit after the step in progress. Photos are refused from then on; maps stay available.
/// Calls that wait return SVBRDF_CANCELLED.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_cancel(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.cancelled.store(true, Ordering::Relaxed);
        live.session.cancel();
        Ok(())
    })
}

/// Ends a session at any time, from any thread, also from its callbacks and while other threads
/// are inside its calls: those return SVBRDF_CANCELLED or their result. Blocks for the step in
/// progress at most, and for callbacks on other threads, those of photos on their way included. When
/// it has returned, no callback of the session is running or will come, but the one it was called
/// from, and those of photos on their way where that was one of them. The handle
/// is never valid again; further calls with it answer SVBRDF_INVALID_HANDLE. NULL is fine.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_destroy(session: *mut svbrdf_session) -> svbrdf_status {
    entry(|| {
        if session.is_null() {
            return Ok(());
        }
        let live = SESSIONS.remove(session.addr())?;
        live.destroyed.store(true, Ordering::Release);
        live.cancelled.store(true, Ordering::Relaxed);
        live.session.cancel();
        let notifier = live.notifier.lock().unwrap_or_else(PoisonError::into_inner).take();
        for thread in [live.pushes.close(), notifier].into_iter().flatten() {
            if thread.thread().id() != thread::current().id() {
                // It catches nothing because nothing of ours panics there; a panic would end there.
                let _ = thread.join();
            }
        }
        live.callbacks.logging.close();
        Ok(())
    })
}
