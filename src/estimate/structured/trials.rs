//! Whether the light is as given, and if not, the widths of the prior.
//!
//! Where no board tells lights, they may not be as given. Where classes explain averaged texels clearly
//! better with exposure and flash free than with what the other phases can correct (a likelihood ratio),
//! they are not, and texels of the other phases would follow that. Of two photographs, which cannot be left
//! out, classes round the latent estimate are taken then; of more, each candidate predicts each of the
//! latest photographs from all others (leave-one-out cross-validation), at a few texels as they are:
//! averages would hide relief. The widths are the mean of the candidates', weighted by the likelihood of their
//! predictions: two that predict alike are as good, and a winner would change from photograph to photograph. A
//! prediction is made only while its candidate can still have a weight.
//!
//! What texels leave that share their gloss, with exposure, flash, ambient light and turns of lights free, tells
//! the noise: nine numbers of each texel would take it up.

use std::sync::Arc;

use super::prediction;
use super::setup::{Light, STEPS, Setup, descended};
use crate::Svbrdf;
use crate::estimate::bundle::{Problem, Sample, State};
use crate::estimate::options::{EstimateOptions, Widths};
use crate::estimate::photographs::Photographs;

/// Texels along the longer side that trials see, at most, and of which those are taken as they are.
const TEXELS: usize = 32;
const TAKEN_FROM: usize = 64;
/// Steps of a trial that leaves a photograph out, at most.
const TRIAL_STEPS: usize = 8;
/// Photographs left out in turn, at most: the latest.
const FOLDS: usize = 3;
/// Weight, relative to the best candidate's, below which one counts for nothing.
const MIN_WEIGHT: f64 = 0.01;

/// Trials of the widths in progress.
pub(crate) struct WidthTrials {
    options: EstimateOptions,
    sample: Arc<Sample>,
    /// Photographs that the trials see.
    which: Vec<usize>,
    light: LightTest,
    /// Whether photographs are too few to leave one out.
    few: bool,
    /// Photographs left out, each in turn; the latest last.
    pub(super) folds: Vec<usize>,
    /// Costs with the light as given, and with exposure and flash free; then, of more than few photographs,
    /// squared errors of each candidate for each photograph left out. Not a number where a trial is not
    /// done.
    pub(super) errors: Vec<f64>,
}

