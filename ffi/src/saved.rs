//! Saving and restoring sessions.

use std::ffi::{c_char, c_void};
use std::path::Path;

use engine::Error;
use engine::export::write_atomic;
use engine::session::Session;

use crate::buffer::{self, svbrdf_buffer};
use crate::handles::svbrdf_session;
use crate::live::act;
use crate::maps::folder;
use crate::models;
use crate::options::svbrdf_session_options;
use crate::session::open;
use crate::status::{Fault, svbrdf_status};

/// The session as bytes: board, camera, settings, budget, measurements in the photos, rectified photos, and maps.
/// svbrdf_session_load_state() continues from them, also in another process or on another machine. It repeats
/// a fit in progress, whose maps then differ by far less than their stated
/// deviations. The session itself continues unchanged. Waits for a photo that is being added and for one step of
/// the fit. A cancelled session cannot be saved: pause it instead. Free with svbrdf_buffer_destroy().
///
/// # Safety
/// `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_save_state(
    session: *const svbrdf_session,
    out: *mut *mut svbrdf_buffer,
) -> svbrdf_status {
    act(session, |live| {
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        let state = buffer::hand_out(live.session.save()?);
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(state) };
        Ok(())
    })
}

/// As svbrdf_session_save_state(), into a file (UTF-8) in an existing folder. An older file is replaced
/// once everything is written, and stays if that fails.
///
/// # Safety
/// `path` is NULL or a C string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_save_state_to(
    session: *const svbrdf_session,
    path: *const c_char,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for the string.
        let path = unsafe { folder(path) }?;
        Ok(write_atomic(path, &live.session.save()?)?)
    })
}

/// Continues a saved session. Only these options count: threads (0: as saved), models, callbacks,
/// user_data and memory_limit_bytes; the rest is in the state. The bytes are not needed after the
/// call. SVBRDF_BAD_STATE if they are damaged, SVBRDF_UNSUPPORTED if a newer
/// version of the library wrote them in another format.
///
/// # Safety
/// As svbrdf_session_create(); `data` is NULL or has as many readable bytes as said.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_load_state(
    options: *const svbrdf_session_options,
    data: *const c_void,
    bytes: usize,
    session: *mut *mut svbrdf_session,
) -> svbrdf_status {
    // SAFETY: the caller vouches for options, bytes and result.
    unsafe {
        open(options, session, |options| {
            restore(options, crate::image::bytes("data", data, bytes)?)
        })
    }
}

/// As svbrdf_session_load_state(), from a file (UTF-8).
///
/// # Safety
/// As svbrdf_session_create(); `path` is NULL or a C string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_load_state_from(
    options: *const svbrdf_session_options,
    path: *const c_char,
    session: *mut *mut svbrdf_session,
) -> svbrdf_status {
    // SAFETY: the caller vouches for options, path and result.
    unsafe {
        open(options, session, |options| {
            let path: &Path = folder(path)?;
            let state = std::fs::read(path).map_err(|e| Error::io(path, e))?;
            restore(options, &state)
        })
    }
}

fn restore(options: &svbrdf_session_options, state: &[u8]) -> Result<Session, Fault> {
    let networks = models::networks(options.models)?;
    Ok(Session::restore(state, networks, options.for_restoring()?)?)
}
