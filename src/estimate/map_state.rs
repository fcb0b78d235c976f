//! Maps and their prior, handed from phase to phase.

use super::finer::interpolated;
use super::noise::Noise;
use super::options::{EstimateOptions, JointPrior};
use super::photographs::Photographs;
use super::prior::Prior;
use crate::Svbrdf;
use crate::observation::Observation;

/// The maps, and the prior of the solver's next steps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MapState {
    /// The current maps, `x`.
    pub maps: Svbrdf,
    /// The prior's mean, `m`.
    pub mean: Svbrdf,
    /// The prior's sigmas, `Λ^-½`.
    pub prior: Prior,
    /// The noise of the solver's next steps.
    pub noise: Noise,
    /// The prior of the joint solve.
    pub joint: JointPrior,
}

impl MapState {
    /// These maps, which are also the prior's mean.
    pub fn new(maps: Svbrdf, options: &EstimateOptions) -> Self {
        Self {
            mean: maps.clone(),
            maps,
            prior: options.prior,
            noise: Noise::expected(&options.noise),
            joint: options.joint.two_photographs,
        }
    }

    /// Brings maps and mean to the photographs' full size for the last steps, unless they have it.
    pub fn refine(&mut self, photographs: &Photographs) {
        let full = photographs.full().first().map_or(0, Observation::width);
        if self.maps.width() >= full {
            return;
        }
        for maps in [&mut self.maps, &mut self.mean] {
            *maps = interpolated(maps, photographs.stride_log2());
        }
    }
}
