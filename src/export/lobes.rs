//! The optional lobes in the conventions of other renderers.

use crate::svbrdf::Anisotropy;
use crate::svbrdf::gltf::{self, Shown};
use crate::{Svbrdf, parallel};

/// Index of refraction of a coat, for an F0 of 0.04.
pub(super) const COAT_IOR: f32 = 1.5;

/// [`gltf::alphas`] of every texel, `None` if no texel is anisotropic.
pub(super) fn anisotropy(maps: &Svbrdf) -> Option<Vec<Anisotropy>> {
    let mean = Shown::of(maps).anisotropy?;
    let width = maps.width();
    let rows = parallel::map(maps.height(), |row| {
        let texels = row * width..(row + 1) * width;
        texels.map(|i| gltf::alphas(maps, mean, i)).collect::<Vec<_>>()
    });
    Some(rows.concat())
}

/// A direction as a colour: `(x + 1) / 2`, `(y + 1) / 2`; `up` as in [`Bundle::normals`](super::bundle::Bundle::normals).
pub(super) fn direction(lobe: &Anisotropy, up: f32) -> [f32; 2] {
    let [x, y] = lobe.direction();
    [0.5 * x + 0.5, 0.5 * up * y + 0.5]
}

/// Convention of Unreal and Unity's HDRP (Kulla and Conty 2017): `along = r² (1 + a)`, `across = r²
/// (1 - a)`; returns the roughness `r` and `a`.
pub(super) fn arithmetic(lobe: &Anisotropy) -> [f32; 2] {
    let mean = 0.5 * (lobe.along + lobe.across);
    [mean.sqrt().min(1.0), (lobe.along - lobe.across) / (lobe.along + lobe.across)]
}

/// Convention of OpenPBR: `along² + across² = 2 r⁴`, `across = (1 - a) along`; returns `r` and `a`.
pub(super) fn quadratic(lobe: &Anisotropy) -> [f32; 2] {
    let square = 0.5 * (lobe.along * lobe.along + lobe.across * lobe.across);
    [square.sqrt().sqrt().min(1.0), 1.0 - lobe.across / lobe.along]
}

/// Convention of Cycles: `along = r² / s`, `across = r² s`, `s² = 1 - 0.9 a`; returns `a` and the rotation
/// from X to the direction in turns, 0 to 1. Ratios above 10 become 10. `r` is the roughness of the maps.
pub(super) fn cycles(lobe: &Anisotropy) -> [f32; 2] {
    use std::f32::consts::TAU;
    // Directions lie within half a turn of X, so adding half a turn makes them positive.
    [((1.0 - lobe.across / lobe.along) / 0.9).min(1.0), (lobe.angle / TAU + 0.5).clamp(0.0, 1.0)]
}

/// OpenPBR roughness that makes the lobe below a coat have the roughness `wanted`: a rough coat spreads rays,
/// `r -> (r⁴ + 2 coat⁴)^(1/4)`, mixed by its weight. 0 if the coat alone spreads more.
pub(super) fn below_rough_coat(wanted: f32, [weight, coat]: [f32; 2]) -> f32 {
    const HALVINGS: usize = 16;
    let spread = 2.0 * coat.powi(4);
    let shown = |r: f32| {
        let through = (r.powi(4) + spread).min(1.0).sqrt().sqrt();
        r + weight * (through - r)
    };
    if weight <= 0.0 {
        return wanted;
    }
    let [mut low, mut high] = [0.0, wanted];
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        *(if shown(middle) < wanted { &mut low } else { &mut high }) = middle;
    }
    0.5 * (low + high)
}

/// Sheen as the fuzz of OpenPBR and Blender's Principled (Zeltner et al. 2022, linearly transformed cosines).
pub(super) struct Fuzz {
    pub weight: f32,
    pub tint: [f32; 3],
    pub roughness: f32,
}

/// Description of [`fuzz`].
pub(super) const FUZZ: &str = "linearly transformed cosines, nearest to Charlie's distribution for each roughness: \
                               19 % (roughness 1) to 39 % (roughness 0.2) RMS off";

/// Roughness and weight of the fuzz nearest to white sheen of roughness 0.1, 0.2, ... 1: least squares over
/// directions of light and view up to 75 degrees, half of them near each other.
const NEAREST_FUZZ: [[f32; 2]; 10] = [
    [0.15, 38.4],
    [0.32, 3.95],
    [0.46, 1.92],
    [0.56, 1.37],
    [0.64, 1.10],
    [0.70, 0.96],
    [0.75, 0.87],
    [0.79, 0.81],
    [0.83, 0.76],
    [0.86, 0.73],
];

