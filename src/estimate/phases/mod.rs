//! The phases of an estimate, their order, and their reports.
//!
//! | phase | photographs | changes | by |
//! |---|---|---|---|
//! | latent | 1 | latent code | Adam through decoder and renderer |
//! | relief | 2 | maps, learned slopes | steps of the texels round the latent maps, completion by a network |
//! | choice | 2 | prior of the joint solve: optional lobes, from three photographs on sigmas and share of relief | leave-one-out prediction |
//! | joint | 2 | gloss of classes, shared unknowns, the prior's mean | Levenberg-Marquardt, texels eliminated |
//! | texels | 1 | maps at full size | steps of the texels round the prior's mean |
//!
//! The baseline (`Method::Classic`) is a single phase.

mod baseline;
mod joint;
mod latent;
mod relief;
mod texels;
mod work;

use std::collections::VecDeque;

use tracing::{Span, debug, debug_span};
use web_time::Instant;

use super::options::Omission;
use super::task::{Method, Task};
use crate::Result;
use work::Done;
pub(super) use work::{Context, Work};
pub use work::{Phase, PhaseReport};

/// The remaining phases, and reports of the others.
pub(super) struct Schedule {
    left: VecDeque<Box<dyn Work>>,
    pub reports: Vec<PhaseReport>,
    begun: bool,
    photographs: usize,
    /// Cost of the phases that have ended.
    spent: f32,
    /// Holds the events of the phases.
    span: Span,
}

/// An event for the end of a phase.
fn tell(report: &PhaseReport) {
    let [cost_before, cost_after] = report.cost.map(|cost| cost.is_finite().then_some(cost));
    debug!(
        target: "svbrdf::fit",
        phase = %report.name,
        steps = report.steps,
        cost_before,
        cost_after,
        milliseconds = report.milliseconds.round() as u64,
        result = report.result.as_deref(),
        "phase ended"
    );
}

impl Schedule {
    /// The phases for a number of photographs, without those that `without` names.
    pub fn new(task: Task, photographs: usize, without: &[Omission]) -> Self {
        let mut left: VecDeque<Box<dyn Work>> = VecDeque::new();
        if task.method == Method::Classic {
            left.push_back(Box::new(baseline::Phase::default()));
        } else {
            left.push_back(Box::new(latent::Phase::default()));
        }
        if task.method == Method::Deep && task.refine {
            if photographs > 1 {
                left.push_back(Box::new(relief::Phase::default()));
                left.push_back(Box::new(joint::Choice::default()));
                left.push_back(Box::new(joint::Joint::default()));
            }
            left.push_back(Box::new(texels::Phase::default()));
        }
        left.retain(|work| !without.iter().any(|part| part.name() == work.name()));
        let span = debug_span!(target: "svbrdf::fit", "fit", photos = photographs);
        Self { left, reports: Vec::new(), begun: false, photographs, spent: 0.0, span }
    }

    /// The current phase, as reported to the user.
    pub fn phase(&self) -> Option<Phase> {
        self.left.front().map(|work| work.phase())
    }

    /// One step; returns whether the schedule has ended.
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
            self.span.in_scope(|| self.reports.last().map(tell));
            self.spent += work.cost(self.photographs);
            self.begun = false;
            self.left.pop_front();
        }
        Ok(self.left.is_empty())
    }

    /// The fraction of the work that is done, weighted by the costs of phases.
    pub fn fraction(&self) -> f32 {
        let cost = |work: &dyn Work| work.cost(self.photographs);
        let left: f32 = self.left.iter().map(|work| cost(work.as_ref())).sum();
        let here = self.left.front().map_or(0.0, |work| work.fraction() * cost(work.as_ref()));
        (self.spent + here) / (self.spent + left).max(f32::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_are_left_out_by_name() {
        let task = Task { method: Method::Deep, refine: true, free_lights: false };
        let names = |without: &[Omission]| {
            let schedule = Schedule::new(task, 3, without);
            schedule.left.iter().map(|work| work.name()).collect::<Vec<_>>()
        };
        let all = ["latent", "relief", "choice", "joint", "texels"];
        assert_eq!(names(&[]), all);
        for part in [Omission::Relief, Omission::Choice, Omission::Joint, Omission::Texels] {
            let left: Vec<_> = all.into_iter().filter(|name| *name != part.name()).collect();
            assert_eq!(names(&[part]), left);
            assert_eq!(left.len(), 4);
        }
        assert_eq!(names(&[Omission::Lobes]), all);
    }
}
