//! Per-texel refinement of maps: the most probable texel given all photographs and an estimate
//! from elsewhere (the latent fit).
//!
//! Once poses and lights are known, texels do not depend on each other: nine unknowns against
//! three log residuals a photograph. Maximised is
//!
//! ```text
//! -sum over photographs, channels of weight * huber(log residual) / noise
//! -sum over parameters of (x - prior mean)² / (2 sigma²)
//! ```
//!
//! by Levenberg-Marquardt steps, the L1 re-weighted in each (iteratively re-weighted least
//! squares). The colours of a texel meet only in normal and roughness, so each channel's 2x2 block
//! (diffuse, specular) is eliminated first (Schur complement), and 3x3 is left. What the
//! photographs cannot see stays at the prior mean: without it, noise would drift along such
//! directions while the loss falls. The scale `noise` is estimated along with the maps, one for all
//! texels in each colour: the better the photographs agree, the less the prior counts. So is the sigma of slopes,
//! where a material turns out to be bumpier than the prior expects: squared deviations by the
//! number of slopes that the photographs determine (MacKay, *Bayesian interpolation*, 1992).
//!
//! Coordinates are slopes, *square roots* of albedos, and roughness, so that a sigma means about
//! the same for dark and bright materials.

mod evidence;
mod normal_equations;
mod spread;

use crate::observation::Observation;
use crate::parallel;
use crate::reflectance::Directions;
use crate::render::{self, BAND_ROWS, Prepared, check_observations, find_directions};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, MAX_SLOPE, MIN_ROUGHNESS, Svbrdf, bands, channel};
use crate::{Error, Result};
pub(crate) use evidence::{Covariance, Evidence, GLOSS, covariance, evidence, slope_precision};
use normal_equations::{NormalEquations, cost};
pub(crate) use spread::Found;
use std::ops::{ControlFlow, Range};

/// How far an estimate is expected to be off, per parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Standard deviations in the order of [`channel`]: slopes, square roots of albedos, roughness.
    pub sigma: [f32; CHANNELS],
}

impl Default for Prior {
    /// Errors of a fair estimate from a few photographs.
    fn default() -> Self {
        Self { sigma: [0.1, 0.1, 0.08, 0.08, 0.08, 0.1, 0.1, 0.1, 0.12] }
    }
}

impl Prior {
    /// The errors of estimates of known materials: root mean squares, at least 0.001, pooled over
    /// the three colours.
    ///
    /// # Errors
    /// When sizes differ or there is no pair.
    pub fn from_estimates<'a>(
        pairs: impl IntoIterator<Item = (&'a Svbrdf, &'a Svbrdf)>,
    ) -> Result<Self> {
        let (mut sums, mut count) = ([0.0_f64; CHANNELS], 0);
        for (estimate, truth) in pairs {
            same_size("truth", estimate, truth)?;
            count += estimate.texels();
            for (c, sum) in sums.iter_mut().enumerate() {
                for (&a, &b) in estimate.plane(c).iter().zip(truth.plane(c)) {
                    *sum += (to_coordinate(c, a) - to_coordinate(c, b)).powi(2) as f64;
                }
            }
        }
        if count == 0 {
            return Err(Error::argument("pairs", "none given, at least one expected"));
        }
        let rms = |channels: std::ops::Range<usize>| {
            let (length, sum) = (channels.len(), sums[channels].iter().sum::<f64>());
            ((sum / (length * count) as f64).sqrt() as f32).max(1e-3)
        };
        let slope = rms(0..2);
        let (diffuse, specular) = (rms(2..5), rms(5..8));
        let mut sigma = [slope; CHANNELS];
        sigma[2..5].fill(diffuse);
        sigma[5..8].fill(specular);
        sigma[channel::ROUGHNESS] = rms(8..9);
        Ok(Self { sigma })
    }
}

/// Options of [`refine`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Levenberg-Marquardt steps.
    pub steps: usize,
    /// Expected scale of the log residuals that noise and model leave (mean of absolute values):
    /// where the estimate of the scale begins. It counts as much as two photographs as long as there
    /// are no more, as a sixth of one from four on; at most twice of it is ever assumed.
    pub noise: f32,
    /// Log residual below which the loss is quadratic, at most: less where there is little noise.
    pub huber: f32,
}

