//! Lights and a common ambient light, corrected against the photographs.
//!
//! A light direction that is wrong by some degrees, or light from elsewhere, explains itself badly by
//! maps that all photographs share: with three photographs and more, what each one disagrees about
//! tells where its light was. Each light turns about the centre of the sample by two small angles;
//! the ambient light is one number, a share of the flash's irradiance; and what of a surround a
//! smooth sample mirrors is one number for each photograph, as it lies elsewhere in each.
//!
//! Maps would slowly follow wrong lights if each were fitted in turn. So a grid of texels is fitted
//! together with the lights, as in bundle adjustment: Levenberg-Marquardt on the posterior of
//! [`crate::refinement`] by reweighted least squares, each texel's nine unknowns eliminated (Schur
//! complement). The maps themselves stay as they are.
//!
//! The estimate that the texels are held to came from the same photographs: what wrong lights did
//! to it, they did everywhere. So it may be off by an [`Offset`], one constant per coordinate. And a
//! sample is flat: its mean slope is nearly zero, which light directions that only slanted normals
//! could explain do not survive.

mod problem;
#[cfg(test)]
mod tests;

use std::borrow::Cow;

use crate::Svbrdf;
use crate::observation::{Falloff, Observation, View};
use crate::refinement::Prior;
use crate::svbrdf::CHANNELS;
use problem::{Damping, Problem, State, is_albedo};

/// Photographs below which lights and maps cannot be told apart.
pub const LEAST_PHOTOGRAPHS: usize = 3;
/// Photographs below which lights should not turn: a texel's nine parameters explain most of what
/// fewer say, and lights would follow what noise and model leave.
pub const LEAST_TO_TURN: usize = 8;

/// Largest logarithm of what is mirrored.
pub(crate) const MOST_MIRRORED: f64 = 2.0;

/// Shares of a step of what texels share that are tried.
const LENGTHS: [f64; 2] = [1.0, 0.3];
/// What turned lights must bring the mean residual down to that texels leave with lights held: with
/// less, they follow noise and what the model cannot say.
const EVIDENCE: f64 = 0.6;
/// Mean residual that rounding of radiances to half floats leaves, at most: less than that told
/// nothing of lights.
const ROUNDING: f64 = 2.5e-4;
/// Relative gain of a step that is not worth another.
const CONVERGED: f64 = 3e-4;
/// Changes of an ambient light that is looked for without turning lights, of the logarithm of what
/// is mirrored, and of the estimate's offset, which are nothing; after so many such steps all are
/// found, whatever texels still do.
const STILL_AMBIENT: f64 = 1e-4;
const STILL_MIRRORED: f64 = 5e-3;
const STILL_OFFSET: f64 = 5e-4;
const STILL_STEPS: usize = 2;

/// Options of [`refine_lights`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Steps of Levenberg and Marquardt, at most.
    pub steps: usize,
    /// Whether lights turn.
    pub turn: bool,
    /// Whether ambient light is looked for that the given views do not have.
    pub ambient: bool,
    /// Whether the surround differs from photograph to photograph where the sample mirrors it.
    pub mirror: bool,
    /// Expected error of a light's direction, radians, at most: lights that turn out to be nearly
    /// right are held narrowly.
    pub direction_sigma: f64,
    /// Expected ambient irradiance, as a share of the flash's.
    pub ambient_sigma: f64,
    /// Expected logarithm of [`View::mirrored`]: less than of rooms, as texels share what the model
    /// cannot say of lobes.
    pub mirrored_sigma: f64,
    /// Texels that count as independent, to weigh those sigmas against: errors of the model
    /// are alike all over a sample.
    pub independent_texels: f64,
    /// Expected error of the maps' estimate.
    pub prior: Prior,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            steps: 20,
            turn: true,
            ambient: true,
            mirror: false,
            direction_sigma: 0.05,
            ambient_sigma: 0.05,
            mirrored_sigma: 0.15,
            independent_texels: 1000.0,
            prior: Prior::default(),
        }
    }
}

/// What is believed of the lights: corrections of what was given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Correction {
    /// Two angles per photograph, radians.
    pub turns: Vec<[f64; 2]>,
    /// Ambient irradiance as a share of the flash's.
    pub ambient: f64,
    /// Logarithm of [`View::mirrored`] per photograph.
    pub mirrored: Vec<f64>,
}

impl Correction {
    /// The view of photograph `index` with its light turned, the ambient light added to what
    /// was `given`, and what of it is mirrored.
    pub fn apply(&self, given: &View, index: usize) -> View {
        corrected(given, self.turn(index), self.ambient, self.mirrored(index))
    }

    fn turn(&self, index: usize) -> [f64; 2] {
        self.turns.get(index).copied().unwrap_or_default()
    }

    fn mirrored(&self, index: usize) -> f64 {
        self.mirrored.get(index).copied().unwrap_or_default()
    }

    /// Largest difference to another, in units of the options' sigmas.
    pub fn distance(&self, other: &Self, options: &Options) -> f64 {
        let turns = self.turns.iter().enumerate().flat_map(|(i, turn)| {
            let before = other.turn(i);
            [turn[0] - before[0], turn[1] - before[1]]
        });
        let turns = turns.fold(0.0f64, |m, d| m.max(d.abs())) / options.direction_sigma;
        let mirrored = self.mirrored.iter().enumerate().map(|(i, m)| m - other.mirrored(i));
        let mirrored = mirrored.fold(0.0f64, |m, d| m.max(d.abs())) / options.mirrored_sigma;
        turns.max(mirrored).max((self.ambient - other.ambient).abs() / options.ambient_sigma)
    }
}

