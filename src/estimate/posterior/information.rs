//! Posterior precisions and covariances of texels at given maps (quadratic model).

use super::cholesky::PAIRS;
use super::model::Posterior;
use super::normal_equations::NormalEquations;
use crate::Svbrdf;
use crate::estimate::coordinates::to_coordinates;
use crate::estimate::noise::Noise;
use crate::estimate::prior::Prior;
use crate::observation::Observation;
use crate::parallel;
use crate::reflectance::Directions;
use crate::render::{self, BAND_ROWS, Prepared, find_directions};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, bands};

/// The point of the quadratic model: maps, prior, noise.
#[derive(Clone, Copy)]
pub(in crate::estimate) struct At<'a> {
    pub maps: &'a Svbrdf,
    pub mean: &'a Svbrdf,
    pub prior: &'a Prior,
    pub noise: Noise,
}

/// Posterior covariance of each texel's coordinates, in sigmas of the prior.
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Covariance {
    texels: usize,
    /// Upper triangle by rows.
    planes: Vec<f32>,
}

impl Covariance {
    /// Covariance of two coordinates. On the diagonal, 1 means that photographs add nothing, 0 that they
    /// determine the coordinate.
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

/// Covariances at given maps.
///
/// # Panics
/// When sizes differ.
pub(in crate::estimate) fn covariance(at: At, observations: &[Observation]) -> Covariance {
    let (texels, sigma) = (at.maps.texels(), at.prior.sigma);
    let mut planes = planes(at, observations, |planes| Out::All(planes));
    let pairs = (0..CHANNELS).flat_map(|i| (i..CHANNELS).map(move |j| [i, j]));
    for ([i, j], plane) in pairs.zip(planes.chunks_exact_mut(texels)) {
        let scale = (sigma[i] * sigma[j]).recip();
        plane.iter_mut().for_each(|v| *v *= scale);
    }
    Covariance { texels, planes }
}

/// Planes of [`Spread`].
const SPREAD: usize = CHANNELS + 2;

/// Marginal variances of each texel's coordinates, and residuals of the maps.
pub(crate) struct Spread {
    texels: usize,
    /// Variances, sum of weights, loss.
    planes: Vec<f32>,
}

impl Spread {
    /// Variance of a coordinate.
    pub fn variance(&self, c: usize) -> &[f32] {
        self.plane(c)
    }

    /// Sum of the photographs' weights.
    pub fn weight(&self) -> &[f32] {
        self.plane(CHANNELS)
    }

    /// Weighted sum over photographs of absolute log residuals, averaged over the colours.
    pub fn loss(&self) -> &[f32] {
        self.plane(CHANNELS + 1)
    }

    fn plane(&self, i: usize) -> &[f32] {
        &self.planes[i * self.texels..][..self.texels]
    }
}

/// Marginal variances and residuals; independent of the prior's mean.
///
/// # Panics
/// When sizes differ.
pub(crate) fn spread(
    maps: &Svbrdf,
    prior: &Prior,
    noise: Noise,
    observations: &[Observation],
) -> Spread {
    let at = At { maps, mean: maps, prior, noise };
    Spread { texels: maps.texels(), planes: planes(at, observations, |planes| Out::Spread(planes)) }
}

fn planes<const PLANES: usize>(
    at: At,
    observations: &[Observation],
    out: impl for<'a> Fn([&'a mut [f32]; PLANES]) -> Out<'a> + Sync,
) -> Vec<f32> {
    let prepared = Prepared::new(at.maps, observations);
    let posterior = Posterior::new(&prepared, at.noise, at.prior, at.maps);
    let (width, height) = (at.maps.width(), at.maps.height());
    let mut planes = vec![0.0; PLANES * at.maps.texels()];
    parallel::parts(bands::<PLANES, _>(&mut planes, width, height, BAND_ROWS), |band, planes| {
        let (first_row, out) = (band * BAND_ROWS, out(planes));
        dispatch(Band { posterior: &posterior, at, first_row, out });
    });
    planes
}

/// Destination of a band's results.
// One value per band: its size does not matter.
#[allow(clippy::large_enum_variant)]
enum Out<'a> {
    /// The covariance.
    All([&'a mut [f32]; PAIRS]),
    /// Variances, weight, loss.
    Spread([&'a mut [f32]; SPREAD]),
}

struct Band<'a> {
    posterior: &'a Posterior<'a>,
    at: At<'a>,
    first_row: usize,
    out: Out<'a>,
}

impl Kernel for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { posterior, at, first_row, mut out } = self;
        let width = at.maps.width();
        let mut directions = vec![Directions::none(); posterior.observations.len()];
        let (Out::All([first, ..]) | Out::Spread([first, ..])) = &out;
        for r in 0..first.len() / width {
            let row = first_row + r;
            for column in (0..width).step_by(LANES) {
                let end = (column + LANES).min(width);
                let (texels, here) =
                    (row * width + column..row * width + end, r * width + column..r * width + end);
                let load = |maps: &Svbrdf| -> [V; CHANNELS] {
                    to_coordinates(render::load_texels(maps, texels.start, texels.end))
                };
                let (x, mean) = (load(at.maps), load(at.mean));
                find_directions(posterior.observations, column, row, &mut directions);
                let (equations, (_, loss)) =
                    NormalEquations::new(posterior, &x, &mean, &directions, texels.clone());
                let factor = equations.factor(V::splat(0.0));
                match &mut out {
                    Out::All(out) => {
                        for (value, out) in factor.inverse().into_iter().zip(out) {
                            value.store(&mut out[here.clone()]);
                        }
                    }
                    Out::Spread([out @ .., weight_out, loss_out]) => {
                        for (c, out) in out.iter_mut().enumerate() {
                            let variance = factor.variance(c).max(V::splat(1e-12));
                            variance.store(&mut out[here.clone()]);
                        }
                        let mut weight = V::splat(0.0);
                        for observation in posterior.observations {
                            weight += observation.load_weight(&texels);
                        }
                        weight.store(&mut weight_out[here.clone()]);
                        let loss = loss * V::splat(1.0 / 3.0);
                        loss.store(&mut loss_out[here.clone()]);
                    }
                }
            }
        }
    }
}
