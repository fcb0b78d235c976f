//! What a phase is, what it works with and what it reports.

use crate::Result;
use crate::estimate::belief::Belief;
use crate::estimate::budget::Meter;
use crate::estimate::latent::LatentFit;
use crate::estimate::options::EstimateOptions;
use crate::estimate::photographs::Photographs;
use crate::estimate::relief::FitRecord;
use crate::estimate::task::{Cut, Task};
use crate::networks::Networks;

/// What a fit is doing for its user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Looks for maps that explain all photographs.
    Fit,
    /// Brings back the detail of every texel.
    Refine,
}

/// What a phase has done for the photographs so far.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseReport {
    /// Its name: `latent`, `relief`, `choice`, `joint`, `texels` or `baseline`.
    pub name: &'static str,
    /// Steps taken.
    pub steps: usize,
    /// What it minimises, before its first step and after its last; not numbers where it minimises nothing.
    pub cost: [f64; 2],
    /// Time of its steps.
    pub milliseconds: f32,
    /// What it has chosen or found, if there is something to say.
    pub result: Option<String>,
}

/// What the phases work with.
pub(in crate::estimate) struct Context<'a> {
    pub networks: &'a Networks,
    pub options: &'a EstimateOptions,
    pub task: Task,
    pub photographs: &'a mut Photographs,
    pub latent: &'a mut Option<LatentFit>,
    /// Maps and prior; none while the latent code is fitted.
    pub belief: &'a mut Option<Belief>,
    pub meter: &'a mut Meter,
    /// Mean log-L1 over all photographs.
    pub loss: &'a mut f32,
    pub cut: &'a mut Option<Cut>,
    /// Where to keep what the network is asked about, if anywhere.
    pub record: Option<&'a mut Option<FitRecord>>,
}

/// What a step has come to.
pub(in crate::estimate) struct Done {
    /// Whether nothing is left to do in this phase.
    pub ended: bool,
    /// What the phase minimises, before the step and after it.
    pub cost: [f64; 2],
}

impl Done {
    pub fn new(ended: bool, cost: [f64; 2]) -> Self {
        Self { ended, cost }
    }

    /// Of a step that minimises nothing.
    pub fn silent(ended: bool) -> Self {
        Self::new(ended, [f64::NAN; 2])
    }
}

/// A phase in progress, or before its first step.
pub(in crate::estimate) trait Work: Send + Sync {
    fn name(&self) -> &'static str;

    /// What it is for the user.
    fn phase(&self) -> Phase {
        Phase::Fit
    }

    /// Its cost, in milliseconds of two cores of a desktop processor at 256 texels a side: only ratios matter.
    fn cost(&self, photographs: usize) -> f32;

    /// The fraction of it that is done.
    fn fraction(&self) -> f32;

    fn step(&mut self, context: &mut Context) -> Result<Done>;

    /// What it has chosen or found.
    fn result(&self) -> Option<String> {
        None
    }
}
