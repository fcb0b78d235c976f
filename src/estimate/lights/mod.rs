//! Lights and a common ambient light, corrected against the photographs.
//!
//! A light direction that is wrong by some degrees, or light from elsewhere, explains itself badly by
//! maps that all photographs share: with three photographs and more, what each one disagrees about
//! tells where its light was. Each light turns about the centre of the sample by two small angles;
//! the ambient light is one number, a fraction of the flash's irradiance; and what of a surround a
//! smooth sample mirrors is one number for each photograph, as it lies elsewhere in each.
//!
//! Maps would slowly follow wrong lights if each were fitted in turn. So a grid of texels is fitted
//! together with the lights, as in bundle adjustment: Levenberg-Marquardt on the posterior of
//! [`super::posterior`] by reweighted least squares, each texel's nine unknowns eliminated (Schur
//! complement). The maps themselves stay as they are.
//!
//! The mean that the texels are held to came from the same photographs: what wrong lights did
//! to it, they did everywhere. So it may be off by an [`Offset`], one constant per coordinate. And a
//! sample is flat: its mean slope is nearly zero, which light directions that only slanted normals
//! could explain do not survive.

mod equations;
mod problem;
mod state;
#[cfg(test)]
mod tests;

use super::correction::{Correction, Offset};
use super::options::{LightOptions, ScheduleOptions};
use super::photographs::Photographs;
use super::prior::Prior;
use crate::Svbrdf;
use crate::observation::{Observation, View};
use problem::Problem;
pub(crate) use state::{Damping, Free, State};

/// What the fit of lights starts from.
#[derive(Clone, Copy)]
pub(super) struct Start<'a> {
    /// Where the texels begin.
    pub maps: &'a Svbrdf,
    /// The prior's mean, which is off by the offset.
    pub base: &'a Svbrdf,
    pub prior: &'a Prior,
    pub observations: &'a [Observation],
    /// Views before their correction.
    pub given: &'a [View],
    pub correction: &'a Correction,
    pub offset: &'a Offset,
}

impl<'a> Start<'a> {
    /// Of a belief.
    pub fn new(
        photographs: &'a Photographs,
        (maps, base): (&'a Svbrdf, &'a Svbrdf),
        prior: &'a Prior,
        offset: &'a Offset,
    ) -> Self {
        let (observations, given) = (photographs.full(), photographs.given());
        Self {
            maps,
            base,
            prior,
            observations,
            given,
            correction: photographs.correction(),
            offset,
        }
    }
}

/// Steps in progress of lights and texels.
pub(crate) struct LightFit {
    free: Descent,
    from: State,
    /// Lights held: what turned ones are compared with. Once they have turned, what is left of their
    /// error need not be as large again: then there is none.
    held: Option<Descent>,
}

/// What differs from step to step of a [`LightFit`]: the free lights' and the held ones'.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SavedLights {
    pub free: Progress,
    pub held: Option<Progress>,
}

impl LightFit {
    /// Before the first step; nothing where photographs are too few.
    pub fn new(
        start: Start,
        free: Free,
        options: &LightOptions,
        schedule: &ScheduleOptions,
    ) -> Option<Self> {
        let count = start.observations.len().min(start.given.len());
        if count < schedule.lights_from {
            return None;
        }
        let mut correction = start.correction.clone();
        correction.turns.resize(count, [0.0; 2]);
        correction.mirrored.resize(count, 0.0);
        let as_given = correction.turns.iter().all(|turn| *turn == [0.0; 2]);
        let problem = |free| {
            let Start { maps, base, prior, observations, given, .. } = start;
            let observations = &observations[..count];
            Problem::new(maps, base, observations, given, free, prior, (options, schedule))
        };
        let of_free = problem(free);
        let texels = of_free.start.clone();
        let from = State { texels, correction, offset: start.offset.0 };
        let held = (free.turn && as_given).then(|| {
            let problem = problem(Free { turn: false, ..free });
            Descent::new(problem, from.clone(), false)
        });
        Some(Self { free: Descent::new(of_free, from.clone(), !free.turn), from, held })
    }

    /// One step; nothing once done.
    pub fn step(&mut self) {
        if !self.free.progress.done {
            self.free.step();
        } else if let Some(held) = &mut self.held {
            held.step();
        }
    }

    /// Whether nothing is left to do.
    pub fn is_done(&self) -> bool {
        let free = &self.free.progress;
        free.done && (!free.changed || self.held.as_ref().is_none_or(|held| held.progress.done))
    }

