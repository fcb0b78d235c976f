//! Limits on the work of a fit.

use serde::{Deserialize, Serialize};
use std::time::Duration;

use web_time::Instant;

use crate::{Error, Result};

/// Limits on the work on each photograph; the default has none.
///
/// A fit at its limit ends with its current maps, and every photograph starts with the full budget. The
/// latent code takes at most half of time and steps, because later steps gain more. A monotonic clock
/// measures the time; pauses do not count.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Budget {
    /// Seconds of work on each photograph. The step in progress is finished.
    pub seconds: Option<f32>,
    /// Steps of the optimisers on each photograph.
    pub steps: Option<u32>,
    /// Whether steps of the texels end once further ones, none better than the latest, would lower the mean
    /// absolute log residual by less than .001: a quarter of half a step of 8-bit white.
    pub stop_when_invisible: bool,
}

impl Budget {
    pub(crate) fn check(&self) -> Result<()> {
        match self.seconds {
            Some(s) if !(s.is_finite() && s >= 0.0) => {
                Err(Error::argument("seconds", "a number of at least 0 is expected"))
            }
            _ => Ok(()),
        }
    }
}

/// Work spent on the latest photograph, and its budget.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Meter {
    pub(crate) budget: Budget,
    /// Time and number of finished steps.
    spent: Duration,
    steps: u32,
    /// Start of the step in progress.
    #[serde(skip)]
    since: Option<Instant>,
}

impl Meter {
    pub(crate) fn new(budget: Budget) -> Self {
        Self { budget, spent: Duration::ZERO, steps: 0, since: None }
    }

    /// For a new photograph.
    pub(crate) fn reset(&mut self) {
        *self = Self::new(self.budget);
    }

    pub(crate) fn start(&mut self) {
        self.since = Some(Instant::now());
    }

    pub(crate) fn stop(&mut self) {
        self.spent = self.elapsed();
        self.since = None;
    }

    pub(crate) fn elapsed(&self) -> Duration {
        let since = self.since.map_or(Duration::ZERO, |since| since.elapsed());
        self.spent.saturating_add(since)
    }

    /// Counts a step of an optimiser.
    pub(crate) fn count(&mut self) {
        self.steps = self.steps.saturating_add(1);
    }

    /// Whether this share of the budget is spent.
    pub(crate) fn exhausted(&self, share: f32) -> bool {
        let time = self.budget.seconds.is_some_and(|s| self.elapsed().as_secs_f32() >= share * s);
        let steps = self.budget.steps;
        time || steps.is_some_and(|n| self.steps as f32 >= (share * n as f32).ceil())
    }
}

/// Mean log-L1 that is invisible: half a step of 8-bit white is 0.004 in log radiance, and a mean difference
/// hides larger ones.
const VISIBLE_LOSS: f64 = 1e-3;

/// Predicts whether further steps of an optimiser, none better than the latest, would lower the mean log-L1
/// visibly.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Trend {
    pub steps: usize,
    pub previous: Option<f64>,
}

impl Trend {
    /// A trend over `steps` steps.
    pub(crate) fn new(steps: usize) -> Self {
        Self { steps, previous: None }
    }

    /// Whether no visible gain remains after a step (from 1).
    pub(crate) fn is_flat(&mut self, step: usize, loss: f64) -> bool {
        let gain = self.previous.replace(loss).map(|before| before - loss);
        let left = self.steps.saturating_sub(step) as f64;
        gain.is_some_and(|gain| gain * left < VISIBLE_LOSS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_meter_counts_work_and_steps() {
        let budget = Budget { steps: Some(10), ..Budget::default() };
        let mut meter = Meter::new(budget);
        (0..4).for_each(|_| meter.count());
        assert!(!meter.exhausted(0.5));
        meter.count();
        assert!(meter.exhausted(0.5) && !meter.exhausted(1.0));
        meter.reset();
        assert!(!meter.exhausted(0.5) && meter.steps == 0);
        let budget = Budget { seconds: Some(1.0), ..Budget::default() };
        let meter = Meter { spent: Duration::from_millis(900), ..Meter::new(budget) };
        assert!(meter.exhausted(0.5) && !meter.exhausted(1.0));
        let unlimited = Meter::new(Budget::default());
        assert!(!Meter { spent: Duration::MAX, steps: u32::MAX, ..unlimited }.exhausted(1.0));
        for seconds in [-1.0, f32::NAN, f32::INFINITY] {
            assert!(Budget { seconds: Some(seconds), ..Budget::default() }.check().is_err());
        }
    }

    #[test]
    fn a_trend_ends_where_further_steps_gain_nothing_visible() {
        let mut trend = Trend::new(8);
        assert!(!trend.is_flat(1, 0.2) && !trend.is_flat(2, 0.1) && trend.is_flat(3, 0.0999));
    }
}
