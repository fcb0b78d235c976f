//! The latent code.

use super::work::{Context, Done, Work};
use crate::Result;
use crate::estimate::map_state::MapState;
use crate::estimate::task::EarlyStop;

/// Largest fraction of a budget: steps of the texels gain more.
const FRACTION: f32 = 0.5;

/// Steps of the latent code.
#[derive(Default)]
pub struct Phase {
    fraction: f32,
}

impl Work for Phase {
    fn name(&self) -> &'static str {
        "latent"
    }

    fn cost(&self, photographs: usize) -> f32 {
        let steps = if photographs == 1 { 8.0 } else { 30.0f32.min(90.0 / photographs as f32) };
        (if photographs == 3 { 2.0 } else { 1.0 }) * steps * (8.0 + 0.5 * photographs as f32)
    }

    fn fraction(&self) -> f32 {
        self.fraction
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        let Some(latent) = context.latent else { return Ok(Done::silent(true)) };
        let before = f64::from(*context.loss);
        let ended = if latent.is_settled() {
            true
        } else if context.meter.exhausted(if context.task.refine { FRACTION } else { 1.0 }) {
            *context.early_stop = Some(EarlyStop::Budget);
            true
        } else {
            let report = latent.step(context.photographs)?;
            context.meter.count();
            *context.loss = report.loss as f32;
            report.settled
        };
        let [done, all] = latent.work();
        self.fraction = done as f32 / all.max(1) as f32;
        if ended {
            latent.refresh()?;
            *context.map_state = Some(MapState::new(latent.maps(), context.options));
        }
        Ok(Done::new(ended, [before, f64::from(*context.loss)]))
    }
}
