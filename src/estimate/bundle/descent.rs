//! Levenberg-Marquardt steps.

use nalgebra::DVector;

use super::elimination::{Eliminated, Totals};
use super::equations::TexelStep;
use super::parameters::Shared;
use super::problem::Problem;
use super::state::State;
use super::sums::Reduced;
use crate::estimate::coordinates::Coordinates;
use crate::estimate::coordinates::clamped;
use crate::parallel;
use crate::simd::LANES;

/// Texels per task.
const CHUNK: usize = 128;
/// Damping of the first step, relative to the diagonal.
const FIRST_DAMPING: f64 = 1e-3;
/// Least damping, and the damping above which a descent gives up.
const DAMPING: [f64; 2] = [1e-6, 10.0];
/// Factors of the damping after a successful and after a failed step.
const EASE: f64 = 0.3;
const RAISE: f64 = 20.0;
/// Fractions of the shared step to try.
const LENGTHS: [f64; 2] = [1.0, 0.3];
/// Fractions of a texel's own step to try.
const TEXEL_LENGTHS: [f64; 3] = [1.0, 0.3, 0.0];
/// Longest step of a coordinate of a texel or of a group.
const MAX_STEP: f64 = 0.2;

/// Reduced equations of some texels, and the eliminated texels.
type Task = (Reduced, Vec<Eliminated>);

/// Blocks of eight texels.
fn eights(from: usize, to: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    (from..to).step_by(LANES).map(move |first| first..(first + LANES).min(to))
}

/// When a descent ends.
#[derive(Debug, Clone, Copy)]
pub(in crate::estimate) struct Limits {
    /// Largest number of steps.
    pub steps: usize,
    /// A step with a smaller relative gain is the last.
    pub converged: f64,
}

/// State of a descent.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Progress {
    pub state: State,
    /// Negative logarithm of the posterior.
    pub cost: f64,
    pub damping: f64,
    pub steps: usize,
    pub done: bool,
}

/// Levenberg-Marquardt on the posterior of a [`Problem`].
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Descent {
    pub problem: Problem,
    pub progress: Progress,
    limits: Limits,
}

impl Descent {
    pub fn new(problem: Problem, state: State, limits: Limits) -> Self {
        let done = limits.steps == 0;
        let cost = problem.cost(&state);
        let progress = Progress { state, cost, damping: FIRST_DAMPING, steps: 0, done };
        Self { problem, progress, limits }
    }

    /// Descends to the nearest minimum.
    pub fn run(mut self) -> (Problem, State) {
        while !self.progress.done {
            self.step();
        }
        (self.problem, self.progress.state)
    }

    /// One step; none after the end.
    pub fn step(&mut self) {
        let Self { problem, progress, limits } = self;
        if progress.done {
            return;
        }
        progress.steps += 1;
        progress.done = progress.steps >= limits.steps;
        let before = progress.cost;
        let Some((shared, steps)) = problem.step(&progress.state, progress.damping) else {
            progress.done = true;
            return;
        };
        let [least, greatest] = DAMPING;
        let tried = LENGTHS.map(|length| problem.stepped(&progress.state, &shared, &steps, length));
        match tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((next, cost)) if cost < before => {
                progress.damping = (progress.damping * EASE).max(least);
                (progress.state, progress.cost) = (next, cost);
                progress.done |= before - cost < limits.converged * before;
            }
            _ => {
                progress.done |= progress.damping >= greatest;
                progress.damping *= RAISE;
            }
        }
    }
}

impl Problem {
    /// The damped reduced equations, and those of each task with its eliminated texels.
    pub(super) fn reduced(&self, state: &State, damping: f64) -> (Reduced, Vec<Task>) {
        let mut sum = self.priors(state);
        let size = sum.gradient.len();
        let linear = self.linear(state);
        let n = self.sample.texels();
        let chunks: Vec<usize> = (0..n).step_by(CHUNK).collect();
        let parts: Vec<Task> = parallel::map_parts(chunks.iter(), |_, &from| {
            let (mut sum, mut totals) = (Reduced::zeros(size), Totals::zeros(size));
            let eliminated = eights(from, (from + CHUNK).min(n))
                .map(|texels| {
                    self.eliminate_eight(texels, state, &linear, damping, &mut sum, &mut totals)
                })
                .collect();
            totals.add_to(&mut sum);
            (sum, eliminated)
        });
        for (part, _) in &parts {
            sum.matrix += &part.matrix;
            sum.gradient += &part.gradient;
        }
        for i in 0..size {
            sum.matrix[(i, i)] *= 1.0 + damping;
        }
        sum.matrix.fill_upper_triangle_with_lower_triangle();
        (sum, parts)
    }

