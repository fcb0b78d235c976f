//! Sheen above the base and below a coat, for eight texels.

use std::f32::consts::{FRAC_1_PI, LOG2_E};

use super::charlie::{SHEEN_ALBEDO, SHEEN_MAX_ALBEDO, SHEEN_MIN_SIN2};
use crate::simd::Lanes;
use crate::svbrdf::MIN_SHEEN_ROUGHNESS;

/// Least exponent of a power of two.
const LEAST_EXPONENT: f32 = -100.0;

/// Sheen of eight texels, precomputed for any number of views.
#[derive(Clone, Copy)]
pub(super) struct Sheen<V> {
    pub colour: [V; 3],
    /// Largest of the colours, and which of them it is: 1 for the first such, 0 for the others.
    pub most: V,
    pub is_most: [V; 3],
    /// 1 / alpha and its derivative by roughness, zero for clamped roughness.
    inverse_alpha: V,
    inverse_by_roughness: V,
    /// (2 + 1 / alpha) / (8 pi), and 1 / (2 + 1 / alpha).
    scale: V,
    inverse_plus_2: V,
    /// Numerator and denominator of E: factors of 1 and the cosine, and their derivatives by roughness.
    albedo: [[V; 2]; 2],
    albedo_by_roughness: [[V; 2]; 2],
}

impl<V: Lanes> Sheen<V> {
    /// Takes colour and roughness.
    #[inline(always)]
    pub fn new([r, g, b, roughness]: [V; 4]) -> Self {
        let (zero, one, two) = (V::splat(0.0), V::splat(1.0), V::splat(2.0));
        let least = V::splat(MIN_SHEEN_ROUGHNESS);
        let held = roughness.max(least);
        let live = roughness.if_greater(least, one, zero);
        let inverse_roughness = held.reciprocal();
        let inverse_alpha = inverse_roughness * inverse_roughness;
        let plus_2 = inverse_alpha + two;
        let red = g.max(b).if_greater(r, zero, one);
        let green = (one - red) * b.if_greater(g, zero, one);
        let (mut albedo, mut albedo_by_roughness) = ([[zero; 2]; 2], [[zero; 2]; 2]);
        for i in 0..2 {
            let [one, of_c, of_r, of_cr, _, of_rr] = SHEEN_ALBEDO[i];
            let (of_r, of_cr, of_rr) = (V::splat(of_r), V::splat(of_cr), V::splat(of_rr));
            albedo[i] = [
                of_rr.mul_add(held, of_r).mul_add(held, V::splat(one)),
                of_cr.mul_add(held, V::splat(of_c)),
            ];
            albedo_by_roughness[i] = [(two * of_rr).mul_add(held, of_r) * live, of_cr * live];
        }
        Self {
            colour: [r, g, b],
            most: r.max(g).max(b),
            is_most: [red, green, one - red - green],
            inverse_alpha,
            inverse_by_roughness: -(two * inverse_alpha * inverse_roughness * live),
            scale: plus_2 * V::splat(FRAC_1_PI / 8.0),
            inverse_plus_2: plus_2.reciprocal(),
            albedo,
            albedo_by_roughness,
        }
    }
}

/// White sheen in one view, and how it dims the base.
#[derive(Clone, Copy)]
pub(super) struct SheenLobe<V> {
    /// D V.
    pub value: V,
    /// Half of ln sin².
    half_log_sin2: V,
    /// By NoL, NoV and NoH: derivatives of ln `value`.
    pub log_by_cosines: [V; 3],
    /// Directional albedo E at the smaller of NoL and NoV, that cosine, and one over the denominator of E, zero
    /// at the limits of E.
    pub albedo: V,
    cosine: V,
    inverse_bottom: V,
    /// Transmission `1 - most E`, and the derivatives of its log by NoL and NoV.
    pub through: V,
    pub log_through_by_cosines: [V; 2],
}

impl<V: Lanes> SheenLobe<V> {
    /// Takes NoL, NoV and NoH, and the squared component of the half vector perpendicular to the normal.
    #[inline(always)]
    pub fn new(sheen: &Sheen<V>, [nl, nv, nh]: [V; 3], sin2: V) -> Self {
        let (zero, one, limit) = (V::splat(0.0), V::splat(1.0), V::splat(SHEEN_MIN_SIN2));
        let held = sin2.max(limit);
        let half_log_sin2 = held.ln() * V::splat(0.5);
        let exponent = sheen.inverse_alpha * half_log_sin2 * V::splat(LOG2_E);
        let inverse_sum = (nl + nv - nl * nv).reciprocal();
        let cosine = nl.min(nv);
        let [[top, top_c], [bottom, bottom_c]] = sheen.albedo;
        let [of_cc, below_cc] = [V::splat(SHEEN_ALBEDO[0][4]), V::splat(SHEEN_ALBEDO[1][4])];
        let inverse_bottom =
            below_cc.mul_add(cosine, bottom_c).mul_add(cosine, bottom).reciprocal();
        let fit = of_cc.mul_add(cosine, top_c).mul_add(cosine, top) * inverse_bottom;
        let albedo = fit.clamp(0.0, SHEEN_MAX_ALBEDO);
        let live = V::splat(SHEEN_MAX_ALBEDO).if_greater(fit, inverse_bottom, zero);
        let inverse_bottom = fit.if_greater(zero, live, zero);
        let twice = cosine + cosine;
        let by_cosine = of_cc.mul_add(twice, top_c) - albedo * below_cc.mul_add(twice, bottom_c);
        let through = one - sheen.most * albedo;
        let dimmed = -(sheen.most * by_cosine * inverse_bottom * through.reciprocal());
        let by_nh = sin2.if_greater(limit, sheen.inverse_alpha * nh * held.reciprocal(), zero);
        Self {
            value: sheen.scale * inverse_sum * exponent.max(V::splat(LEAST_EXPONENT)).exp2(),
            half_log_sin2,
            log_by_cosines: [(nv - one) * inverse_sum, (nl - one) * inverse_sum, -by_nh],
            albedo,
            cosine,
            inverse_bottom,
            through,
            log_through_by_cosines: [
                nv.if_greater(nl, dimmed, zero),
                nv.if_greater(nl, zero, dimmed),
            ],
        }
    }

    /// Derivatives by roughness of ln `value` and of `albedo`.
    #[inline(always)]
    pub fn by_roughness(&self, sheen: &Sheen<V>) -> [V; 2] {
        let by_inverse = sheen.inverse_plus_2 + self.half_log_sin2;
        let [[top, top_c], [bottom, bottom_c]] = sheen.albedo_by_roughness;
        let by =
            top_c.mul_add(self.cosine, top) - self.albedo * bottom_c.mul_add(self.cosine, bottom);
        [by_inverse * sheen.inverse_by_roughness, by * self.inverse_bottom]
    }
}
