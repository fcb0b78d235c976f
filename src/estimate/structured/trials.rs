//! The choice of the widths by predicting photographs.
//!
//! Candidates are compared by how well they predict each of the latest photographs from all others
//! (leave-one-out cross-validation), at a few texels as they are: averages would hide relief. Where the
//! widest wins, or the maps of the other phases have predicted these photographs better, each when it came
//! (prequential error), those go on, and nothing is changed. A choice once made needs less evidence to
//! stay. A prediction is made only while it can still change the choice.
//!
//! Where no board tells lights, they may not be as given. Where classes explain averaged texels clearly
//! better with exposure and flash free than with what the other phases can correct (a likelihood ratio),
//! they are not, and texels of the other phases would follow that. Of two photographs, which cannot be left
//! out, the classes are taken then, round the latent estimate; of more, the candidate that predicts best,
//! those with relief among them, unless the maps before were far better. Averages of strong relief look a
//! little as if the light were wrong: unless the ratio is clear, that candidate must predict worse with the
//! light as given.

use std::sync::Arc;

use super::prediction::{self, Predicted};
use super::setup::{Light, Setup, descended};
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
    /// Asks whether the light is as given, where no board tells it.
    light: Option<LightTest>,
    /// Whether photographs are too few to leave one out.
    few: bool,
    /// Photographs left out, each in turn; the latest last.
    pub(super) folds: Vec<usize>,
    /// How the maps before each of these predicted it.
    pub(super) predicted: Vec<Option<Predicted>>,
    /// Costs with exposure and flash as given, and free, where that is asked; but of few photographs,
    /// squared errors of each candidate for each photograph left out, then, where the light is asked for,
    /// those of the best with the light as given, then what the widest leaves of all photographs. Not a
    /// number where a trial is not done.
    pub(super) errors: Vec<f64>,
}

/// Classes round the estimate, whose averaged texels show no relief.
struct LightTest {
    sample: Arc<Sample>,
    setup: Setup,
    widths: Widths,
    /// What is free of the light as given.
    given: Light,
    /// Ratio of costs from which on the light is not as given.
    limit: f64,
}

impl LightTest {
    fn new(photographs: &Photographs, estimate: &Svbrdf, options: &EstimateOptions) -> Self {
        let (count, o) = (photographs.len(), &options.structured);
        let sample = Arc::new(Sample::new(photographs, o.trial_texels, o.trial_texels));
        let (widths, given, limit) = if count < o.leave_out_from {
            (o.few, Light::AsGiven, o.contradiction[0])
        } else {
            let turn = count >= options.schedule.turns_from;
            let widths = Widths { slope: o.averaged_slope, ..o.few };
            (widths, Light::Ambient { turn }, o.contradiction[1])
        };
        let setup = Setup::new(&sample, &photographs.drawn(0), widths.classes, options);
        let setup = setup.around(&sample.coordinates(estimate), o.own_share);
        Self { sample, setup, widths, given, limit }
    }
}

/// Trials that ask whether the light is as given.
const OF_LIGHT: usize = 2;

