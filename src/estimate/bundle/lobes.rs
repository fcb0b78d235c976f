//! Optional lobes with their standard deviations.

use nalgebra::{DMatrix, DVector};

use super::parameters::{Parameter, Shared};
use super::problem::Problem;
use super::state::State;
use crate::svbrdf::{LOBES, lobe};

/// Damping that keeps equations in single precision positive definite.
const DAMPING: f64 = 1e-6;

/// Optional lobes and their standard deviations, 0 for absent lobes, each in the order of [`lobe`].
pub(crate) type EstimatedLobes = [[f64; LOBES]; 2];

impl Problem {
    /// The lobes of the mean texel, or of the mean texels of two `directions`; empty without lobes. Their covariance
    /// is the inverse of the reduced equations, in which a sample counts as `independent` texels; that of their
    /// priors if the equations are singular.
    pub fn estimated_lobes(
        &self,
        state: &State,
        directions: usize,
        independent: f64,
    ) -> Vec<EstimatedLobes> {
        let Some(lobes) = &state.lobes else { return Vec::new() };
        let matrix = self.reduced(state, DAMPING).0.matrix;
        let (size, count) = (matrix.nrows(), self.shared.len());
        let covariance = match matrix.cholesky() {
            Some(factor) => factor.inverse(),
            None => DMatrix::from_diagonal(&self.priors(state).matrix.diagonal().map(f64::recip)),
        };
        let (texels, groups) = (self.sample.texels(), self.groups.mean.len());
        let mut shares = vec![0.0; groups];
        for (i, share) in self.groups.shares.iter().enumerate() {
            shares[i % groups] += share / texels as f32;
        }
        let of_direction = |direction: usize| {
            if directions == 2 {
                let first = 1.0 - direction as f32;
                shares[groups - 2..].copy_from_slice(&[first, 1.0 - first]);
            }
            let deviation = |lobe: usize| {
                let by = |shared: &Shared| match shared.parameter {
                    Parameter::Anisotropy(group, i) if i == lobe => f64::from(shares[group]),
                    Parameter::Coat(i) if lobe::COAT + i == lobe => 1.0,
                    Parameter::Sheen(i) if lobe::SHEEN + i == lobe => 1.0,
                    _ => 0.0,
                };
                let gloss = std::iter::repeat_n(0.0, size - count);
                let by = DVector::from_iterator(size, gloss.chain(self.shared.iter().map(by)));
                (by.dot(&(&covariance * &by)) * texels as f64 / independent).sqrt()
            };
            [lobes.of_texel(shares.iter().copied()), std::array::from_fn(deviation)]
        };
        (0..directions.max(1)).map(of_direction).collect()
    }
}
