//! The choice of the widths by predicting photographs.
//!
//! Candidates are compared by how well they predict each of the latest photographs from all others
//! (leave-one-out cross-validation), at a few texels as they are: averages would hide relief. Where the
//! widest wins, or the maps of the other phases have predicted the latest photograph better
//! (prequential error), those go on, and nothing is changed. A choice once made needs less evidence to
//! stay. A prediction is made only while it can still change the choice.
//!
//! Two photographs cannot be left out. They tell whether exposure and flash are as given: where the
//! classes explain them clearly better with both free (a likelihood ratio), the light is known badly,
//! texels would follow it, and the classes are taken, round the latent estimate.

use std::sync::Arc;

use super::prediction::{self, Predicted};
use super::setup::{Setup, descended};
use crate::Svbrdf;
use crate::estimate::bundle::{Problem, Sample, State};
use crate::estimate::options::{EstimateOptions, StructuredOptions, Widths};
use crate::estimate::photographs::Photographs;

/// Trials of the widths in progress.
pub(crate) struct WidthTrials {
    options: EstimateOptions,
    /// Whether exposure and flash are free.
    free: bool,
    sample: Arc<Sample>,
    /// Photographs that the trials see.
    which: Vec<usize>,
    /// Classes round the estimate, where photographs are too few to leave one out.
    few: Option<Setup>,
    /// Photographs left out, each in turn; the latest last.
    pub(super) folds: Vec<usize>,
    /// How the maps before the latest photograph predicted it.
    predicted: Option<Predicted>,
    /// Squared errors of each candidate for each photograph left out; then what the widest leaves of
    /// all photographs. Of few photographs: costs with exposure and flash as given, and free. Not a
    /// number where a trial is not done.
    pub(super) errors: Vec<f64>,
}

impl WidthTrials {
    /// Before the first trial, with the latent estimate. Where a board tells exposure and flash, they
    /// are not `free`.
    pub fn new(
        photographs: &Photographs,
        estimate: &Svbrdf,
        free: bool,
        predicted: Option<Predicted>,
        options: &EstimateOptions,
    ) -> Self {
        let (count, o) = (photographs.len(), &options.structured);
        let averaged = if count < o.leave_out_from { o.trial_texels } else { o.trial_averaged };
        let sample = Sample::new(photographs, averaged, o.trial_texels);
        let few = (count < o.leave_out_from).then(|| {
            let which: Vec<usize> = (0..count).collect();
            let setup = Setup::new(&sample, &which, o.few.classes, options);
            setup.around(&sample.coordinates(estimate), o.own_share)
        });
        let folds: Vec<usize> = (count.saturating_sub(o.folds)..count).collect();
        let trials = if few.is_some() { 2 } else { o.candidates.len() * folds.len() + 1 };
        Self {
            options: options.clone(),
            free,
            sample: Arc::new(sample),
            which: photographs.drawn(0),
            few,
            folds,
            predicted,
            errors: vec![f64::NAN; trials],
        }
    }

    /// Trials done, and all that may be needed with the fit that may follow.
    pub fn work(&self) -> [usize; 2] {
        let done = self.errors.iter().filter(|e| !e.is_nan()).count();
        [done, 1 + if self.is_done() { done } else { self.errors.len() }]
    }

    /// Whether no trial can change the choice any more.
    pub fn is_done(&self) -> bool {
        self.next().is_none()
    }

    /// The next trial.
    pub fn step(&mut self) {
        let Some(trial) = self.next() else { return };
        let error = match &self.few {
            Some(setup) => self.cost_of_all(setup, trial > 0),
            None if trial < self.residual() => self.error(trial),
            None => self.residual_of_all(),
        };
        self.record(trial, error);
    }

    /// Keeps the error of a trial; one that is no finite number is the largest, or the trial would not
    /// count as done.
    pub(super) fn record(&mut self, trial: usize, error: f64) {
        self.errors[trial] = if error.is_finite() { error } else { f64::MAX };
    }

    /// Errors of all trials, for [`WidthTrials::resume`]; negative where one is not done.
    pub fn save(&self) -> Vec<f64> {
        self.errors.iter().map(|e| if e.is_nan() { -1.0 } else { *e }).collect()
    }

    /// Takes over errors of trials that were done before; whether they fit.
    pub fn resume(&mut self, errors: &[f64]) -> bool {
        let fits = errors.len() == self.errors.len();
        self.errors = errors.iter().map(|e| if *e < 0.0 { f64::NAN } else { *e }).collect();
        fits
    }

    /// The prior that was chosen, if any.
    pub fn chosen(&self) -> Option<Widths> {
        let StructuredOptions { contradiction, few, candidates, .. } = &self.options.structured;
        match self.errors.as_slice() {
            &[given, free] if self.few.is_some() => (given > contradiction * free).then_some(*few),
            _ => self.best_narrow().map(|best| candidates[best]),
        }
    }

    /// The trial of all photographs with the widest candidate.
    fn residual(&self) -> usize {
        self.errors.len() - 1
    }

    /// The widest candidate.
    fn widest(&self) -> usize {
        self.options.structured.candidates.len() - 1
    }

    /// Trials of a candidate.
    fn of(&self, candidate: usize) -> std::ops::Range<usize> {
        let folds = self.folds.len();
        candidate * folds..(candidate + 1) * folds
    }

    /// Sum of a candidate's squared errors; not a number where a trial is not done.
    fn sum(&self, candidate: usize) -> f64 {
        self.errors[self.of(candidate)].iter().sum()
    }

