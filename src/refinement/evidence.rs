//! What photographs tell of texels as they are.

use super::normal_equations::{NormalEquations, PAIRS};
use super::{Model, Noise, Options, Prior, coordinates};
use crate::Svbrdf;
use crate::observation::Observation;
use crate::parallel;
use crate::reflectance::Directions;
use crate::render::{self, BAND_ROWS, Prepared, find_directions};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, bands, channel};

/// Parameters whose precisions are told: roughness, roots of specular albedo.
pub(crate) const GLOSS: [usize; 4] =
    [channel::ROUGHNESS, channel::SPECULAR, channel::SPECULAR + 1, channel::SPECULAR + 2];

/// What photographs tell of each texel.
pub(crate) struct Evidence {
    texels: usize,
    /// Precisions, cost.
    planes: Vec<f32>,
}

impl Evidence {
    /// Precisions that they give roughness and the roots of the three specular albedos, whatever
    /// the other parameters are.
    pub fn precision(&self) -> [&[f32]; GLOSS.len()] {
        std::array::from_fn(|i| self.plane(i))
    }

    /// Negative logarithm of the texel's probability, apart from a constant.
    pub fn cost(&self) -> &[f32] {
        self.plane(GLOSS.len())
    }

    fn plane(&self, i: usize) -> &[f32] {
        &self.planes[i * self.texels..(i + 1) * self.texels]
    }
}

/// The evidence of maps around a mean, noise and tails as in the options.
///
/// # Panics
/// When sizes differ.
pub(crate) fn evidence(
    maps: &Svbrdf,
    mean: &Svbrdf,
    prior: &Prior,
    observations: &[Observation],
    options: &Options,
) -> Evidence {
    let planes = told(maps, mean, prior, observations, options, |planes| Out::Gloss(planes));
    Evidence { texels: maps.texels(), planes }
}

/// Precisions of each texel's slopes, the prior's included, whatever its other parameters are:
/// planes of xx, xy, yy.
///
/// # Panics
/// When sizes differ.
pub(crate) fn slope_precision(
    maps: &Svbrdf,
    mean: &Svbrdf,
    prior: &Prior,
    observations: &[Observation],
    options: &Options,
) -> Vec<f32> {
    told(maps, mean, prior, observations, options, |planes| Out::Slopes(planes))
}

/// Covariance of each texel's coordinates given the photographs, in sigmas of the prior.
#[derive(Debug, Clone)]
pub(crate) struct Covariance {
    texels: usize,
    /// Upper triangle by rows.
    planes: Vec<f32>,
}

impl Covariance {
    /// Of two parameters: 1 on the diagonal where photographs say nothing, 0 where all.
    pub fn plane(&self, i: usize, j: usize) -> &[f32] {
        let (i, j) = (i.min(j), i.max(j));
        let pair = i * CHANNELS - i * (i + 1) / 2 + j;
        &self.planes[pair * self.texels..][..self.texels]
    }

    /// All planes, the upper triangle by rows.
    pub fn planes(&self) -> &[f32] {
        &self.planes
    }
}

/// The covariance of maps around a mean, noise and tails as in the options.
///
/// # Panics
/// When sizes differ.
pub(crate) fn covariance(
    maps: &Svbrdf,
    mean: &Svbrdf,
    prior: &Prior,
    observations: &[Observation],
    options: &Options,
) -> Covariance {
    let texels = maps.texels();
    let mut planes = told(maps, mean, prior, observations, options, |planes| Out::All(planes));
    let pairs = (0..CHANNELS).flat_map(|i| (i..CHANNELS).map(move |j| [i, j]));
    for ([i, j], plane) in pairs.zip(planes.chunks_exact_mut(texels)) {
        let scale = (prior.sigma[i] * prior.sigma[j]).recip();
        plane.iter_mut().for_each(|v| *v *= scale);
    }
    Covariance { texels, planes }
}

fn told<const PLANES: usize>(
    maps: &Svbrdf,
    mean: &Svbrdf,
    prior: &Prior,
    observations: &[Observation],
    options: &Options,
    out: impl for<'a> Fn([&'a mut [f32]; PLANES]) -> Out<'a> + Sync,
) -> Vec<f32> {
    let prepared = Prepared::new(maps, observations);
    let model = Model {
        observations: &prepared,
        noise: [Noise::expected(options); 3],
        precision: prior.sigma.map(|s| (s * s).recip()),
        widening: 1.0,
    };
    let mut planes = vec![0.0; PLANES * maps.texels()];
    let parts = bands::<PLANES, _>(&mut planes, maps.width(), maps.height(), BAND_ROWS);
    parallel::parts(parts, |band, planes| {
        let (first_row, out) = (band * BAND_ROWS, out(planes));
        dispatch(Band { model: &model, maps, mean, first_row, out });
    });
    planes
}

/// Where a band's answers go.
// One a band: its size is nothing beside them.
#[allow(clippy::large_enum_variant)]
enum Out<'a> {
    /// Precisions of gloss, cost.
    Gloss([&'a mut [f32]; 5]),
    /// Precision of slopes.
    Slopes([&'a mut [f32]; 3]),
    /// The covariance.
    All([&'a mut [f32]; PAIRS]),
}

struct Band<'a> {
    model: &'a Model<'a>,
    maps: &'a Svbrdf,
    mean: &'a Svbrdf,
    first_row: usize,
    out: Out<'a>,
}

impl Kernel for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { model, maps, mean, first_row, mut out } = self;
        let width = maps.width();
        let mut directions = vec![Directions::none(); model.observations.len()];
        let (Out::Gloss([first, ..]) | Out::Slopes([first, ..]) | Out::All([first, ..])) = &out;
        for r in 0..first.len() / width {
            let row = first_row + r;
            for column in (0..width).step_by(LANES) {
                let end = (column + LANES).min(width);
                let (texels, here) =
                    (row * width + column..row * width + end, r * width + column..r * width + end);
                let load = |maps: &Svbrdf| -> [V; CHANNELS] {
                    coordinates(render::load_texels(maps, texels.start, texels.end))
                };
                let (x, mean) = (load(maps), load(mean));
                find_directions(model.observations, column, row, &mut directions);
                let (equations, (cost, _)) =
                    NormalEquations::new(model, &x, &mean, &directions, texels);
                match &mut out {
                    Out::Gloss([out @ .., cost_out]) => {
                        cost.store(&mut cost_out[here.clone()]);
                        let variances = equations.gloss_variances();
                        for ((variance, out), c) in variances.into_iter().zip(out).zip(GLOSS) {
                            let all = variance.max(V::splat(1e-9)).reciprocal();
                            let told = (all - V::splat(model.precision[c])).max(V::splat(0.0));
                            told.store(&mut out[here.clone()]);
                        }
                    }
                    Out::All(out) => {
                        for (value, out) in equations.covariance().into_iter().zip(out) {
                            value.store(&mut out[here.clone()]);
                        }
                    }
                    Out::Slopes(out) => {
                        for (value, out) in equations.slope_precision().into_iter().zip(out) {
                            value.store(&mut out[here.clone()]);
                        }
                    }
                }
            }
        }
    }
}
