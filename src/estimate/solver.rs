//! Maximises the posterior of each texel by Levenberg-Marquardt steps with a robust loss (iteratively
//! reweighted least squares).
//!
//! Directions that the photographs do not determine stay at the prior's mean; without the prior, noise would
//! drift along them.
//!
//! Each step re-estimates two hyper-parameters: the noise of each colour, from the residuals, and the sigma
//! of slopes, which grows for a material that is bumpier than expected ([`probable_variance`]).

use std::ops::Range;

use super::coordinates::{from_coordinates, limits, to_coordinates};
use super::noise::Noise;
use super::options::NoiseOptions;
use super::posterior::{NormalEquations, Posterior, cost};
use super::prior::{Prior, probable_variance, same_size};
use crate::Result;
use crate::observation::Observation;
use crate::parallel;
use crate::reflectance::Directions;
use crate::render::{self, BAND_ROWS, Prepared, check_observations, find_directions};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, Svbrdf, bands, channel};

/// Damping of the first step, relative to the diagonal.
const FIRST_DAMPING: f32 = 0.01;
/// Factors of the damping after a successful and after a failed step.
const EASE: f32 = 0.2;
const RAISE: f32 = 8.0;
/// Longest step of a coordinate.
const MAX_STEP: f32 = 0.3;
/// Largest ratio of the estimated sigma of slopes to the prior's.
const MAX_WIDENING: f32 = 4.0;

/// Result of the steps so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Summary {
    /// Steps taken.
    pub steps: usize,
    /// [`render::loss`] of the maps; NaN before the first step.
    pub loss: f64,
    /// The prior with the estimated sigma of slopes.
    pub prior: Prior,
    /// Scale of the log residuals in each colour: demosaicking and JPEG leave two or three times as much in
    /// red and blue as in green.
    pub noise: [f32; 3],
}

/// Steps in progress; the caller keeps the maps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Solver {
    options: NoiseOptions,
    /// The given prior.
    prior: Prior,
    pub state: SolverState,
    /// Sum of the photographs' weights.
    weight: f64,
    /// Whether noise and sigma of slopes are fixed.
    fixed: bool,
}

/// State between steps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SolverState {
    pub steps: usize,
    pub loss: f64,
    /// Variance of slopes relative to the prior's.
    pub widening: f32,
    pub noise: [Noise; 3],
    /// Damping of each texel, relative to the diagonal.
    pub damping: Vec<f32>,
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
        options: &NoiseOptions,
    ) -> Result<Self> {
        prior.check()?;
        options.check()?;
        maps.clamp();
        let state = SolverState {
            steps: 0,
            loss: f64::NAN,
            widening: 1.0,
            noise: [Noise::expected(options); 3],
            damping: vec![FIRST_DAMPING; maps.texels()],
        };
        check_observations(maps, observations)?;
        let weight = observations.iter().map(Observation::total_weight).sum();
        Ok(Self { options: *options, prior: *prior, state, weight, fixed: false })
    }

    /// Fixes the noise and the sigma of slopes; does nothing for `None`.
    pub fn with_noise(mut self, noise: Option<f32>) -> Self {
        if let Some(scale) = noise {
            self.state.noise = [Noise { scale, huber: self.options.huber }; 3];
            self.fixed = true;
        }
        self
    }

    /// Result of the steps so far.
    pub fn summary(&self) -> Summary {
        let SolverState { steps, loss, noise, .. } = self.state;
        let mut prior = self.prior;
        for (wide, sigma) in prior.sigma[..2].iter_mut().zip(self.prior.sigma) {
            *wide = sigma * self.state.widening.sqrt();
        }
        Summary { steps, loss, prior, noise: noise.map(|n| n.scale) }
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
        self.state.steps += 1;
        if self.weight <= 0.0 {
            self.state.loss = 0.0;
            return Ok(0.0);
        }
        let (width, height, texels) = (maps.width(), maps.height(), maps.texels());
        let prepared = Prepared::new(maps, observations);
        let posterior = Posterior {
            observations: &prepared,
            noise: self.state.noise,
            precision: self.precision(),
            lobes: mean,
        };
        let damping = bands::<1, _>(&mut self.state.damping, width, height, BAND_ROWS);
        let parts = bands::<CHANNELS, _>(maps.planes_mut(), width, height, BAND_ROWS).zip(damping);
        let posterior = &posterior;
        let sums: Vec<[f64; 5]> = parallel::map_parts(parts, |band, (planes, [damping])| {
            let first_row = band * BAND_ROWS;
            dispatch(StepBand { posterior, mean, first_row, planes, damping })
        });
        let total =
            sums.iter().fold([0.0; 5], |sum, band| std::array::from_fn(|i| sum[i] + band[i]));
        let [squares, determined, losses @ ..] = total;
        self.state.loss = losses.iter().sum::<f64>() / (3.0 * self.weight);
        if self.fixed {
            return Ok(self.state.loss);
        }
        self.widen(squares, determined);
        let photographs = self.weight / texels as f64;
        let estimated =
            |loss: f64| Noise::estimated(&self.options, loss / self.weight, photographs);
        self.state.noise = losses.map(estimated);
        Ok(self.state.loss)
    }

    /// 1 / sigma², with the estimated sigma of slopes.
    fn precision(&self) -> [f32; CHANNELS] {
        let mut precision = self.prior.precision();
        for (precision, sigma) in precision[..2].iter_mut().zip(self.prior.sigma) {
            *precision = (sigma * sigma * self.state.widening).recip();
        }
        precision
    }

    /// Estimates the variance of slopes from the sums of their squared deviations, in sigmas, and of the
    /// fractions that the photographs determine.
    fn widen(&mut self, squares: f64, determined: f64) {
        let squares = f64::from(self.state.widening) * squares;
        if let Some(variance) = probable_variance(squares, determined) {
            self.state.widening = (variance as f32).clamp(1.0, MAX_WIDENING * MAX_WIDENING);
        }
    }
}

