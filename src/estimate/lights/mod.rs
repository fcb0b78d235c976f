//! Lights and a common ambient light, corrected against the photographs.
//!
//! A light direction that is wrong by some degrees, or light from elsewhere, explains itself badly by
//! maps that all photographs share: with three photographs and more, what each one disagrees about
//! tells where its light was. Each light turns about the centre of the sample by two small angles;
//! the ambient light is one number, a fraction of the flash's irradiance; and what of a surround a
//! smooth sample mirrors is one number for each photograph, as it lies elsewhere in each.
//!
//! A grid of texels is fitted together with the lights ([`super::bundle`]); the maps themselves stay as
//! they are.
//!
//! The mean that the texels are held to came from the same photographs: what wrong lights did
//! to it, they did everywhere. So it may be off by an [`Offset`], one constant per coordinate. And a
//! sample is flat: its mean slope is nearly zero, which light directions that only slanted normals
//! could explain do not survive.

#[cfg(test)]
mod tests;

use std::sync::Arc;

use super::bundle::{
    Descent, Groups, Limits, MIRRORED, Parameter, Problem, Progress, Sample, Shared, State,
};
use super::correction::{Correction, Offset};
use super::noise::Noise;
use super::options::{EstimateOptions, LightOptions};
use super::photographs::Photographs;
use super::prior::{Coordinates, Prior};
use crate::Svbrdf;
use crate::svbrdf::{CHANNELS, channel};

/// Steps of a round, at most.
const STEPS: usize = 20;
/// Texels a side that are looked at, at most.
const TEXELS: usize = 64;
/// Longest step of a light, and longest turn, radians: the model is one of small angles.
const MAX_STEP: f64 = 0.06;
const MAX_TURN: f64 = 0.3;
/// Largest ambient fraction: beyond it a capture is no flash capture.
const MAX_AMBIENT: f64 = 0.4;
/// Mean residual that rounding of radiances to half floats leaves, at most.
const ROUNDING: f64 = 2.5e-4;
/// Relative decrease of the cost of a step that is not worth another.
const CONVERGED: f64 = 3e-4;
/// Changes of ambient light, of the logarithm of what is mirrored, and of the offset that are nothing.
const STILL: [f64; 3] = [1e-4, 5e-3, 5e-4];
/// Steps with such changes after which held lights are found.
const STILL_STEPS: usize = 2;

/// Which lights are free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Free {
    /// Whether lights turn.
    pub turn: bool,
    /// Whether ambient light is looked for that the given views do not have.
    pub ambient: bool,
    /// Whether the surround differs from photograph to photograph where the sample mirrors it.
    pub mirror: bool,
}

impl Free {
    /// What is free in a fit to compare with, where one is needed: of what is still as given, turns, or else
    /// ambient light, must explain much of the residuals to be taken.
    fn held(self, as_given: Self) -> Option<Self> {
        if self.turn {
            as_given.turn.then_some(Self { turn: false, ..self })
        } else {
            (self.ambient && as_given.ambient).then_some(Self { ambient: false, ..self })
        }
    }
}

/// What the fit of lights starts from.
#[derive(Clone, Copy)]
pub(super) struct Start<'a> {
    pub photographs: &'a Photographs,
    /// Where the texels begin.
    pub maps: &'a Svbrdf,
    /// The prior's mean, which is off by the offset.
    pub base: &'a Svbrdf,
    pub prior: &'a Prior,
    pub offset: &'a Offset,
}

/// Steps in progress of lights and texels.
pub(crate) struct LightFit {
    /// Photographs that it sees, and the correction of all before it.
    which: Vec<usize>,
    before: Correction,
    free: Lights,
    from: State,
    /// Lights held, or without ambient light: what turned ones, or ambient light, are compared with. Ambient
    /// light and darker maps explain photographs nearly as well as none, and smaller deviations from the mean
    /// cost less. Once taken, what is left of the error need not be as large again: then there is none.
    held: Option<Lights>,
}

