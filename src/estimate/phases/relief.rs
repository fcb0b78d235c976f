//! Learned relief: steps of the texels, and completion by a network.

use super::texels::Steps;
use super::work::{Context, Done, Work};
use crate::Result;
use crate::estimate::relief::FitRecord;

/// Steps before the network's completion.
const STEPS: usize = 4;

/// Steps of the texels round the latent maps, then the network.
pub struct Phase {
    steps: Steps,
}

impl Default for Phase {
    fn default() -> Self {
        Self { steps: Steps::new(STEPS, false) }
    }
}

impl Work for Phase {
    fn name(&self) -> &'static str {
        "relief"
    }

    fn cost(&self, photographs: usize) -> f32 {
        60.0 + STEPS as f32 * (3.0 + photographs as f32)
    }

    fn fraction(&self) -> f32 {
        0.4 * self.steps.fraction()
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        if self.steps.fraction() < 1.0 {
            let which = context.photographs.subset(0);
            let done = self.steps.step(&which, context)?;
            return Ok(Done { ended: false, ..done });
        }
        if let Some(map_state) = context.map_state {
            let record = FitRecord::new(context.photographs.working(), map_state)?;
            record.complete(context.networks, &mut map_state.maps)?;
            if let Some(kept) = &mut context.record {
                **kept = Some(record);
            }
        }
        Ok(Done::silent(true))
    }
}
