//! Sigmas of the prior, inferred from how far a material turns out to be off its mean.
//!
//! A sigma that suits most materials is too wide for some: where a sheet of metal is flat, it lets the noise of
//! the photographs into the slopes. So a sigma is set to the value that makes the deviations found so far most
//! probable ([`probable_variance`]), texels taken for independent. That trusts the scale of the noise, which is
//! only roughly known. But noise is white, and relief is not: neighbouring texels share it, and no sigma is made
//! less than twice that share.

use std::ops::Range;

use crate::estimate::options::ReliefOptions;
use crate::estimate::posterior::Covariance;
use crate::estimate::prior::{Prior, probable_variance, to_coordinate};
use crate::svbrdf::Svbrdf;

/// Rounds of the search for the most probable sigma: it moves by less than 1 % in further ones.
const ROUNDS: usize = 12;
/// What photographs must tell of a parameter to count, in units of what the prior does.
const MIN_INFORMATION: f32 = 1e-3;
/// Least fraction of the prior's variance that photographs leave: rounding.
const MIN_OPEN: f32 = 1e-3;

/// Neighbours: columns to the right, rows below.
const NEIGHBOURS: [[usize; 2]; 7] = [[1, 0], [0, 1], [1, 1], [2, 0], [0, 2], [3, 0], [0, 3]];

/// Deviations of maps from the prior's mean, and what photographs tell of them.
pub(super) struct Deviations<'a> {
    pub options: &'a ReliefOptions,
    pub maps: &'a Svbrdf,
    pub mean: &'a Svbrdf,
    /// Of the steps that found them.
    pub prior: &'a Prior,
    /// Of every n-th texel of every n-th row, in sigmas of that prior.
    pub covariance: &'a Covariance,
    /// Noise that was found, in units of that which the covariance expects.
    pub noise: f32,
    /// Columns of the covariance.
    pub columns: usize,
}

impl Deviations<'_> {
    /// `prior`, its sigma of some parameters, which share one, as narrow as the material.
    pub fn narrowed(&self, prior: &Prior, group: Range<usize>) -> Prior {
        let ReliefOptions { min_fraction, min_common } = *self.options;
        let widest = f64::from(prior.sigma[group.start]);
        let least = (min_common * self.common(group.clone())).max(min_fraction * widest);
        let sigma = self.most_probable(group.clone(), least.min(widest), widest) as f32;
        let mut narrowed = *prior;
        narrowed.sigma[group].fill(sigma);
        narrowed
    }

    /// Deviation of a parameter.
    fn off(&self, c: usize, t: usize) -> f32 {
        to_coordinate(c, self.maps.plane(c)[t]) - to_coordinate(c, self.mean.plane(c)[t])
    }

    /// Texels and their index in the covariance.
    fn texels(&self) -> impl Iterator<Item = (usize, usize)> {
        let (width, height) = (self.maps.width(), self.maps.height());
        let (columns, step) = (self.columns, width / self.columns);
        (0..height / step).flat_map(move |y| {
            (0..columns).map(move |x| (x * step + y * step * width, x + y * columns))
        })
    }

    /// Root of the largest autocovariance of deviations.
    fn common(&self, group: Range<usize>) -> f64 {
        let (width, height) = (self.maps.width(), self.maps.height());
        let (mut sums, mut count) = ([0.0; NEIGHBOURS.len()], 0.0);
        for c in group {
            for (t, _) in self.texels() {
                let (x, y, here) = (t % width, t / width, self.off(c, t));
                for (sum, [right, below]) in sums.iter_mut().zip(NEIGHBOURS) {
                    if x + right < width && y + below < height {
                        *sum += f64::from(here * self.off(c, t + right + below * width));
                    }
                }
                count += 1.0;
            }
        }
        let largest = sums.into_iter().fold(0.0, |most: f64, sum| most.max(sum.abs()));
        (largest / count).sqrt()
    }

    /// The sigma between `least` and `widest` that makes the deviations most probable.
    fn most_probable(&self, group: Range<usize>, least: f64, widest: f64) -> f64 {
        if least >= widest {
            return widest;
        }
        // deviations as they would be without a prior, squared, and their precision
        let mut precise = Vec::with_capacity(group.len() * self.covariance.plane(0, 0).len());
        for c in group {
            let sigma = self.prior.sigma[c];
            let open = self.covariance.plane(c, c);
            for (t, i) in self.texels() {
                let open = open[i].clamp(MIN_OPEN, 1.0);
                // photographs' precision in units of the prior's
                let data = (1.0 - open) / (open * self.noise);
                if data > MIN_INFORMATION {
                    let known = data / (1.0 + data);
                    precise.push([(self.off(c, t) / known).powi(2), data / (sigma * sigma)]);
                }
            }
        }
        let mut sigma = widest;
        for _ in 0..ROUNDS {
            let variance = (sigma * sigma) as f32;
            let (mut squares, mut known) = (0.0, 0.0);
            for [square, precision] in &precise {
                let share = precision * variance / (1.0 + precision * variance);
                squares += f64::from(square * share * share);
                known += f64::from(share);
            }
            let Some(variance) = probable_variance(squares, known) else { return widest };
            sigma = variance.sqrt().clamp(least, widest);
        }
        sigma
    }
}

#[cfg(test)]
mod tests;
