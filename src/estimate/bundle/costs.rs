//! Costs of texels, eight at a time: each step tries several against all photographs.

use super::eight::{Column, Eight, in_eights, loaded, stored};
use super::problem::Problem;
use super::sample::Photograph;
use super::state::{EightLobes, State, in_lanes};
use crate::estimate::coordinates::Coordinates;
use crate::estimate::coordinates::natural;
use crate::estimate::posterior::{Measurement, Residual};
use crate::parallel;
use crate::reflectance::{Directions, Lobes, Material, TexelView};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::CHANNELS;

/// Texels per task: a sample of 32 a side keeps several threads busy.
const CHUNK: usize = 128;

impl Problem {
    /// Each texel's cost (residuals and prior of the deviations) for `K` values of its deviations, with the
    /// correction and groups of `state`.
    pub(super) fn texel_costs<const K: usize>(
        &self,
        state: &State,
        deviations: [&[Coordinates]; K],
    ) -> Vec<[f64; K]> {
        let mut costs = self.of_residuals(state, deviations);
        parallel::parts(costs.chunks_mut(CHUNK), |chunk, costs| {
            for (cost, t) in costs.iter_mut().zip(chunk * CHUNK..) {
                for (cost, deviations) in cost.iter_mut().zip(deviations) {
                    let prior = deviations[t].iter().zip(self.precision);
                    *cost += 0.5 * prior.map(|(d, precision)| precision * d * d).sum::<f64>();
                }
            }
        });
        costs
    }

    /// Cost of each texel's residuals for `K` values of its deviations.
    fn of_residuals<const K: usize>(
        &self,
        state: &State,
        deviations: [&[Coordinates]; K],
    ) -> Vec<[f64; K]> {
        let views = self.views(&state.correction);
        let mut sums = vec![[0.0; K]; self.sample.texels()];
        parallel::parts(sums.chunks_mut(CHUNK), |chunk, sums| {
            let first = chunk * CHUNK;
            for (block, sums) in sums.chunks_mut(LANES).enumerate() {
                let texels = first + block * LANES..first + block * LANES + sums.len();
                let natural = deviations.map(|deviations| {
                    let of = |t| natural(&self.deviating(t, state, &deviations[t]));
                    in_eights(texels.clone().map(of))
                });
                let lobes = self.eight_lobes(texels.clone(), state);
                let block = Block::<K> { problem: self, lobes, views: &views, texels, natural };
                let of_eight = dispatch(block);
                for (lane, sums) in sums.iter_mut().enumerate() {
                    *sums = of_eight.map(|lanes| f64::from(lanes[lane]));
                }
            }
        });
        sums
    }
}

/// At most eight texels.
struct Block<'a, const K: usize> {
    problem: &'a Problem,
    lobes: Option<EightLobes>,
    views: &'a [(TexelView, &'a Photograph)],
    texels: std::ops::Range<usize>,
    natural: [Column; K],
}

// Loops, because closures may stay calls without the kernel's target features.
impl<const K: usize> Kernel for Block<'_, K> {
    type Output = [Eight; K];

    #[inline(always)]
    fn run<V: Lanes>(self) -> Self::Output {
        let Problem { sample, noise, .. } = self.problem;
        let (n, zero) = (sample.texels(), V::splat(0.0));
        let [x, y] = sample.eight_places::<V>(self.texels.clone());
        let mut materials = [Material::new(&[zero; CHANNELS], None); K];
        for (material, natural) in materials.iter_mut().zip(&self.natural) {
            *material = Material::new(&loaded(natural), in_lanes(&self.lobes));
        }
        let mut sums = [zero; K];
        for (view, photograph) in self.views {
            let directions = Directions::at(view, x, y);
            let weight = V::load(&photograph.weight[self.texels.clone()], 0.0);
            for (sum, material) in sums.iter_mut().zip(&materials) {
                let lobes = Lobes::new(material, &directions);
                for c in 0..3 {
                    let plane = &photograph.radiance[c * n..(c + 1) * n];
                    let radiance = V::load(&plane[self.texels.clone()], 0.0);
                    let seen = Measurement { noise: *noise, radiance, weight };
                    let residual = Residual::of(&lobes, material, view, c, &seen);
                    *sum += residual.cost;
                }
            }
        }
        stored(&sums)
    }
}