impl Default for Options {
    fn default() -> Self {
        Self { steps: 8, noise: 0.05, huber: 0.02 }
    }
}

/// What [`refine`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Steps taken.
    pub steps: usize,
    /// [`render::loss`] of the start.
    pub loss_before: f64,
    /// [`render::loss`] of the result.
    pub loss_after: f64,
    /// Whether the caller ended the refinement early.
    pub stopped: bool,
    /// The prior, its slopes as wide as the material has shown.
    pub prior: Prior,
    /// Scale of the log residuals that noise and model leave, as found in each colour: demosaicking
    /// and JPEG leave red and blue two or three times what they leave green.
    pub noise: [f32; 3],
}

impl Report {
    /// Mean of the colours' noise.
    pub fn mean_noise(&self) -> f32 {
        self.noise.iter().sum::<f32>() / 3.0
    }
}

/// Damping of the first step, relative to the diagonal.
const FIRST_DAMPING: f32 = 0.01;

/// Log residual below which the loss is quadratic, relative to the noise.
const HUBER_NOISE: f32 = 3.0;

/// Residuals of a texel that its parameters take up.
const FREE: f64 = 6.0;

/// Residuals of a texel that the expected noise counts as at least.
const LEAST_BELIEF: f64 = 0.5;

/// How much wider than the prior's the slopes' deviations may be assumed.
const MAX_WIDENING: f32 = 4.0;

/// Longest step of a parameter.
const MAX_STEP: f32 = 0.3;

/// Least square root of an albedo: at zero its derivative would vanish for good. As an albedo it is
/// far below what [`EPSILON`](crate::loss::EPSILON) hides; more of it slopes and gloss would explain
/// away.
pub(crate) const MIN_ROOT: f32 = 0.001;

/// Refines maps in place, from their present values, around `prior_mean`. After each step `after`
/// gets its number (from 1) and the mean log-L1 loss so far, and may end the work; maps are valid
/// after every step.
///
/// # Errors
/// When sizes differ, or a sigma, the noise or the Huber threshold is not positive.
pub fn refine(
    maps: &mut Svbrdf,
    prior_mean: &Svbrdf,
    prior: &Prior,
    observations: &[Observation],
    options: &Options,
    after: &mut dyn FnMut(usize, f64) -> ControlFlow<()>,
) -> Result<Report> {
    same_size("prior_mean", maps, prior_mean)?;
    check_observations(maps, observations)?;
    let positive = |x: f32| x.is_finite() && x > 0.0;
    if !prior.sigma.iter().all(|&s| positive(s)) {
        return Err(Error::argument("prior.sigma", "all must be positive numbers"));
    }
    if !(positive(options.noise) && positive(options.huber)) {
        return Err(Error::argument("options", "noise and huber must be positive numbers"));
    }
    maps.clamp();
    let (width, height) = (maps.width(), maps.height());
    let prepared = Prepared::new(maps, observations);
    let weights: f64 = observations.iter().map(Observation::total_weight).sum();
    let loss_before = render::loss(maps, observations);
    let mut report = Report {
        steps: 0,
        loss_before,
        loss_after: loss_before,
        stopped: false,
        prior: *prior,
        noise: [options.noise; 3],
    };
    let mut model = Model {
        observations: &prepared,
        noise: [Noise::expected(options); 3],
        precision: prior.sigma.map(|s| (s * s).recip()),
        widening: 1.0,
    };
    let mut damping = vec![FIRST_DAMPING; maps.texels()];
    for step in 1..=options.steps {
        if weights <= 0.0 {
            break;
        }
        let parts =
            bands::<CHANNELS, _>(maps.planes_mut(), width, height, BAND_ROWS).zip(bands::<1, _>(
                &mut damping,
                width,
                height,
                BAND_ROWS,
            ));
        let sums: Vec<[f64; 5]> = parallel::map_parts(parts, |band, (planes, [damping])| {
            let first_row = band * BAND_ROWS;
            dispatch(StepBand { model: &model, prior_mean, first_row, planes, damping })
        });
        report.steps = step;
        let total =
            sums.iter().fold([0.0; 5], |sum, band| std::array::from_fn(|i| sum[i] + band[i]));
        let [squares, determined, losses @ ..] = total;
        report.loss_after = losses.iter().sum::<f64>() / (3.0 * weights);
        model.widen_slopes(&prior.sigma, squares, determined);
        let photographs = weights / maps.texels() as f64;
        report.noise = losses.map(|l| noise_scale(options.noise, l / weights, photographs));
        model.noise = report.noise.map(|noise| Noise::found(noise, options));
        for (wide, sigma) in report.prior.sigma[..2].iter_mut().zip(prior.sigma) {
            *wide = sigma * model.widening.sqrt();
        }
        if after(step, report.loss_after).is_break() {
            report.stopped = true;
            break;
        }
    }
    Ok(report)
}

