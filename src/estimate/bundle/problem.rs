//! The posterior of a sample's texels, of groups of them, and of shared parameters.

use std::ops::Range;
use std::sync::Arc;

use super::eight::in_eights;
use super::parameters::{Parameter, Shared};
use super::sample::{Photograph, Sample};
use super::state::{EightLobes, SharedLobes, State};
use crate::estimate::coordinates::Coordinates;
use crate::estimate::coordinates::clamped;
use crate::estimate::correction::Correction;
use crate::estimate::noise::Noise;
use crate::reflectance::TexelView;
use crate::simd::LANES;
use crate::svbrdf::{CHANNELS, LOBES};

/// Groups of texels whose prior means move together.
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Groups {
    /// Coordinates that move.
    pub coordinates: Range<usize>,
    /// Range of a group's contribution.
    pub range: [f64; 2],
    /// Share of each texel in each group, texel by texel.
    pub shares: Vec<f32>,
    /// Each group's prior mean, and its precision.
    pub mean: Vec<Coordinates>,
    pub precision: Vec<Coordinates>,
}

/// A fit of some photographs of a sample.
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Problem {
    pub sample: Arc<Sample>,
    /// Fitted photographs; the indices of parameters refer to this list.
    pub which: Vec<usize>,
    /// Prior means of texels without their groups' contributions.
    pub mean: Vec<Coordinates>,
    /// Precisions of texels' deviations.
    pub precision: Coordinates,
    pub groups: Groups,
    pub shared: Vec<Shared>,
    pub noise: Noise,
}

impl Problem {
    /// The prior means of texels, groups and optional lobes, and this correction.
    pub fn start(&self, correction: Correction) -> State {
        let deviations = vec![[0.0; CHANNELS]; self.sample.texels()];
        let mut state =
            State { deviations, groups: self.groups.mean.clone(), correction, lobes: None };
        for shared in &self.shared {
            use Parameter::{Anisotropy, Coat, Sheen};
            if matches!(shared.parameter, Anisotropy(..) | Coat(_) | Sheen(_)) {
                shared.parameter.set(&mut state, shared.mean);
            }
        }
        state
    }

    /// The fitted photographs.
    pub(super) fn photographs(&self) -> impl Iterator<Item = &Photograph> {
        self.which.iter().map(|&i| &self.sample.photographs[i])
    }

    pub(super) fn texel_shares(&self, t: usize) -> &[f32] {
        let k = self.groups.mean.len();
        &self.groups.shares[t * k..(t + 1) * k]
    }

    /// The prior mean of a texel.
    pub fn mean(&self, t: usize, state: &State) -> Coordinates {
        let mut mean = self.mean[t];
        for (share, group) in self.texel_shares(t).iter().zip(&state.groups) {
            for c in self.groups.coordinates.clone() {
                mean[c] += f64::from(*share) * group[c];
            }
        }
        mean
    }

    /// A texel's optional lobes, in the order of [`lobe`](crate::svbrdf::lobe).
    pub fn lobes(&self, t: usize, state: &State) -> Option<[f64; LOBES]> {
        Some(state.lobes.as_ref()?.of_texel(self.texel_shares(t).iter().copied()))
    }

    /// Optional lobes of at most eight texels, for kernels.
    pub(super) fn eight_lobes(&self, texels: Range<usize>, state: &State) -> Option<EightLobes> {
        let sheen = state.lobes.as_ref()?.sheen;
        let of_texels = texels.filter_map(|t| self.lobes(t, state)?.first_chunk().copied());
        let sheen = sheen.map(|of_all| of_all.map(|value| [value as f32; LANES]));
        Some(EightLobes { base: in_eights(of_texels), sheen })
    }

    pub fn coordinates(&self, t: usize, state: &State) -> Coordinates {
        self.deviating(t, state, &state.deviations[t])
    }

    /// A texel's coordinates with these deviations.
    pub(super) fn deviating(
        &self,
        t: usize,
        state: &State,
        deviations: &Coordinates,
    ) -> Coordinates {
        let mean = self.mean(t, state);
        std::array::from_fn(|c| clamped(c, mean[c] + deviations[c]))
    }

    /// Corrected views of the fitted photographs, for kernels.
    pub(super) fn views(&self, correction: &Correction) -> Vec<(TexelView, &Photograph)> {
        let photographs = self.photographs().enumerate();
        let view = |(i, view)| TexelView::new(&correction.apply(view, i), 1, 1);
        photographs.map(|(i, p)| (view((i, &p.view)), p)).collect()
    }

    /// Each texel's cost with this anisotropy of the specular lobe and no other optional lobe.
    pub fn costs_with(&self, state: &State, anisotropy: [f64; 2]) -> Vec<f64> {
        let mut lobes = SharedLobes::none(state.groups.len());
        lobes.anisotropy[0] = anisotropy;
        let state = State { lobes: Some(lobes), ..state.clone() };
        self.texel_costs(&state, [&state.deviations]).into_iter().map(|[cost]| cost).collect()
    }

    /// Negative logarithm of the posterior.
    pub fn cost(&self, state: &State) -> f64 {
        let costs = self.texel_costs(state, [&state.deviations]);
        costs.iter().map(|[cost]| cost).sum::<f64>() + self.shared_cost(state)
    }

    /// Cost of the shared unknowns.
    pub(super) fn shared_cost(&self, state: &State) -> f64 {
        let parameter = |s: &Shared| s.precision * (s.parameter.get(state) - s.mean).powi(2);
        let parameters: f64 = self.shared.iter().map(parameter).sum();
        let mut groups = 0.0;
        let Groups { mean, precision, .. } = &self.groups;
        for ((group, mean), precision) in state.groups.iter().zip(mean).zip(precision) {
            for c in self.groups.coordinates.clone() {
                groups += precision[c] * (group[c] - mean[c]).powi(2);
            }
        }
        0.5 * (parameters + groups)
    }
}
