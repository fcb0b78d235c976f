//! What `fit` says while it works: a bar on a terminal, and lines.

use indicatif::{ProgressBar, ProgressStyle};

const STEPS: u64 = 1000;

/// Progress on standard error.
pub struct Progress {
    quiet: bool,
    /// The piece of work that is shown.
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Says nothing if `quiet`. Bars are drawn on terminals only.
    pub fn new(quiet: bool) -> Self {
        Self { quiet, bar: None }
    }

    /// Shows how far a piece of work is.
    pub fn show(&mut self, fraction: f32, message: String) {
        if self.quiet {
            return;
        }
        let bar = self.bar.get_or_insert_with(|| {
            let style = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3}%");
            ProgressBar::new(STEPS).with_style(style.expect("a valid template"))
        });
        bar.set_message(message);
        bar.set_position((STEPS as f32 * fraction) as u64);
    }

    /// Takes the bar off the terminal: the piece of work is done.
    pub fn done(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }

    /// Says a line in place of the bar.
    pub fn say(&mut self, line: &str) {
        self.done();
        if !self.quiet {
            eprintln!("{line}");
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.done();
    }
}
