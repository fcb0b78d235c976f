//! The learned prior: what photographs leave open, completed by a network that has seen how fits go
//! wrong.
//!
//! After some steps of the solver every texel has its most probable parameters and their covariance.
//! Where that is as wide as the prior the photographs were silent, and the texel is the prior's mean.
//! A small network looks at the maps, at the base and the mean of the prior, and at the variances, and
//! says where the mean should lie instead: what a bump looks like of which one flank was seen, which
//! gloss goes with the gloss around. It was trained on fits of known materials
//! (`training/train_completion.py`) so that maps *solved round the new mean* come closest to the
//! truth. What photographs do tell therefore stays theirs: the network only moves the mean, and the
//! maps as far as the covariance allows (a learned prior of one step, as in plug-and-play or unrolled
//! reconstruction). It answers in units of what the photographs found the material to be off its
//! prior's mean, so a mirror stays as flat as it was seen to be.
//!
//! It works at 256 texels along the longer side at most; its answer is interpolated.

use std::ops::Range;

use super::widths::Deviations;
use crate::estimate::belief::Belief;
use crate::estimate::noise::Noise;
use crate::estimate::options::{EstimateOptions, WidthOptions};
use crate::estimate::photographs::Photographs;
use crate::estimate::posterior::{At, Covariance, covariance};
use crate::estimate::prior::{Prior, coordinates, from_coordinate, to_coordinate};
use crate::initial_estimate::{COMPLETION_CHANNELS, Networks};
use crate::parallel;
use crate::render::check_observations;
use crate::svbrdf::{CHANNELS, channel, halved};
use crate::{Error, Result, Svbrdf};

/// Texels along the longer side that the network sees, at most: what it was trained on.
pub(in crate::estimate) const TEXELS: usize = 256;
/// Bounds of a material's scales, sigmas, and its least steepness: as in training.
const SCALE: [f32; 2] = [0.02, 2.0];
const MIN_SLOPE: f32 = 0.01;
/// Largest size of an input.
const LIMIT: f32 = 4.0;
/// What natural coordinates other than slopes are measured from, and their scale.
const MIDDLE: f32 = 0.4;
const STRETCH: f32 = 2.0;
/// Scale of differences between estimates.
const DIFFERENCE: f32 = 0.3;
/// Parameters that are measured together: slopes, diffuse, specular albedo, roughness.
const GROUPS: [Range<usize>; 4] = [0..2, 2..5, 5..8, 8..9];

/// A fit as the network sees it, at its resolution: what it learns from.
#[derive(Debug, Clone)]
pub struct FitRecord {
    base: Svbrdf,
    mean: Svbrdf,
    maps: Svbrdf,
    covariance: Covariance,
    /// Of the steps that found the maps.
    prior: Prior,
    photographs: usize,
    /// How often maps were halved.
    halvings: u32,
    widest: Prior,
    /// The noise that the covariance expects.
    noise: f32,
    widths: WidthOptions,
    /// Whether photographs determine texels.
    determined: bool,
}

