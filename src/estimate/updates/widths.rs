//! The widths of the prior, inferred from how far a material turns out to be off its mean.
//!
//! A sigma that suits most materials is too wide for some: where a sheet of metal is flat and of one
//! gloss, it lets the photographs' noise into the maps, and every photograph brings more of it. So
//! sigmas are set, one for each kind of parameter, to what makes the deviations found so far most
//! probable ([`probable_variance`]), texels taken for independent. That trusts the
//! scale of the noise, which is roughly known only. Noise is white however, and relief and texture are
//! not: what neighbouring texels have in common is the material's, and no sigma is made less than
//! twice of it.

use std::ops::Range;

use crate::estimate::options::WidthOptions;
use crate::estimate::posterior::Covariance;
use crate::estimate::prior::{Prior, probable_variance, to_coordinate};
use crate::parallel;
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
    pub options: &'a WidthOptions,
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
    /// `prior`, its sigmas of the given parameters, which share one, as narrow as the material.
    pub fn narrowed<const N: usize>(&self, prior: &Prior, groups: [Range<usize>; N]) -> Prior {
        let WidthOptions { min_fraction, min_common, .. } = *self.options;
        let sigmas = parallel::map(N, |i| {
            let group = groups[i].clone();
            let widest = f64::from(prior.sigma[group.start]);
            let least = (min_common * self.common(group.clone())).max(min_fraction * widest);
            self.most_probable(group, least.min(widest), widest) as f32
        });
        let mut narrowed = *prior;
        for (group, sigma) in groups.into_iter().zip(sigmas) {
            narrowed.sigma[group].fill(sigma);
        }
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
mod tests {
    use super::*;
    use crate::estimate::noise::Noise;
    use crate::estimate::options::NoiseOptions;
    use crate::estimate::posterior::{At, covariance};
    use crate::estimate::solver::tests::{errors, gauss, photographs};
    use crate::estimate::solver::{Summary, solve};
    use crate::observation::Observation;
    use crate::render::tests::noise;
    use crate::svbrdf::channel;
    use std::sync::LazyLock;

    const SIDE: usize = 48;
    const SLOPES: Range<usize> = 0..2;
    const ROUGHNESS: Range<usize> = 8..9;

    /// A dark, glossy material with the given slopes.
    fn material(mut slope: impl FnMut(usize, f32, f32) -> f32) -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        for c in 0..9 {
            for (t, v) in maps.plane_mut(c).iter_mut().enumerate() {
                *v = match c {
                    0..2 => slope(c, (t % SIDE) as f32, (t / SIDE) as f32),
                    2..5 => 0.05,
                    5..8 => 0.06,
                    _ => 0.35,
                };
            }
        }
        maps
    }

    fn solved(prior: &Prior, mean: &Svbrdf, photographs: &[Observation]) -> (Svbrdf, Summary) {
        let mut maps = mean.clone();
        let options = &NoiseOptions::default();
        let summary = solve(&mut maps, mean, prior, photographs, 8, options).unwrap();
        (maps, summary)
    }

    fn deviations<'a>(
        maps: &'a Svbrdf,
        mean: &'a Svbrdf,
        summary: &'a Summary,
        covariance: &'a Covariance,
        columns: usize,
    ) -> Deviations<'a> {
        static OPTIONS: LazyLock<WidthOptions> = LazyLock::new(WidthOptions::default);
        let noise = summary.mean_noise() / NoiseOptions::default().expected;
        let prior = &summary.prior;
        Deviations { options: &OPTIONS, maps, mean, prior, covariance, noise, columns }
    }

    fn at<'a>(maps: &'a Svbrdf, mean: &'a Svbrdf, prior: &'a Prior) -> At<'a> {
        At { maps, mean, prior, noise: Noise::expected(&NoiseOptions::default()) }
    }

    /// The prior that steps round a flat mean lead to.
    fn narrowed(truth: &Svbrdf, photographs: &[Observation]) -> (Svbrdf, Prior) {
        let mut mean = truth.clone();
        (0..2).for_each(|c| mean.plane_mut(c).fill(0.0));
        let (maps, summary) = solved(&Prior::default(), &mean, photographs);
        let covariance = covariance(at(&maps, &mean, &summary.prior), photographs);
        let found = deviations(&maps, &mean, &summary, &covariance, SIDE);
        let narrowed = found.narrowed(&Prior::default(), [SLOPES, ROUGHNESS]);
        (mean, narrowed)
    }

    /// Noise that a narrower prior keeps out of flat maps, which a second solution shows.
    #[test]
    fn a_flat_material_is_found_to_be_flat() {
        let truth = material(|_, _, _| 0.0);
        let photographs = photographs(&truth, 5, 0.1, 3);
        let (mean, narrow) = narrowed(&truth, &photographs);
        assert!(narrow.sigma[0] < 0.2 * Prior::default().sigma[0], "{narrow:?}");
        assert!(narrow.sigma[8] < 0.2 * Prior::default().sigma[8], "{narrow:?}");
        assert_eq!(narrow.sigma[2..8], Prior::default().sigma[2..8]);
        let error = |prior| errors(&solved(prior, &mean, &photographs).0, &truth);
        let (wide, narrow) = (error(&Prior::default()), error(&narrow));
        for i in [0, 3] {
            assert!(narrow[i] < 0.5 * wide[i], "{i}: {narrow:?} {wide:?}");
        }
    }

    /// Slopes without anything in common with their neighbours, as noise would be, but seen well.
    #[test]
    fn sigma_comes_to_that_of_what_is_seen() {
        let mut random = noise(5);
        let truth = material(|_, _, _| 0.03 * gauss(&mut random));
        let (_, narrow) = narrowed(&truth, &photographs(&truth, 12, 0.005, 6));
        assert!((narrow.sigma[0] / 0.03 - 1.0).abs() < 0.15, "{narrow:?}");
        assert_eq!(narrow.sigma[0], narrow.sigma[1]);
    }

    /// Neighbours alike: the sigma is twice what they have in common, or stays as it is.
    #[test]
    fn relief_is_no_noise() {
        for (height, expected) in [(0.042, 0.06), (0.2, 0.1)] {
            let wave = |c: usize, x: f32, y: f32| height * (0.2 * if c == 0 { x } else { y }).sin();
            let truth = material(wave);
            let (_, narrow) = narrowed(&truth, &photographs(&truth, 12, 0.01, 7));
            assert!((narrow.sigma[0] / expected - 1.0).abs() < 0.1, "{narrow:?}");
        }
    }

    #[test]
    fn a_coarser_covariance_is_of_every_second_texel() {
        let truth = material(|c, x, y| 0.05 * (0.3 * if c == 0 { x } else { y }).sin());
        let photographs = photographs(&truth, 5, 0.05, 8);
        let mean = material(|_, _, _| 0.0);
        let (maps, summary) = solved(&Prior::default(), &mean, &photographs);
        let prior = &summary.prior;
        let of = |columns: usize| {
            let small: Vec<_> = photographs.iter().map(Observation::downsampled).collect();
            let half = columns < SIDE;
            let covariance = if half {
                covariance(at(&maps.downsampled(), &mean.downsampled(), prior), &small)
            } else {
                covariance(at(&maps, &mean, prior), &photographs)
            };
            let found = deviations(&maps, &mean, &summary, &covariance, columns);
            found.narrowed(&Prior::default(), [SLOPES]).sigma[channel::SLOPE_X]
        };
        let (fine, coarse) = (of(SIDE), of(SIDE / 2));
        assert!((coarse / fine - 1.0).abs() < 0.1, "{fine} {coarse}");
    }

    #[test]
    fn nothing_seen_nothing_narrowed() {
        let truth = material(|_, _, _| 0.0);
        let (_, narrow) = narrowed(&truth, &[]);
        assert_eq!(narrow, Prior::default());
    }
}
