//! Capture folders: photos in files with their description.

use std::ffi::c_char;
use std::sync::Arc;

use engine::capture::Capture;

use crate::handles::Handles;
use crate::log::{self, SVBRDF_LOG_WARNING};
use crate::maps::folder;
use crate::status::{Fault, entry, svbrdf_status};

/// A folder with capture.json and photos (PNG, JPEG, TIFF, OpenEXR).
pub struct svbrdf_capture {
    _opaque: (),
}

pub(crate) static CAPTURES: Handles<Capture> = Handles::new("capture");

/// Reads capture.json in a folder (UTF-8) and checks every field; photos are read when they are added. The
/// message of SVBRDF_INVALID_ARGUMENT names the field at fault. Free with svbrdf_capture_destroy().
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

/// Number of photos of a capture.
///
/// # Safety
/// `count` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_capture_photos(
    capture: *const svbrdf_capture,
    count: *mut u32,
) -> svbrdf_status {
    entry(|| {
        let capture = CAPTURES.get(capture.addr())?;
        if count.is_null() {
            return Err(Fault::argument("count: NULL given"));
        }
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { count.write(capture.photos.len() as u32) };
        Ok(())
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
