//! Learned prior: a network completes coordinates that the photographs leave undetermined.
//!
//! The solver's steps give each texel a MAP estimate and its covariance. Coordinates whose covariance is as
//! wide as the prior are undetermined and stay at the prior's mean. A small network gets the maps, the
//! prior's mean and the covariances, and predicts the truth: the other flank of a bump, or gloss like that of
//! neighbours. It was trained on fits of known materials (`training/train_completion.py`). The maps move
//! towards the prediction in proportion to the covariance, as in one step of plug-and-play or unrolled
//! reconstruction. The prediction is in units of the material's determined deviation from the prior's mean,
//! so that a mirror stays flat.
//!
//! The network works on at most 256 texels along the longer side; its prediction is interpolated.

use std::ops::Range;

use crate::estimate::coordinates::{coordinates, from_coordinate, to_coordinate};
use crate::estimate::map_state::MapState;
use crate::estimate::photographs::Photographs;
use crate::estimate::posterior::{At, Covariance, covariance};
use crate::estimate::prior::Prior;
use crate::networks::{COMPLETION_CHANNELS, Networks};
use crate::parallel;
use crate::render::check_observations;
use crate::svbrdf::{CHANNELS, channel, halved};
use crate::{Error, Result, Svbrdf};

/// Largest number of texels along the network's longer side, as in training.
pub(in crate::estimate) const TEXELS: usize = 256;
/// Range of a material's scales (in sigmas), and its least steepness, as in training.
const SCALE: [f32; 2] = [0.02, 2.0];
const MIN_SLOPE: f32 = 0.01;
/// Largest absolute value of an input.
const LIMIT: f32 = 4.0;
/// Offset and scale of coordinates other than slopes.
const MIDDLE: f32 = 0.4;
const STRETCH: f32 = 2.0;
/// Scale of differences between maps.
const DIFFERENCE: f32 = 0.3;
/// Coordinates with one scale: slopes, diffuse albedo, specular albedo, roughness.
const GROUPS: [Range<usize>; 4] = [0..2, 2..5, 5..8, 8..9];

/// Inputs of the relief network at its resolution: its training data.
#[derive(Debug, Clone)]
pub struct FitRecord {
    mean: Svbrdf,
    maps: Svbrdf,
    covariance: Covariance,
    /// The prior of the solver's steps.
    prior: Prior,
    photographs: usize,
    /// Halvings of the maps.
    halvings: u32,
}

impl FitRecord {
    /// Inputs after the solver's steps.
    ///
    /// # Errors
    /// When sizes differ.
    pub(crate) fn new(photographs: &Photographs, map_state: &MapState) -> Result<Self> {
        for maps in [&map_state.mean, &map_state.maps] {
            check_observations(maps, photographs.full())?;
        }
        let halvings = photographs.halvings_to(TEXELS);
        let small = |maps: &Svbrdf| halved(maps, halvings, Svbrdf::downsampled);
        let (mean, maps) = (small(&map_state.mean), small(&map_state.maps));
        let prior = map_state.prior;
        let at = At { maps: &maps, mean: &mean, prior: &prior, noise: map_state.noise };
        let covariance = covariance(at, &photographs.level(halvings));
        Ok(Self { mean, maps, covariance, prior, photographs: photographs.len(), halvings })
    }

    /// Width and height in texels.
    pub fn size(&self) -> [usize; 2] {
        [self.maps.width(), self.maps.height()]
    }

    /// Training data: nine planes (slopes, roots of albedos, roughness) of the maps and twice of the prior's
    /// mean, which is that of the latent maps; 45 planes of the covariance in sigmas of the prior (upper
    /// triangle by rows); the nine sigmas.
    pub fn planes(&self) -> Vec<f32> {
        let maps = [&self.maps, &self.mean, &self.mean].into_iter().flat_map(coordinates);
        maps.chain(self.covariance.planes().iter().copied()).chain(self.prior.sigma).collect()
    }

    /// Moves maps towards the network's prediction, in proportion to the covariance.
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

    /// The material's determined deviation from the prior's mean, in sigmas: weighted root mean square over
    /// each group of coordinates.
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

    /// The network's input: coordinates of the maps; their differences to the prior's mean, twice; variances,
    /// and the covariance of slopes; logarithms of the number of photographs, the steepness and the scales.
    /// Slopes are in units of the steepness, differences in units of the scales.
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

    /// Shift of the maps, nine planes of coordinates: the covariance times the network's prediction.
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

/// Adds a coarser shift to the coordinates of maps.
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

/// For each of `many` texels: its two neighbours among `few`, and its fraction of the way between them.
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
