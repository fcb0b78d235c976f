//! Progress of `fit`: a bar and lines on a terminal, or JSON for programs.

use std::io::Write;

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use crate::terminal;

const STEPS: u64 = 1000;
/// Smallest step of progress that is an event, as a fraction.
const EVENT_STEP: f32 = 0.05;

/// The reader of the output.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Log {
    /// People: lines on standard error.
    Text,
    /// Programs: a JSON object a line on standard output.
    Json,
}

/// Progress on standard error, or events on standard output.
pub struct Progress {
    quiet: bool,
    log: Log,
    /// The work that is shown.
    bar: Option<ProgressBar>,
    /// Fraction at the latest event.
    reported: f32,
}

impl Progress {
    /// Says nothing if `quiet`. Bars are drawn on terminals only.
    pub fn new(quiet: bool, log: Log) -> Self {
        Self { quiet, log, bar: None, reported: 0.0 }
    }

    /// Shows how far the work is.
    pub fn show(&mut self, fraction: f32, message: String) {
        if self.quiet {
            return;
        }
        if self.log == Log::Json {
            if fraction >= self.reported + EVENT_STEP {
                self.reported = fraction;
                self.event("progress", json!({ "fraction": fraction, "text": message }));
            }
            return;
        }
        let bar = self.bar.get_or_insert_with(|| {
            let style = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3}%");
            ProgressBar::new(STEPS).with_style(style.expect("a valid template"))
        });
        bar.set_message(message);
        bar.set_position((STEPS as f32 * fraction) as u64);
    }

    /// Takes the bar off the terminal: the work is done.
    pub fn done(&mut self) {
        self.reported = 0.0;
        self.clear();
    }

    fn clear(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }

    /// Says a line in place of the bar.
    pub fn say(&mut self, line: &str) {
        self.clear();
        if !self.quiet && self.log == Log::Text {
            terminal::say(line);
        }
    }

    /// Reports an event to a program, also with `quiet`.
    pub fn event(&self, name: &str, mut what: Value) {
        if self.log == Log::Json {
            what["event"] = json!(name);
            // A reader that has gone away is no reason to end.
            let _ = writeln!(std::io::stdout().lock(), "{what}");
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}
