//! The prior of the joint solve, chosen by prediction.
//!
//! Each candidate predicts each of the latest photographs from all others (leave-one-out cross-validation), at
//! few texels: averages would hide relief. First one prior predicts with and without optional lobes, because with
//! a wrong lobe texels that are free look best. Then priors predict with the lobes found. The prior is the mean of
//! the candidates, weighted by the likelihood of their predictions: two that predict alike are equally good, and a
//! winner would change from photograph to photograph. A prediction is made only while its candidate can still have
//! a weight.

use std::sync::Arc;

use super::prediction;
use super::setup::{Setup, descended};
use crate::Svbrdf;
use crate::estimate::bundle::{Problem, Sample, State};
use crate::estimate::coordinates::Coordinates;
use crate::estimate::options::{EstimateOptions, JointOptions, JointPrior};
use crate::estimate::photographs::Photographs;
use crate::svbrdf::NO_LOBES;

/// Texels along the longer side that predictions are made at, at most, and of which those are taken as they are.
const TEXELS: usize = 32;
const TAKEN_FROM: usize = 64;
/// Steps of a fit that leaves a photograph out, at most.
const STEPS: usize = 6;
/// Photographs left out in turn, at most: the latest.
const FOLDS: usize = 3;
/// Weight, relative to the best candidate's, below which one counts for nothing.
const MIN_WEIGHT: f64 = 0.01;
/// Share of the weights that candidates with a lobe need: the lobe predicts better by more than chance.
const LOBE_WEIGHT: f64 = 0.9;

/// Predictions in progress: first with and without each optional lobe, then by each prior.
pub(crate) struct PriorChoice {
    /// Whether the optional lobes have been chosen.
    lobes_chosen: bool,
    /// Predictions made before that.
    earlier: usize,
    pub(super) candidates: Vec<JointPrior>,
    /// Priors of the second round.
    priors: Vec<JointPrior>,
    options: EstimateOptions,
    sample: Arc<Sample>,
    estimate: Vec<Coordinates>,
    board: bool,
    /// Photographs that the predictions see.
    which: Vec<usize>,
    /// Photographs left out, each in turn; the latest last.
    pub(super) folds: Vec<usize>,
    /// Squared errors of each candidate for each photograph left out; not a number where a prediction has not
    /// been made.
    pub(super) errors: Vec<f64>,
}

impl PriorChoice {
    /// Before the first prediction; `maps` have the learned slopes.
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
        // `may_count` knows this order.
        let mut lobes = vec![[false, false], [true, false], [false, true], [true, true]];
        let mut priors = priors.clone();
        if count < options.schedule.determined_from {
            // A photograph predicts another too badly to tell a coat from tails of a highlight.
            lobes.truncate(2);
            priors = vec![*few];
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
            which: photographs.drawn(0),
            folds,
        }
    }

    /// Predictions made, and about how many there will be.
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

    /// Whether no prediction can change the choice any more.
    pub fn is_done(&self) -> bool {
        self.lobes_chosen && self.next().is_none()
    }

    /// The next prediction.
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

    /// Goes on with the priors that have the optional lobes that predict; the first of them has predicted.
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

    /// Keeps the error of a prediction; one that is no finite number is the largest, or the prediction would
    /// not count as made.
    pub(super) fn record(&mut self, prediction: usize, error: f64) {
        self.errors[prediction] = if error.is_finite() { error } else { f64::MAX };
    }

    /// Predictions of a candidate.
    fn of(&self, candidate: usize) -> std::ops::Range<usize> {
        let folds = self.folds.len();
        candidate * folds..(candidate + 1) * folds
    }

    fn candidates(&self) -> std::ops::Range<usize> {
        0..self.candidates.len()
    }

    /// The mean of the candidates: of the logarithms of their sigmas, of their shares of relief. `None` where no
    /// candidate has predicted.
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

    /// Least and greatest mean squared errors of the candidates that have predicted all.
    pub fn range(&self) -> [f64; 2] {
        let means = self.candidates().map(|c| self.sum(c) / self.folds.len() as f64);
        means.filter(|e| !e.is_nan()).fold([f64::INFINITY, 0.0], |[a, b], e| [a.min(e), b.max(e)])
    }

    /// Weight of a sum of squared errors, that of the least so far being 1: the likelihood of as many normal
    /// deviates as there are independent texels. 0 where it is not a number.
    fn weight(&self, sum: f64) -> f64 {
        let least = self.candidates().map(|c| self.sum(c)).fold(f64::INFINITY, f64::min);
        let deviates = self.options.joint.independent_texels * self.folds.len() as f64;
        match sum {
            sum if sum.is_nan() => 0.0,
            _ if least.is_infinite() => 1.0,
            sum => (least / sum).powf(0.5 * deviates),
        }
    }

    /// Sum of a candidate's squared errors; not a number where a prediction has not been made.
    fn sum(&self, candidate: usize) -> f64 {
        self.errors[self.of(candidate)].iter().sum()
    }

    /// Whether a candidate may still have a weight, as far as is known.
    fn may_count(&self, candidate: usize) -> bool {
        let prior = &self.candidates[candidate];
        if !self.lobes_chosen && prior.anisotropic && prior.coated {
            // Together only where one of them alone helps.
            let [without, anisotropic, coated] = [0, 1, 2].map(|c| self.sum(c));
            if anisotropic.min(coated) > without {
                return false;
            }
        }
        let known = self.errors[self.of(candidate)].iter().filter(|e| !e.is_nan());
        // The empty sum of floats is -0.
        self.weight(known.fold(0.0, |sum, error| sum + error)) >= MIN_WEIGHT
    }

    /// The next prediction that can change the choice.
    pub(super) fn next(&self) -> Option<usize> {
        let open = |of: std::ops::Range<usize>| of.rev().find(|&t| self.errors[t].is_nan());
        self.candidates().filter(|&c| self.may_count(c)).find_map(|c| open(self.of(c)))
    }

    /// Predicts a photograph from all others.
    fn error(&self, prediction: usize) -> f64 {
        let folds = self.folds.len();
        let left_out = self.folds[prediction % folds];
        let (problem, state) = self.fitted(prediction / folds, left_out);
        let at = |t| problem.coordinates(t, &state);
        let lobes = |t| problem.lobes(t, &state).unwrap_or(NO_LOBES);
        prediction::error(&problem.sample, left_out, &state.correction, lobes, at)
    }

    /// A candidate fitted to all photographs but one.
    fn fitted(&self, candidate: usize, left_out: usize) -> (Problem, State) {
        let prior = &self.candidates[candidate];
        let which: Vec<usize> = self.which.iter().copied().filter(|&i| i != left_out).collect();
        let setup = Setup::new(&self.sample, &which, prior, &self.estimate, &self.options.joint);
        let problem = setup.problem(&self.sample, which, prior, self.board, &self.options);
        descended(problem, STEPS)
    }
}