impl LightFit {
    /// Before the first step; nothing where photographs are too few.
    pub fn new(start: Start, free: Free, options: &EstimateOptions) -> Option<Self> {
        let count = start.photographs.len();
        if count < options.schedule.determined_from {
            return None;
        }
        let which = start.photographs.drawn(0);
        let before = start.photographs.correction().clone();
        let correction = before.of(&which);
        let as_given = Free {
            turn: correction.turns.iter().all(|turn| *turn == [0.0; 2]),
            ambient: correction.ambient == 0.0,
            mirror: false,
        };
        let sample = Arc::new(Sample::new(start.photographs, usize::MAX, TEXELS));
        let of_free = problem(&start, &sample, &which, free, options);
        let from = from(&of_free, &start, correction);
        let held = free.held(as_given).map(|free| {
            let problem = problem(&start, &sample, &which, free, options);
            Lights::new(problem, from.clone(), false, options)
        });
        let free = Lights::new(of_free, from.clone(), !free.turn, options);
        Some(Self { which, before, free, from, held })
    }

    /// One step; nothing once done.
    pub fn step(&mut self) {
        if !self.free.progress().done {
            self.free.step();
        } else if let Some(held) = &mut self.held {
            held.step();
        }
    }

    /// Whether nothing is left to do.
    pub fn is_done(&self) -> bool {
        let free = self.free.progress();
        free.done && (!free.changed || self.held.as_ref().is_none_or(|held| held.progress().done))
    }

    /// Correction and offset once done, if they changed: lights turn from where they were given, and there is
    /// ambient light that was not given, only where that explains much of the residuals.
    pub fn result(&self) -> Option<(Correction, Offset)> {
        let Progress { state, changed, .. } = self.free.progress();
        if !changed {
            return None;
        }
        if let Some(held) = &self.held {
            let evidence = self.free.options.lights.evidence;
            let at = if held.progress().changed { &held.progress().state } else { &self.from };
            let loss = held.descent.problem.mean_residual(at);
            let free = self.free.descent.problem.mean_residual(state);
            if free > (evidence * loss).min(loss - ROUNDING) {
                return None;
            }
        }
        let correction = self.before.with(&self.which, &state.correction);
        Some((correction, Offset(state.groups[0])))
    }

    /// Steps done, and about how many there will be.
    pub fn work(&self) -> [usize; 2] {
        let runs = [Some(&self.free), self.held.as_ref()];
        runs.into_iter().flatten().fold([0, 0], |[done, all], lights| {
            let Progress { steps, done: ended, .. } = *lights.progress();
            [done + steps, all + if ended { steps } else { (steps + 2).max(6) }]
        })
    }
}

/// A descent of the posterior.
struct Lights {
    descent: Descent,
    /// Whether ambient light, what is mirrored and offset that stay are the end, whatever texels
    /// still do.
    still: bool,
    still_steps: usize,
    options: EstimateOptions,
}

impl Lights {
    fn new(problem: Problem, state: State, still: bool, options: &EstimateOptions) -> Self {
        let limits = Limits { steps: STEPS, converged: CONVERGED };
        let descent = Descent::new(problem, state, limits);
        Self { descent, still, still_steps: 0, options: options.clone() }
    }

    fn progress(&self) -> &Progress {
        &self.descent.progress
    }

    /// One step towards the most probable state.
    fn step(&mut self) {
        if self.progress().done {
            return;
        }
        self.update_scales();
        let before = self.progress().state.clone();
        self.descent.step();
        let progress = &mut self.descent.progress;
        let moved = progress.state != before;
        let is_still = moved && is_still(&before, &progress.state);
        self.still_steps = if is_still { self.still_steps + 1 } else { 0 };
        progress.done |= self.still && self.still_steps >= STILL_STEPS;
    }

    /// The noise that the residuals show. And how wrong the lights are: those that turn little are
    /// held where they were told, as lights that are all farther out, and a sample that bulges,
    /// explain photographs nearly as well.
    fn update_scales(&mut self) {
        let Descent { problem, progress, .. } = &mut self.descent;
        let loss = problem.mean_residual(&progress.state);
        problem.noise = Noise::found(&self.options.noise, loss, problem.photographs_per_texel());
        let options = &self.options.lights;
        let turns = progress.state.correction.turns.as_flattened();
        let square = turns.iter().map(|t| t * t).sum::<f64>() / turns.len().max(1) as f64;
        let widest = options.direction_sigma;
        let sigma = square.sqrt().clamp(options.min_direction_sigma.min(widest), widest);
        let scale = scale(&problem.sample, options);
        for shared in &mut problem.shared {
            if matches!(shared.parameter, Parameter::Turn(..)) {
                shared.precision = scale / (sigma * sigma);
            }
        }
    }
}