/// Takes `steps` steps at once.
#[cfg(test)]
pub(super) fn solve(
    maps: &mut Svbrdf,
    mean: &Svbrdf,
    prior: &Prior,
    observations: &[Observation],
    steps: usize,
    options: &NoiseOptions,
) -> Result<Summary> {
    let mut solver = Solver::new(maps, observations, prior, options)?;
    for _ in 0..steps {
        solver.step(maps, mean, observations)?;
    }
    Ok(solver.summary())
}

struct StepBand<'a> {
    posterior: &'a Posterior<'a>,
    mean: &'a Svbrdf,
    first_row: usize,
    planes: [&'a mut [f32]; CHANNELS],
    damping: &'a mut [f32],
}

impl Kernel for StepBand<'_> {
    /// The two sums of [`Solver::widen`] before the step, and the weighted log-L1 loss of each colour after
    /// it.
    type Output = [f64; 5];

    #[inline(always)]
    fn run<V: Lanes>(self) -> [f64; 5] {
        let Self { posterior, mean, first_row, mut planes, damping } = self;
        let width = mean.width();
        let mut sum = [0.0; 5];
        let mut directions = vec![Directions::none(); posterior.observations.len()];
        for r in 0..damping.len() / width {
            let row = first_row + r;
            let mut row_sum = [V::splat(0.0); 5];
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
                let sums = step(posterior, &mut x, &mean, &mut damped, &directions, texels);
                row_sum.iter_mut().zip(sums).for_each(|(a, b)| *a += b);
                damped.store(&mut damping[here.clone()]);
                for (value, plane) in from_coordinates(&x).into_iter().zip(&mut planes) {
                    value.store(&mut plane[here.clone()]);
                }
            }
            for (a, b) in sum.iter_mut().zip(row_sum) {
                *a += b.sum();
            }
        }
        sum
    }
}

/// One damped Gauss-Newton step of eight texels. A texel whose cost rises is tried once more with stronger
/// damping, then stays. Returns the slopes' squared deviations from the mean in sigmas and the number of
/// slopes that the photographs determine, both before the step, and the weighted log-L1 loss of each colour
/// after it.
#[inline(always)]
fn step<V: Lanes>(
    posterior: &Posterior,
    x: &mut [V; CHANNELS],
    mean: &[V; CHANNELS],
    damping: &mut V,
    directions: &[Directions<V>],
    texels: Range<usize>,
) -> [V; 5] {
    let (equations, start) = NormalEquations::new(posterior, x, mean, directions, texels.clone());
    let (mut squares, mut determined) = (V::splat(0.0), V::splat(0.0));
    let factor = equations.factor(V::splat(0.0));
    for c in [channel::SLOPE_X, channel::SLOPE_Y] {
        let precision = V::splat(posterior.precision[c]);
        let deviation = x[c] - mean[c];
        squares = (deviation * deviation).mul_add(precision, squares);
        determined += V::splat(1.0) - factor.variance(c) * precision;
    }
    let (from, zero, one) = (*x, V::splat(0.0), V::splat(1.0));
    let (mut best, mut loss) = start;
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
        for c in 0..3 {
            loss[c] = taken.if_greater(zero, trial_loss[c], loss[c]);
        }
        best = taken.if_greater(zero, cost, best);
        let eased = *damping * V::splat(EASE);
        let raised = waiting.if_greater(zero, *damping * V::splat(RAISE), *damping);
        *damping = taken.if_greater(zero, eased, raised).clamp(1e-6, 1e4);
        waiting = waiting - taken;
        if waiting.sum() == 0.0 {
            break;
        }
    }
    [squares, determined, loss[0], loss[1], loss[2]]
}

#[cfg(test)]
mod reference_tests;
#[cfg(test)]
pub(crate) mod tests;
