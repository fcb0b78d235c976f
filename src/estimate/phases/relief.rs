//! Learned relief: steps of the texels, completed by a network.

use super::texels::Steps;
use super::work::{Context, Done, Work};
use crate::Result;
use crate::estimate::relief::FitRecord;

/// Steps before the network is asked and after it, and those of one photograph, which it is not asked about.
const BEFORE: usize = 6;
const AFTER: usize = 4;
const OF_ONE: usize = 8;

/// Steps of the texels round the latent maps, then the network, then steps round its maps.
pub struct Phase {
    steps: Steps,
    ask: Ask,
}

/// Whether the network is asked.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Ask {
    Later,
    Now,
    NotAnyMore,
}

impl Phase {
    pub fn new(photographs: usize) -> Self {
        let (steps, ask) =
            if photographs > 1 { (BEFORE, Ask::Later) } else { (OF_ONE, Ask::NotAnyMore) };
        Self { steps: Steps::new(steps, false), ask }
    }
}

impl Work for Phase {
    fn name(&self) -> &'static str {
        "relief"
    }

    fn cost(&self, photographs: usize) -> f32 {
        let network = if photographs > 1 { 60.0 } else { 0.0 };
        (BEFORE + AFTER) as f32 * (3.0 + photographs as f32) + network
    }

    fn fraction(&self) -> f32 {
        match self.ask {
            Ask::Later => 0.4 * self.steps.fraction(),
            Ask::Now => 0.4,
            Ask::NotAnyMore => 0.7 + 0.3 * self.steps.fraction(),
        }
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        if self.ask != Ask::Now {
            let which = context.photographs.drawn(0);
            let done = self.steps.step(&which, context)?;
            let ended = done.ended && self.ask == Ask::NotAnyMore;
            if done.ended {
                self.ask = Ask::Now;
            }
            return Ok(Done { ended, ..done });
        }
        if let Some(belief) = context.belief {
            let record = FitRecord::new(context.photographs.working(), belief, context.options)?;
            record.update(context.networks, belief)?;
            if let Some(kept) = &mut context.record {
                **kept = Some(record);
            }
        }
        (self.steps, self.ask) = (Steps::new(AFTER, false), Ask::NotAnyMore);
        Ok(Done::silent(false))
    }
}
