//! The prior of the joint solve, chosen by leave-one-out cross-validation.
//!
//! Each candidate of [`JointOptions::candidates`] fits all photographs but one, at a few texels, and predicts
//! the one left out. The latest photographs are left out in turn, in two rounds:
//!
//! 1. One prior predicts with each combination of optional lobes. A lobe is accepted if candidates with it
//!    get most of the weight. Lobes come first, because free texels predict best when the lobe is wrong.
//! 2. All candidates predict with these lobes. They differ in the share of the learned relief and in the
//!    sigmas of slopes, of gloss within classes, and between classes.
//!
//! The chosen prior is the candidates' mean, weighted by the likelihood of their predictions. Its sigma of
//! roughness, for example, is the weighted geometric mean of the candidates' [`JointPrior::roughness`].
//! A single winner would change from photograph to photograph when candidates predict alike. With two
//! photographs, the only candidates are [`JointOptions::few`] with and without anisotropy.
//! [`Setup`] turns the chosen prior into means and sigmas of texels.
//!
//! A prediction is skipped once its candidate can no longer get a weight.

use std::sync::Arc;

use super::prediction;
use super::setup::{Setup, descended};
use crate::Svbrdf;
use crate::estimate::bundle::{Problem, Sample, State};
use crate::estimate::coordinates::Coordinates;
use crate::estimate::options::{EstimateOptions, JointOptions, JointPrior, Omission};
use crate::estimate::photographs::Photographs;
use crate::svbrdf::NO_LOBES;

/// Largest numbers of texels along the longer side: of a prediction, and of the averages that its texels are
/// sampled from. Coarser averages would hide relief.
const TEXELS: usize = 32;
const TAKEN_FROM: usize = 64;
/// Largest number of steps of a fit.
const STEPS: usize = 6;
/// Largest number of photographs left out in turn: the latest.
const FOLDS: usize = 3;
/// Weight relative to the best candidate's, below which a candidate is ignored.
const MIN_WEIGHT: f64 = 0.01;
/// Share of the weights that accepts a lobe: its candidates predict better by more than chance.
const LOBE_WEIGHT: f64 = 0.9;

/// Predictions in progress.
pub(crate) struct PriorChoice {
    /// Whether the first round, of optional lobes, has ended.
    lobes_chosen: bool,
    /// Predictions of the first round.
    earlier: usize,
    pub(super) candidates: Vec<JointPrior>,
    /// Priors of the second round.
    priors: Vec<JointPrior>,
    options: EstimateOptions,
    sample: Arc<Sample>,
    estimate: Vec<Coordinates>,
    board: bool,
    /// Photographs in the predictions.
    which: Vec<usize>,
    /// Photographs left out in turn; the latest last.
    pub(super) folds: Vec<usize>,
    /// Squared errors, candidate by candidate, photograph by photograph; NaN before the prediction.
    pub(super) errors: Vec<f64>,
}

impl PriorChoice {
    /// Before the first prediction. `maps` have the learned slopes.
    pub fn new(
        photographs: &Photographs,
        maps: &Svbrdf,
        board: bool,
        options: &EstimateOptions,
    ) -> Self {
        let count = photographs.len();
        let folds: Vec<usize> = (count.saturating_sub(FOLDS)..count).collect();
        let sample = Arc::new(Sample::new(photographs, TAKEN_FROM, TEXELS));
        let JointOptions { few, candidates: priors, .. } = &options.joint;
        // `may_count` relies on this order.
        let mut lobes = vec![[false, false], [true, false], [false, true], [true, true]];
        let mut priors = priors.clone();
        if count < options.schedule.determined_from {
            // One photograph cannot separate a coat from the tail of a highlight.
            lobes.truncate(2);
            priors = vec![*few];
        }
        if options.schedule.without.contains(&Omission::Lobes) {
            lobes.truncate(1);
        }
        let neutral = priors.first().copied().unwrap_or_default();
        let with =
            |&[anisotropic, coated]: &[bool; 2]| JointPrior { anisotropic, coated, ..neutral };
        let candidates: Vec<JointPrior> = lobes.iter().map(with).collect();
        Self {
            lobes_chosen: false,
            earlier: 0,
            errors: vec![f64::NAN; candidates.len() * folds.len()],
            candidates,
            priors,
            estimate: sample.coordinates(maps),
            options: options.clone(),
            sample,
            board,
            which: photographs.subset(0),
            folds,
        }
    }

