//! Anisotropy of the specular lobe, sheen above it and a coat above both, for eight texels.

use super::directions::{Directions, dot};
use super::microfacets::{Gloss, Microfacets};
use super::scalar::COAT_F0;
use super::sheen::{Sheen, SheenLobe};
use crate::simd::Lanes;
use crate::svbrdf::{LOBES, lobe};

/// Parameters of the optional lobes of eight texels.
#[derive(Clone, Copy)]
pub(crate) struct LobeParameters<V> {
    /// Anisotropy and coat, in the order of [`lobe`].
    pub base: [V; lobe::SHEEN],
    /// Sheen, in the same order; `None` for materials without sheen.
    pub sheen: Option<[V; LOBES - lobe::SHEEN]>,
}

/// Optional lobes of eight texels, precomputed for any number of views.
#[derive(Clone, Copy)]
pub(super) struct Optional<V> {
    /// Quadratic form of the half vector's components t, b: `xx t² + 2 xy t b + yy b²`.
    xx: V,
    xy: V,
    yy: V,
    anisotropy: [V; 2],
    /// sinh(m) / m and its derivative by m, divided by m, at the anisotropy's strength m.
    sinhc: V,
    slope: V,
    weight: V,
    pub gloss: Gloss<V>,
    /// Reciprocal length of the tangent before normalisation: X made orthogonal to the normal.
    inverse_tangent: V,
    pub sheen: Option<Sheen<V>>,
}

impl<V: Lanes> Optional<V> {
    #[inline(always)]
    pub fn new(lobes: &LobeParameters<V>, normal: [V; 3]) -> Self {
        let parameters = lobes.base;
        let (half, one) = (V::splat(0.5), V::splat(1.0));
        let [u, v] = [parameters[lobe::ANISOTROPY_X], parameters[lobe::ANISOTROPY_Y]];
        let m2 = u.mul_add(u, v * v);
        // Below this limit the differences lose their digits, and the functions equal their limits.
        let least = V::splat(0.1);
        let m = m2.max(V::splat(0.01)).sqrt();
        let exp = (m * V::splat(std::f32::consts::LOG2_E)).exp2();
        let (rising, inverse_m) = (exp * half, m.reciprocal());
        let falling = half * exp.reciprocal();
        let (cosh, sinhc) = (rising + falling, (rising - falling) * inverse_m);
        let slope = (cosh - sinhc) * (inverse_m * inverse_m);
        let sixth = V::splat(1.0 / 6.0);
        let small = |full: V, limit: V| m2.sqrt().if_greater(least, full, limit);
        let cosh = small(cosh, m2.mul_add(half, one));
        let sinhc = small(sinhc, m2.mul_add(sixth, one));
        Self {
            xx: cosh - sinhc * u,
            xy: -(sinhc * v),
            yy: cosh + sinhc * u,
            anisotropy: [u, v],
            sinhc,
            slope: small(slope, V::splat(1.0 / 3.0)),
            weight: parameters[lobe::COAT],
            gloss: Gloss::new(parameters[lobe::COAT_ROUGHNESS]),
            inverse_tangent: (one - normal[0] * normal[0]).reciprocal_sqrt(),
            // A closure may stay a call without the kernel's target features.
            #[allow(clippy::manual_map)]
            sheen: match lobes.sheen {
                Some(parameters) => Some(Sheen::new(parameters)),
                None => None,
            },
        }
    }
}

#[derive(Clone, Copy)]
pub(super) struct OptionalLobes<V> {
    tangent: V,
    bitangent: V,
    /// Derivatives of `stretched` by tangent and bitangent components.
    by_tangent: V,
    by_bitangent: V,
    inverse_tangent: V,
    /// Replaces sin² in the base lobe.
    pub stretched: V,
    pub microfacets: Microfacets<V>,
    pub fresnel: V,
    /// Reflection of the coat, and its transmission.
    pub coat: V,
    pub through: V,
    pub sheen: Option<SheenLobe<V>>,
    /// Reflection above the base in each colour: of the coat and of sheen below it.
    pub above: [V; 3],
    /// Transmission of both.
    pub through_all: V,
}

