//! The quadratic model of eight texels, and its minimum.

use std::ops::Range;

use super::cholesky::{Cholesky, PAIRS, at};
use super::model::Posterior;
use super::residual::{Measurement, Residual, Shading, coordinates_of};
use crate::reflectance::{Directions, Lobes};
use crate::simd::Lanes;
use crate::svbrdf::CHANNELS;

/// `H d = -g`. `H` is the weighted sum of Jacobian products plus the prior's precision.
pub(in crate::estimate) struct NormalEquations<V> {
    /// Lower triangle, by rows.
    pub matrix: [V; PAIRS],
    pub gradient: [V; CHANNELS],
}

/// Half the squared distance to the prior's mean, in sigmas.
#[inline(always)]
fn prior_cost<V: Lanes>(posterior: &Posterior, x: &[V; CHANNELS], mean: &[V; CHANNELS]) -> V {
    let mut sum = V::splat(0.0);
    for c in 0..CHANNELS {
        let d = x[c] - mean[c];
        sum = (d * d).mul_add(V::splat(0.5 * posterior.precision[c]), sum);
    }
    sum
}

/// Objective, and weighted log-L1 loss, at coordinates `x`.
#[inline(always)]
pub(in crate::estimate) fn cost<V: Lanes>(
    posterior: &Posterior,
    x: &[V; CHANNELS],
    mean: &[V; CHANNELS],
    directions: &[Directions<V>],
    texels: Range<usize>,
) -> (V, V) {
    let material = posterior.material(x, &texels);
    let (mut cost, mut loss) = (prior_cost(posterior, x, mean), V::splat(0.0));
    for (observation, directions) in posterior.observations.iter().zip(directions) {
        let view = &observation.view;
        let lobes = Lobes::new(&material, directions);
        let weight = observation.load_weight(&texels);
        for c in 0..3 {
            let radiance = observation.load_radiance(c, &texels);
            let seen = Measurement { noise: posterior.noise, radiance, weight };
            let residual = Residual::of(&lobes, &material, view, c, &seen);
            cost += residual.cost;
            loss += residual.loss;
        }
    }
    (cost, loss)
}

impl<V: Lanes> NormalEquations<V> {
    /// The equations at coordinates `x`, and the result of [`cost`].
    #[inline(always)]
    pub fn new(
        posterior: &Posterior,
        x: &[V; CHANNELS],
        mean: &[V; CHANNELS],
        directions: &[Directions<V>],
        texels: Range<usize>,
    ) -> (Self, (V, V)) {
        let material = posterior.material(x, &texels);
        let mut equations = Self::of_prior(posterior, x, mean);
        let (mut cost, mut loss) = (prior_cost(posterior, x, mean), V::splat(0.0));
        for (observation, directions) in posterior.observations.iter().zip(directions) {
            let shading = Shading::new(&material, directions);
            let weight = observation.load_weight(&texels);
            for c in 0..3 {
                let radiance = observation.load_radiance(c, &texels);
                let seen = Measurement { noise: posterior.noise, radiance, weight };
                let line = shading.line(&material, &observation.view, c, x, &seen);
                cost += line.residual.cost;
                loss += line.residual.loss;
                let Residual { value, square_weight, .. } = line.residual;
                equations.add(c, line.by, value, square_weight);
            }
        }
        (equations, (cost, loss))
    }

    /// Equations without residuals and prior.
    #[inline(always)]
    pub fn none() -> Self {
        Self { matrix: [V::splat(0.0); PAIRS], gradient: [V::splat(0.0); CHANNELS] }
    }

    #[inline(always)]
    fn of_prior(posterior: &Posterior, x: &[V; CHANNELS], mean: &[V; CHANNELS]) -> Self {
        let mut equations = Self::none();
        for c in 0..CHANNELS {
            let precision = V::splat(posterior.precision[c]);
            equations.matrix[at(c, c)] = precision;
            equations.gradient[c] = (x[c] - mean[c]) * precision;
        }
        equations
    }

    /// Adds a residual in colour `c` with its derivatives by the [`coordinates_of`] the colour.
    #[inline(always)]
    pub fn add(&mut self, c: usize, by: [V; 5], residual: V, weight: V) {
        let coordinates = coordinates_of(c);
        for (i, row) in coordinates.into_iter().enumerate() {
            let weighted = by[i] * weight;
            self.gradient[row] = weighted.mul_add(residual, self.gradient[row]);
            for (j, column) in coordinates[..=i].iter().enumerate() {
                let entry = &mut self.matrix[at(row, *column)];
                *entry = weighted.mul_add(by[j], *entry);
            }
        }
    }

    /// The factors of the matrix with its diagonal times `1 + damping`.
    #[inline(always)]
    pub fn factor(&self, damping: V) -> Cholesky<V> {
        let mut matrix = self.matrix;
        for i in 0..CHANNELS {
            matrix[at(i, i)] = damping.mul_add(matrix[at(i, i)], matrix[at(i, i)]);
        }
        Cholesky::new(&matrix)
    }

    /// The step to the minimum, with the diagonal times `1 + damping`.
    #[inline(always)]
    pub fn solve(&self, damping: V) -> [V; CHANNELS] {
        let factor = self.factor(damping);
        factor.backward(&factor.forward(&self.gradient))
    }
}

#[cfg(test)]
mod tests;
