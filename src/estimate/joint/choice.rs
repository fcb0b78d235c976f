//! The prior of the joint solve, chosen by leave-one-out cross-validation.
//!
//! Each candidate of [`JointOptions::candidates`] fits all photographs but one, at a few texels, and predicts
//! the one left out. The latest photographs are left out in turn, in three rounds:
//!
//! 1. One prior predicts with each optional lobe. A lobe is accepted if candidates with it get most of the
//!    weight. Lobes come first, because free texels predict best when the lobe is wrong.
//! 2. The same prior predicts with two directions of anisotropy. Averages of texels would mix the yarns of a
//!    weave, so that these predictions are those of single texels.
//! 3. All candidates predict with these lobes. They differ in the share of the learned relief and in the
//!    sigmas of slopes, of gloss within classes, and between classes.
//!
//! The chosen prior is the candidates' mean, weighted by the likelihood of their predictions. Its sigma of
//! roughness, for example, is the weighted geometric mean of the candidates' [`JointPrior::roughness`].
//! A single winner would change from photograph to photograph when candidates predict alike. With two
//! photographs, the only candidates are [`JointOptions::two_photographs`] with and without anisotropy.
//! [`Setup`] turns the chosen prior into means and sigmas of texels.
//!
//! A prediction is skipped once its candidate can no longer get a weight.

use std::sync::{Arc, OnceLock};

use super::directions::Directions;
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
const TEXELS: usize = 24;
const TAKEN_FROM: usize = 64;
/// Largest number of steps of a fit.
const STEPS: usize = 6;
/// Largest number of photographs left out in turn: the latest.
const FOLDS: usize = 3;
/// Weight relative to the best candidate's, below which a candidate is ignored.
const MIN_WEIGHT: f64 = 0.01;
/// Share of the weights that accepts a lobe: its candidates predict better by more than chance.
const LOBE_WEIGHT: f64 = 0.9;
/// Factor on the squared errors of predictions for each parameter of an optional lobe: it also explains a little
/// of a relief or a base that the model does not contain.
const HANDICAP: f64 = 1.05;

/// Rounds of predictions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Round {
    Lobes,
    Directions,
    Priors,
}

/// A grid of texels, and an estimate there.
#[derive(Clone)]
struct Grid {
    sample: Arc<Sample>,
    estimate: Vec<Coordinates>,
}

