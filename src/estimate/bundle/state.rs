//! The unknowns of a fit, and the optional lobes among them.

use super::eight::{Eight, loaded};
use crate::estimate::coordinates::Coordinates;
use crate::estimate::correction::Correction;
use crate::reflectance::LobeParameters;
use crate::simd::Lanes;
use crate::svbrdf::{LOBES, NO_LOBES, lobe};

/// Optional lobes of eight texels.
pub(super) struct EightLobes {
    pub base: [Eight; lobe::SHEEN],
    /// `None` for a material without sheen.
    pub sheen: Option<[Eight; LOBES - lobe::SHEEN]>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    /// Deviations of texels from their prior means.
    pub deviations: Vec<Coordinates>,
    /// Each group's contribution to the prior means of its texels.
    pub groups: Vec<Coordinates>,
    pub correction: Correction,
    /// Optional lobes; `None` without any.
    pub lobes: Option<SharedLobes>,
}

/// Optional lobes of groups and of all texels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SharedLobes {
    /// Each group's contribution to both numbers of anisotropy.
    pub anisotropy: Vec<[f64; 2]>,
    /// Weight and roughness of the coat of all texels.
    pub coat: [f64; 2],
    /// Colour and roughness of the sheen of all texels; `None` without sheen.
    pub sheen: Option<[f64; LOBES - lobe::SHEEN]>,
}

impl SharedLobes {
    /// Neutral lobes of `groups` groups.
    pub fn none(groups: usize) -> Self {
        let coat = [NO_LOBES[lobe::COAT], NO_LOBES[lobe::COAT_ROUGHNESS]];
        Self { anisotropy: vec![[0.0; 2]; groups], coat, sheen: None }
    }

    /// The lobes of a texel with these shares of the groups, in the order of [`lobe`](crate::svbrdf::lobe).
    pub fn of_texel(&self, shares: impl IntoIterator<Item = f32>) -> [f64; LOBES] {
        let [mut u, mut v] = [0.0; 2];
        for (share, [of_u, of_v]) in shares.into_iter().zip(&self.anisotropy) {
            u += f64::from(share) * of_u;
            v += f64::from(share) * of_v;
        }
        let mut lobes = NO_LOBES;
        (lobes[lobe::ANISOTROPY_X], lobes[lobe::ANISOTROPY_Y]) = (u, v);
        [lobes[lobe::COAT], lobes[lobe::COAT_ROUGHNESS]] = self.coat;
        if let Some(sheen) = self.sheen {
            lobes[lobe::SHEEN..].copy_from_slice(&sheen);
        }
        lobes
    }
}

/// Optional lobes of eight texels, as vectors.
#[inline(always)]
pub(super) fn in_lanes<V: Lanes>(lobes: &Option<EightLobes>) -> Option<LobeParameters<V>> {
    let EightLobes { base, sheen } = lobes.as_ref()?;
    let mut parameters = LobeParameters { base: loaded(base), sheen: None };
    if let Some(sheen) = sheen {
        parameters.sheen = Some(loaded(sheen));
    }
    Some(parameters)
}