fn same_size(argument: &'static str, a: &Svbrdf, b: &Svbrdf) -> Result<()> {
    if (a.width(), a.height()) == (b.width(), b.height()) {
        return Ok(());
    }
    let message =
        format!("{}x{} texels, expected {}x{}", b.width(), b.height(), a.width(), a.height());
    Err(Error::argument(argument, message))
}

/// Scale of the residuals once the parameters' own freedom is taken off: of nine parameters the
/// prior leaves about six to the photographs. `photographs` is their mean number per texel.
fn noise_scale(expected: f32, loss: f64, photographs: f64) -> f32 {
    let residuals = 3.0 * photographs;
    let telling = (residuals - FREE).max(0.0);
    let belief = (FREE - telling).max(LEAST_BELIEF);
    let estimate = (belief * expected as f64 + residuals * loss) / (belief + telling);
    (estimate as f32).min(2.0 * expected)
}

/// Coordinate in which steps are taken, of a natural parameter.
pub(crate) fn to_coordinate(c: usize, value: f32) -> f32 {
    if (channel::DIFFUSE..channel::ROUGHNESS).contains(&c) { value.max(0.0).sqrt() } else { value }
}

/// The probability of a texel, apart from its prior mean.
struct Model<'a> {
    observations: &'a [Prepared<'a>],
    /// Of each colour.
    noise: [Noise; 3],
    /// 1 / sigma².
    precision: [f32; CHANNELS],
    /// Variance of slopes in units of the prior's.
    widening: f32,
}

/// How far log residuals are expected to be off.
#[derive(Clone, Copy)]
struct Noise {
    /// 1 / scale.
    inverse: f32,
    /// Residual below which the objective is quadratic.
    huber: f32,
}

impl Noise {
    fn expected(options: &Options) -> Self {
        Self { inverse: options.noise.recip(), huber: options.huber }
    }

    fn found(noise: f32, options: &Options) -> Self {
        Self { inverse: noise.recip(), huber: (HUBER_NOISE * noise).min(options.huber) }
    }
}

impl Model<'_> {
    /// Widens the prior of slopes to what was found: sums of squared deviations in sigmas, and of
    /// the shares of the slopes that the photographs determine.
    fn widen_slopes(&mut self, sigma: &[f32; CHANNELS], squares: f64, determined: f64) {
        if determined > 0.0 {
            let found = f64::from(self.widening) * squares / determined;
            self.widening = (found as f32).clamp(1.0, MAX_WIDENING * MAX_WIDENING);
        }
        for (precision, sigma) in self.precision[..2].iter_mut().zip(sigma) {
            *precision = (sigma * sigma * self.widening).recip();
        }
    }
}

struct StepBand<'a> {
    model: &'a Model<'a>,
    prior_mean: &'a Svbrdf,
    first_row: usize,
    planes: [&'a mut [f32]; CHANNELS],
    damping: &'a mut [f32],
}

