//! Pausing, cancelling and ending a session.

use std::sync::PoisonError;
use std::sync::atomic::Ordering;
use std::thread;

use crate::handles::svbrdf_session;
use crate::live::{SESSIONS, act};
use crate::status::{entry, svbrdf_status};

/// Announces the number of photos still to come: from then on svbrdf_progress.fraction is that of the
/// work on all of them together, and never falls before they have come. Each photo added takes one of them
/// away, whether it is accepted or rejected; a call that returns another status does not. If fewer
/// or more come after all, say so by another call. Without it, where nobody knows how many there will be,
/// the fraction is that of each photo.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_announce(
    session: *mut svbrdf_session,
    photos: u32,
) -> svbrdf_status {
    act(session, |live| {
        live.session.announce(photos as usize);
        Ok(())
    })
}

/// Pauses the fit after the step in progress; photos are still taken in.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_pause(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.paused.store(true, Ordering::Relaxed);
        live.session.pause();
        Ok(())
    })
}

/// Continues after svbrdf_session_pause().
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_resume(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.paused.store(false, Ordering::Relaxed);
        live.session.resume();
        Ok(())
    })
}

/// Ends the fit after the step in progress. Photos are refused afterwards; the maps stay available.
/// Waiting calls return SVBRDF_CANCELLED.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_cancel(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.cancelled.store(true, Ordering::Relaxed);
        live.session.cancel();
        Ok(())
    })
}

/// Ends a session at any time, from any thread, also from its callbacks and while other threads are
/// inside its calls: those return SVBRDF_CANCELLED or their result. Waits at most for the step in
/// progress, and for callbacks on other threads, including those of waiting photos and of log lines.
/// When it has returned, no callback of the session is running or will come. There are two
/// exceptions: the callbacks that it was called from, and, if one of those was that of a photo, those
/// of the photos that are still waiting. Later calls with the handle return SVBRDF_INVALID_HANDLE. NULL
/// is fine.
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
        for thread in [live.photos.close(), notifier].into_iter().flatten() {
            if thread.thread().id() != thread::current().id() {
                // It catches nothing because nothing of ours panics there; a panic would end there.
                let _ = thread.join();
            }
        }
        live.callbacks.logging.close();
        Ok(())
    })
}