    /// The steps of the shared unknowns and of each texel; `None` if the equations are singular.
    pub(super) fn step(
        &self,
        state: &State,
        damping: f64,
    ) -> Option<(DVector<f64>, Vec<TexelStep>)> {
        let (sum, parts) = self.reduced(state, damping);
        let shared = self.solved(state, &sum)?;
        let mut steps = vec![TexelStep::default(); self.sample.texels()];
        let tasks = steps.chunks_mut(CHUNK).zip(&parts);
        parallel::parts(tasks, |chunk, (steps, (_, eliminated))| {
            let from = chunk * CHUNK;
            for (texels, eliminated) in eights(from, from + steps.len()).zip(eliminated) {
                let steps = &mut steps[texels.start - from..texels.end - from];
                let of_eight = self.texel_steps(texels, &shared, eliminated);
                steps.iter_mut().zip(of_eight).for_each(|(step, found)| *step = found);
            }
        });
        Some((shared, steps))
    }

    /// The step of the shared unknowns. Parameters that would leave their range step to its bound, and the
    /// others are solved for again.
    fn solved(&self, state: &State, sum: &Reduced) -> Option<DVector<f64>> {
        let first = sum.gradient.len() - self.shared.len();
        let mut step = sum.matrix.clone().cholesky()?.solve(&-&sum.gradient);
        let beyond = |(a, shared): (usize, &Shared)| {
            let value = shared.parameter.get(state);
            let to = value + step[first + a];
            let bound = to.clamp(shared.range[0], shared.range[1]);
            (bound != to).then_some((first + a, bound - value))
        };
        let bounded: Vec<(usize, f64)> =
            self.shared.iter().enumerate().filter_map(beyond).collect();
        if bounded.is_empty() {
            return Some(step);
        }
        let is_bounded = |i: &usize| bounded.iter().any(|(at, _)| at == i);
        let rest: Vec<usize> = (0..step.len()).filter(|i| !is_bounded(i)).collect();
        let rows = sum.matrix.select_rows(&rest);
        let mut gradient = sum.gradient.select_rows(&rest);
        for (at, by) in &bounded {
            gradient.axpy(*by, &rows.column(*at), 1.0);
            step[*at] = *by;
        }
        let others = rows.select_columns(&rest).cholesky()?.solve(&-gradient);
        rest.iter().zip(&others).for_each(|(i, by)| step[*i] = *by);
        Some(step)
    }

    /// The state after `length` of the shared step and the best fraction of each texel's own step, and its
    /// cost.
    pub(super) fn stepped(
        &self,
        state: &State,
        shared: &DVector<f64>,
        steps: &[TexelStep],
        length: f64,
    ) -> (State, f64) {
        let (moving, mut next) = (self.groups.coordinates.clone(), state.clone());
        let (g, first) = (moving.len(), shared.len() - self.shared.len());
        let [low, high] = self.groups.range;
        for (k, group) in next.groups.iter_mut().enumerate() {
            for (i, c) in moving.clone().enumerate() {
                let by = (length * shared[g * k + i]).clamp(-MAX_STEP, MAX_STEP);
                group[c] = (group[c] + by).clamp(low, high);
            }
        }
        for (s, by) in self.shared.iter().zip(shared.rows_range(first..).iter()) {
            let by = (length * by).clamp(-s.max_step, s.max_step);
            let to = (s.parameter.get(state) + by).clamp(s.range[0], s.range[1]);
            s.parameter.set(&mut next, to);
        }
        let trials = TEXEL_LENGTHS.map(|own| {
            let deviations = |(t, step): (usize, &TexelStep)| {
                let (mean, step) = (self.mean(t, &next), step.with(length));
                std::array::from_fn(|c| {
                    let by = (own * step[c]).clamp(-MAX_STEP, MAX_STEP);
                    clamped(c, mean[c] + state.deviations[t][c] + by) - mean[c]
                })
            };
            steps.iter().enumerate().map(deviations).collect::<Vec<Coordinates>>()
        });
        let costs = self.texel_costs(&next, trials.each_ref().map(Vec::as_slice));
        let mut cost = self.shared_cost(&next);
        for (t, costs) in costs.iter().enumerate() {
            let trials = trials.iter().zip(costs);
            if let Some((trial, least)) = trials.min_by(|a, b| a.1.total_cmp(b.1)) {
                next.deviations[t] = trial[t];
                cost += least;
            }
        }
        (next, cost)
    }
}