impl Kernel for StepBand<'_> {
    /// Sums of what [`Model::widen_slopes`] needs of before the step, and of the weighted log-L1
    /// losses of each colour after it.
    type Output = [f64; 5];

    #[inline(always)]
    fn run<V: Lanes>(self) -> [f64; 5] {
        let width = self.prior_mean.width();
        let mut sum = [0.0; 5];
        let mut directions = vec![Directions::none(); self.model.observations.len()];
        for r in 0..self.damping.len() / width {
            let row = self.first_row + r;
            let mut row_sum = [V::splat(0.0); 5];
            for column in (0..width).step_by(LANES) {
                let end = (column + LANES).min(width);
                let here = r * width + column..r * width + end;
                let mut x = [V::splat(0.0); CHANNELS];
                for (x, plane) in x.iter_mut().zip(&self.planes) {
                    *x = V::load(&plane[here.clone()], 0.0);
                }
                let mean = render::load_texels::<V>(
                    self.prior_mean,
                    row * width + column,
                    row * width + end,
                );
                let mut damping = V::load(&self.damping[here.clone()], 1.0);
                let (mut x, mean) = (coordinates(x), coordinates(mean));
                find_directions(self.model.observations, column, row, &mut directions);
                let texels = row * width + column..row * width + end;
                let sums = step(self.model, &mut x, &mean, &mut damping, &directions, texels);
                row_sum.iter_mut().zip(sums).for_each(|(a, b)| *a += b);
                damping.store(&mut self.damping[here.clone()]);
                for c in 0..CHANNELS {
                    let squared = (channel::DIFFUSE..channel::ROUGHNESS).contains(&c);
                    let value = if squared { x[c] * x[c] } else { x[c] };
                    value.store(&mut self.planes[c][here.clone()]);
                }
            }
            for (a, b) in sum.iter_mut().zip(row_sum) {
                *a += b.sum();
            }
        }
        sum
    }
}

/// One damped Gauss-Newton step of eight texels; a texel whose step does not help is tried once
/// more with stronger damping, else stays. Answers of before it the squares of the slopes'
/// deviations from the mean in sigmas, and how many of the two slopes the photographs determine; and
/// of after it the weighted log-L1 loss of each colour.
#[inline(always)]
fn step<V: Lanes>(
    model: &Model,
    x: &mut [V; CHANNELS],
    mean: &[V; CHANNELS],
    damping: &mut V,
    directions: &[Directions<V>],
    texels: Range<usize>,
) -> [V; 5] {
    let (equations, start) = NormalEquations::new(model, x, mean, directions, texels.clone());
    let (mut squares, mut determined) = (V::splat(0.0), V::splat(0.0));
    let slopes = [channel::SLOPE_X, channel::SLOPE_Y];
    for (c, variance) in slopes.into_iter().zip(equations.slope_variances()) {
        let precision = V::splat(model.precision[c]);
        let deviation = x[c] - mean[c];
        squares = (deviation * deviation).mul_add(precision, squares);
        determined += V::splat(1.0) - variance * precision;
    }
    let (from, zero, one) = (*x, V::splat(0.0), V::splat(1.0));
    let (mut best, mut loss) = start;
    let mut waiting = one;
    for _ in 0..2 {
        let delta = equations.solve(*damping);
        let mut trial = from;
        for c in 0..CHANNELS {
            let (low, high) = limits(c);
            trial[c] = (from[c] + delta[c].clamp(-MAX_STEP, MAX_STEP)).clamp(low, high);
        }
        let (cost, trial_loss) = cost(model, &trial, mean, directions, texels.clone());
        // 1 where the texel waited for a better value and this is one.
        let taken = best.if_greater(cost, waiting, zero);
        for c in 0..CHANNELS {
            x[c] = taken.if_greater(zero, trial[c], x[c]);
        }
        for c in 0..3 {
            loss[c] = taken.if_greater(zero, trial_loss[c], loss[c]);
        }
        best = taken.if_greater(zero, cost, best);
        let eased = *damping * V::splat(0.2);
        let raised = waiting.if_greater(zero, *damping * V::splat(8.0), *damping);
        *damping = taken.if_greater(zero, eased, raised).clamp(1e-6, 1e4);
        waiting = waiting - taken;
        if waiting.sum() == 0.0 {
            break;
        }
    }
    [squares, determined, loss[0], loss[1], loss[2]]
}

#[inline(always)]
fn coordinates<V: Lanes>(natural: [V; CHANNELS]) -> [V; CHANNELS] {
    let mut out = natural;
    for c in channel::DIFFUSE..channel::ROUGHNESS {
        out[c] = natural[c].max(V::splat(MIN_ROOT * MIN_ROOT)).sqrt();
    }
    out
}

#[inline(always)]
fn limits(c: usize) -> (f32, f32) {
    match c {
        channel::SLOPE_X | channel::SLOPE_Y => (-MAX_SLOPE, MAX_SLOPE),
        channel::ROUGHNESS => (MIN_ROUGHNESS, 1.0),
        _ => (MIN_ROOT, 1.0),
    }
}

#[cfg(test)]
mod reference_tests;
#[cfg(test)]
pub(crate) mod tests;
