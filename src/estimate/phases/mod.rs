//! The phases of an estimate, in their order, and what each of them reports.
//!
//! | phase | photographs | changes | by |
//! |---|---|---|---|
//! | latent | 1 | latent code | Adam through decoder and renderer |
//! | relief | 1 | maps, their learned slopes | steps of the texels round the latent maps; from two photographs on a network completes them |
//! | choice | 3 | prior of the joint solve | prediction of photographs left out |
//! | joint | 2 | gloss of classes, what all texels share, the prior's mean | Levenberg-Marquardt, texels eliminated |
//! | texels | 1 | maps at full size | steps of the texels round the prior's mean |
//!
//! The baseline (classic) is a phase of its own, without the others.

mod baseline;
mod joint;
mod latent;
mod relief;
mod texels;

use std::collections::VecDeque;

use web_time::Instant;

use super::belief::Belief;
use super::budget::Meter;
use super::estimation::{Cut, Method, Task};
use super::latent::LatentFit;
use super::options::EstimateOptions;
use super::photographs::Photographs;
use super::relief::FitRecord;
use crate::Result;
use crate::initial_estimate::Networks;

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
pub(super) struct Context<'a> {
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
pub(super) struct Done {
    /// Whether nothing is left to do in this phase.
    pub ended: bool,
    /// What the phase minimises, before the step and after it.
    pub cost: [f64; 2],
}

impl Done {
    fn new(ended: bool, cost: [f64; 2]) -> Self {
        Self { ended, cost }
    }

    /// Of a step that minimises nothing.
    fn silent(ended: bool) -> Self {
        Self::new(ended, [f64::NAN; 2])
    }
}

/// A phase in progress, or before its first step.
pub(super) trait Work: Send + Sync {
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

/// The phases that are left, and reports of those that were begun.
pub(super) struct Schedule {
    left: VecDeque<Box<dyn Work>>,
    pub reports: Vec<PhaseReport>,
    begun: bool,
    photographs: usize,
    /// Cost of the phases that have ended.
    spent: f32,
}

impl Schedule {
    /// The phases for so many photographs; `coarse`: whether the maps have more texels than phases work with.
    pub fn new(task: Task, photographs: usize, coarse: bool, options: &EstimateOptions) -> Self {
        let mut left: VecDeque<Box<dyn Work>> = VecDeque::new();
        if task.method == Method::Classic {
            left.push_back(Box::new(baseline::Phase::default()));
        } else {
            left.push_back(Box::new(latent::Phase::default()));
        }
        if task.method == Method::Deep && task.refine {
            left.push_back(Box::new(relief::Phase::new(photographs)));
            if photographs >= options.schedule.determined_from {
                left.push_back(Box::new(joint::Choice::default()));
            }
            if photographs > 1 {
                left.push_back(Box::new(joint::Joint::default()));
            }
            if photographs > 1 || coarse {
                left.push_back(Box::new(texels::Phase::default()));
            }
        }
        Self { left, reports: Vec::new(), begun: false, photographs, spent: 0.0 }
    }

    /// What it is at for the user.
    pub fn phase(&self) -> Option<Phase> {
        self.left.front().map(|work| work.phase())
    }

    /// One step; whether nothing is left to do.
    pub fn step(&mut self, context: &mut Context) -> Result<bool> {
        let Some(work) = self.left.front_mut() else { return Ok(true) };
        let since = Instant::now();
        let Done { ended, cost } = work.step(context)?;
        if !std::mem::replace(&mut self.begun, true) {
            let (name, cost) = (work.name(), [cost[0]; 2]);
            let report = PhaseReport { name, steps: 0, cost, milliseconds: 0.0, result: None };
            self.reports.push(report);
        }
        if let Some(report) = self.reports.last_mut() {
            report.steps += 1;
            report.cost[1] = cost[1];
            report.milliseconds += 1e3 * since.elapsed().as_secs_f32();
            report.result = work.result();
        }
        if ended {
            self.spent += work.cost(self.photographs);
            self.begun = false;
            self.left.pop_front();
        }
        Ok(self.left.is_empty())
    }

    /// The fraction of the work that is done, by what phases cost.
    pub fn fraction(&self) -> f32 {
        let cost = |work: &dyn Work| work.cost(self.photographs);
        let left: f32 = self.left.iter().map(|work| cost(work.as_ref())).sum();
        let here = self.left.front().map_or(0.0, |work| work.fraction() * cost(work.as_ref()));
        (self.spent + here) / (self.spent + left).max(f32::MIN_POSITIVE)
    }
}