/// Asks whether the light is as given: classes round the estimate, whose averaged texels show no relief.
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
        let sample = Arc::new(Sample::new(photographs, TEXELS, TEXELS));
        let (widths, given, limit) = if count < options.schedule.determined_from {
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

/// Numbers that a texel has of its own where gloss is shared: slopes and diffuse albedo.
const OF_TEXEL: f64 = 5.0;

impl WidthTrials {
    /// Before the first trial, with the latent estimate.
    pub fn new(photographs: &Photographs, estimate: &Svbrdf, options: &EstimateOptions) -> Self {
        let (count, o) = (photographs.len(), &options.structured);
        let few = count < options.schedule.determined_from;
        let folds: Vec<usize> = (count.saturating_sub(FOLDS)..count).collect();
        let left_out = if few { 0 } else { o.candidates.len() * folds.len() };
        Self {
            options: options.clone(),
            sample: Arc::new(Sample::new(photographs, TAKEN_FROM, TEXELS)),
            which: photographs.drawn(0),
            light: LightTest::new(photographs, estimate, options),
            few,
            folds,
            errors: vec![f64::NAN; OF_LIGHT + left_out],
        }
    }

    /// Mean of absolute log residuals of the median texel with relief of its own and the gloss of its class,
    /// for the degrees of freedom that five numbers of its own leave.
    pub fn texel_residual(&self) -> f32 {
        let (options, o) = (&self.options, &self.options.structured);
        let setup = Setup::new(&self.sample, &self.which, o.noise_widths.classes, options);
        let (which, turn) = (self.which.clone(), self.which.len() >= options.schedule.turns_from);
        let mut problem =
            setup.problem(&self.sample, which, o.noise_widths, Light::Free { turn }, options);
        problem.noise.scale = options.noise.expected;
        let (problem, state) = descended(problem, STEPS);
        let residuals = 3.0 * self.which.len() as f64;
        (problem.median_residual(&state) * residuals / (residuals - OF_TEXEL)) as f32
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
        let error = if trial < OF_LIGHT { self.cost_of_all(trial > 0) } else { self.error(trial) };
        self.record(trial, error);
    }

    /// Keeps the error of a trial; one that is no finite number is the largest, or the trial would not
    /// count as done.
    pub(super) fn record(&mut self, trial: usize, error: f64) {
        self.errors[trial] = if error.is_finite() { error } else { f64::MAX };
    }

    /// The prior that was chosen; nothing where the light is as given.
    pub fn chosen(&self) -> Option<Widths> {
        let options = &self.options.structured;
        match (self.is_contradicted(), self.few) {
            (false, _) => None,
            (true, true) => Some(options.few),
            (true, false) => self.mean(),
        }
    }

    /// Whether photographs contradict that exposure and flash are as given.
    fn is_contradicted(&self) -> bool {
        self.errors[0] > self.light.limit * self.errors[1]
    }

    /// Trials of a candidate.
    fn of(&self, candidate: usize) -> std::ops::Range<usize> {
        let folds = self.folds.len();
        OF_LIGHT + candidate * folds..OF_LIGHT + (candidate + 1) * folds
    }

    fn candidates(&self) -> std::ops::Range<usize> {
        0..self.options.structured.candidates.len()
    }

    /// Mean of the logarithms of the candidates' widths.
    fn mean(&self) -> Option<Widths> {
        let candidates = &self.options.structured.candidates;
        let all = self.candidates().map(|c| self.weight(self.sum(c)));
        let weights: Vec<f64> =
            all.map(|weight| if weight < MIN_WEIGHT { 0.0 } else { weight }).collect();
        let total: f64 = weights.iter().sum();
        let mean = |width: fn(&Widths) -> f64| {
            let logarithms = weights.iter().zip(candidates).map(|(w, c)| w * width(c).ln());
            (logarithms.sum::<f64>() / total).exp()
        };
        (total > 0.0).then(|| Widths {
            classes: mean(|widths| widths.classes as f64).round() as usize,
            slope: mean(|widths| widths.slope),
            diffuse: mean(|widths| widths.diffuse),
            specular: mean(|widths| widths.specular),
            roughness: mean(|widths| widths.roughness),
        })
    }

    /// Weight of a sum of squared errors, that of the least so far being 1: the likelihood of as many normal
    /// deviates as there are independent texels. 0 where it is not a number.
    fn weight(&self, sum: f64) -> f64 {
        let least = self.candidates().map(|c| self.sum(c)).fold(f64::INFINITY, f64::min);
        let deviates = self.options.structured.independent_texels * self.folds.len() as f64;
        match sum {
            sum if sum.is_nan() => 0.0,
            _ if least.is_infinite() => 1.0,
            sum => (least / sum).powf(0.5 * deviates),
        }
    }

    /// Sum of a candidate's squared errors; not a number where a trial is not done.
    fn sum(&self, candidate: usize) -> f64 {
        self.errors[self.of(candidate)].iter().sum()
    }

    /// Whether a candidate may still have a weight, as far as is known.
    fn may_count(&self, candidate: usize) -> bool {
        let known = self.errors[self.of(candidate)].iter().filter(|e| !e.is_nan());
        // The empty sum of floats is -0.
        self.weight(known.fold(0.0, |sum, error| sum + error)) >= MIN_WEIGHT
    }

    /// The next trial that can change the choice: those of the light first.
    pub(super) fn next(&self) -> Option<usize> {
        let open = |trials: std::ops::Range<usize>| trials.rev().find(|&t| self.errors[t].is_nan());
        let [given, free] = [self.errors[0], self.errors[1]];
        if given.is_nan() {
            return Some(0);
        }
        if given == 0.0 {
            return None;
        }
        if free.is_nan() {
            return Some(1);
        }
        if self.few || !self.is_contradicted() {
            return None;
        }
        self.candidates().filter(|&c| self.may_count(c)).find_map(|c| open(self.of(c)))
    }

    /// The cost of all photographs, exposure and flash as given or free; nothing where as given they
    /// leave nothing visible.
    fn cost_of_all(&self, free: bool) -> f64 {
        let LightTest { sample, setup, widths, given, .. } = &self.light;
        let light = if free { Light::Exposure } else { *given };
        let which = self.which.clone();
        let problem = setup.clone().problem(sample, which, *widths, light, &self.options);
        // What is left is compared with a bound, so the fit has to have arrived.
        let (problem, state) = descended(problem, STEPS);
        let visible = free || problem.mean_residual(&state) > self.options.structured.visible;
        if visible { problem.cost(&state) } else { 0.0 }
    }

    /// Predicts the photograph that a trial leaves out from all others.
    fn error(&self, trial: usize) -> f64 {
        let (at, folds) = (trial - OF_LIGHT, self.folds.len());
        let left_out = self.folds[at % folds];
        let (problem, state) = self.fitted(at / folds, left_out);
        let at = |t| problem.coordinates(t, &state);
        prediction::error(&problem.sample, left_out, &state.correction, at)
    }

    /// A candidate fitted to all photographs but one.
    fn fitted(&self, candidate: usize, left_out: usize) -> (Problem, State) {
        let options = &self.options;
        let widths = options.structured.candidates[candidate];
        let which: Vec<usize> = self.which.iter().copied().filter(|&i| i != left_out).collect();
        let setup = Setup::new(&self.sample, &which, widths.classes, options);
        let problem = setup.problem(&self.sample, which, widths, Light::Exposure, options);
        descended(problem, TRIAL_STEPS)
    }
}