/// The fuzz nearest to sheen. Weights are at most 1.
pub(super) fn fuzz(colour: [f32; 3], roughness: f32) -> Fuzz {
    let most = colour.into_iter().fold(0.0, f32::max);
    let place = (10.0 * roughness - 1.0).clamp(0.0, 8.999);
    let (below, share) = (place as usize, place.fract());
    let [roughness, weight] = [0, 1].map(|i| {
        NEAREST_FUZZ[below][i] + share * (NEAREST_FUZZ[below + 1][i] - NEAREST_FUZZ[below][i])
    });
    let tint = if most > 0.0 { colour.map(|v| v / most) } else { [1.0; 3] };
    Fuzz { weight: (most * weight).min(1.0), tint, roughness }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::export::convert::Interface;
    use crate::svbrdf::{LOBES, lobe};

    proptest! {
        /// Each renderer's formulas convert the output back to the two alphas.
        #[test]
        fn other_forms_hold_the_same_alphas(roughness in 0.1..0.7f32, log_ratio in 0.0..2.2f32, angle in -1.57..1.57f32) {
            let (sin, cos) = (2.0 * angle).sin_cos();
            let lobe = Anisotropy::new(roughness, [log_ratio * cos, log_ratio * sin]);
            prop_assume!(lobe.along < 1.0);
            let same = |[along, across]: [f32; 2]| (along / lobe.along - 1.0).abs() < 1e-4 && (across / lobe.across - 1.0).abs() < 1e-4;
            let [r, a] = arithmetic(&lobe);
            prop_assert!(same([r * r * (1.0 + a), r * r * (1.0 - a)]));
            let [r, a] = quadratic(&lobe);
            let along = r * r * (2.0 / (1.0 + (1.0 - a).powi(2))).sqrt();
            prop_assert!(same([along, (1.0 - a) * along]));
            let [a, turns] = cycles(&lobe);
            let s = (1.0 - 0.9 * a).sqrt();
            prop_assert!(same([roughness.powi(2) / s, roughness.powi(2) * s]));
            let turned = std::f32::consts::TAU * turns;
            let [x, y] = lobe.direction();
            prop_assert!((x * turned.sin() - y * turned.cos()).abs() < 1e-4, "the same axis");
        }

        #[test]
        fn openpbr_s_spreading_is_undone(wanted in 0.3..1.0f32, weight in 0.0..1.0f32, coat in 0.0..0.2f32) {
            let given = below_rough_coat(wanted, [weight, coat]);
            let through = (given.powi(4) + 2.0 * coat.powi(4)).min(1.0).powf(0.25);
            prop_assert!((given + weight * (through - given) - wanted).abs() < 1e-3);
        }
    }

    #[test]
    fn fuzz_has_the_sheens_colour_and_a_weight_of_one_at_most() {
        let of = fuzz([0.1, 0.2, 0.05], 0.55);
        assert!((of.roughness - 0.67).abs() < 1e-6 && (of.weight - 0.2 * 1.03).abs() < 1e-6);
        assert_eq!(of.tint, [0.5, 1.0, 0.25]);
        assert_eq!(fuzz([0.5; 3], 0.1).weight, 1.0);
        assert_eq!((fuzz([0.0; 3], 1.0).weight, fuzz([0.0; 3], 1.0).tint), (0.0, [1.0; 3]));
        assert!((fuzz([1.0; 3], 1.0).roughness - 0.86).abs() < 1e-4);
    }

    #[test]
    fn directions_face_the_mean_one() {
        let mut maps = Svbrdf::new(2, 2);
        // Just above and below the direction of -X and X, and one isotropic texel.
        let mut planes = vec![0.0; LOBES * 4];
        planes[4 * lobe::ANISOTROPY_X..][..3].copy_from_slice(&[-1.0; 3]);
        planes[4 * lobe::ANISOTROPY_Y..][..3].copy_from_slice(&[-0.1, 0.1, 0.1]);
        maps.set_lobes(planes).unwrap();
        maps.roughness_mut().fill(0.4);
        let lobes = anisotropy(&maps).unwrap();
        let spread = |i: usize| (lobes[i].angle - lobes[0].angle).abs();
        assert!((1..4).all(|i| spread(i) < 0.2), "{lobes:?}");
        assert!(lobes[3].along == lobes[3].across);
        assert_eq!(anisotropy(&Svbrdf::new(2, 2)), None);
    }

    #[test]
    fn a_coat_has_the_librarys_f0() {
        assert!((Interface::of(0.04).ior - COAT_IOR).abs() < 1e-5);
    }
}