impl FitRecord {
    /// Of the belief after some steps of the solver.
    ///
    /// # Errors
    /// When sizes differ.
    pub(crate) fn new(
        photographs: &Photographs,
        belief: &Belief,
        options: &EstimateOptions,
    ) -> Result<Self> {
        for maps in [&belief.base, &belief.mean, &belief.maps] {
            check_observations(maps, photographs.full())?;
        }
        let halvings = photographs.halvings_to(TEXELS);
        let small = |maps: &Svbrdf| halved(maps, halvings, Svbrdf::downsampled);
        let base = small(&belief.corrected_base());
        let (mean, maps) = (small(&belief.mean), small(&belief.maps));
        let (prior, noise) = (belief.found, Noise::expected(&options.noise));
        let at = At { maps: &maps, mean: &mean, prior: &prior, noise };
        let covariance = covariance(at, &photographs.level(halvings));
        Ok(Self {
            base,
            mean,
            maps,
            covariance,
            prior,
            photographs: photographs.len(),
            halvings,
            widest: options.prior,
            noise: options.noise.expected,
            widths: options.widths,
            determined: photographs.len() >= options.schedule.determined_from,
        })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.maps.width(), self.maps.height()]
    }

    /// All that there is to learn from: nine planes each of the maps, the base and the mean of the
    /// prior (slopes, roots of albedos, roughness), 45 of the covariance in sigmas of the prior (upper
    /// triangle by rows); then the nine sigmas.
    pub fn planes(&self) -> Vec<f32> {
        let maps = [&self.maps, &self.base, &self.mean].into_iter().flat_map(coordinates);
        maps.chain(self.covariance.planes().iter().copied()).chain(self.prior.sigma).collect()
    }

    /// Moves the mean of the prior to where the network expects the truth, and the maps as far as the
    /// photographs leave them open; sets the widths for the steps that follow.
    pub(crate) fn update(&self, networks: &Networks, belief: &mut Belief) -> Result<()> {
        let full = self.size().map(|n| n << self.halvings);
        if [belief.maps.width(), belief.maps.height()] != full {
            return Err(Error::argument("maps", "not of the size of the record's"));
        }
        belief.prior = self.narrowed(belief);
        let [moved, follows] = self.shifts(networks)?;
        move_by(&mut belief.mean, &moved);
        move_by(&mut belief.maps, &follows);
        Ok(())
    }

    /// The prior as narrow as the material. Diffuse albedo keeps its sigma, every photograph tells it.
    fn narrowed(&self, belief: &Belief) -> Prior {
        let [slopes, _, specular, roughness] = GROUPS;
        let deviations = Deviations {
            options: &self.widths,
            maps: &belief.maps,
            mean: &belief.mean,
            prior: &self.prior,
            covariance: &self.covariance,
            noise: belief.noise / self.noise,
            columns: self.maps.width(),
        };
        if self.determined {
            deviations.narrowed(&self.widest, [slopes, specular, roughness])
        } else {
            // Fewer photographs take varying roughness for specular albedo.
            deviations.narrowed(&self.widest, [slopes, specular])
        }
    }

    /// How far the material is off its prior's mean where photographs tell, in sigmas: root mean
    /// square over each group of parameters.
    fn scales(&self) -> [f32; CHANNELS] {
        let [least, greatest] = SCALE;
        let mut scales = [0.0; CHANNELS];
        for group in GROUPS {
            let (mut squares, mut total) = (0.0, 1e-3);
            for c in group.clone() {
                let sigma = self.prior.sigma[c];
                let pairs = self.maps.plane(c).iter().zip(self.mean.plane(c));
                for ((&a, &b), &open) in pairs.zip(self.covariance.plane(c, c)) {
                    let known = f64::from(1.0 - open.clamp(0.0, 1.0));
                    let off = (to_coordinate(c, a) - to_coordinate(c, b)) / sigma;
                    squares += known * f64::from(off * off);
                    total += known;
                }
            }
            scales[group].fill(((squares / total).sqrt() as f32).clamp(least, greatest));
        }
        scales
    }

    /// The network's input: coordinates of the maps, how far base and mean of the prior are off them, variances and the covariance of slopes; logarithms of the number of photographs, of
    /// the material's steepness, of its scales. Slopes and differences are in units of these.
    fn features(&self, scales: &[f32; CHANNELS]) -> Vec<f32> {
        let [width, height] = self.size();
        let n = width * height;
        let maps = coordinates(&self.maps);
        let (slopes, others) = maps.split_at(2 * n);
        let squares: f64 = slopes.iter().map(|v| f64::from(v * v)).sum();
        let steepness = ((squares / (2 * n) as f64).sqrt() as f32).max(MIN_SLOPE);
        let mut planes = Vec::with_capacity(COMPLETION_CHANNELS * n);
        planes.extend(slopes.iter().map(|v| v / steepness));
        planes.extend(others.iter().map(|v| STRETCH * (v - MIDDLE)));
        for other in [&self.base, &self.mean] {
            let pairs = coordinates(other).into_iter().zip(&maps).enumerate();
            let unit = |c: usize| DIFFERENCE / (self.prior.sigma[c] * scales[c]);
            planes.extend(pairs.map(|(i, (v, r))| (v - r) * unit(i / n)));
        }
        for c in 0..CHANNELS {
            planes.extend_from_slice(self.covariance.plane(c, c));
        }
        planes.extend_from_slice(self.covariance.plane(channel::SLOPE_X, channel::SLOPE_Y));
        let whole = [self.photographs as f32, steepness];
        for value in whole.into_iter().chain(GROUPS.map(|group| scales[group.start])) {
            planes.extend(std::iter::repeat_n(value.ln(), n));
        }
        planes.iter_mut().for_each(|v| *v = v.clamp(-LIMIT, LIMIT));
        planes
    }

    /// How far the mean should move, and how far the maps follow: nine planes each, coordinates.
    fn shifts(&self, networks: &Networks) -> Result<[Svbrdf; 2]> {
        let [width, height] = self.size();
        let n = width * height;
        let scales = self.scales();
        let mut answer = networks.complete(self.features(&scales), [height, width])?;
        for (plane, scale) in answer.chunks_exact_mut(n).zip(scales) {
            plane.iter_mut().for_each(|v| *v *= scale);
        }
        let mut follows = vec![0.0; CHANNELS * n];
        for (i, out) in follows.chunks_exact_mut(n).enumerate() {
            for (j, moved) in answer.chunks_exact(n).enumerate() {
                let share = self.covariance.plane(i, j);
                for ((out, share), moved) in out.iter_mut().zip(share).zip(moved) {
                    *out += self.prior.sigma[i] * share * moved;
                }
            }
        }
        for (plane, sigma) in answer.chunks_exact_mut(n).zip(self.prior.sigma) {
            plane.iter_mut().for_each(|v| *v *= sigma);
        }
        let [moved, follows] =
            [answer, follows].map(|planes| Svbrdf::from_planes(width, height, planes));
        Ok([moved?, follows?])
    }
}

