//! Sessions behind handles, and the barrier that makes a session fail when a call in it panics.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread::JoinHandle;

use engine::guide::Guide;
use engine::session::Session;

use crate::callbacks::Callbacks;
use crate::events::Events;
use crate::handles::{Handles, svbrdf_session};
use crate::log::SVBRDF_LOG_ERROR;
use crate::queue::Queue;
use crate::reports::{
    SVBRDF_STATE_CANCELLED, SVBRDF_STATE_FAILED, SVBRDF_STATE_FITTING, SVBRDF_STATE_PAUSED,
    SVBRDF_STATE_READY, svbrdf_progress,
};
use crate::status::{Fault, SVBRDF_FAILED, entry, panic_text, svbrdf_status};

/// A session behind a handle. Lives until destroyed and the last call inside it has returned.
pub(crate) struct Live {
    pub(crate) session: Session,
    pub(crate) callbacks: Arc<Callbacks>,
    /// Events of its calls.
    events: Events,
    /// No callback starts after this.
    pub(crate) destroyed: AtomicBool,
    handle: usize,
    pub(crate) sample_mm: [f32; 2],
    pub(crate) paused: AtomicBool,
    pub(crate) cancelled: AtomicBool,
    /// The message of a panic inside one of the calls.
    failed: OnceLock<String>,
    /// The thread that calls back, if there is one.
    pub(crate) notifier: Mutex<Option<JoinHandle<()>>>,
    /// Photos that are added on a thread of their own.
    pub(crate) photos: Queue,
    /// Guides the hand that holds the camera.
    pub(crate) guide: Mutex<Guide>,
}

pub(crate) static SESSIONS: Handles<Live> = Handles::new("session");

impl Live {
    /// A session under a handle of its own.
    pub(crate) fn new(session: Session, callbacks: Arc<Callbacks>) -> Self {
        let sample_mm = session.settings().sample_mm;
        Self {
            session,
            events: Events::of_calls(&callbacks),
            callbacks,
            destroyed: AtomicBool::new(false),
            handle: Handles::<Self>::reserve(),
            sample_mm,
            paused: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
            failed: OnceLock::new(),
            notifier: Mutex::new(None),
            photos: Queue::default(),
            guide: Mutex::default(),
        }
    }

    pub(crate) fn handle(&self) -> *mut svbrdf_session {
        std::ptr::without_provenance_mut(self.handle)
    }

    pub(crate) fn progress(&self) -> svbrdf_progress {
        let progress = self.session.progress();
        let state = if self.failed.get().is_some() || self.session.failure().is_some() {
            SVBRDF_STATE_FAILED
        } else if self.cancelled.load(Ordering::Relaxed) {
            SVBRDF_STATE_CANCELLED
        } else if progress.settled {
            SVBRDF_STATE_READY
        } else if self.paused.load(Ordering::Relaxed) {
            SVBRDF_STATE_PAUSED
        } else {
            SVBRDF_STATE_FITTING
        };
        svbrdf_progress::new(&progress, state, self.session.revision().maps)
    }

    /// Runs a call; a panic makes the session fail for ever.
    fn guarded(&self, body: impl FnOnce() -> Result<(), Fault>) -> Result<(), Fault> {
        catch_unwind(AssertUnwindSafe(|| self.events.inside(body))).unwrap_or_else(|panic| {
            let message = self.failed.get_or_init(|| panic_text(&*panic)).clone();
            self.session.cancel();
            self.callbacks.log(SVBRDF_LOG_ERROR, || message.clone());
            Err(Fault::new(SVBRDF_FAILED, message))
        })
    }

    /// Refuses calls after a panic.
    pub(crate) fn usable(&self) -> Result<(), Fault> {
        match self.failed.get() {
            Some(message) => Err(Fault::new(SVBRDF_FAILED, message.clone())),
            None => Ok(()),
        }
    }

    /// A call inside a session that is held already; a failed one refuses it.
    pub(crate) fn act(&self, body: impl FnOnce(&Self) -> Result<(), Fault>) -> svbrdf_status {
        entry(|| {
            self.guarded(|| {
                self.usable()?;
                body(self)
            })
        })
    }
}

/// A call that a failed session still answers.
pub(crate) fn look(
    session: *const svbrdf_session,
    body: impl FnOnce(&Live) -> Result<(), Fault>,
) -> svbrdf_status {
    entry(|| {
        let live = SESSIONS.get(session.addr())?;
        live.guarded(|| body(&live))
    })
}

/// A call that a failed session refuses.
pub(crate) fn act(
    session: *const svbrdf_session,
    body: impl FnOnce(&Live) -> Result<(), Fault>,
) -> svbrdf_status {
    look(session, |live| {
        live.usable()?;
        body(live)
    })
}
