//! The learned prior: what photographs leave open, completed by a network that has seen how fits go
//! wrong.
//!
//! After some steps of the solver every texel has its most probable parameters and their covariance.
//! Where that is as wide as the prior the photographs were silent, and the texel is the prior's mean.
//! A small network looks at the maps, at the base and the mean of the prior, and at the variances, and
//! says where the truth should lie instead: the shape of a bump of which one flank was seen, the
//! gloss that goes with the gloss around. It was trained on fits of known materials
//! (`training/train_completion.py`). The maps move towards its answer as far as the covariance leaves them
//! open (a learned prior of one step, as in plug-and-play or unrolled reconstruction). It answers in units
//! of how far the photographs found the material off its prior's mean: a mirror stays as flat as it was
//! seen to be.
//!
//! It works at 256 texels along the longer side at most; its answer is interpolated.

use std::ops::Range;

use crate::estimate::belief::Belief;
use crate::estimate::coordinates::{coordinates, from_coordinate, to_coordinate};
use crate::estimate::noise::Noise;
use crate::estimate::options::EstimateOptions;
use crate::estimate::photographs::Photographs;
use crate::estimate::posterior::{At, Covariance, covariance};
use crate::estimate::prior::Prior;
use crate::networks::{COMPLETION_CHANNELS, Networks};
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
    mean: Svbrdf,
    maps: Svbrdf,
    covariance: Covariance,
    /// Of the steps that found the maps.
    prior: Prior,
    photographs: usize,
    /// How often maps were halved.
    halvings: u32,
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
        for maps in [&belief.mean, &belief.maps] {
            check_observations(maps, photographs.full())?;
        }
        let halvings = photographs.halvings_to(TEXELS);
        let small = |maps: &Svbrdf| halved(maps, halvings, Svbrdf::downsampled);
        let (mean, maps) = (small(&belief.mean), small(&belief.maps));
        let (prior, noise) = (belief.found, Noise::expected(&options.noise));
        let at = At { maps: &maps, mean: &mean, prior: &prior, noise };
        let covariance = covariance(at, &photographs.level(halvings));
        Ok(Self { mean, maps, covariance, prior, photographs: photographs.len(), halvings })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.maps.width(), self.maps.height()]
    }

    /// All that there is to learn from: nine planes each of the maps, of the latent maps and of the mean of the
    /// prior, which are the same (slopes, roots of albedos, roughness), 45 of the covariance in sigmas of the prior (upper
    /// triangle by rows); then the nine sigmas.
    pub fn planes(&self) -> Vec<f32> {
        let maps = [&self.maps, &self.mean, &self.mean].into_iter().flat_map(coordinates);
        maps.chain(self.covariance.planes().iter().copied()).chain(self.prior.sigma).collect()
    }

    /// Moves maps towards what the network expects, as far as the photographs leave them open.
    ///
    /// # Errors
    /// When the maps are not of the record's size, or the network is broken.
    pub(crate) fn complete(&self, networks: &Networks, maps: &mut Svbrdf) -> Result<()> {
        if [maps.width(), maps.height()] != self.size().map(|n| n << self.halvings) {
            return Err(Error::argument("maps", "not of the size of the record's"));
        }
        move_by(maps, &self.shift(networks)?);
        Ok(())
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

    /// The network's input: coordinates of the maps, how far the latent maps and the prior's mean, which are the
    /// same, are off them, variances and the covariance of slopes; logarithms of the number of photographs, of
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
        for other in [&self.mean, &self.mean] {
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

    /// How far the maps move: nine planes of coordinates. The network says where it expects the truth, and the
    /// covariance how much of the way is open.
    fn shift(&self, networks: &Networks) -> Result<Svbrdf> {
        let [width, height] = self.size();
        let n = width * height;
        let scales = self.scales();
        let expected = networks.complete(self.features(&scales), [height, width])?;
        let mut shift = vec![0.0; CHANNELS * n];
        for (i, out) in shift.chunks_exact_mut(n).enumerate() {
            for ((j, expected), scale) in expected.chunks_exact(n).enumerate().zip(scales) {
                let scale = self.prior.sigma[i] * scale;
                let pairs = self.covariance.plane(i, j).iter().zip(expected);
                out.iter_mut().zip(pairs).for_each(|(out, (open, v))| *out += scale * open * v);
            }
        }
        Svbrdf::from_planes(width, height, shift)
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
mod tests;
