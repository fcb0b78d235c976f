//! Limits on the work of a fit.

use serde::{Deserialize, Serialize};
use std::time::Duration;

use web_time::Instant;

use crate::svbrdf::{CHANNELS, channel, encoding};
use crate::{Error, Result, Svbrdf};

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
    /// Whether the fit ends once its remaining change is below half a step of 8-bit maps (root mean square of
    /// each channel, as shown: normals and roughness linear, albedos with the sRGB curve).
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

/// Half a step of 8 bits.
const VISIBLE: f32 = 0.5 / 255.0;
/// Mean log-L1 that is invisible: half a step of 8-bit white is 0.004 in log radiance, and a mean difference
/// hides larger ones.
const VISIBLE_LOSS: f64 = 1e-3;

/// Maps as 8-bit files show them, at a subset of texels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shown {
    /// Channel after channel.
    pub values: Vec<f32>,
}

impl Shown {
    /// The root mean square of this many texels is within a few per cent of that of all.
    const TEXELS: usize = 4096;

    pub(crate) fn of(maps: &Svbrdf) -> Self {
        // An odd step does not follow the columns of maps of even width.
        let step = maps.texels().div_ceil(Self::TEXELS) | 1;
        let texels = |c: usize| maps.plane(c).iter().step_by(step).map(move |&v| shown(c, v));
        Self { values: (0..CHANNELS).flat_map(texels).collect() }
    }

    /// Largest root mean square difference of a channel between maps of one size, in units of the visible
    /// difference.
    pub(crate) fn visible_change(&self, other: &Self) -> f32 {
        let texels = self.values.len() / CHANNELS;
        let rms = |(a, b): (&[f32], &[f32])| {
            let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            (sum / texels as f64).sqrt() as f32
        };
        let planes = self.values.chunks(texels).zip(other.values.chunks(texels));
        planes.map(rms).fold(0.0, f32::max) / VISIBLE
    }
}

/// A parameter on the scale of its 8-bit map.
fn shown(c: usize, value: f32) -> f32 {
    match c {
        channel::SLOPE_X | channel::SLOPE_Y => 0.5 * value / (1.0 + value * value).sqrt(),
        channel::ROUGHNESS => value,
        // The square root is within a few per cent of the sRGB curve's slope.
        _ => 0.5 * (encoding::encode(c, value) + 1.0),
    }
}

/// Upper bound of the change of the steps after step `done`, if each changes as much as the latest; rates
/// fall along a half cosine over `steps`.
pub(crate) fn predicted_change(latest: f32, done: u32, steps: u32) -> f32 {
    let rate =
        |step: u32| 0.5 * (1.0 + (std::f32::consts::PI * step as f32 / steps.max(1) as f32).cos());
    let left: f32 = (done..steps).map(rate).sum();
    latest * left / rate(done.saturating_sub(1)).max(f32::MIN_POSITIVE)
}

/// Predicts whether further steps of an optimiser, none better than the latest, would lower the mean log-L1
/// visibly.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Trend {
    pub every: usize,
    pub steps: usize,
    pub previous: Option<f64>,
}

impl Trend {
    /// A trend over `steps` steps, judged after every `every`.
    pub(crate) fn new(steps: usize, every: usize) -> Self {
        Self { every, steps, previous: None }
    }

    /// Whether no visible gain remains after a step (from 1).
    pub(crate) fn is_flat(&mut self, step: usize, loss: f64) -> bool {
        if !step.is_multiple_of(self.every) {
            return false;
        }
        let gain = self.previous.replace(loss).map(|before| before - loss);
        let left = self.steps.saturating_sub(step) as f64 / self.every as f64;
        gain.is_some_and(|gain| gain * left < VISIBLE_LOSS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_grey_level_is_visible_and_a_quarter_is_not() {
        for (c, size) in (0..CHANNELS).flat_map(|c| [(c, 16), (c, 256)]) {
            let a = Svbrdf::new(size, size);
            for (levels, seen) in [(1.0, true), (0.25, false)] {
                let mut b = a.clone();
                let step = levels / 255.0;
                for v in b.plane_mut(c) {
                    *v = match c {
                        channel::SLOPE_X | channel::SLOPE_Y => 2.0 * step,
                        channel::ROUGHNESS => *v + step,
                        _ => (v.sqrt() + step).powi(2),
                    };
                }
                let change = Shown::of(&a).visible_change(&Shown::of(&b));
                assert_eq!(change >= 1.0, seen, "channel {c}, {levels} levels");
            }
        }
    }

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
    fn change_is_predicted_from_the_remaining_rates() {
        assert_eq!(predicted_change(1.0, 30, 30), 0.0);
        // Half way the rate is one half, and the rest of the cosine sums to 15 (1/2 - 1/pi).
        let left = predicted_change(1.0, 15, 30);
        assert!((left - 15.0 * (0.5 - std::f32::consts::FRAC_1_PI) / 0.5).abs() < 0.7, "{left}");
        let mut trend = Trend::new(8, 1);
        assert!(!trend.is_flat(1, 0.2) && !trend.is_flat(2, 0.1) && trend.is_flat(3, 0.0999));
    }
}