/// Adds to the coordinates of maps what is given at a resolution of which theirs is a multiple.
fn move_by(maps: &mut Svbrdf, shift: &Svbrdf) {
    let (width, height) = (maps.width(), maps.height());
    let factor = width / shift.width();
    let across = neighbours(width, factor, shift.width());
    let down = neighbours(height, factor, shift.height());
    parallel::parts_with(
        maps.planes_mut().chunks_exact_mut(width),
        || vec![0.0; shift.width()],
        |mixed, row, out| {
            let (c, ([above, below], share)) = (row / height, down[row % height]);
            let line = |y: usize| &shift.plane(c)[y * shift.width()..][..shift.width()];
            for ((mixed, a), b) in mixed.iter_mut().zip(line(above)).zip(line(below)) {
                *mixed = a + share * (b - a);
            }
            for (out, &([left, right], share)) in out.iter_mut().zip(&across) {
                let moved =
                    to_coordinate(c, *out) + (mixed[left] + share * (mixed[right] - mixed[left]));
                *out = from_coordinate(c, moved);
            }
        },
    );
    maps.clamp();
}

/// The two of `few` texels between which each of `factor` times as many lies, and how far it is
/// from the first to the second.
fn neighbours(many: usize, factor: usize, few: usize) -> Vec<([usize; 2], f32)> {
    let place = |i: usize| {
        let at = ((i as f32 + 0.5) / factor as f32 - 0.5).clamp(0.0, (few - 1) as f32);
        let first = at as usize;
        ([first, (first + 1).min(few - 1)], at - first as f32)
    };
    (0..many).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::solver::solve;
    use crate::estimate::updates::pooling::tests::photograph;
    use crate::random::Random;

    const SIDE: usize = 64;

    /// A knobbly, half glossy material.
    fn truth() -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        let mut random = Random::new(9);
        let waves: Vec<[f32; 3]> = (0..6)
            .map(|_| {
                let mut any = || random.uniform() as f32;
                [0.6 * any() - 0.3, 0.6 * any() - 0.3, 6.0 * any()]
            })
            .collect();
        for t in 0..SIDE * SIDE {
            let (x, y) = ((t % SIDE) as f32, (t / SIDE) as f32);
            let (mut slope, mut shade) = ([0.0; 2], 0.0);
            for [a, b, phase] in &waves {
                let (sin, cos) = (a * x + b * y + phase).sin_cos();
                slope = [slope[0] + a * cos, slope[1] - b * cos];
                shade += 0.05 * sin;
            }
            maps.plane_mut(channel::SLOPE_X)[t] = slope[0];
            maps.plane_mut(channel::SLOPE_Y)[t] = slope[1];
            for c in 0..3 {
                maps.plane_mut(channel::DIFFUSE + c)[t] = 0.3 + shade;
                maps.plane_mut(channel::SPECULAR + c)[t] = 0.05;
            }
            maps.plane_mut(channel::ROUGHNESS)[t] = 0.45 - shade;
        }
        maps
    }

    fn photographs(truth: &Svbrdf, places: &[[f32; 2]]) -> Photographs {
        let mut photographs = Photographs::new();
        places.iter().for_each(|&at| photographs.add(photograph(truth, at)).unwrap());
        photographs
    }

    /// A fit from a flat guess.
    fn fitted(truth: &Svbrdf) -> (Belief, Photographs) {
        let photographs = photographs(truth, &[[0.0, 0.0], [60.0, 15.0], [-40.0, 50.0]]);
        let mut mean = truth.clone();
        mean.plane_mut(channel::SLOPE_X).fill(0.0);
        mean.plane_mut(channel::SLOPE_Y).fill(0.0);
        let mut belief = Belief::new(mean, &EstimateOptions::default());
        step(&mut belief, &photographs);
        (belief, photographs)
    }

    /// Eight steps of the solver, with the widths of the options.
    fn step(belief: &mut Belief, photographs: &Photographs) {
        let EstimateOptions { noise, prior, .. } = EstimateOptions::default();
        let Belief { maps, mean, .. } = belief;
        let summary = solve(maps, mean, &prior, photographs.full(), 8, &noise).unwrap();
        belief.found = summary.prior;
    }

    fn record(belief: &Belief, photographs: &Photographs) -> FitRecord {
        FitRecord::new(photographs, belief, &EstimateOptions::default()).unwrap()
    }

    #[test]
    fn shifts_are_interpolated_between_texel_centres() {
        for factor in [1, 2, 4] {
            let few = 8;
            let between = neighbours(few * factor, factor, few);
            for (i, ([a, b], share)) in between.into_iter().enumerate() {
                let at = (i as f32 + 0.5) / factor as f32 - 0.5;
                let found = a as f32 + share * (b as f32 - a as f32);
                assert!((found - at.clamp(0.0, 7.0)).abs() < 1e-5, "{factor} {i}: {found} {at}");
            }
        }
    }

    #[test]
    fn coordinates_move_and_albedos_follow_by_their_roots() {
        let mut maps = Svbrdf::new(8, 4);
        let shift = Svbrdf::from_planes(4, 2, vec![0.1; CHANNELS * 8]).unwrap();
        let before = maps.clone();
        move_by(&mut maps, &shift);
        for c in 0..CHANNELS {
            for (after, before) in maps.plane(c).iter().zip(before.plane(c)) {
                let expected = to_coordinate(c, *before) + 0.1;
                assert!((to_coordinate(c, *after) - expected).abs() < 1e-6, "{c}");
            }
        }
    }

    #[test]
    fn features_of_a_turned_sample_are_turned() {
        use crate::initial_estimate::{COMPLETION_ODD, MAPS_ODD, half_turn};
        let truth = truth();
        let belief = Belief { base: truth.clone(), ..fitted(&truth).0 };
        let turned = |maps: &Svbrdf| {
            let mut planes = maps.planes().to_vec();
            half_turn(&mut planes, SIDE * SIDE, &MAPS_ODD);
            Svbrdf::from_planes(SIDE, SIDE, planes).unwrap()
        };
        let features = |belief: &Belief, truth: &Svbrdf, sign: f32| {
            let places = [[60.0, 15.0], [-40.0, 50.0]].map(|at: [f32; 2]| at.map(|v| sign * v));
            let record = record(belief, &photographs(truth, &places));
            record.features(&record.scales())
        };
        let mut expected = features(&belief, &truth, 1.0);
        half_turn(&mut expected, SIDE * SIDE, &COMPLETION_ODD);
        let belief = Belief {
            base: turned(&belief.base),
            mean: turned(&belief.mean),
            maps: turned(&belief.maps),
            ..belief
        };
        let found = features(&belief, &turned(&truth), -1.0);
        // single precision, through the inverses of the texels' equations
        let off = found.iter().zip(&expected).fold(0f32, |a, (f, e)| a.max((f - e).abs()));
        assert!(off < 0.02, "{off}");
    }

    #[test]
    fn features_are_what_training_makes_of_a_record() {
        let (mut belief, photographs) = fitted(&truth());
        belief.base.plane_mut(channel::DIFFUSE).fill(0.09);
        let fit = record(&belief, &photographs);
        let Belief { maps, mean, found: prior, .. } = &belief;
        let scales = fit.scales();
        let (n, record, features) = (SIDE * SIDE, fit.planes(), fit.features(&scales));
        assert_eq!(record.len(), (3 * CHANNELS + 45) * n + CHANNELS);
        let t = 20 * SIDE + 33;
        let at = |values: &[f32], plane: usize| values[plane * n + t];
        let root = |maps: &Svbrdf| maps.plane(channel::DIFFUSE)[t].sqrt();
        let sigma = &record[(3 * CHANNELS + 45) * n..];
        assert_eq!(sigma, prior.sigma);
        let slopes = maps.planes()[..2 * n].iter().map(|v| v * v).sum::<f32>();
        let steepness = (slopes / (2 * n) as f32).sqrt();
        let pairs = [
            (at(&features, 0), maps.plane(0)[t] / steepness),
            (at(&features, 2), 2.0 * (root(maps) - 0.4)),
            (at(&features, 9 + 2), 0.3 * (0.3 - root(maps)) / (sigma[2] * scales[2])),
            (at(&features, 18 + 2), 0.3 * (root(mean) - root(maps)) / (sigma[2] * scales[2])),
            (at(&features, 27), at(&record, 27)),
            (at(&features, 27 + 8), at(&record, 27 + 44)),
            (at(&features, 36), at(&record, 27 + 1)),
            (at(&features, 37), 3.0f32.ln()),
            (at(&features, 38), steepness.ln()),
            (at(&features, 39), scales[0].ln()),
            (at(&features, 42), scales[8].ln()),
        ];
        for (found, expected) in pairs {
            assert!((found - expected.clamp(-4.0, 4.0)).abs() < 1e-5, "{found} {expected}");
        }
        assert_eq!(features.len(), 43 * n);
        // variances are between nothing known and all
        assert!((0..CHANNELS).all(|c| (0.0..1.001).contains(&at(&features, 27 + c))));
    }

    #[test]
    fn what_is_seen_stays_and_what_is_not_comes_nearer() {
        let networks = Networks::embedded().unwrap();
        let truth = truth();
        let (mut belief, photographs) = fitted(&truth);
        let fit = record(&belief, &photographs);
        let [moved, follows] = fit.shifts(&networks).unwrap();
        let prior = belief.found;
        // the best known slope follows no further than what is open of it allows (Cauchy-Schwarz)
        let open = fit.covariance.plane(0, 0);
        let known = (0..SIDE * SIDE).min_by(|&a, &b| open[a].total_cmp(&open[b])).unwrap();
        let moves = (0..CHANNELS).map(|c| moved.plane(c)[known].abs() / prior.sigma[c]);
        let limit = prior.sigma[0] * open[known].sqrt() * moves.sum::<f32>();
        assert!(follows.plane(0)[known].abs() < 1.001 * limit, "{}", follows.plane(0)[known]);
        assert!(open[known] < 0.1, "{}", open[known]);

        let error = |maps: &Svbrdf| {
            let of = |c: usize| {
                let pairs = maps.plane(c).iter().zip(truth.plane(c));
                pairs.map(|(a, b)| (a - b).powi(2)).sum::<f32>()
            };
            ((of(0) + of(1)) / (SIDE * SIDE) as f32).sqrt()
        };
        let before = error(&belief.maps);
        fit.update(&networks, &mut belief).unwrap();
        let narrow = belief.prior.sigma.iter().zip(EstimateOptions::default().prior.sigma);
        assert!(narrow.into_iter().all(|(narrow, wide)| *narrow <= wide));
        step(&mut belief, &photographs);
        let after = error(&belief.maps);
        assert!(after < before, "{before} {after}");
        let mut other = Belief::new(Svbrdf::new(8, 8), &EstimateOptions::default());
        assert!(fit.update(&networks, &mut other).is_err());
    }

    #[test]
    fn large_maps_are_completed_at_the_network_s_resolution() {
        let flat = Svbrdf::new(1024, 512);
        let photographs = photographs(&flat, &[[0.0; 2]]);
        let mut belief = Belief::new(flat, &EstimateOptions::default());
        let fit = record(&belief, &photographs);
        assert_eq!(fit.size(), [256, 128]);
        fit.update(&Networks::embedded().unwrap(), &mut belief).unwrap();
    }
}
