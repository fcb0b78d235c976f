//! The baseline: inverse rendering without a prior.

use super::work::{Context, Done, Work};
use crate::Result;
use crate::estimate::baseline::{Baseline, STEPS};

/// Iterations of the baseline.
#[derive(Default)]
pub struct Phase {
    run: Option<Box<Baseline>>,
}

impl Work for Phase {
    fn name(&self) -> &'static str {
        "baseline"
    }

    fn cost(&self, _: usize) -> f32 {
        1.0
    }

    fn fraction(&self) -> f32 {
        self.run.as_ref().map_or(0, |run| run.steps()) as f32 / STEPS as f32
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        let Some(map_state) = context.map_state else { return Ok(Done::silent(true)) };
        let (maps, observations) = (&mut map_state.maps, context.photographs.full());
        let run = match &mut self.run {
            Some(run) => run,
            None => self.run.insert(Box::new(Baseline::new(maps, observations)?)),
        };
        let before = f64::from(*context.loss);
        let loss = run.step(maps, observations);
        *context.loss = loss as f32;
        context.meter.count();
        Ok(Done::new(run.is_done(), [before, loss]))
    }
}
