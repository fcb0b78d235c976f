//! Maximises the posterior of each texel by Levenberg-Marquardt steps with a robust loss (iteratively
//! reweighted least squares).
//!
//! Directions that the photographs do not determine stay at the prior's mean; without the prior, noise would
//! drift along them.

use std::ops::Range;

use super::coordinates::{from_coordinates, limits, to_coordinates};
use super::noise::Noise;
use super::posterior::{NormalEquations, Posterior, cost};
use super::prior::{Prior, same_size};
use crate::Result;
use crate::observation::Observation;
use crate::parallel;
use crate::reflectance::Directions;
use crate::render::{self, BAND_ROWS, Prepared, check_observations, find_directions};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, Svbrdf, bands};

/// Damping of the first step, relative to the diagonal.
const FIRST_DAMPING: f32 = 0.01;
/// Factors of the damping after a successful and after a failed step.
const EASE: f32 = 0.2;
const RAISE: f32 = 8.0;
/// Longest step of a coordinate.
const MAX_STEP: f32 = 0.3;
/// Steps in progress; the caller keeps the maps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Solver {
    prior: Prior,
    noise: Noise,
    /// Sum of the photographs' weights.
    weight: f64,
    /// Damping of each texel, relative to the diagonal.
    damping: Vec<f32>,
    /// Steps taken.
    pub steps: usize,
}

impl Solver {
    /// Before the first step from `maps`, which are clamped to their range.
    ///
    /// # Errors
    /// When sizes differ, or a sigma, the noise or the Huber threshold is not positive.
    pub fn new(
        maps: &mut Svbrdf,
        observations: &[Observation],
        prior: &Prior,
        noise: Noise,
    ) -> Result<Self> {
        prior.check()?;
        noise.check()?;
        check_observations(maps, observations)?;
        maps.clamp();
        let weight = observations.iter().map(Observation::total_weight).sum();
        let damping = vec![FIRST_DAMPING; maps.texels()];
        Ok(Self { prior: *prior, noise, weight, damping, steps: 0 })
    }

    /// One step of the maps round the prior's `mean`; returns the mean log-L1 after it. Maps are valid after
    /// every step. Does nothing if all weights are 0.
    ///
    /// # Errors
    /// When sizes differ.
    pub fn step(
        &mut self,
        maps: &mut Svbrdf,
        mean: &Svbrdf,
        observations: &[Observation],
    ) -> Result<f64> {
        same_size("mean", maps, mean)?;
        check_observations(maps, observations)?;
        self.steps += 1;
        if self.weight <= 0.0 {
            return Ok(0.0);
        }
        let (width, height) = (maps.width(), maps.height());
        let prepared = Prepared::new(maps, observations);
        let posterior = &Posterior::new(&prepared, self.noise, &self.prior, mean);
        let damping = bands::<1, _>(&mut self.damping, width, height, BAND_ROWS);
        let parts = bands::<CHANNELS, _>(maps.planes_mut(), width, height, BAND_ROWS).zip(damping);
        let losses: Vec<f64> = parallel::map_parts(parts, |band, (planes, [damping])| {
            let first_row = band * BAND_ROWS;
            dispatch(StepBand { posterior, mean, first_row, planes, damping })
        });
        Ok(losses.iter().sum::<f64>() / (3.0 * self.weight))
    }
}

/// Takes `steps` steps at once; returns the mean log-L1 after them.
#[cfg(test)]
pub(super) fn solve(
    maps: &mut Svbrdf,
    mean: &Svbrdf,
    prior: &Prior,
    observations: &[Observation],
    steps: usize,
    noise: Noise,
) -> Result<f64> {
    let mut solver = Solver::new(maps, observations, prior, noise)?;
    (0..steps).try_fold(f64::NAN, |_, _| solver.step(maps, mean, observations))
}

struct StepBand<'a> {
    posterior: &'a Posterior<'a>,
    mean: &'a Svbrdf,
    first_row: usize,
    planes: [&'a mut [f32]; CHANNELS],
    damping: &'a mut [f32],
}

impl Kernel for StepBand<'_> {
    /// Weighted log-L1 loss after the step.
    type Output = f64;

    #[inline(always)]
    fn run<V: Lanes>(self) -> f64 {
        let Self { posterior, mean, first_row, mut planes, damping } = self;
        let width = mean.width();
        let mut sum = 0.0;
        let mut directions = vec![Directions::none(); posterior.observations.len()];
        for r in 0..damping.len() / width {
            let row = first_row + r;
            let mut row_sum = V::splat(0.0);
            for column in (0..width).step_by(LANES) {
                let end = (column + LANES).min(width);
                let (texels, here) =
                    (row * width + column..row * width + end, r * width + column..r * width + end);
                let mut x = [V::splat(0.0); CHANNELS];
                for (x, plane) in x.iter_mut().zip(&planes) {
                    *x = V::load(&plane[here.clone()], 0.0);
                }
                let mean = render::load_texels::<V>(mean, texels.start, texels.end);
                let mut damped = V::load(&damping[here.clone()], 1.0);
                let (mut x, mean) = (to_coordinates(x), to_coordinates(mean));
                find_directions(posterior.observations, column, row, &mut directions);
                row_sum += step(posterior, &mut x, &mean, &mut damped, &directions, texels);
                damped.store(&mut damping[here.clone()]);
                for (value, plane) in from_coordinates(&x).into_iter().zip(&mut planes) {
                    value.store(&mut plane[here.clone()]);
                }
            }
            sum += row_sum.sum();
        }
        sum
    }
}

/// One damped Gauss-Newton step of eight texels. A texel whose cost rises is tried once more with stronger
/// damping, then stays. Returns the weighted log-L1 loss after the step.
#[inline(always)]
fn step<V: Lanes>(
    posterior: &Posterior,
    x: &mut [V; CHANNELS],
    mean: &[V; CHANNELS],
    damping: &mut V,
    directions: &[Directions<V>],
    texels: Range<usize>,
) -> V {
    let (equations, (mut best, mut loss)) =
        NormalEquations::new(posterior, x, mean, directions, texels.clone());
    let (from, zero, one) = (*x, V::splat(0.0), V::splat(1.0));
    let mut waiting = one;
    for _ in 0..2 {
        let delta = equations.solve(*damping);
        let mut trial = from;
        for c in 0..CHANNELS {
            let (low, high) = limits(c);
            let delta = delta[c].clamp(-MAX_STEP, MAX_STEP);
            trial[c] = (from[c] + delta).clamp(low, high);
        }
        let (cost, trial_loss) = cost(posterior, &trial, mean, directions, texels.clone());
        // 1 for a texel that waits and improves.
        let taken = best.if_greater(cost, waiting, zero);
        for c in 0..CHANNELS {
            x[c] = taken.if_greater(zero, trial[c], x[c]);
        }
        loss = taken.if_greater(zero, trial_loss, loss);
        best = taken.if_greater(zero, cost, best);
        let eased = *damping * V::splat(EASE);
        let raised = waiting.if_greater(zero, *damping * V::splat(RAISE), *damping);
        *damping = taken.if_greater(zero, eased, raised).clamp(1e-6, 1e4);
        waiting = waiting - taken;
        if waiting.sum() == 0.0 {
            break;
        }
    }
    loss
}

#[cfg(test)]
mod reference_tests;
#[cfg(test)]
pub(crate) mod tests;
