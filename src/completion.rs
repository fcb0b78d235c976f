//! What photographs leave open, completed by a network that has seen how fits go wrong.
//!
//! After a refinement every texel has its most probable parameters and their covariance. Where that
//! is as wide as the prior the photographs were silent, and the texel is the latent fit's guess. A
//! small network looks at the maps as refined, at the estimates before, and at the variances, and
//! answers where the prior's mean should lie instead: what a bump looks like of which one flank was
//! seen, which gloss goes with the gloss around. It was trained on fits of known materials
//! (`training/train_completion.py`) so that maps *refined round the new mean* come closest to the
//! truth. What photographs do tell therefore stays theirs: its answer only moves the mean, and the
//! maps as far as the covariance allows (a learned prior of one step, as in plug-and-play or unrolled
//! reconstruction). It answers in units of what the photographs found the material to be off its
//! prior's mean, so a mirror stays as flat as it was seen to be.
//!
//! It works at 256 texels along the longer side at most; its answer is interpolated.

use crate::initial_estimate::{COMPLETION_CHANNELS, Networks};
use crate::observation::Observation;
use crate::parallel;
use crate::refinement::{self, Covariance, Found, Prior, covariance, to_coordinate};
use crate::render::check_observations;
use crate::svbrdf::{CHANNELS, channel, halved};
use crate::{Error, Result, Svbrdf};
use std::ops::Range;

/// Texels along the longer side that the network sees, at most.
const TEXELS: usize = 256;
/// Largest size of an input.
const LIMIT: f32 = 4.0;
/// What natural coordinates other than slopes are measured from, and their scale.
const MIDDLE: f32 = 0.4;
const STRETCH: f32 = 2.0;
/// Scale of differences between estimates.
const DIFFERENCE: f32 = 0.3;
/// Parameters that are measured together: slopes, diffuse, specular albedo, roughness.
const GROUPS: [Range<usize>; 4] = [0..2, 2..5, 5..8, 8..9];
/// Bounds of a material's scales, sigmas; its least steepness.
const LEAST_SCALE: f32 = 0.02;
const MOST_SCALE: f32 = 2.0;
const LEAST_SLOPE: f32 = 0.01;
/// Photographs from which on they tell how much roughness varies. Fewer take it for specular albedo.
const LEAST_TO_TELL_ROUGHNESS: usize = 3;

/// A fit before its completion, at the resolution of the network.
#[derive(Debug, Clone)]
pub struct Incomplete {
    /// The latent fit's maps.
    estimate: Svbrdf,
    /// The mean of the refinement's prior: the estimate with all that was told.
    mean: Svbrdf,
    refined: Svbrdf,
    covariance: Covariance,
    prior: Prior,
    photographs: usize,
    /// How often maps were halved.
    halvings: u32,
}