    /// Correction and offset once done, if they changed: lights turn from where they were given only
    /// where that explains much of the residuals.
    pub fn result(&self) -> Option<(Correction, Offset)> {
        let Progress { state, changed, .. } = &self.free.progress;
        if !changed {
            return None;
        }
        if let Some(held) = &self.held {
            let LightOptions { evidence, rounding, .. } = self.free.problem.options;
            let at = if held.progress.changed { &held.progress.state } else { &self.from };
            let loss = held.problem.loss(at);
            if self.free.problem.loss(state) > (evidence * loss).min(loss - rounding) {
                return None;
            }
        }
        Some((state.correction.clone(), Offset(state.offset)))
    }

    /// Steps done, and about how many there will be.
    pub fn work(&self) -> [usize; 2] {
        let runs = [Some(&self.free), self.held.as_ref()];
        runs.into_iter().flatten().fold([0, 0], |[done, all], descent| {
            let Progress { steps, done: ended, .. } = descent.progress;
            [done + steps, all + if ended { steps } else { (steps + 2).max(6) }]
        })
    }

    /// What [`LightFit::resume`] needs.
    pub fn save(&self) -> SavedLights {
        let held = self.held.as_ref().map(|held| held.progress.clone());
        SavedLights { free: self.free.progress.clone(), held }
    }

    /// Goes on where another stopped that began with the same; `None` where sizes differ.
    pub fn resume(mut self, saved: SavedLights) -> Option<Self> {
        self.free = self.free.resume(saved.free)?;
        self.held = match (self.held, saved.held) {
            (Some(held), Some(saved)) => Some(held.resume(saved)?),
            (None, None) => None,
            _ => return None,
        };
        Some(self)
    }
}

/// A descent of the posterior.
struct Descent {
    problem: Problem,
    progress: Progress,
    /// Whether ambient light, what is mirrored and offset that stay are the end, whatever texels
    /// still do.
    still: bool,
}

/// How far a descent is.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Progress {
    pub state: State,
    pub damping: Damping,
    pub steps: usize,
    pub still_steps: usize,
    /// Whether a step has descended.
    pub changed: bool,
    pub done: bool,
}

impl Descent {
    fn new(problem: Problem, state: State, still: bool) -> Self {
        let damping = Damping::new(problem.texels(), &problem.options);
        let done = problem.options.steps == 0;
        let progress = Progress { state, damping, steps: 0, still_steps: 0, changed: false, done };
        Self { problem, progress, still }
    }

    fn resume(mut self, progress: Progress) -> Option<Self> {
        let sizes = |p: &Progress| {
            let Correction { turns, mirrored, .. } = &p.state.correction;
            [p.state.texels.len(), p.damping.0.len(), turns.len(), mirrored.len()]
        };
        let fits = sizes(&progress) == sizes(&self.progress);
        self.progress = progress;
        fits.then_some(self)
    }

    /// One step towards the most probable state.
    fn step(&mut self) {
        let Self { problem, progress, .. } = self;
        if progress.done {
            return;
        }
        progress.steps += 1;
        progress.done = progress.steps >= problem.options.steps;
        problem.update_scales(&progress.state);
        let before = problem.cost(&progress.state);
        let Some(step) = problem.step(&progress.state, &progress.damping) else {
            progress.done = true;
            return;
        };
        let options = problem.options;
        let tried = options.lengths.map(|length| problem.stepped(&progress.state, &step, length));
        let best = tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let Some(next) = best.filter(|best| best.cost < before) else {
            progress.done |= !progress.damping.raise(&options);
            return;
        };
        progress.damping.update(&next, &options);
        let whole = next.length == options.lengths[0];
        let is_still = whole && is_still(&progress.state, &next.state, &options);
        progress.still_steps = if is_still { progress.still_steps + 1 } else { 0 };
        (progress.state, progress.changed) = (next.state, true);
        progress.done |= before - next.cost < options.converged * before
            || (self.still && progress.still_steps >= options.still_steps);
    }
}

/// Whether ambient light, what is mirrored of it, and offset hardly changed.
fn is_still(before: &State, after: &State, options: &LightOptions) -> bool {
    let [still_ambient, still_mirrored, still_offset] = options.still;
    let ambient = (after.correction.ambient - before.correction.ambient).abs();
    let mut offsets = after.offset.iter().zip(&before.offset);
    let mut mirrored = after.correction.mirrored.iter().zip(&before.correction.mirrored);
    ambient < still_ambient
        && offsets.all(|(a, b)| (a - b).abs() < still_offset)
        && mirrored.all(|(a, b)| (a - b).abs() < still_mirrored)
}
