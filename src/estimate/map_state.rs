//! Maps and prior between two phases.

use super::finer::Guide;
use super::options::{EstimateOptions, JointPrior};
use super::photographs::Photographs;
use super::prior::Prior;
use crate::Svbrdf;
use crate::observation::Observation;

/// Texels to each side of the middle of the windows in which albedos and roughness go with colour, where
/// maps are brought to full size.
const GUIDE_RADIUS: usize = 2;

/// The maps, and the prior that the next steps of the solver hold them to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Belief {
    /// The most probable maps so far, `x`.
    pub maps: Svbrdf,
    /// The prior's mean, `m`.
    pub mean: Svbrdf,
    /// The prior's widths in the next steps.
    pub prior: Prior,
    /// The widths that the latest steps have found.
    pub found: Prior,
    /// Noise of the next steps where it is given, not found.
    pub fixed_noise: Option<f32>,
    /// The prior of the joint solve.
    pub joint: JointPrior,
}

impl Belief {
    /// Round maps.
    pub fn new(maps: Svbrdf, options: &EstimateOptions) -> Self {
        Self {
            mean: maps.clone(),
            maps,
            prior: options.prior,
            found: options.prior,
            fixed_noise: None,
            joint: options.joint.few,
        }
    }

    /// Brings maps and mean to the photographs' full resolution, for the last steps. Nothing happens where they
    /// have it.
    pub fn refine(&mut self, photographs: &Photographs) {
        let full = photographs.full().first().map_or(0, Observation::width);
        if self.maps.width() >= full {
            return;
        }
        let guide = Guide::new(photographs, GUIDE_RADIUS);
        for maps in [&mut self.maps, &mut self.mean] {
            *maps = guide.refined(maps);
        }
    }
}
