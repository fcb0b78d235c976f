//! Normal equations of texels and shared unknowns, with the texels eliminated.

use std::ops::Range;

use nalgebra::DVector;

use super::eight::{Column, Eight, in_eights};
use super::elimination::{Eliminate, Eliminated, Totals};
use super::problem::Problem;
use super::state::State;
use super::sums::{Linear, Reduced};
use crate::estimate::coordinates::Coordinates;
use crate::simd::{LANES, dispatch};
use crate::svbrdf::CHANNELS;

/// A texel's own step, and the step that follows from a whole step of the shared unknowns.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TexelStep {
    own: [f32; CHANNELS],
    of_shared: [f32; CHANNELS],
}

impl TexelStep {
    /// The step with `length` of the shared step.
    pub fn with(&self, length: f64) -> Coordinates {
        std::array::from_fn(|c| f64::from(self.own[c]) + length * f64::from(self.of_shared[c]))
    }
}

impl Problem {
    /// Eliminates at most eight texels and adds them to the reduced equations.
    pub(super) fn eliminate_eight(
        &self,
        texels: Range<usize>,
        state: &State,
        linear: &[Linear],
        damping: f64,
        reduced: &mut Reduced,
        totals: &mut Totals,
    ) -> Eliminated {
        let block = self.block(texels.clone(), state, linear);
        let deviations = in_eights(texels.map(|t| state.deviations[t]));
        dispatch(Eliminate { block, deviations, damping, reduced, totals })
    }

    /// Shares of at most eight texels in each group.
    pub(super) fn eight_shares(&self, texels: Range<usize>) -> Vec<Eight> {
        let mut shares = vec![[0.0; LANES]; self.groups.mean.len()];
        for (lane, t) in texels.enumerate() {
            for (lanes, share) in shares.iter_mut().zip(self.texel_shares(t)) {
                lanes[lane] = *share;
            }
        }
        shares
    }

    /// Steps of at most eight texels for the step `shared`.
    pub(super) fn texel_steps(
        &self,
        texels: Range<usize>,
        shared: &DVector<f64>,
        eliminated: &Eliminated,
    ) -> [TexelStep; LANES] {
        let g = self.groups.coordinates.len();
        let shares = self.eight_shares(texels);
        let (groups, parameters) = shared.as_slice().split_at(g * shares.len());
        let of_groups = (0..g).map(|i| {
            let mut by = [0.0; LANES];
            for (share, group) in shares.iter().zip(groups.chunks_exact(g)) {
                for (by, share) in by.iter_mut().zip(share) {
                    *by += share * group[i] as f32;
                }
            }
            by
        });
        let by: Vec<Eight> =
            of_groups.chain(parameters.iter().map(|by| [*by as f32; LANES])).collect();
        let steps = eliminated.steps(&by);
        let of_lane = |step: &Column, lane: usize| std::array::from_fn(|c| step[c][lane]);
        std::array::from_fn(|lane| {
            let [own, of_shared] = [0, 1].map(|i| of_lane(&steps[i], lane));
            TexelStep { own, of_shared }
        })
    }

    /// The equations of the priors of groups and parameters.
    pub(super) fn priors(&self, state: &State) -> Reduced {
        let (moving, g) = (self.groups.coordinates.clone(), self.groups.coordinates.len());
        let mut sum = Reduced::zeros(g * state.groups.len() + self.shared.len());
        for (k, (group, mean)) in state.groups.iter().zip(&self.groups.mean).enumerate() {
            for (i, c) in moving.clone().enumerate() {
                let precision = self.groups.precision[k][c];
                sum.matrix[(g * k + i, g * k + i)] += precision;
                sum.gradient[g * k + i] += precision * (group[c] - mean[c]);
            }
        }
        let first = g * state.groups.len();
        for (a, shared) in self.shared.iter().enumerate() {
            sum.matrix[(first + a, first + a)] += shared.precision;
            let from_mean = shared.parameter.get(state) - shared.mean;
            sum.gradient[first + a] += shared.precision * from_mean;
        }
        sum
    }
}
