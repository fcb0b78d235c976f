//! What photographs tell of texels as they are.

use super::normal_equations::NormalEquations;
use super::{Model, Options, Prior, coordinates};
use crate::Svbrdf;
use crate::observation::Observation;
use crate::reflectance::Directions;
use crate::render::{self, BAND_ROWS, Prepared, find_directions};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, bands, channel};
use rayon::prelude::*;

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
    let n = maps.texels();
    let prepared = Prepared::new(maps, observations);
    let model = Model {
        observations: &prepared,
        inverse_noise: options.noise.recip(),
        huber: options.huber,
        precision: prior.sigma.map(|s| (s * s).recip()),
        widening: 1.0,
    };
    let mut planes = vec![0.0; 5 * n];
    bands::<5, _>(&mut planes, maps.width(), maps.height(), BAND_ROWS)
        .into_par_iter()
        .enumerate()
        .for_each(|(band, out)| {
            dispatch(Band { model: &model, maps, mean, first_row: band * BAND_ROWS, out });
        });
    Evidence { texels: n, planes }
}

struct Band<'a> {
    model: &'a Model<'a>,
    maps: &'a Svbrdf,
    mean: &'a Svbrdf,
    first_row: usize,
    out: [&'a mut [f32]; 5],
}

impl Kernel for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        let width = self.maps.width();
        let mut directions = vec![Directions::none(); self.model.observations.len()];
        let [mut out @ .., cost_out] = self.out;
        for r in 0..cost_out.len() / width {
            let row = self.first_row + r;
            for column in (0..width).step_by(LANES) {
                let end = (column + LANES).min(width);
                let (texels, here) =
                    (row * width + column..row * width + end, r * width + column..r * width + end);
                let load = |maps: &Svbrdf| -> [V; CHANNELS] {
                    coordinates(render::load_texels(maps, texels.start, texels.end))
                };
                let (x, mean) = (load(self.maps), load(self.mean));
                find_directions(self.model.observations, column, row, &mut directions);
                let (equations, [cost, _]) =
                    NormalEquations::new(self.model, &x, &mean, &directions, texels);
                cost.store(&mut cost_out[here.clone()]);
                for ((variance, out), c) in
                    equations.gloss_variances().into_iter().zip(out.iter_mut()).zip(GLOSS)
                {
                    let all = variance.max(V::splat(1e-9)).reciprocal();
                    let told = (all - V::splat(self.model.precision[c])).max(V::splat(0.0));
                    told.store(&mut out[here.clone()]);
                }
            }
        }
    }
}
