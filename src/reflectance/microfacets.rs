//! A GGX lobe of eight texels, without its Fresnel term.

use crate::simd::Lanes;
use crate::svbrdf::MIN_ROUGHNESS;
use std::f32::consts::FRAC_1_PI;

/// Roughness of eight texels, precomputed for any number of views.
#[derive(Clone, Copy)]
pub(super) struct Gloss<V> {
    alpha2: V,
    inverse_alpha2: V,
    alpha2_minus_1: V,
    k: V,
    one_minus_k: V,
    /// d alpha² / d roughness and dk / d roughness, zero for clamped roughness.
    alpha2_by_roughness: V,
    k_by_roughness: V,
}

impl<V: Lanes> Gloss<V> {
    #[inline(always)]
    pub fn new(roughness: V) -> Self {
        let (zero, one, least) = (V::splat(0.0), V::splat(1.0), V::splat(MIN_ROUGHNESS));
        let held = roughness.max(least);
        let live = roughness.if_greater(least, held, zero);
        let alpha = held * held;
        let alpha2 = alpha * alpha;
        let k = alpha * V::splat(0.5);
        Self {
            alpha2,
            inverse_alpha2: alpha2.reciprocal(),
            alpha2_minus_1: alpha2 - one,
            k,
            one_minus_k: one - k,
            alpha2_by_roughness: alpha * live * V::splat(4.0),
            k_by_roughness: live,
        }
    }
}

/// D G / (4 NoL NoV) of a lobe in one view.
#[derive(Clone, Copy)]
pub(super) struct Microfacets<V> {
    pub value: V,
    inverse_den: V,
    inverse_light: V,
    inverse_view: V,
}

impl<V: Lanes> Microfacets<V> {
    /// Takes NoL, NoV and NoH, and the squared component of the half vector perpendicular to the normal.
    #[inline(always)]
    pub fn new(gloss: &Gloss<V>, [nl, nv, nh]: [V; 3], sin2: V) -> Self {
        let den = (nh * nh).mul_add(gloss.alpha2, sin2);
        let shadow_light = nl.mul_add(gloss.one_minus_k, gloss.k);
        let shadow_view = nv.mul_add(gloss.one_minus_k, gloss.k);
        let inverse_den = den.reciprocal();
        let inverse_both = (shadow_light * shadow_view).reciprocal();
        let value = gloss.alpha2
            * (inverse_den * inverse_den)
            * (inverse_both * V::splat(0.25 * FRAC_1_PI));
        Self {
            value,
            inverse_den,
            inverse_light: inverse_both * shadow_view,
            inverse_view: inverse_both * shadow_light,
        }
    }

    /// Derivative of the log by roughness.
    #[inline(always)]
    pub fn log_by_roughness(&self, gloss: &Gloss<V>, [nl, nv, nh]: [V; 3]) -> V {
        let one = V::splat(1.0);
        let by_alpha2 = gloss.inverse_alpha2 - V::splat(2.0) * nh * nh * self.inverse_den;
        let by_k = (one - nl) * self.inverse_light + (one - nv) * self.inverse_view;
        by_alpha2 * gloss.alpha2_by_roughness - by_k * gloss.k_by_roughness
    }

    /// Derivatives of the log by NoL, NoV and NoH, with sin² = 1 - NoH².
    #[inline(always)]
    pub fn log_by_cosines(&self, gloss: &Gloss<V>, [_, _, nh]: [V; 3]) -> [V; 3] {
        [
            -(gloss.one_minus_k * self.inverse_light),
            -(gloss.one_minus_k * self.inverse_view),
            self.inverse_den * nh * (gloss.alpha2_minus_1 * V::splat(-4.0)),
        ]
    }

    /// Derivative of the log by sin² alone.
    #[inline(always)]
    pub fn log_by_sin2(&self) -> V {
        self.inverse_den * V::splat(-2.0)
    }
}
