//! Learned relief: steps of the texels, and completion by a network.

use super::texels::Steps;
use super::work::{Context, Done, Work};
use crate::Result;
use crate::estimate::relief::FitRecord;

/// Steps before the network's completion, and steps without completion for a single photograph.
const STEPS: usize = 4;
const OF_ONE: usize = 8;

/// Steps of the texels round the latent maps, then the network.
pub struct Phase {
    steps: Steps,
    completed: bool,
}

impl Phase {
    pub fn new(photographs: usize) -> Self {
        let completed = photographs > 1;
        Self { steps: Steps::new(if completed { STEPS } else { OF_ONE }, false), completed }
    }
}

impl Work for Phase {
    fn name(&self) -> &'static str {
        "relief"
    }

    fn cost(&self, photographs: usize) -> f32 {
        let network = if self.completed { 60.0 } else { 0.0 };
        network + STEPS as f32 * (3.0 + photographs as f32)
    }

    fn fraction(&self) -> f32 {
        if self.completed { 0.4 * self.steps.fraction() } else { self.steps.fraction() }
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        if self.steps.fraction() < 1.0 {
            let which = context.photographs.subset(0);
            let done = self.steps.step(&which, context)?;
            return Ok(Done { ended: done.ended && !self.completed, ..done });
        }
        if let Some(map_state) = context.map_state {
            let record = FitRecord::new(context.photographs.working(), map_state, context.options)?;
            record.complete(context.networks, &mut map_state.maps)?;
            if let Some(kept) = &mut context.record {
                **kept = Some(record);
            }
        }
        Ok(Done::silent(true))
    }
}