/// By how much an estimate's coordinates (slopes, square roots of albedos, roughness) are off
/// everywhere.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Offset(pub [f64; CHANNELS]);

impl Offset {
    /// The estimate without it.
    pub fn applied<'a>(&self, maps: &'a Svbrdf) -> Cow<'a, Svbrdf> {
        if *self == Self::default() {
            return Cow::Borrowed(maps);
        }
        let mut maps = maps.clone();
        for (c, by) in self.0.into_iter().enumerate() {
            let by = by as f32;
            for value in maps.plane_mut(c) {
                *value = if is_albedo(c) {
                    (value.max(0.0).sqrt() + by).max(0.0).powi(2)
                } else {
                    *value + by
                };
            }
        }
        maps.clamp();
        Cow::Owned(maps)
    }
}

/// Improves a correction of the `given` views. `maps` is where the texels begin, `prior_mean` the
/// estimate that [`Options::prior`] belongs to, which is off by `offset`. Returns whether the
/// correction and the offset changed: lights as they were told turn only where that explains much of
/// the residuals. Observations (whose own views do not matter) and maps have one size; with fewer
/// than [`LEAST_PHOTOGRAPHS`] nothing happens.
pub fn refine_lights(
    maps: &Svbrdf,
    prior_mean: &Svbrdf,
    observations: &[Observation],
    given: &[View],
    options: &Options,
    correction: &mut Correction,
    offset: &mut Offset,
) -> bool {
    let count = observations.len().min(given.len());
    if count < LEAST_PHOTOGRAPHS {
        return false;
    }
    correction.turns.resize(count, [0.0; 2]);
    correction.mirrored.resize(count, 0.0);
    let problem = |options| Problem::new(maps, prior_mean, &observations[..count], given, options);
    let mut free = problem(options);
    let texels = free.start.clone();
    let from = State { texels, correction: correction.clone(), offset: offset.0 };
    let Some(state) = descended(&mut free, &from, !options.turn) else { return false };
    // once they have turned, what is left of their error need not be as large again
    let told = correction.turns.iter().all(|turn| *turn == [0.0; 2]);
    if options.turn && told {
        let options = Options { turn: false, ..*options };
        let mut held = problem(&options);
        let loss = descended(&mut held, &from, false).map_or(held.loss(&from), |s| held.loss(&s));
        if free.loss(&state) > (EVIDENCE * loss).min(loss - ROUNDING) {
            return false;
        }
    }
    (*correction, offset.0) = (state.correction, state.offset);
    true
}

/// The most probable state near another, unless that is it; where `still`, a state whose correction
/// and offset are.
fn descended(problem: &mut Problem, from: &State, still: bool) -> Option<State> {
    let mut state = from.clone();
    let mut damping = Damping::new(problem.texels());
    let (mut changed, mut still_steps) = (false, 0);
    for _ in 0..problem.options.steps {
        problem.update_scales(&state);
        let before = problem.cost(&state);
        let Some(step) = problem.step(&state, &damping) else { break };
        let tried = LENGTHS.map(|length| problem.stepped(&state, &step, length));
        let best = tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let Some(next) = best.filter(|best| best.cost < before) else {
            if damping.raise() {
                continue;
            }
            break;
        };
        damping.update(&next);
        let whole = next.length == LENGTHS[0];
        still_steps = if whole && is_still(&state, &next.state) { still_steps + 1 } else { 0 };
        let value = next.cost;
        (state, changed) = (next.state, true);
        if before - value < CONVERGED * before || (still && still_steps >= STILL_STEPS) {
            break;
        }
    }
    changed.then_some(state)
}

/// Whether ambient light, what is mirrored of it, and offset hardly changed.
fn is_still(before: &State, after: &State) -> bool {
    let ambient = (after.correction.ambient - before.correction.ambient).abs();
    let mut offsets = after.offset.iter().zip(&before.offset);
    let mut mirrored = after.correction.mirrored.iter().zip(&before.correction.mirrored);
    ambient < STILL_AMBIENT
        && offsets.all(|(a, b)| (a - b).abs() < STILL_OFFSET)
        && mirrored.all(|(a, b)| (a - b).abs() < STILL_MIRRORED)
}

/// The light turned about the centre of the sample, ambient light added, `mirrored` the logarithm of
/// the view's.
fn corrected(given: &View, turn: [f64; 2], ambient: f64, mirrored: f64) -> View {
    let light = glam::Vec3::from(given.light_mm).as_dvec3();
    let (u, v) = light.normalize_or(glam::DVec3::Z).any_orthonormal_pair();
    let turn = glam::DQuat::from_scaled_axis(u * turn[0] + v * turn[1]);
    let white = match given.falloff {
        Falloff::None { power } => power,
        Falloff::InverseSquare { power_mm2 } => {
            power_mm2.map(|p| p / light.length_squared().max(1.0) as f32)
        }
    };
    let mut view = *given;
    view.light_mm = (turn * light).as_vec3().into();
    view.mirrored = given.mirrored * mirrored.exp() as f32;
    for (a, w) in view.ambient.iter_mut().zip(white) {
        *a += ambient as f32 * w / std::f32::consts::PI;
    }
    view
}