    /// Of the narrow candidates that predict better than the widest and than the maps of the other
    /// phases that were before the latest photograph, the one that predicts best. Where there are no
    /// such maps, it must be the better for it; a choice made before stays until the widest predicts
    /// better. None begins where free texels explain the photographs to within noise and rounding.
    fn best_narrow(&self) -> Option<usize> {
        let better = (0..self.widest()).filter(|&candidate| {
            self.sum(candidate) < self.limit() && self.predicts_latest(candidate)
        });
        better.min_by(|&a, &b| self.sum(a).total_cmp(&self.sum(b)))
    }

    /// Sum of squared errors that a narrow candidate must be below; not a number before the widest is
    /// tried, or where none begins.
    fn limit(&self) -> f64 {
        let options = &self.options.structured;
        let part = match self.predicted {
            _ if self.was_chosen() => 1.0,
            _ if !self.may_begin() => f64::NAN,
            Some(Predicted { structured: false, .. }) => options.evidence,
            _ => options.evidence_alone,
        };
        part * self.sum(self.widest())
    }

    /// Whether free texels leave enough of the photographs for a narrow prior to begin; not before that
    /// is tried.
    fn may_begin(&self) -> bool {
        self.errors[self.residual()] > self.options.structured.min_residual
    }

    /// Whether a narrow prior was chosen before.
    fn was_chosen(&self) -> bool {
        let least = self.options.structured.leave_out_from;
        self.predicted.is_some_and(|p| p.structured && p.photographs >= least)
    }

    /// Squared error of the latest photograph that a narrow candidate must be below.
    fn limit_of_latest(&self) -> f64 {
        match self.predicted {
            Some(Predicted { structured: false, error, .. }) => error,
            _ => f64::INFINITY,
        }
    }

    /// Whether a candidate predicts the latest photograph well enough; not where that is not tried.
    fn predicts_latest(&self, candidate: usize) -> bool {
        let limit = self.limit_of_latest();
        limit == f64::INFINITY || self.errors[self.of(candidate).end - 1] < limit
    }

    /// Whether a narrow candidate may still be chosen, as far as is known.
    fn may_win(&self, candidate: usize) -> bool {
        let trials = &self.errors[self.of(candidate)];
        let so_far: f64 = trials.iter().filter(|e| !e.is_nan()).sum();
        let others = (0..candidate).filter(|&other| self.predicts_latest(other));
        let beaten_by = |limit: f64| so_far >= limit;
        let misses_latest = trials.last().is_some_and(|&e| e >= self.limit_of_latest());
        let mut limits = others.map(|other| self.sum(other)).chain([self.limit()]);
        !misses_latest && !limits.any(beaten_by)
    }

    /// The trial that tells most for its time among those that can change the choice: whether a narrow
    /// prior may begin, how it predicts the latest photograph where that decides, the widest, others.
    pub(super) fn next(&self) -> Option<usize> {
        let open = |trials: std::ops::Range<usize>| trials.rev().find(|&t| self.errors[t].is_nan());
        if self.few.is_some() {
            return (0..self.errors.len()).find(|&t| self.errors[t].is_nan());
        }
        if !self.was_chosen() && !self.may_begin() {
            return open(self.residual()..self.errors.len());
        }
        let rivals: Vec<usize> = (0..self.widest()).filter(|&c| self.may_win(c)).collect();
        let latest = |&c: &usize| open(self.of(c).end - 1..self.of(c).end);
        let decides = self.limit_of_latest() < f64::INFINITY;
        let latest = decides.then(|| rivals.iter().find_map(latest)).flatten();
        let widest = || if rivals.is_empty() { None } else { open(self.of(self.widest())) };
        latest.or_else(widest).or_else(|| rivals.iter().find_map(|&c| open(self.of(c))))
    }

    /// The cost of all photographs, exposure and flash as given or free.
    fn cost_of_all(&self, setup: &Setup, free: bool) -> f64 {
        let (options, few) = (&self.options, self.options.structured.few);
        let which: Vec<usize> = (0..self.sample.photographs.len()).collect();
        let problem = setup.clone().problem(&self.sample, which, few, self.free && free, options);
        let (problem, state) = descended(problem, options.structured.trial_steps, options);
        problem.cost(&state)
    }

    /// Predicts the photograph that a trial leaves out from all others.
    fn error(&self, trial: usize) -> f64 {
        let folds = self.folds.len();
        let (candidate, left_out) = (trial / folds, self.folds[trial % folds]);
        let (problem, state) = self.fitted(candidate, Some(left_out));
        let at = |t| problem.coordinates(t, &state);
        prediction::error(&problem.sample, left_out, &state.correction, at)
    }

    /// What the widest candidate leaves of all photographs.
    fn residual_of_all(&self) -> f64 {
        let (problem, state) = self.fitted(self.widest(), None);
        problem.mean_residual(&state)
    }

    /// A candidate fitted to all photographs but one.
    fn fitted(&self, candidate: usize, left_out: Option<usize>) -> (Problem, State) {
        let options = &self.options;
        let widths = options.structured.candidates[candidate];
        let seen = self.which.iter().copied().filter(|&i| Some(i) != left_out);
        let which: Vec<usize> = seen.collect();
        let setup = Setup::new(&self.sample, &which, widths.classes, options);
        let problem = setup.problem(&self.sample, which, widths, self.free, options);
        descended(problem, options.structured.trial_steps, options)
    }
}