/// Texels that count as one.
fn scale(sample: &Sample, options: &LightOptions) -> f64 {
    sample.texels() as f64 / options.independent_texels
}

/// Texels held to the estimate, which is off by one offset.
fn problem(
    start: &Start,
    sample: &Arc<Sample>,
    which: &[usize],
    free: Free,
    options: &EstimateOptions,
) -> Problem {
    let (noise, options) = (&options.noise, &options.lights);
    let scale = scale(sample, options);
    let mean = sample.coordinates(start.base);
    let precision = start.prior.sigma.map(|s| f64::from(s).powi(-2));
    let [mut offset_mean, mut offset_precision] = [[0.0; CHANNELS], precision.map(|p| scale * p)];
    for c in [channel::SLOPE_X, channel::SLOPE_Y] {
        let [slope, deviation] = moments(&mean, c);
        let flat = scale * (options.flatness[0] + options.flatness[1] * deviation).powi(-2);
        offset_precision[c] += flat;
        offset_mean[c] = -slope * flat / offset_precision[c];
    }
    Problem {
        sample: sample.clone(),
        which: which.to_vec(),
        groups: Groups {
            coordinates: 0..CHANNELS,
            range: [-1.0, 1.0],
            shares: vec![1.0; sample.texels()],
            mean: vec![offset_mean],
            precision: offset_precision,
        },
        mean,
        precision,
        shared: parameters(which.len(), scale, free, options),
        noise: Noise::expected(noise),
    }
}

/// Mean and deviation of a coordinate.
fn moments(all: &[Coordinates], c: usize) -> [f64; 2] {
    let count = all.len().max(1) as f64;
    let mean = all.iter().map(|x| x[c]).sum::<f64>() / count;
    let square = all.iter().map(|x| (x[c] - mean).powi(2)).sum::<f64>();
    [mean, (square / count).sqrt()]
}

/// What is free of the lights of so many photographs.
pub(super) fn parameters(
    photographs: usize,
    scale: f64,
    free: Free,
    options: &LightOptions,
) -> Vec<Shared> {
    let LightOptions { direction_sigma, ambient_sigma, mirrored_sigma, .. } = *options;
    let shared =
        |parameter, sigma: f64, most| Shared::new(parameter, scale / (sigma * sigma), most);
    let turn = |i: usize, axis| {
        let turn = shared(Parameter::Turn(i, axis), direction_sigma, MAX_STEP);
        turn.within(-MAX_TURN, MAX_TURN)
    };
    let mut all = Vec::new();
    for i in 0..photographs {
        if free.turn {
            all.extend([turn(i, 0), turn(i, 1)]);
        }
        if free.mirror {
            let [low, high] = MIRRORED;
            all.push(shared(Parameter::Mirrored(i), mirrored_sigma, 1.0).within(low, high));
        }
    }
    if free.ambient {
        let ambient = shared(Parameter::Ambient, ambient_sigma, f64::INFINITY);
        all.push(ambient.within(0.0, MAX_AMBIENT));
    }
    all
}

/// The state with a correction and an offset, texels as the maps say.
fn from(problem: &Problem, start: &Start, correction: Correction) -> State {
    let mut state = problem.start(correction);
    state.groups[0] = start.offset.0;
    problem.at(state, &problem.sample.coordinates(start.maps))
}

/// Whether ambient light, what is mirrored of it, and offset hardly changed.
fn is_still(before: &State, after: &State) -> bool {
    let [still_ambient, still_mirrored, still_offset] = STILL;
    let ambient = (after.correction.ambient - before.correction.ambient).abs();
    let mut offsets = after.groups[0].iter().zip(&before.groups[0]);
    let mut mirrored = after.correction.mirrored.iter().zip(&before.correction.mirrored);
    ambient < still_ambient
        && offsets.all(|(a, b)| (a - b).abs() < still_offset)
        && mirrored.all(|(a, b)| (a - b).abs() < still_mirrored)
}