impl Incomplete {
    /// Of a refinement that ended with `prior` round `mean`, which came from `estimate`.
    ///
    /// # Errors
    /// When sizes differ.
    pub fn new(
        estimate: &Svbrdf,
        mean: &Svbrdf,
        refined: &Svbrdf,
        observations: &[Observation],
        prior: &Prior,
    ) -> Result<Self> {
        for maps in [estimate, mean, refined] {
            check_observations(maps, observations)?;
        }
        let mut halvings = 0;
        while refined.width().max(refined.height()) >> halvings > TEXELS {
            halvings += 1;
        }
        let small = |maps| halved(maps, halvings, Svbrdf::downsampled);
        let (estimate, mean, refined) = (small(estimate), small(mean), small(refined));
        let options = refinement::Options::default();
        let covariance = if halvings == 0 {
            covariance(&refined, &mean, prior, observations, &options)
        } else {
            let half = |o| halved(o, halvings, Observation::downsampled);
            let observations: Vec<_> = observations.iter().map(half).collect();
            covariance(&refined, &mean, prior, &observations, &options)
        };
        let (prior, photographs) = (*prior, observations.len());
        Ok(Self { estimate, mean, refined, covariance, prior, photographs, halvings })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.refined.width(), self.refined.height()]
    }

    /// All that there is to learn from: nine planes each of the maps as refined, the latent fit's,
    /// the prior's mean (slopes, roots of albedos, roughness), 45 of the covariance in sigmas of the
    /// prior (upper triangle by rows); then the nine sigmas.
    pub fn record(&self) -> Vec<f32> {
        let maps = [&self.refined, &self.estimate, &self.mean].into_iter().flat_map(coordinates);
        maps.chain(self.covariance.planes().iter().copied()).chain(self.prior.sigma).collect()
    }

    /// The prior of the refinement that follows, as narrow as the material: `mean` and `refined` are
    /// those that this was made of, `noise` what the refinement found. Diffuse albedo keeps its sigma,
    /// every photograph tells it.
    ///
    /// # Panics
    /// When sizes are not those that this was made of.
    pub fn narrowed_prior(&self, mean: &Svbrdf, refined: &Svbrdf, noise: f32) -> Prior {
        let [slopes, _, specular, roughness] = GROUPS;
        let found = Found {
            maps: refined,
            mean,
            prior: &self.prior,
            covariance: &self.covariance,
            noise: noise / refinement::Options::default().noise,
            columns: self.refined.width(),
        };
        let prior = Prior::default();
        if self.photographs < LEAST_TO_TELL_ROUGHNESS {
            found.narrowed(&prior, [slopes, specular])
        } else {
            found.narrowed(&prior, [slopes, specular, roughness])
        }
    }

    /// How far the material is off its prior's mean where photographs tell, in sigmas: root mean
    /// square over each group of parameters.
    fn scales(&self) -> [f32; CHANNELS] {
        let mut scales = [0.0; CHANNELS];
        for group in GROUPS {
            let (mut squares, mut told) = (0.0, 1e-3);
            for c in group.clone() {
                let sigma = self.prior.sigma[c];
                let pairs = self.refined.plane(c).iter().zip(self.mean.plane(c));
                for ((&a, &b), &open) in pairs.zip(self.covariance.plane(c, c)) {
                    let known = f64::from(1.0 - open.clamp(0.0, 1.0));
                    let off = (to_coordinate(c, a) - to_coordinate(c, b)) / sigma;
                    squares += known * f64::from(off * off);
                    told += known;
                }
            }
            scales[group].fill(((squares / told).sqrt() as f32).clamp(LEAST_SCALE, MOST_SCALE));
        }
        scales
    }

    /// The network's input: coordinates as refined, how far the latent fit and the prior's mean are
    /// off them, variances and the covariance of slopes; logarithms of the number of photographs, of
    /// the material's steepness, of its scales. Slopes and differences are in units of these.
    fn features(&self, scales: &[f32; CHANNELS]) -> Vec<f32> {
        let [width, height] = self.size();
        let n = width * height;
        let refined = coordinates(&self.refined);
        let (slopes, others) = refined.split_at(2 * n);
        let squares: f64 = slopes.iter().map(|v| f64::from(v * v)).sum();
        let steepness = ((squares / (2 * n) as f64).sqrt() as f32).max(LEAST_SLOPE);
        let mut planes = Vec::with_capacity(COMPLETION_CHANNELS * n);
        planes.extend(slopes.iter().map(|v| v / steepness));
        planes.extend(others.iter().map(|v| STRETCH * (v - MIDDLE)));
        for other in [&self.estimate, &self.mean] {
            let pairs = coordinates(other).into_iter().zip(&refined).enumerate();
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

    /// Moves the mean of the prior to where the network expects the truth, and the refined maps as
    /// far as the photographs leave them open: for another refinement.
    ///
    /// # Errors
    /// When sizes are not those that this was made of, or the network is broken.
    pub fn complete(
        &self,
        networks: &Networks,
        mean: &mut Svbrdf,
        refined: &mut Svbrdf,
    ) -> Result<()> {
        let full = self.size().map(|n| n << self.halvings).into();
        for (maps, shift) in [mean, refined].into_iter().zip(self.shifts(networks)?) {
            if (maps.width(), maps.height()) != full {
                return Err(Error::argument("maps", "not of the size of the refinement's"));
            }
            move_by(maps, &shift);
        }
        Ok(())
    }
}

/// Nine planes of what the refinement steps in: slopes, roots of albedos, roughness.
pub fn coordinates(maps: &Svbrdf) -> Vec<f32> {
    let n = maps.texels();
    maps.planes().iter().enumerate().map(|(i, &v)| to_coordinate(i / n, v)).collect()
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
            let is_root = (channel::DIFFUSE..channel::ROUGHNESS).contains(&c);
            for (out, &([left, right], share)) in out.iter_mut().zip(&across) {
                let moved =
                    to_coordinate(c, *out) + (mixed[left] + share * (mixed[right] - mixed[left]));
                *out = if is_root { moved.max(0.0).powi(2) } else { moved };
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
    use crate::propagation::tests::photograph;
    use crate::random::Random;
    use std::ops::ControlFlow;

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

    /// A fit from a flat guess: mean, refined maps, photographs, prior.
    fn fitted(truth: &Svbrdf) -> (Svbrdf, Svbrdf, Vec<Observation>, Prior) {
        let places = [[0.0, 0.0], [60.0, 15.0], [-40.0, 50.0]];
        let photographs: Vec<_> = places.iter().map(|&at| photograph(truth, at)).collect();
        let mut mean = truth.clone();
        mean.plane_mut(channel::SLOPE_X).fill(0.0);
        mean.plane_mut(channel::SLOPE_Y).fill(0.0);
        let mut refined = mean.clone();
        let prior = refine(&mut refined, &mean, &photographs);
        (mean, refined, photographs, prior)
    }

    fn refine(maps: &mut Svbrdf, mean: &Svbrdf, photographs: &[Observation]) -> Prior {
        let (options, go_on) =
            (refinement::Options::default(), &mut |_, _| ControlFlow::Continue(()));
        let prior = Prior::default();
        refinement::refine(maps, mean, &prior, photographs, &options, go_on).unwrap().prior
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
        let (mean, refined, _, prior) = fitted(&truth);
        let turned = |maps: &Svbrdf| {
            let mut planes = maps.planes().to_vec();
            half_turn(&mut planes, SIDE * SIDE, &MAPS_ODD);
            Svbrdf::from_planes(SIDE, SIDE, planes).unwrap()
        };
        let features = |[estimate, mean, refined]: [&Svbrdf; 3], sign: f32| {
            let maps = if sign < 0.0 { turned(&truth) } else { truth.clone() };
            let photographs = [[60.0, 15.0], [-40.0, 50.0]]
                .map(|at: [f32; 2]| photograph(&maps, at.map(|v| sign * v)));
            let fit = Incomplete::new(estimate, mean, refined, &photographs, &prior).unwrap();
            fit.features(&fit.scales())
        };
        let mut expected = features([&truth, &mean, &refined], 1.0);
        half_turn(&mut expected, SIDE * SIDE, &COMPLETION_ODD);
        let found = features([&turned(&truth), &turned(&mean), &turned(&refined)], -1.0);
        // single precision, through the inverses of the texels' equations
        let off = found.iter().zip(&expected).fold(0f32, |a, (f, e)| a.max((f - e).abs()));
        assert!(off < 0.02, "{off}");
    }

    #[test]
    fn features_are_what_training_makes_of_a_record() {
        let (mean, refined, photographs, prior) = fitted(&truth());
        let mut estimate = mean.clone();
        estimate.plane_mut(channel::DIFFUSE).fill(0.09);
        let fit = Incomplete::new(&estimate, &mean, &refined, &photographs, &prior).unwrap();
        let scales = fit.scales();
        let (n, record, features) = (SIDE * SIDE, fit.record(), fit.features(&scales));
        assert_eq!(record.len(), (3 * CHANNELS + 45) * n + CHANNELS);
        let t = 20 * SIDE + 33;
        let at = |values: &[f32], plane: usize| values[plane * n + t];
        let root = |maps: &Svbrdf| maps.plane(channel::DIFFUSE)[t].sqrt();
        let sigma = &record[(3 * CHANNELS + 45) * n..];
        assert_eq!(sigma, prior.sigma);
        let slopes = refined.planes()[..2 * n].iter().map(|v| v * v).sum::<f32>();
        let steepness = (slopes / (2 * n) as f32).sqrt();
        let pairs = [
            (at(&features, 0), refined.plane(0)[t] / steepness),
            (at(&features, 2), 2.0 * (root(&refined) - 0.4)),
            (at(&features, 9 + 2), 0.3 * (0.3 - root(&refined)) / (sigma[2] * scales[2])),
            (at(&features, 18 + 2), 0.3 * (root(&mean) - root(&refined)) / (sigma[2] * scales[2])),
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
        let (mut mean, mut refined, photographs, prior) = fitted(&truth);
        let fit = Incomplete::new(&mean, &mean, &refined, &photographs, &prior).unwrap();
        let [moved, follows] = fit.shifts(&networks).unwrap();
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
        let before = error(&refined);
        fit.complete(&networks, &mut mean, &mut refined).unwrap();
        refine(&mut refined, &mean, &photographs);
        let after = error(&refined);
        assert!(after < before, "{before} {after}");
        assert!(fit.complete(&networks, &mut Svbrdf::new(8, 8), &mut refined).is_err());
    }

    #[test]
    fn large_maps_are_completed_at_the_network_s_resolution() {
        let flat = Svbrdf::new(1024, 512);
        let photograph = photograph(&flat, [0.0; 2]);
        let prior = Prior::default();
        let fit = Incomplete::new(&flat, &flat, &flat, &[photograph], &prior).unwrap();
        assert_eq!(fit.size(), [256, 128]);
        let (mut mean, mut refined) = (flat.clone(), flat);
        fit.complete(&Networks::embedded().unwrap(), &mut mean, &mut refined).unwrap();
    }
}
