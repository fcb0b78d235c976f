//! Widths of the posterior of texels, and the residuals that the maps leave.

use crate::Svbrdf;
use crate::estimate::noise::Noise;
use crate::estimate::posterior::{NormalEquations, Posterior};
use crate::estimate::prior::{Prior, to_coordinates};
use crate::observation::Observation;
use crate::parallel;
use crate::reflectance::Directions;
use crate::render::{self, BAND_ROWS, Prepared, find_directions};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, bands};

/// Planes that a band fills: variances, the sum of the weights, the loss.
const PLANES: usize = CHANNELS + 2;

/// Marginal variances of each texel's coordinates under the quadratic model, and what it was made of.
pub(super) struct Widths {
    texels: usize,
    planes: Vec<f32>,
}

impl Widths {
    /// Variance of a coordinate.
    pub fn variance(&self, c: usize) -> &[f32] {
        self.plane(c)
    }

    /// Sum over the photographs of their weights.
    pub fn weight(&self) -> &[f32] {
        self.plane(CHANNELS)
    }

    /// Weighted sum over the photographs of the absolute log residuals, mean of the colours.
    pub fn loss(&self) -> &[f32] {
        self.plane(CHANNELS + 1)
    }

    fn plane(&self, i: usize) -> &[f32] {
        &self.planes[i * self.texels..][..self.texels]
    }
}

/// The widths at maps. The mean of the prior does not enter them.
///
/// # Panics
/// When sizes differ.
pub(super) fn widths(
    maps: &Svbrdf,
    observations: &[Observation],
    prior: &Prior,
    noise: Noise,
) -> Widths {
    let prepared = Prepared::new(maps, observations);
    let posterior = Posterior::new(&prepared, [noise; 3], prior);
    let (width, height, texels) = (maps.width(), maps.height(), maps.texels());
    let mut planes = vec![0.0; PLANES * texels];
    let bands = bands::<PLANES, _>(&mut planes, width, height, BAND_ROWS);
    parallel::parts(bands, |band, planes| {
        let first_row = band * BAND_ROWS;
        dispatch(Band { posterior: &posterior, maps, first_row, planes });
    });
    Widths { texels, planes }
}

struct Band<'a> {
    posterior: &'a Posterior<'a>,
    maps: &'a Svbrdf,
    first_row: usize,
    planes: [&'a mut [f32]; PLANES],
}

impl Kernel for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { posterior, maps, first_row, planes } = self;
        let width = maps.width();
        let mut directions = vec![Directions::none(); posterior.observations.len()];
        for r in 0..planes[0].len() / width {
            let row = first_row + r;
            for column in (0..width).step_by(LANES) {
                let end = (column + LANES).min(width);
                let (texels, here) =
                    (row * width + column..row * width + end, r * width + column..r * width + end);
                let x: [V; CHANNELS] =
                    to_coordinates(render::load_texels(maps, texels.start, texels.end));
                find_directions(posterior.observations, column, row, &mut directions);
                let mut weight = V::splat(0.0);
                for observation in posterior.observations {
                    weight += observation.load_weight(&texels);
                }
                let (equations, (_, [red, green, blue])) =
                    NormalEquations::new(posterior, &x, &x, &directions, texels);
                let covariance = equations.covariance();
                let mut diagonal = 0;
                for c in 0..CHANNELS {
                    let variance = covariance[diagonal].max(V::splat(1e-12));
                    diagonal += CHANNELS - c;
                    variance.store(&mut planes[c][here.clone()]);
                }
                weight.store(&mut planes[CHANNELS][here.clone()]);
                let loss = (red + green + blue) * V::splat(1.0 / 3.0);
                loss.store(&mut planes[CHANNELS + 1][here.clone()]);
            }
        }
    }
}
