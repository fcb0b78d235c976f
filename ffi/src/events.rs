//! Events of the engine as log lines.

use std::fmt::{Debug, Write};
use std::sync::{Arc, Once};

use tracing::dispatcher::{self, Dispatch};
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};

use crate::callbacks::Callbacks;
use crate::log::{self, SVBRDF_LOG_DEBUG, SVBRDF_LOG_ERROR, SVBRDF_LOG_INFO, SVBRDF_LOG_WARNING};

/// Target of events about photos: they have lines already, with the caller's timestamps.
const PHOTO: &str = "svbrdf::photo";

/// The receiver of log lines.
enum Receiver {
    /// The callback of the library.
    Library,
    /// A session and the library, on the thread of the event, which is inside a call.
    Call(Arc<Callbacks>),
    /// The same, on the session's callback thread: the fit must not wait for a callback that waits for it.
    Fit(Arc<Callbacks>),
}

/// Turns events into log lines.
struct Lines(Receiver);

impl Lines {
    fn is_heard(&self) -> bool {
        !matches!(self.0, Receiver::Library) || log::has_library_sink()
    }
}

impl Subscriber for Lines {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        let target = metadata.target();
        metadata.is_event()
            && *metadata.level() <= Level::DEBUG
            && target.starts_with("svbrdf")
            && target != PHOTO
            && self.is_heard()
    }

    fn max_level_hint(&self) -> Option<LevelFilter> {
        Some(if self.is_heard() { LevelFilter::DEBUG } else { LevelFilter::OFF })
    }

    fn event(&self, event: &Event<'_>) {
        let level = match *event.metadata().level() {
            Level::ERROR => SVBRDF_LOG_ERROR,
            Level::WARN => SVBRDF_LOG_WARNING,
            Level::INFO => SVBRDF_LOG_INFO,
            _ => SVBRDF_LOG_DEBUG,
        };
        match &self.0 {
            Receiver::Library => log::write(level, || text(event)),
            Receiver::Call(callbacks) => callbacks.log(level, || text(event)),
            Receiver::Fit(callbacks) => callbacks.log_later(level, text(event)),
        }
    }

    // Spans are never enabled.
    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }
    fn record(&self, _: &Id, _: &Record<'_>) {}
    fn record_follows_from(&self, _: &Id, _: &Id) {}
    fn enter(&self, _: &Id) {}
    fn exit(&self, _: &Id) {}
}

/// A message and its fields: `phase ended: phase=joint steps=12`.
#[derive(Default)]
struct Text {
    message: String,
    fields: String,
}

impl Visit for Text {
    fn record_f64(&mut self, field: &Field, value: f64) {
        self.record_debug(field, &format_args!("{value:.4}"));
    }

    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        // Writing to a string cannot fail.
        let _ = match field.name() {
            "message" => write!(self.message, "{value:?}"),
            name => write!(self.fields, " {name}={value:?}"),
        };
    }
}

fn text(event: &Event<'_>) -> String {
    let mut text = Text::default();
    event.record(&mut text);
    let Text { message, fields } = text;
    if fields.is_empty() { message } else { format!("{message}:{fields}") }
}

/// Sends events that belong to no session with a log to the library's callback, which has just changed.
pub(crate) fn library_sink_changed() {
    static FIRST: Once = Once::new();
    if log::has_library_sink() {
        FIRST.call_once(|| {
            // Fails if there is one: this library has no other.
            let _ = dispatcher::set_global_default(Dispatch::new(Lines(Receiver::Library)));
        });
    }
    if FIRST.is_completed() {
        tracing::callsite::rebuild_interest_cache();
    }
}

/// The way of a session's events to its log; `None` where it has none.
#[derive(Clone)]
pub(crate) struct Events(Option<Dispatch>);

impl Events {
    /// Events of calls of the session.
    pub(crate) fn of_calls(callbacks: &Arc<Callbacks>) -> Self {
        Self::new(callbacks, Receiver::Call)
    }

    /// Events of its fit, whose threads are started inside.
    pub(crate) fn of_fit(callbacks: &Arc<Callbacks>) -> Self {
        Self::new(callbacks, Receiver::Fit)
    }

    fn new(callbacks: &Arc<Callbacks>, to: fn(Arc<Callbacks>) -> Receiver) -> Self {
        Self(callbacks.logs().then(|| Dispatch::new(Lines(to(callbacks.clone())))))
    }

    /// Runs `body` with its events going this way.
    pub(crate) fn inside<R>(&self, body: impl FnOnce() -> R) -> R {
        match &self.0 {
            Some(way) => dispatcher::with_default(way, body),
            None => body(),
        }
    }
}
