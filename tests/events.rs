//! Events for a subscriber of the caller's: from all threads of a session, and to no other.

#[path = "common/rectified.rs"]
mod rectified;

use std::collections::HashMap;
use std::fmt::Debug;
use std::sync::{Arc, Mutex};
use std::thread::{self, ThreadId};

use rectified::{POSITIONS, material, photo, scene};
use svbrdf::Rejection;
use svbrdf::session::{Session, Settings};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::subscriber::with_default;
use tracing::{Event, Metadata, Subscriber};

/// Fields as `name=value`.
#[derive(Default)]
struct Fields(String);

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let gap = if self.0.is_empty() { "" } else { " " };
        self.0 += &format!("{gap}{}={value:?}", field.name());
    }
}

/// Spans by their numbers, those that each thread has entered, and events with the innermost span of their thread.
#[derive(Default)]
struct Seen {
    spans: Vec<String>,
    entered: HashMap<ThreadId, Vec<u64>>,
    events: Vec<(String, String)>,
}

#[derive(Clone, Default)]
struct Collector(Arc<Mutex<Seen>>);

impl Subscriber for Collector {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target().starts_with("svbrdf::")
    }

    fn new_span(&self, span: &Attributes<'_>) -> Id {
        let mut fields = Fields::default();
        span.record(&mut fields);
        let mut seen = self.0.lock().unwrap();
        seen.spans.push(format!("{} {}", span.metadata().name(), fields.0));
        Id::from_u64(seen.spans.len() as u64)
    }

    fn event(&self, event: &Event<'_>) {
        let mut fields = Fields::default();
        event.record(&mut fields);
        let mut seen = self.0.lock().unwrap();
        let innermost = seen.entered.get(&thread::current().id()).and_then(|ids| ids.last());
        let span = innermost.map(|id| seen.spans[*id as usize - 1].clone());
        seen.events.push((span.unwrap_or_default(), fields.0));
    }

    fn enter(&self, span: &Id) {
        let mut seen = self.0.lock().unwrap();
        seen.entered.entry(thread::current().id()).or_default().push(span.into_u64());
    }

    fn exit(&self, _: &Id) {
        let mut seen = self.0.lock().unwrap();
        seen.entered.get_mut(&thread::current().id()).and_then(Vec::pop);
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}
    fn record_follows_from(&self, _: &Id, _: &Id) {}
}

/// The value of a field, up to a space.
fn value<'a>(event: &'a str, name: &str) -> Option<&'a str> {
    event.split(' ').find_map(|field| field.strip_prefix(name)?.strip_prefix('='))
}

#[test]
fn a_subscriber_sees_photographs_and_the_phases_of_each_fit_in_order() {
    let truth = material();
    let (collector, other) = (Collector::default(), Collector::default());
    let settings = Settings { threads: 2, ..Settings::default() };
    let reports = with_default(collector.clone(), || {
        let session = Session::new(scene(), settings).unwrap();
        for position in &POSITIONS[..3] {
            session.add_rectified_photo(&photo(&truth, *position), *position, *position).unwrap();
            session.wait().unwrap();
        }
        session.reject(Rejection::LightNotVisible);
        let reports = session.phase_reports().unwrap();
        session.remove_photo(2).unwrap();
        session.pause();
        session.pause();
        session.cancel();
        // The threads of the session keep the subscriber of its start; calls have that of their thread.
        with_default(other.clone(), || session.cancel());
        reports
    });
    assert!(other.0.lock().unwrap().events.is_empty());
    let seen = collector.0.lock().unwrap();
    let phases = |photos: usize| -> Vec<&str> {
        let of = |span: &str| span == format!("fit photos={photos}");
        let events = seen.events.iter().filter(|(span, _)| of(span));
        events.filter_map(|(_, event)| value(event, "phase")).collect()
    };
    assert_eq!(phases(1), ["latent", "texels"]);
    let all = ["latent", "relief", "choice", "joint", "texels"];
    assert_eq!(phases(3), all);
    // As the reports have it.
    assert_eq!(reports.iter().map(|report| report.name).collect::<Vec<_>>(), all);
    for report in &reports {
        let phase = |event: &str| value(event, "phase") == Some(report.name);
        let latest = seen.events.iter().find(|(span, event)| span.ends_with("=3") && phase(event));
        let latest = &latest.unwrap().1;
        assert_eq!(value(latest, "steps"), Some(&*report.steps.to_string()), "{latest}");
        let cost = value(latest, "cost_after").map(|cost| cost.parse::<f64>().unwrap());
        assert_eq!(cost, Some(report.cost[1]).filter(|cost| cost.is_finite()), "{latest}");
        assert!(value(latest, "milliseconds").is_some(), "{latest}");
        assert_eq!(latest.contains("result="), report.result.is_some(), "{latest}");
    }
    let of_calls = |event: &&(String, String)| event.0.is_empty();
    let calls: Vec<&str> = seen.events.iter().filter(of_calls).map(|(_, event)| &**event).collect();
    let begins = [
        "message=photo accepted index=0 milliseconds=",
        "message=photo accepted index=1 milliseconds=",
        "message=photo accepted index=2 milliseconds=",
        "message=photo rejected: ",
        "message=photo removed index=2",
        "message=fit paused",
        "message=session cancelled",
    ];
    assert_eq!(calls.len(), begins.len(), "{calls:#?}");
    for (call, begin) in calls.iter().zip(begins) {
        assert!(call.starts_with(begin), "{call} does not begin with {begin}");
    }
    assert_eq!(value(calls[3], "reason"), Some(Rejection::LightNotVisible.code()));
}
