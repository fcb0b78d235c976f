//! Starting a session.

use std::sync::{Arc, PoisonError};

use engine::session::{Session, Settings};

use crate::callbacks::Callbacks;
use crate::capture::CAPTURES;
use crate::events::Events;
use crate::handles::svbrdf_session;
use crate::live::{Live, SESSIONS};
use crate::log::SVBRDF_LOG_INFO;
use crate::models;
use crate::notifier;
use crate::options::svbrdf_session_options;
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned;

/// Starts a session. Free it with svbrdf_session_destroy().
///
/// # Safety
/// `options` is NULL or initialised by svbrdf_session_options_init(), with pointers as the
/// header requires; `session` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_create(
    options: *const svbrdf_session_options,
    session: *mut *mut svbrdf_session,
) -> svbrdf_status {
    // SAFETY: the caller vouches for the options, their pointers, and the result.
    unsafe {
        open(options, session, |options| {
            let (scene, settings) = if options.capture.is_null() {
                (options.scene()?, options.settings()?)
            } else {
                let capture = CAPTURES.get(options.capture.addr())?;
                let settings = Settings { sample_mm: capture.sample_mm, ..options.settings()? };
                (capture.scene.clone(), settings)
            };
            let networks = models::networks(options.models)?;
            Ok(Session::with_networks(scene, settings, networks)?)
        })
    }
}

/// Makes a session with the callbacks of options and hands it out.
///
/// # Safety
/// As svbrdf_session_create().
pub(crate) unsafe fn open(
    options: *const svbrdf_session_options,
    session: *mut *mut svbrdf_session,
    make: impl FnOnce(&svbrdf_session_options) -> Result<Session, Fault>,
) -> svbrdf_status {
    entry(|| {
        if session.is_null() {
            return Err(Fault::argument("session: NULL given"));
        }
        // SAFETY: the caller vouches for the options.
        let options = unsafe { versioned::read(options) }?;
        let callbacks = Arc::new(Callbacks::new(&options));
        let made = Events::of_fit(&callbacks).inside(|| make(&options))?;
        let live = Arc::new(Live::new(made, callbacks));
        live.callbacks.log(SVBRDF_LOG_INFO, || {
            format!("session of {0} x {0} texels started", live.session.settings().resolution)
        });
        // Known before the first callback, which may use it.
        SESSIONS.insert(live.handle().addr(), live.clone());
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { session.write(live.handle()) };
        if live.callbacks.notifies() {
            let thread = notifier::start(&live).inspect_err(|_| {
                let _ = SESSIONS.remove(live.handle().addr());
                // SAFETY: as above.
                unsafe { session.write(std::ptr::null_mut()) };
            })?;
            *live.notifier.lock().unwrap_or_else(PoisonError::into_inner) = Some(thread);
        }
        Ok(())
    })
}
