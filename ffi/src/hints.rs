//! Hints about the accepted photos.

use std::ffi::{CString, c_char, c_void};

use engine::session::Hint;

use crate::handles::svbrdf_session;
use crate::live::act;
use crate::status::{Fault, svbrdf_status};

/// Called with a hint about an accepted photo: the photo's number among the accepted ones, from 0, the
/// hint's name for programs, such as "two_groups", and its sentence for people (UTF-8). Both texts are valid
/// during the call.
pub type svbrdf_hint_callback = Option<
    unsafe extern "C" fn(
        user_data: *mut c_void,
        index: u32,
        code: *const c_char,
        text: *const c_char,
    ),
>;

/// Calls `callback` with each hint about each accepted photo from all present knowledge, on the calling thread and
/// before it returns. Hints given when a photo was added (svbrdf_photo_report.hints) may no longer hold, and others
/// may. Meaningful once the fit has settled. Waits for a step of the fit.
///
/// # Safety
/// `callback` is called with `user_data`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_hints(
    session: *const svbrdf_session,
    callback: svbrdf_hint_callback,
    user_data: *mut c_void,
) -> svbrdf_status {
    let text = |text: &str| CString::new(text.replace('\0', " ")).unwrap_or_default();
    let mut all = Vec::new();
    let status = act(session, |live| {
        if callback.is_none() {
            return Err(Fault::argument("callback: NULL given"));
        }
        for (index, hints) in (0..).zip(live.session.hints()?) {
            let texts = |hint: &Hint| (index, text(hint.code()), text(&hint.to_string()));
            all.extend(hints.iter().map(texts));
        }
        Ok(())
    });
    // Outside of the session, so that the callback may call every function.
    if let Some(call) = callback {
        for (index, code, text) in &all {
            // SAFETY: the caller's function with the arguments that the header says.
            unsafe { call(user_data, *index, code.as_ptr(), text.as_ptr()) };
        }
    }
    status
}
