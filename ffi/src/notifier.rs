//! The thread that calls back.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::{Builder, JoinHandle};

use engine::Error;
use engine::session::Revision;

use crate::live::Live;
use crate::log::SVBRDF_LOG_ERROR;
use crate::status::Fault;
use crate::threads::{self, SVBRDF_THREAD_CALLBACK};

/// Starts the thread of a session's callbacks.
pub(crate) fn start(live: &Arc<Live>) -> Result<JoinHandle<()>, Fault> {
    let live = live.clone();
    Builder::new().name("svbrdf-callback".into()).spawn(move || run(&live)).map_err(|e| {
        Error::Internal(format!("cannot start the thread of the callbacks: {e}")).into()
    })
}

fn run(live: &Live) {
    threads::started(SVBRDF_THREAD_CALLBACK);
    let mut seen = Revision::default();
    loop {
        let changed = live.session.wait_for_change(seen);
        if live.destroyed.load(Ordering::Acquire) {
            return;
        }
        live.callbacks.log_now();
        let now = live.session.revision();
        if now.maps != seen.maps {
            live.callbacks.maps(live.handle());
        }
        if !live.destroyed.load(Ordering::Acquire) {
            live.callbacks.progress(live.handle(), || live.progress());
        }
        if let Err(fault) = changed {
            if !matches!(fault, Error::Cancelled) {
                live.callbacks.log(SVBRDF_LOG_ERROR, || fault.to_string());
            }
            return;
        }
        seen = now;
    }
}
