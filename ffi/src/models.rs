//! The networks, shared between sessions.

use std::ffi::{c_char, c_void};
use std::sync::Arc;
#[cfg(feature = "embedded-models")]
use std::sync::{Mutex, PoisonError, Weak};

use engine::networks::Networks;

use crate::handles::Handles;
use crate::maps::folder;
use crate::status::{Fault, entry, svbrdf_status};

/// Networks that any number of sessions may share. They may be destroyed while sessions use them.
pub struct svbrdf_models {
    _opaque: (),
}

static MODELS: Handles<Networks> = Handles::new("models");

/// The networks of a handle; the embedded ones for NULL.
pub(crate) fn networks(models: *const svbrdf_models) -> Result<Arc<Networks>, Fault> {
    if models.is_null() { embedded() } else { MODELS.get(models.addr()) }
}

/// Parsed once for all sessions that live at the same time.
#[cfg(feature = "embedded-models")]
fn embedded() -> Result<Arc<Networks>, Fault> {
    static SHARED: Mutex<Weak<Networks>> = Mutex::new(Weak::new());
    let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(networks) = shared.upgrade() {
        return Ok(networks);
    }
    let networks = Arc::new(Networks::embedded()?);
    *shared = Arc::downgrade(&networks);
    Ok(networks)
}

#[cfg(not(feature = "embedded-models"))]
fn embedded() -> Result<Arc<Networks>, Fault> {
    let message = "models: this library was built without them; set svbrdf_session_options.models";
    Err(Fault::new(crate::status::SVBRDF_UNSUPPORTED, message))
}

/// # Safety
/// `out` is NULL or writable.
unsafe fn hand_out(
    out: *mut *mut svbrdf_models,
    networks: impl FnOnce() -> Result<Networks, Fault>,
) -> svbrdf_status {
    entry(|| {
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        let handle = Handles::<Networks>::reserve();
        MODELS.insert(handle, Arc::new(networks()?));
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(std::ptr::without_provenance_mut(handle)) };
        Ok(())
    })
}

/// Reads models from the contents of decoder.bin, encoder.onnx, photo.onnx and completion.onnx. The
/// bytes are not needed after the call. Free with svbrdf_models_destroy().
///
/// # Safety
/// Each pointer is NULL or has as many readable bytes as said; `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_models_from_memory(
    decoder: *const c_void,
    decoder_bytes: usize,
    encoder: *const c_void,
    encoder_bytes: usize,
    photo: *const c_void,
    photo_bytes: usize,
    completion: *const c_void,
    completion_bytes: usize,
    out: *mut *mut svbrdf_models,
) -> svbrdf_status {
    let read = || {
        // SAFETY: the caller vouches for each pointer and size.
        let (decoder, encoder, photo, completion) = unsafe {
            (
                crate::image::bytes("decoder", decoder, decoder_bytes)?,
                crate::image::bytes("encoder", encoder, encoder_bytes)?,
                crate::image::bytes("photo", photo, photo_bytes)?,
                crate::image::bytes("completion", completion, completion_bytes)?,
            )
        };
        Ok(Networks::from_bytes(decoder, encoder, photo, completion)?)
    };
    // SAFETY: the caller vouches for `out`.
    unsafe { hand_out(out, read) }
}

/// Reads models from decoder.bin, encoder.onnx, photo.onnx and completion.onnx of a folder (UTF-8).
/// Free with svbrdf_models_destroy().
///
/// # Safety
/// `path` is NULL or a C string; `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_models_from_folder(
    path: *const c_char,
    out: *mut *mut svbrdf_models,
) -> svbrdf_status {
    // SAFETY: the caller vouches for both pointers.
    unsafe { hand_out(out, || Ok(Networks::from_folder(folder(path)?)?)) }
}

/// Frees models; NULL is fine.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_models_destroy(models: *mut svbrdf_models) -> svbrdf_status {
    entry(|| {
        if !models.is_null() {
            MODELS.remove(models.addr())?;
        }
        Ok(())
    })
}