    /// Predictions made, and an estimate of all.
    pub fn work(&self) -> [usize; 2] {
        let done = self.earlier + self.made();
        let priors = if self.lobes_chosen { 0 } else { self.priors.len() };
        let all = self.earlier + self.errors.len() + priors * self.folds.len();
        [done, if self.is_done() { done } else { all }]
    }

    /// Predictions made in this round.
    fn made(&self) -> usize {
        self.errors.iter().filter(|e| !e.is_nan()).count()
    }

    /// Whether no further prediction can change the choice.
    pub fn is_done(&self) -> bool {
        self.lobes_chosen && self.next().is_none()
    }

    /// Makes the next prediction, or chooses the optional lobes.
    pub fn step(&mut self) {
        match self.next() {
            Some(next) => {
                let error = self.error(next);
                self.record(next, error);
            }
            None if !self.lobes_chosen => self.choose_lobes(),
            None => {}
        }
    }

    /// Accepts optional lobes and starts the second round. Its first candidate has predicted in the first.
    pub(super) fn choose_lobes(&mut self) {
        let weights: Vec<f64> = self.candidates().map(|c| self.weight(self.sum(c))).collect();
        let total: f64 = weights.iter().sum();
        let share = |has: fn(&JointPrior) -> bool| {
            let with = weights.iter().zip(&self.candidates).filter(|(_, prior)| has(prior));
            with.map(|(weight, _)| weight).sum::<f64>() / total
        };
        let anisotropic = share(|prior| prior.anisotropic) > LOBE_WEIGHT;
        let coated = share(|prior| prior.coated) > LOBE_WEIGHT;
        let has = |prior: &JointPrior| [prior.anisotropic, prior.coated] == [anisotropic, coated];
        let known = self.candidates.iter().position(has).map(|c| self.errors[self.of(c)].to_vec());
        self.earlier = self.made();
        let priors = self.priors.iter();
        self.candidates =
            priors.map(|prior| JointPrior { anisotropic, coated, ..*prior }).collect();
        self.errors = vec![f64::NAN; self.candidates.len() * self.folds.len()];
        for (error, known) in self.errors.iter_mut().zip(known.unwrap_or_default()) {
            *error = known;
        }
        self.lobes_chosen = true;
    }

    /// Keeps the error of a prediction. An error that is not finite becomes the largest number, because NaN
    /// marks open predictions.
    pub(super) fn record(&mut self, prediction: usize, error: f64) {
        self.errors[prediction] = if error.is_finite() { error } else { f64::MAX };
    }

    /// Indices of a candidate's predictions.
    fn of(&self, candidate: usize) -> std::ops::Range<usize> {
        let folds = self.folds.len();
        candidate * folds..(candidate + 1) * folds
    }

    fn candidates(&self) -> std::ops::Range<usize> {
        0..self.candidates.len()
    }

