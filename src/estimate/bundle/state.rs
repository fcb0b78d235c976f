//! The unknowns of a fit, and the optional lobes among them.

use crate::estimate::coordinates::Coordinates;
use crate::estimate::correction::Correction;
use crate::simd::{LANES, Lanes};
use crate::svbrdf::{LOBES, NO_LOBES};

/// Optional lobes of eight texels.
pub(super) type EightLobes = [[f32; LANES]; LOBES];

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
}

impl SharedLobes {
    /// Neutral lobes of `groups` groups.
    pub fn none(groups: usize) -> Self {
        let [_, _, weight, roughness] = NO_LOBES;
        Self { anisotropy: vec![[0.0; 2]; groups], coat: [weight, roughness] }
    }

    /// The lobes of a texel with these shares of the groups, in the order of [`lobe`](crate::svbrdf::lobe).
    pub fn of_texel(&self, shares: impl IntoIterator<Item = f32>) -> [f64; LOBES] {
        let [mut u, mut v] = [0.0; 2];
        for (share, [of_u, of_v]) in shares.into_iter().zip(&self.anisotropy) {
            u += f64::from(share) * of_u;
            v += f64::from(share) * of_v;
        }
        let [weight, roughness] = self.coat;
        [u, v, weight, roughness]
    }
}

/// Optional lobes of eight texels, as vectors.
#[inline(always)]
pub(super) fn in_lanes<V: Lanes>(lobes: &Option<EightLobes>) -> Option<[V; LOBES]> {
    let mut lanes = [V::splat(0.0); LOBES];
    for (to, from) in lanes.iter_mut().zip(lobes.as_ref()?) {
        *to = V::from_array(*from);
    }
    Some(lanes)
}
