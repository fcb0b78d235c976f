//! Capture folders: photos in files with their description.

use std::ffi::c_char;
use std::sync::Arc;

use engine::capture::Capture;
use engine::session::{Session, Settings};

use crate::handles::{Handles, svbrdf_session};
use crate::live::act;
use crate::log::{self, SVBRDF_LOG_WARNING};
use crate::maps::folder;
use crate::models;
use crate::options::svbrdf_session_options;
use crate::reports::svbrdf_frame_report;
use crate::session::{open, tell};
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned;

/// A folder with capture.json and photos (PNG, JPEG, TIFF, OpenEXR).
pub struct svbrdf_capture {
    _opaque: (),
}

static CAPTURES: Handles<Capture> = Handles::new("capture");

/// Reads capture.json of a folder (UTF-8) and checks every field; photos are read when pushed.
/// SVBRDF_INVALID_ARGUMENT names the field at fault. Free with svbrdf_capture_destroy().
///
/// # Safety
/// `path` is NULL or a C string; `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_capture_open(
    path: *const c_char,
    out: *mut *mut svbrdf_capture,
) -> svbrdf_status {
    entry(|| {
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        // SAFETY: the caller vouches for the string.
        let capture = Capture::load(unsafe { folder(path) }?)?;
        for warning in &capture.warnings {
            log::write(SVBRDF_LOG_WARNING, || warning.clone());
        }
        let handle = Handles::<Capture>::reserve();
        CAPTURES.insert(handle, Arc::new(capture));
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(std::ptr::without_provenance_mut(handle)) };
        Ok(())
    })
}

/// How many photos a capture has.
///
/// # Safety
/// `count` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_capture_frames(
    capture: *const svbrdf_capture,
    count: *mut u32,
) -> svbrdf_status {
    entry(|| {
        let capture = CAPTURES.get(capture.addr())?;
        if count.is_null() {
            return Err(Fault::argument("count: NULL given"));
        }
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { count.write(capture.frames.len() as u32) };
        Ok(())
    })
}

/// Starts a session as svbrdf_session_create() with scene, sample, board, camera, flash and
/// falloff of a capture instead of those of the options.
///
/// # Safety
/// As svbrdf_session_create().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_create_for_capture(
    options: *const svbrdf_session_options,
    capture: *const svbrdf_capture,
    session: *mut *mut svbrdf_session,
) -> svbrdf_status {
    // SAFETY: the caller vouches for options and result.
    unsafe {
        open(options, session, |options| {
            let capture = CAPTURES.get(capture.addr())?;
            let settings = Settings { sample_mm: capture.sample_mm, ..options.settings()? };
            let networks = models::networks(options.models)?;
            Ok(Session::with_networks(capture.scene.clone(), settings, networks)?)
        })
    }
}

/// Reads a capture's photo and takes it in, as svbrdf_session_push_frame() or
/// svbrdf_session_push_rectified(); the report's timestamp is the index. `report` may be NULL.
///
/// # Safety
/// `report` is NULL or initialised by svbrdf_frame_report_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_push_capture(
    session: *mut svbrdf_session,
    capture: *const svbrdf_capture,
    index: u32,
    report: *mut svbrdf_frame_report,
) -> svbrdf_status {
    act(session, |live| {
        let capture = CAPTURES.get(capture.addr())?;
        // SAFETY: the caller vouches for the report.
        let size = unsafe { versioned::result_size(report) }?;
        let frame = capture.frames.get(index as usize).ok_or_else(|| {
            Fault::argument(format!(
                "index: {index} given, but the capture has {} frames",
                capture.frames.len()
            ))
        })?;
        let photo = frame.read()?;
        let pushed = match frame.rectified {
            Some(view) => live.session.push_rectified(&photo, view.camera_mm, view.light_mm)?,
            None => live.session.push(&photo)?,
        };
        // SAFETY: `size` bytes are there.
        unsafe { tell(live, &pushed, index.into(), report, size) }
    })
}

/// Frees a capture; NULL is fine. Sessions do not need it.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_capture_destroy(capture: *mut svbrdf_capture) -> svbrdf_status {
    entry(|| {
        if !capture.is_null() {
            CAPTURES.remove(capture.addr())?;
        }
        Ok(())
    })
}
