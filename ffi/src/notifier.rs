//! The thread that calls back.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::{Builder, JoinHandle};

use engine::Error;
use engine::session::Revision;

use crate::live::Live;
use crate::options::SVBRDF_LOG_ERROR;
use crate::status::Fault;

/// Starts the thread of a session's callbacks.
pub(crate) fn start(live: &Arc<Live>) -> Result<JoinHandle<()>, Fault> {
    let live = live.clone();
    Builder::new().name("svbrdf-callback".into()).spawn(move || run(&live)).map_err(|e| {
        Error::Internal(format!("cannot start the thread of the callbacks: {e}")).into()
    })
}

fn run(live: &Live) {
    let mut seen = Revision::default();
    loop {
        let changed = live.session.wait_for_change(seen);
        if live.destroyed.load(Ordering::Acquire) {
            return;
        }
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
