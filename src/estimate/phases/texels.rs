//! Steps of the texels.

use super::work::{Context, Done, Phase as Shown, Work};
use crate::Result;
use crate::estimate::budget::Trend;
use crate::estimate::map_state::MapState;
use crate::estimate::solver::Solver;
use crate::estimate::task::EarlyStop;

/// Largest number of last steps.
const STEPS: usize = 8;

/// A number of steps of the texels.
pub(super) struct Steps {
    solver: Option<Solver>,
    trend: Trend,
    steps: usize,
    /// Whether they may stop early without a visible gain, whatever the budget says.
    may_end: bool,
}

impl Steps {
    pub fn new(steps: usize, may_end: bool) -> Self {
        Self { solver: None, trend: Trend::new(steps), steps, may_end }
    }

    pub fn taken(&self) -> usize {
        self.solver.as_ref().map_or(0, |solver| solver.steps)
    }

    pub fn fraction(&self) -> f32 {
        self.taken() as f32 / self.steps.max(1) as f32
    }

    /// A step with these photographs.
    pub fn step(&mut self, which: &[usize], context: &mut Context) -> Result<Done> {
        let Context { map_state: Some(map_state), photographs, meter, .. } = context else {
            return Ok(Done::silent(true));
        };
        let observations = &photographs.like(&map_state.maps).some(which)[..];
        let solver = match &mut self.solver {
            Some(solver) => solver,
            None => {
                let MapState { maps, prior, noise, .. } = map_state;
                self.solver.insert(Solver::new(maps, observations, prior, *noise)?)
            }
        };
        let before = f64::from(*context.loss);
        let loss = solver.step(&mut map_state.maps, &map_state.mean, observations)?;
        *context.loss = loss as f32;
        meter.count();
        let step = solver.steps;
        let invisible = meter.budget.stop_when_invisible;
        let is_flat = self.trend.is_flat(step, loss) && (self.may_end || invisible);
        if is_flat && step < self.steps && invisible {
            *context.early_stop = context.early_stop.or(Some(EarlyStop::Invisible));
        }
        Ok(Done::new(is_flat || step >= self.steps, [before, loss]))
    }
}

/// The last steps: all texels, all photographs.
pub struct Phase {
    steps: Steps,
    begun: bool,
}

impl Default for Phase {
    fn default() -> Self {
        // Steps at full size are expensive and start near convergence.
        Self { steps: Steps::new(STEPS, true), begun: false }
    }
}

impl Work for Phase {
    fn name(&self) -> &'static str {
        "texels"
    }

    fn phase(&self) -> Shown {
        Shown::Refine
    }

    fn cost(&self, photographs: usize) -> f32 {
        STEPS as f32 * (5.0 + 2.0 * photographs as f32)
    }

    fn fraction(&self) -> f32 {
        self.steps.fraction()
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        if !std::mem::replace(&mut self.begun, true)
            && let Some(map_state) = context.map_state
        {
            map_state.refine(context.photographs);
        }
        let all: Vec<usize> = (0..context.photographs.len()).collect();
        self.steps.step(&all, context)
    }
}