/// Predictions in progress.
pub(crate) struct PriorChoice {
    round: Round,
    /// Predictions of earlier rounds.
    earlier: usize,
    pub(super) candidates: Vec<JointPrior>,
    /// Accepted lobes with the first prior, and the errors of its predictions.
    accepted: (JointPrior, Vec<f64>),
    options: EstimateOptions,
    /// Averages of texels, and single texels.
    grids: [Grid; 2],
    /// Whether the predictions are those of single texels.
    single: bool,
    board: bool,
    /// Photographs in the predictions.
    which: Vec<usize>,
    /// Photographs left out in turn; the latest last.
    pub(super) folds: Vec<usize>,
    /// Classes of two directions without each photograph, once they are tried.
    directions: Vec<OnceLock<Directions>>,
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
        let grids = [TAKEN_FROM, usize::MAX].map(|averaged| {
            let sample = Arc::new(Sample::new(photographs, averaged, TEXELS));
            Grid { estimate: sample.coordinates(maps), sample }
        });
        let JointOptions { two_photographs, candidates, .. } = &options.joint;
        let first = candidates.first().filter(|_| count >= options.schedule.determined_from);
        let mut choice = Self {
            round: Round::Lobes,
            earlier: 0,
            candidates: Vec::new(),
            accepted: (*first.unwrap_or(two_photographs), Vec::new()),
            errors: Vec::new(),
            options: options.clone(),
            grids,
            single: false,
            board,
            which: photographs.subset(0),
            folds,
            directions: vec![OnceLock::new(); count],
        };
        // One photograph cannot separate a coat from the tail of a highlight.
        let lobes = [
            (0, false, false),
            (1, false, false),
            (0, true, false),
            (0, false, true),
            (1, true, false),
        ];
        let number = match choice.is_determined() {
            _ if !choice.has_lobes() => 1,
            true => lobes.len(),
            false => 2,
        };
        let with = |(directions, coated, sheen)| JointPrior {
            directions,
            coated,
            sheen,
            ..choice.accepted.0
        };
        let candidates = lobes.into_iter().take(number).map(with).collect();
        choice.begin(Round::Lobes, candidates);
        choice
    }

    /// Whether there are enough photographs to leave one out.
    fn is_determined(&self) -> bool {
        self.which.len() >= self.options.schedule.determined_from
    }

    /// Whether optional lobes are tried.
    fn has_lobes(&self) -> bool {
        !self.options.schedule.without.contains(&Omission::Lobes)
    }

    fn begin(&mut self, round: Round, candidates: Vec<JointPrior>) {
        self.earlier += self.made();
        self.errors = vec![f64::NAN; candidates.len() * self.folds.len()];
        (self.round, self.candidates) = (round, candidates);
    }

    /// Predictions made, and an estimate of all.
    pub fn work(&self) -> [usize; 2] {
        let done = self.earlier + self.made();
        let later = match self.round {
            _ if !self.is_determined() => 0,
            Round::Lobes => 3 + self.options.joint.candidates.len(),
            Round::Directions => self.options.joint.candidates.len(),
            Round::Priors => 0,
        };
        let all = self.earlier + self.errors.len() + later * self.folds.len();
        [done, if self.is_done() { done } else { all }]
    }

    /// Predictions made in this round.
    fn made(&self) -> usize {
        self.errors.iter().filter(|e| !e.is_nan()).count()
    }

    /// Whether no further prediction can change the choice.
    pub fn is_done(&self) -> bool {
        self.round == Round::Priors && self.next().is_none()
    }

    /// Makes the next prediction, or ends a round.
    pub fn step(&mut self) {
        match self.next() {
            Some(next) => {
                let error = self.error(next);
                self.record(next, error);
            }
            None => self.end_round(),
        }
    }

    /// Accepts optional lobes and starts the next round.
    pub(super) fn end_round(&mut self) {
        let weights: Vec<f64> = self.candidates().map(|c| self.final_weight(c)).collect();
        let total: f64 = weights.iter().sum();
        let accepts = |has: fn(&JointPrior) -> bool| {
            let with = weights.iter().zip(&self.candidates).filter(|(_, prior)| has(prior));
            with.map(|(weight, _)| weight).sum::<f64>() > LOBE_WEIGHT * total
        };
        let (mut prior, known) = self.accepted.clone();
        match self.round {
            Round::Lobes => prior.directions = usize::from(accepts(|prior| prior.directions > 0)),
            Round::Directions if accepts(|prior| prior.directions == 2) => prior.directions = 2,
            Round::Directions => {
                self.single = false;
                return self.begin_priors(prior, known);
            }
            Round::Priors => return,
        }
        prior.coated |= accepts(|prior| prior.coated);
        prior.sheen |= accepts(|prior| prior.sheen);
        let place = self.candidates.iter().position(|c| *c == prior);
        let known = place.map(|c| self.errors[self.of(c)].to_vec()).unwrap_or_default();
        if self.round == Round::Lobes && self.is_determined() && self.has_lobes() {
            let two = JointPrior { directions: 2, ..prior };
            let coated = (!prior.coated).then_some(JointPrior { coated: true, ..two });
            let candidates = [prior, two].into_iter().chain(coated).collect();
            self.accepted = (prior, known);
            self.single = true;
            self.begin(Round::Directions, candidates);
        } else {
            self.begin_priors(prior, known);
        }
    }

    /// Starts the last round. Its first candidate has predicted before.
    fn begin_priors(&mut self, prior: JointPrior, known: Vec<f64>) {
        let mut candidates = vec![prior];
        if self.is_determined() {
            let others = self.options.joint.candidates.iter().skip(1);
            candidates.extend(others.map(|other| other.with_lobes_of(&prior)));
        }
        self.begin(Round::Priors, candidates);
        self.errors.iter_mut().zip(known).for_each(|(error, known)| *error = known);
    }

    /// Keeps the error of a prediction. An error that is not finite becomes the largest number, because NaN
    /// marks open predictions.
    pub(super) fn record(&mut self, prediction: usize, error: f64) {
        self.errors[prediction] =
            if error.is_finite() { error.max(f64::MIN_POSITIVE) } else { f64::MAX };
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
        let weights: Vec<f64> = self.candidates().map(|c| self.final_weight(c)).collect();
        let total: f64 = weights.iter().sum();
        let mean = |value: &dyn Fn(&JointPrior) -> f64| {
            weights.iter().zip(candidates).map(|(w, c)| w * value(c)).sum::<f64>() / total
        };
        let sigma = |sigma: fn(&JointPrior) -> f64| mean(&|prior| sigma(prior).ln()).exp();
        (total > 0.0).then(|| JointPrior {
            between_classes: sigma(|prior| prior.between_classes),
            relief: mean(&|prior| prior.relief),
            slope: sigma(|prior| prior.slope),
            diffuse: sigma(|prior| prior.diffuse),
            specular: sigma(|prior| prior.specular),
            roughness: sigma(|prior| prior.roughness),
            noise: sigma(|prior| prior.noise),
            ..candidates[0]
        })
    }

    /// Least and greatest geometric mean of the squared errors of the candidates that have predicted all
    /// photographs.
    pub fn range(&self) -> [f64; 2] {
        let means = self.candidates().map(|c| (self.sum(c) / self.folds.len() as f64).exp());
        means.filter(|e| !e.is_nan()).fold([f64::INFINITY, 0.0], |[a, b], e| [a.min(e), b.max(e)])
    }

    /// Weight of a candidate relative to the best one by the predictions so far: their likelihood as so many
    /// normal deviates as there are independent texels. Each photograph has a variance of its own, because
    /// one with a highlight is predicted ten times worse than others.
    fn weight(&self, candidate: usize) -> f64 {
        let complete = self.candidates().filter(|&c| !self.sum(c).is_nan());
        let Some(best) = complete.min_by(|&a, &b| self.sum(a).total_cmp(&self.sum(b))) else {
            return 1.0;
        };
        let pairs = self.errors[self.of(candidate)].iter().zip(&self.errors[self.of(best)]);
        let known = pairs.filter(|(error, _)| !error.is_nan());
        let logarithms: f64 = known.map(|(error, least)| (least / error).ln()).sum();
        (0.5 * self.options.joint.independent_texels * logarithms).exp()
    }

    /// Sum of the logarithms of a candidate's squared errors; NaN before its last prediction.
    fn sum(&self, candidate: usize) -> f64 {
        self.errors[self.of(candidate)].iter().map(|error| error.ln()).sum()
    }

    /// Weight of a candidate that has predicted all photographs; 0 for others and for small weights.
    fn final_weight(&self, candidate: usize) -> f64 {
        let weight = self.weight(candidate);
        if weight < MIN_WEIGHT || self.sum(candidate).is_nan() { 0.0 } else { weight }
    }

    /// Whether a candidate can still get a weight.
    fn may_count(&self, candidate: usize) -> bool {
        let prior = &self.candidates[candidate];
        // Two lobes are tried together only if one of them helps.
        let helps = match self.round {
            Round::Lobes if prior.directions > 0 && prior.coated => {
                let [without, anisotropic, coated] = [0, 1, 2].map(|c| self.sum(c));
                anisotropic.min(coated) < without
            }
            Round::Directions if candidate == 2 => self.sum(1) < self.sum(0),
            _ => true,
        };
        helps && self.weight(candidate) >= MIN_WEIGHT
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
        let error = prediction::error(&problem.sample, left_out, &state.correction, lobes, at);
        HANDICAP.powi(self.candidates[prediction / folds].lobe_parameters() as i32) * error
    }

    /// A candidate's fit to all photographs but one.
    fn fitted(&self, candidate: usize, left_out: usize) -> (Problem, State) {
        let prior = &self.candidates[candidate];
        let which: Vec<usize> = self.which.iter().copied().filter(|&i| i != left_out).collect();
        let Grid { sample, estimate } = &self.grids[usize::from(self.single)];
        let setup = Setup::new(sample, &which, prior, estimate, &self.options.joint);
        let fit = |setup: Setup, prior: &JointPrior| {
            let problem = setup.problem(sample, which.clone(), prior, self.board, &self.options);
            descended(problem, STEPS)
        };
        if prior.directions < 2 {
            return fit(setup, prior);
        }
        let directions = self.directions[left_out].get_or_init(|| {
            let neutral = self.accepted.0.with_lobes_of(&JointPrior::default());
            let (problem, state) = fit(setup.clone(), &neutral);
            Directions::of(&problem, &state)
        });
        fit(setup.with_directions(directions), prior)
    }
}