impl WidthTrials {
    /// Before the first trial, with the latent estimate. Where a board tells exposure and flash, they
    /// are not `free`.
    pub fn new(
        photographs: &Photographs,
        estimate: &Svbrdf,
        free: bool,
        predicted: &[Predicted],
        options: &EstimateOptions,
    ) -> Self {
        let (count, o) = (photographs.len(), &options.structured);
        let sample = Sample::new(photographs, o.trial_averaged, o.trial_texels);
        let few = count < o.leave_out_from;
        let folds: Vec<usize> = (count.saturating_sub(o.folds)..count).collect();
        // Maps of so many photographs have predicted the next.
        let of = |fold: &usize| predicted.iter().find(|p| p.photographs == *fold).copied();
        let predicted = folds.iter().map(of).collect();
        let fitted = o.candidates.len() + usize::from(free);
        let left_out = if few { 0 } else { fitted * folds.len() + 1 };
        let light = free.then(|| LightTest::new(photographs, estimate, options));
        let of_light = if free { OF_LIGHT } else { 0 };
        Self {
            options: options.clone(),
            free,
            sample: Arc::new(sample),
            which: photographs.drawn(0),
            light,
            few,
            folds,
            predicted,
            errors: vec![f64::NAN; of_light + left_out],
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
        let error = match &self.light {
            Some(test) if trial < OF_LIGHT => self.cost_of_all(test, trial > 0),
            _ if trial == self.residual() => self.residual_of_all(),
            _ => self.error(trial),
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
        let StructuredOptions { few, candidates, .. } = &self.options.structured;
        match (self.is_contradicted(), self.few) {
            (true, true) => Some(*few),
            (false, true) => None,
            (true, false) => self.best_of_all().map(|best| candidates[best]),
            (false, false) => self.best_narrow().map(|best| candidates[best]),
        }
    }

    /// Whether photographs contradict that exposure and flash are as given.
    fn is_contradicted(&self) -> bool {
        self.light.as_ref().is_some_and(|test| self.errors[0] > test.limit * self.errors[1])
    }

    /// Whether they do so beyond what strong relief, which averaged texels cannot follow, may feign.
    fn is_clear(&self) -> bool {
        self.errors[0] > self.options.structured.clear_contradiction * self.errors[1]
    }

    /// Where errors of photographs left out begin.
    fn first(&self) -> usize {
        if self.light.is_some() { OF_LIGHT } else { 0 }
    }

    /// The trial of all photographs with the widest candidate.
    fn residual(&self) -> usize {
        self.errors.len() - 1
    }

    /// The widest candidate.
    fn widest(&self) -> usize {
        self.options.structured.candidates.len() - 1
    }

    /// Candidates that are rivals of the other phases.
    fn narrow(&self) -> std::ops::Range<usize> {
        0..self.options.structured.narrow.min(self.widest())
    }

    /// Trials of a candidate.
    fn of(&self, candidate: usize) -> std::ops::Range<usize> {
        let (first, folds) = (self.first(), self.folds.len());
        first + candidate * folds..first + (candidate + 1) * folds
    }

    /// Trials of the best of all candidates with the light as given.
    fn of_given(&self) -> std::ops::Range<usize> {
        self.of(self.widest() + 1)
    }

    /// The candidate that predicts best, as far as is known.
    fn best(&self, candidates: impl IntoIterator<Item = usize>) -> Option<usize> {
        let tried = candidates.into_iter().filter(|&c| !self.sum(c).is_nan());
        tried.min_by(|&a, &b| self.sum(a).total_cmp(&self.sum(b)))
    }

    /// Sum of a candidate's squared errors; not a number where a trial is not done.
    fn sum(&self, candidate: usize) -> f64 {
        self.errors[self.of(candidate)].iter().sum()
    }

    /// Of all candidates the one that predicts best, unless with the light as given it predicts as well, or
    /// the maps of the other phases have predicted clearly better.
    fn best_of_all(&self) -> Option<usize> {
        let StructuredOptions { confirmation, evidence_of_maps, .. } = self.options.structured;
        let best = self.best(0..=self.widest())?;
        let of_given: f64 = self.errors[self.of_given()].iter().sum();
        let confirmed = self.is_clear() || of_given > confirmation * self.sum(best);
        let rivals = evidence_of_maps * self.sum_against_maps(best) < self.limit_of_maps();
        (confirmed && rivals).then_some(best)
    }

    /// Of the narrow candidates that predict better than the widest and than the maps of the other
    /// phases did, the one that predicts best. Where there are no such maps, it must be the better for
    /// it, and none is taken without a board that tells the light; a choice made before stays until the widest predicts better. None begins where free texels
    /// explain the photographs to within noise and rounding.
    fn best_narrow(&self) -> Option<usize> {
        self.best(
            self.narrow().filter(|&candidate| {
                self.sum(candidate) < self.limit() && self.beats_maps(candidate)
            }),
        )
    }

    /// Sum of squared errors that a narrow candidate must be below; not a number before the widest is
    /// tried, or where none begins.
    fn limit(&self) -> f64 {
        let options = &self.options.structured;
        let part = match self.latest_predicted() {
            _ if self.was_chosen() => 1.0,
            _ if !self.may_begin() => f64::NAN,
            Some(Predicted { structured: false, .. }) => options.evidence,
            // The other phases correct light that is as given but for that; the widest does not.
            None if self.light.is_some() => f64::NAN,
            _ => options.evidence_alone,
        };
        part * self.sum(self.widest())
    }

    /// Whether free texels leave enough of the photographs for a narrow prior to begin; not before that
    /// is tried.
    fn may_begin(&self) -> bool {
        self.errors[self.residual()] > self.options.structured.min_residual
    }

    /// How the maps before the latest photograph predicted it.
    fn latest_predicted(&self) -> Option<Predicted> {
        self.predicted.last().copied().flatten()
    }

    /// Whether a narrow prior was chosen before.
    fn was_chosen(&self) -> bool {
        let least = self.options.structured.leave_out_from;
        self.latest_predicted().is_some_and(|p| p.structured && p.photographs >= least)
    }

    /// Photographs left out that maps of the other phases have predicted, with the error of that; none
    /// unless the latest is among them. One photograph's maps are no rivals of candidates that see more.
    fn predicted_by_maps(&self) -> impl Iterator<Item = (usize, f64)> {
        let rivals = self.latest_predicted().is_some_and(|p| !p.structured);
        let least = self.options.structured.leave_out_from - 1;
        let of_maps = self.predicted.iter().enumerate().filter_map(move |(fold, predicted)| {
            let rival = predicted.filter(|p| !p.structured && p.photographs >= least)?;
            Some((fold, rival.error))
        });
        of_maps.filter(move |_| rivals)
    }

    /// Sum of squared errors of the maps of the other phases that a narrow candidate must be below.
    fn limit_of_maps(&self) -> f64 {
        let errors = self.predicted_by_maps().map(|(_, error)| error);
        errors.reduce(|a, b| a + b).unwrap_or(f64::INFINITY)
    }

    /// Sum of a candidate's squared errors of the photographs that these have predicted; not a number
    /// where a trial is not done.
    fn sum_against_maps(&self, candidate: usize) -> f64 {
        let first = self.of(candidate).start;
        self.predicted_by_maps().map(|(fold, _)| self.errors[first + fold]).sum()
    }

    /// Whether a candidate predicts better than the maps of the other phases did; not where that is not
    /// tried.
    fn beats_maps(&self, candidate: usize) -> bool {
        let limit = self.limit_of_maps();
        limit == f64::INFINITY || self.sum_against_maps(candidate) < limit
    }

    /// Whether a narrow candidate may still be chosen, as far as is known.
    fn may_win(&self, candidate: usize) -> bool {
        let trials = &self.errors[self.of(candidate)];
        let so_far: f64 = trials.iter().filter(|e| !e.is_nan()).sum();
        let others = (0..candidate).filter(|&other| self.beats_maps(other));
        let against_maps = self.predicted_by_maps().map(|(fold, _)| trials[fold]);
        let against_maps: f64 = against_maps.filter(|e| !e.is_nan()).sum();
        let mut limits = others.map(|other| self.sum(other)).chain([self.limit()]);
        against_maps < self.limit_of_maps() && !limits.any(|limit| so_far >= limit)
    }

    /// Whether a candidate may still predict better than all others, as far as is known.
    fn may_be_best(&self, candidate: usize) -> bool {
        let so_far: f64 = self.errors[self.of(candidate)].iter().filter(|e| !e.is_nan()).sum();
        self.best(0..=self.widest()).is_none_or(|best| so_far < self.sum(best))
    }

    /// The trial that tells most for its time among those that can change the choice: whether a narrow
    /// prior may begin, how it predicts the latest photograph where maps have too, the widest, others.
    pub(super) fn next(&self) -> Option<usize> {
        let open = |trials: std::ops::Range<usize>| trials.rev().find(|&t| self.errors[t].is_nan());
        let explained = self.light.is_some() && self.errors[0] == 0.0;
        let mut of_light = 0..if explained { 1 } else { self.first() };
        if let Some(trial) = of_light.find(|&t| self.errors[t].is_nan()) {
            return Some(trial);
        }
        if self.few {
            return None;
        }
        if self.is_contradicted() {
            return (0..=self.widest())
                .filter(|&c| self.may_be_best(c))
                .find_map(|c| open(self.of(c)))
                .or_else(|| open(self.of_given()).filter(|_| !self.is_clear()));
        }
        if !self.was_chosen() && !self.may_begin() {
            return open(self.residual()..self.errors.len());
        }
        let rivals: Vec<usize> = self.narrow().filter(|&c| self.may_win(c)).collect();
        let latest = |&c: &usize| open(self.of(c).end - 1..self.of(c).end);
        let decides = self.limit_of_maps() < f64::INFINITY;
        let latest = decides.then(|| rivals.iter().find_map(latest)).flatten();
        let widest = || if rivals.is_empty() { None } else { open(self.of(self.widest())) };
        latest.or_else(widest).or_else(|| rivals.iter().find_map(|&c| open(self.of(c))))
    }

    /// The cost of all photographs, exposure and flash as given or free; nothing where as given they
    /// leave nothing visible.
    fn cost_of_all(&self, test: &LightTest, free: bool) -> f64 {
        let LightTest { sample, setup, widths, given, .. } = test;
        let light = if free { Light::Exposure } else { *given };
        let which = self.which.clone();
        let problem = setup.clone().problem(sample, which, *widths, light, &self.options);
        // What is left is compared with a bound, so the fit has to have arrived.
        let (problem, state) = descended(problem, self.options.structured.steps, &self.options);
        let visible = free || problem.mean_residual(&state) > self.options.structured.visible;
        if visible { problem.cost(&state) } else { 0.0 }
    }

    /// Predicts the photograph that a trial leaves out from all others.
    fn error(&self, trial: usize) -> f64 {
        let (at, folds) = (trial - self.first(), self.folds.len());
        let (mut candidate, left_out) = (at / folds, self.folds[at % folds]);
        let mut light = Light::exposure(self.free);
        if let Some(test) = self.light.as_ref().filter(|_| self.of_given().contains(&trial)) {
            candidate = self.best(0..=self.widest()).unwrap_or(0);
            light = test.given;
        }
        let (problem, state) = self.fitted(candidate, Some(left_out), light);
        let at = |t| problem.coordinates(t, &state);
        prediction::error(&problem.sample, left_out, &state.correction, at)
    }

    /// What the widest candidate leaves of all photographs.
    fn residual_of_all(&self) -> f64 {
        let (problem, state) = self.fitted(self.widest(), None, Light::exposure(self.free));
        problem.mean_residual(&state)
    }

    /// A candidate fitted to all photographs but one.
    fn fitted(&self, candidate: usize, left_out: Option<usize>, light: Light) -> (Problem, State) {
        let options = &self.options;
        let widths = options.structured.candidates[candidate];
        let seen = self.which.iter().copied().filter(|&i| Some(i) != left_out);
        let which: Vec<usize> = seen.collect();
        let setup = Setup::new(&self.sample, &which, widths.classes, options);
        let problem = setup.problem(&self.sample, which, widths, light, options);
        descended(problem, options.structured.trial_steps, options)
    }
}
