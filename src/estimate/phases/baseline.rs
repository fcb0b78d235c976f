//! The baseline: inverse rendering without a prior.

use super::work::{Context, Done, Work};
use crate::Result;
use crate::estimate::baseline::{Baseline, STEPS};
use crate::estimate::budget::Trend;
use crate::estimate::task::EarlyStop;

/// Iterations of the baseline.
#[derive(Default)]
pub struct Phase {
    run: Option<(Box<Baseline>, Trend)>,
}

impl Work for Phase {
    fn name(&self) -> &'static str {
        "baseline"
    }

    fn cost(&self, _: usize) -> f32 {
        1.0
    }

    fn fraction(&self) -> f32 {
        self.run.as_ref().map_or(0, |(baseline, _)| baseline.steps()) as f32 / STEPS as f32
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        let Some(map_state) = context.map_state else { return Ok(Done::silent(true)) };
        let (maps, observations) = (&mut map_state.maps, context.photographs.full());
        if self.run.is_none() {
            let baseline = Box::new(Baseline::new(maps, observations)?);
            // Adam's loss is noisy: the trend compares every fiftieth.
            self.run = Some((baseline, Trend::new(STEPS, 50)));
        }
        let Some((baseline, trend)) = &mut self.run else { return Ok(Done::silent(true)) };
        let before = f64::from(*context.loss);
        let loss = baseline.step(maps, observations);
        *context.loss = loss as f32;
        context.meter.count();
        let is_flat =
            context.meter.budget.stop_when_invisible && trend.is_flat(baseline.steps(), loss);
        if is_flat && !baseline.is_done() {
            *context.early_stop = Some(EarlyStop::Invisible);
        }
        Ok(Done::new(is_flat || baseline.is_done(), [before, loss]))
    }
}
