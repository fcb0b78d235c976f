//! Interface of the phases, their context and reports.

use crate::Result;
use crate::estimate::budget::Meter;
use crate::estimate::bundle::EstimatedLobes;
use crate::estimate::latent::LatentFit;
use crate::estimate::map_state::MapState;
use crate::estimate::options::EstimateOptions;
use crate::estimate::photographs::Photographs;
use crate::estimate::relief::FitRecord;
use crate::estimate::task::{EarlyStop, Task};
use crate::networks::Networks;

/// A user's view of the current phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Search for maps that explain all photographs.
    Fit,
    /// Detail of every texel.
    Refine,
}

/// Report of a phase for the photographs so far.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseReport {
    /// Its name: `latent`, `relief`, `choice`, `joint`, `texels` or `baseline`.
    pub name: &'static str,
    /// Steps taken.
    pub steps: usize,
    /// The objective before the first step and after the last; NaN without an objective.
    pub cost: [f64; 2],
    /// Time of the steps.
    pub milliseconds: f32,
    /// Choices and estimates in words, if any.
    pub result: Option<String>,
}

/// Data of the phases.
pub(in crate::estimate) struct Context<'a> {
    pub networks: &'a Networks,
    pub options: &'a EstimateOptions,
    pub task: Task,
    pub photographs: &'a mut Photographs,
    pub latent: &'a mut Option<LatentFit>,
    /// Maps and prior; `None` during the latent phase.
    pub map_state: &'a mut Option<MapState>,
    /// Optional lobes of the maps, if any: of all texels or of each direction.
    pub lobes: &'a mut Vec<EstimatedLobes>,
    pub meter: &'a mut Meter,
    /// Mean log-L1 over all photographs.
    pub loss: &'a mut f32,
    pub early_stop: &'a mut Option<EarlyStop>,
    /// Destination of the relief network's inputs, if they are kept.
    pub record: Option<&'a mut Option<FitRecord>>,
}

/// Result of a step.
pub(in crate::estimate) struct Done {
    /// Whether the phase has ended.
    pub ended: bool,
    /// The objective before the step and after it.
    pub cost: [f64; 2],
}

impl Done {
    pub fn new(ended: bool, cost: [f64; 2]) -> Self {
        Self { ended, cost }
    }

    /// A step without an objective.
    pub fn silent(ended: bool) -> Self {
        Self::new(ended, [f64::NAN; 2])
    }
}

/// A phase.
pub(in crate::estimate) trait Work: Send + Sync {
    fn name(&self) -> &'static str;

    /// The phase, as reported to the user.
    fn phase(&self) -> Phase {
        Phase::Fit
    }

    /// Relative cost: milliseconds of two cores of a desktop processor at 256 texels a side.
    fn cost(&self, photographs: usize) -> f32;

    /// The fraction of the phase that is done.
    fn fraction(&self) -> f32;

    fn step(&mut self, context: &mut Context) -> Result<Done>;

    /// Choices and estimates in words.
    fn result(&self) -> Option<String> {
        None
    }
}
