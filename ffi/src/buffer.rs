//! Bytes that the library hands out.

use std::ffi::c_void;
use std::sync::Arc;

use crate::handles::Handles;
use crate::status::{Fault, entry, svbrdf_status};

/// Bytes that the library made.
pub struct svbrdf_buffer {
    _opaque: (),
}

static BUFFERS: Handles<Vec<u8>> = Handles::new("buffer");

/// A handle for bytes.
pub(crate) fn hand_out(bytes: Vec<u8>) -> *mut svbrdf_buffer {
    let handle = Handles::<Vec<u8>>::reserve();
    BUFFERS.insert(handle, Arc::new(bytes));
    std::ptr::without_provenance_mut(handle)
}

/// Address and number of a buffer's bytes, valid until svbrdf_buffer_destroy().
///
/// # Safety
/// Both results are NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_buffer_view(
    buffer: *const svbrdf_buffer,
    data: *mut *const c_void,
    bytes: *mut usize,
) -> svbrdf_status {
    entry(|| {
        let buffer = BUFFERS.get(buffer.addr())?;
        if data.is_null() || bytes.is_null() {
            return Err(Fault::argument("data, bytes: NULL given"));
        }
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe {
            data.write(buffer.as_ptr().cast());
            bytes.write(buffer.len());
        }
        Ok(())
    })
}

/// Frees a buffer; NULL is fine.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_buffer_destroy(buffer: *mut svbrdf_buffer) -> svbrdf_status {
    entry(|| {
        if !buffer.is_null() {
            BUFFERS.remove(buffer.addr())?;
        }
        Ok(())
    })
}