impl<V: Lanes> OptionalLobes<V> {
    #[inline(always)]
    pub fn new(
        optional: &Optional<V>,
        n: [V; 3],
        directions: &Directions<V>,
        cosines: [V; 3],
        sin2: V,
    ) -> Self {
        let (h, two) = (directions.half, V::splat(2.0));
        let r = optional.inverse_tangent;
        // h.x - n.x NoH, in a form that keeps its digits near the mirror direction.
        let across = n[1]
            .mul_add(n[1].mul_add(h[0], -(n[0] * h[1])), n[2] * n[2].mul_add(h[0], -(n[0] * h[2])));
        let (t, b) = (across * r, n[2].mul_add(h[1], -(n[1] * h[2])) * r);
        let by_tangent = optional.xx.mul_add(t, optional.xy * b);
        let by_bitangent = optional.xy.mul_add(t, optional.yy * b);
        let microfacets = Microfacets::new(&optional.gloss, cosines, sin2);
        let f0 = V::splat(COAT_F0);
        let fresnel = directions.fresnel.mul_add(V::splat(1.0) - f0, f0);
        let reflected = optional.weight * fresnel;
        let (coat, through) = (reflected * microfacets.value, V::splat(1.0) - reflected);
        let (mut above, mut through_all, mut sheen) = ([coat; 3], through, None);
        if let Some(material) = &optional.sheen {
            let lobe = SheenLobe::new(material, cosines, sin2);
            for (above, colour) in above.iter_mut().zip(material.colour) {
                *above = (through * lobe.value).mul_add(colour, *above);
            }
            through_all = through * lobe.through;
            sheen = Some(lobe);
        }
        Self {
            tangent: t,
            bitangent: b,
            by_tangent: two * by_tangent,
            by_bitangent: two * by_bitangent,
            inverse_tangent: r,
            stretched: t.mul_add(by_tangent, b * by_bitangent),
            microfacets,
            fresnel,
            coat,
            through,
            sheen,
            above,
            through_all,
        }
    }

    /// Derivative of `stretched` by the unit normal.
    #[inline(always)]
    pub fn stretched_by_normal(&self, n: [V; 3], h: [V; 3]) -> [V; 3] {
        let r = self.inverse_tangent;
        let (t, b) = (-(self.by_tangent * r), self.by_bitangent * r);
        let along = self.by_tangent.mul_add(self.tangent, self.by_bitangent * self.bitangent);
        let nh = dot(n, h);
        [
            t.mul_add(n[0].mul_add(h[0], nh), along * n[0] * (r * r)),
            t.mul_add(n[0] * h[1], -(b * h[2])),
            t.mul_add(n[0] * h[2], b * h[1]),
        ]
    }

    #[inline(always)]
    pub fn stretched_by_half(&self, n: [V; 3]) -> [V; 3] {
        let r = self.inverse_tangent;
        let (t, b) = (self.by_tangent * r, self.by_bitangent * r);
        [
            t * (V::splat(1.0) - n[0] * n[0]),
            b.mul_add(n[2], -(t * n[0] * n[1])),
            -(b.mul_add(n[1], t * n[0] * n[2])),
        ]
    }

    /// Derivatives of `stretched` by both parameters of the anisotropy.
    #[inline(always)]
    pub fn stretched_by_anisotropy(&self, optional: &Optional<V>) -> [V; 2] {
        let (t, b) = (self.tangent, self.bitangent);
        let square = t.mul_add(t, b * b);
        let own = [t.mul_add(t, -(b * b)), V::splat(2.0) * t * b];
        let [u, v] = optional.anisotropy;
        let turned = u.mul_add(own[0], v * own[1]);
        let mut out = [u, v];
        for (out, own) in out.iter_mut().zip(own) {
            let by = optional.sinhc * square - optional.slope * turned;
            *out = by.mul_add(*out, -(optional.sinhc * own));
        }
        out
    }
}
