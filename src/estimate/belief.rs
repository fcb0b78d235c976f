//! What is believed of the maps between two phases.

use super::correction::Offset;
use super::finer::Guide;
use super::options::EstimateOptions;
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
    /// What the prior's mean begins with: maps of the latent code, their gloss pooled. Always of the
    /// texels that phases work with.
    pub base: Svbrdf,
    /// The prior's mean, `m`.
    pub mean: Svbrdf,
    /// The prior's widths in the next steps.
    pub prior: Prior,
    /// The widths that the latest steps have found.
    pub found: Prior,
    /// Mean noise that the latest steps have found.
    pub noise: f32,
    /// Noise of the next steps where it is given, not found.
    pub fixed_noise: Option<f32>,
    /// By how much the base is off everywhere.
    pub offset: Offset,
}

impl Belief {
    /// Around maps of the latent code.
    pub fn new(base: Svbrdf, options: &EstimateOptions) -> Self {
        Self {
            maps: base.clone(),
            mean: base.clone(),
            base,
            prior: options.prior,
            found: options.prior,
            noise: options.noise.expected,
            fixed_noise: None,
            offset: Offset::default(),
        }
    }

    /// Brings maps and mean to the photographs' full resolution, for the last steps: these need no base.
    /// Nothing happens where they have it.
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

    /// The base without what it is off everywhere.
    pub fn corrected_base(&self) -> Svbrdf {
        self.offset.applied(&self.base)
    }
}