    /// The candidates' weighted mean: of the logarithms of sigmas, of the shares of relief. `None` before a
    /// candidate has predicted all photographs.
    pub fn chosen(&self) -> Option<JointPrior> {
        let candidates = &self.candidates;
        let all = self.candidates().map(|c| self.weight(self.sum(c)));
        let weights: Vec<f64> =
            all.map(|weight| if weight < MIN_WEIGHT { 0.0 } else { weight }).collect();
        let total: f64 = weights.iter().sum();
        let mean = |value: &dyn Fn(&JointPrior) -> f64| {
            weights.iter().zip(candidates).map(|(w, c)| w * value(c)).sum::<f64>() / total
        };
        let sigma = |sigma: fn(&JointPrior) -> f64| mean(&|prior| sigma(prior).ln()).exp();
        (total > 0.0).then(|| JointPrior {
            between: sigma(|prior| prior.between),
            relief: mean(&|prior| prior.relief),
            slope: sigma(|prior| prior.slope),
            diffuse: sigma(|prior| prior.diffuse),
            specular: sigma(|prior| prior.specular),
            roughness: sigma(|prior| prior.roughness),
            noise: sigma(|prior| prior.noise),
            anisotropic: mean(&|prior| f64::from(prior.anisotropic)) > 0.5,
            coated: mean(&|prior| f64::from(prior.coated)) > 0.5,
        })
    }

    /// Least and greatest mean squared error of the candidates that have predicted all photographs.
    pub fn range(&self) -> [f64; 2] {
        let means = self.candidates().map(|c| self.sum(c) / self.folds.len() as f64);
        means.filter(|e| !e.is_nan()).fold([f64::INFINITY, 0.0], |[a, b], e| [a.min(e), b.max(e)])
    }

    /// Weight of a sum of squared errors, relative to the least sum: the likelihood of as many normal
    /// deviates as independent texels. 0 for NaN.
    fn weight(&self, sum: f64) -> f64 {
        let least = self.candidates().map(|c| self.sum(c)).fold(f64::INFINITY, f64::min);
        let deviates = self.options.joint.independent_texels * self.folds.len() as f64;
        match sum {
            sum if sum.is_nan() => 0.0,
            _ if least.is_infinite() => 1.0,
            sum => (least / sum).powf(0.5 * deviates),
        }
    }

    /// Sum of a candidate's squared errors; NaN before its last prediction.
    fn sum(&self, candidate: usize) -> f64 {
        self.errors[self.of(candidate)].iter().sum()
    }

    /// Whether a candidate can still get a weight.
    fn may_count(&self, candidate: usize) -> bool {
        let prior = &self.candidates[candidate];
        if !self.lobes_chosen && prior.anisotropic && prior.coated {
            // Both lobes are tried together only if one of them helps.
            let [without, anisotropic, coated] = [0, 1, 2].map(|c| self.sum(c));
            if anisotropic.min(coated) > without {
                return false;
            }
        }
        let known = self.errors[self.of(candidate)].iter().filter(|e| !e.is_nan());
        // An empty sum of floats is -0.
        self.weight(known.fold(0.0, |sum, error| sum + error)) >= MIN_WEIGHT
    }

    /// The next prediction that can change the choice.
    pub(super) fn next(&self) -> Option<usize> {
        let open = |of: std::ops::Range<usize>| of.rev().find(|&t| self.errors[t].is_nan());
        self.candidates().filter(|&c| self.may_count(c)).find_map(|c| open(self.of(c)))
    }

    /// Squared error of a prediction.
    fn error(&self, prediction: usize) -> f64 {
        let folds = self.folds.len();
        let left_out = self.folds[prediction % folds];
        let (problem, state) = self.fitted(prediction / folds, left_out);
        let at = |t| problem.coordinates(t, &state);
        let lobes = |t| problem.lobes(t, &state).unwrap_or(NO_LOBES);
        prediction::error(&problem.sample, left_out, &state.correction, lobes, at)
    }

    /// A candidate's fit to all photographs but one.
    fn fitted(&self, candidate: usize, left_out: usize) -> (Problem, State) {
        let prior = &self.candidates[candidate];
        let which: Vec<usize> = self.which.iter().copied().filter(|&i| i != left_out).collect();
        let setup = Setup::new(&self.sample, &which, prior, &self.estimate, &self.options.joint);
        let problem = setup.problem(&self.sample, which, prior, self.board, &self.options);
        descended(problem, STEPS)
    }
}
