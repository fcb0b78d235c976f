//! Photos into a session, without waiting.

use std::ffi::c_void;
use std::sync::atomic::Ordering;

use engine::{Error, Rejection};

use super::photos::logged;
use crate::handles::svbrdf_session;
use crate::image::svbrdf_image;
use crate::live::{SESSIONS, look};
use crate::options::{SVBRDF_FLASH_OFF, svbrdf_photo_info};
use crate::owned_photo::OwnedPhoto;
use crate::reports::svbrdf_photo_report;
use crate::status::{Fault, svbrdf_status};
use crate::versioned;

/// Called with the outcome of a photo of svbrdf_session_add_photo_async(): the status and report that
/// svbrdf_session_add_photo() would have given. If the status is neither SVBRDF_OK nor
/// SVBRDF_REJECTED, the report contains only the timestamp. The report is valid during the call, and
/// svbrdf_last_error_message() until the next call of the library. See "Threads" at the top.
pub type svbrdf_photo_callback = Option<
    unsafe extern "C" fn(
        user_data: *mut c_void,
        session: *mut svbrdf_session,
        status: svbrdf_status,
        report: *const svbrdf_photo_report,
    ),
>;

/// The caller's function.
struct Callback {
    call: unsafe extern "C" fn(
        *mut c_void,
        *mut svbrdf_session,
        svbrdf_status,
        *const svbrdf_photo_report,
    ),
    user_data: *mut c_void,
}

// SAFETY: the header tells callers that the callback comes on another thread; the pointer is only
// handed back to them.
unsafe impl Send for Callback {}

impl Callback {
    fn call(
        &self,
        session: *mut svbrdf_session,
        status: svbrdf_status,
        report: &svbrdf_photo_report,
    ) {
        // SAFETY: the caller's function with the arguments that the header says; the report lives
        // during the call.
        unsafe { (self.call)(self.user_data, session, status, report) };
    }
}

/// As svbrdf_session_add_photo(), on a thread of the session: returns once the planes are copied, so
/// that their memory is free again. Photos are taken in one after the other, in the order of the
/// calls. When this returns SVBRDF_OK, `callback` is called exactly once: with SVBRDF_CANCELLED if the
/// session is cancelled or destroyed first, with SVBRDF_INVALID_ARGUMENT if the planes do not match
/// their description. Otherwise it is not called. SVBRDF_BUSY: three photos are waiting already.
/// SVBRDF_MEMORY_LIMIT: with this copy, svbrdf_session_options.memory_limit_bytes would be exceeded.
///
/// # Safety
/// As svbrdf_session_add_photo().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_add_photo_async(
    session: *mut svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_photo_info,
    callback: svbrdf_photo_callback,
    user_data: *mut c_void,
) -> svbrdf_status {
    look(session, |live| {
        let call = callback.ok_or_else(|| Fault::argument("callback: NULL given"))?;
        let callback = Callback { call, user_data };
        live.usable()?;
        if live.cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled.into());
        }
        let place = live.photos.place()?;
        // SAFETY: the caller vouches for the structs and planes.
        let (info, photo) = unsafe {
            let (image, info) = (versioned::read(image)?, svbrdf_photo_info::from_caller(info)?);
            let dark = info.flash == SVBRDF_FLASH_OFF;
            (info, if dark { None } else { Some(OwnedPhoto::copy(&live.session, &image, &info)?) })
        };
        // Kept alive until the callback has come, also after its end.
        let held = SESSIONS.get(session.addr())?;
        let timestamp_ns = info.timestamp_ns;
        live.photos.put(move || {
            let mut report = svbrdf_photo_report { timestamp_ns, ..Default::default() };
            let status = held.act(|live| {
                let outcome = match &photo {
                    Some(photo) => live.session.add_photo(&photo.photo()?)?,
                    None => live.session.reject(Rejection::LightNotVisible),
                };
                let result;
                (result, report) = logged(live, &outcome, timestamp_ns);
                result
            });
            // Before the callback, which may bring the next one.
            drop((photo, place));
            callback.call(held.handle(), status, &report);
        })
    })
}
