//! Reflection of eight texels at once, with the equations and names of the parent module.

use super::directions::{Directions, dot};
use super::microfacets::{Gloss, Microfacets};
use super::optional::{LobeParameters, Optional, OptionalLobes};
use super::scalar::{FRESNEL, MIN_COSINE};
use crate::simd::Lanes;
use crate::svbrdf::{CHANNELS, LOBES, channel, lobe};
use std::f32::consts::FRAC_1_PI;

/// Parameters of eight texels, precomputed for any number of views.
#[derive(Clone, Copy)]
pub(crate) struct Material<V> {
    pub normal: [V; 3],
    /// `n.z`: one over the length of (p, q, 1).
    pub inverse_length: V,
    pub diffuse: [V; 3],
    pub specular: [V; 3],
    gloss: Gloss<V>,
    optional: Option<Optional<V>>,
}

impl<V: Lanes> Material<V> {
    /// Takes parameters in the order of [`channel`], and those of optional lobes.
    #[inline(always)]
    pub fn new(parameters: &[V; CHANNELS], optional: Option<LobeParameters<V>>) -> Self {
        let one = V::splat(1.0);
        let [p, q] = [parameters[channel::SLOPE_X], parameters[channel::SLOPE_Y]];
        let inverse_length = p.mul_add(p, q.mul_add(q, one)).reciprocal_sqrt();
        let [_, _, dr, dg, db, sr, sg, sb, roughness] = *parameters;
        let normal = [p * inverse_length, q * inverse_length, inverse_length];
        Self {
            normal,
            inverse_length,
            diffuse: [dr, dg, db],
            specular: [sr, sg, sb],
            gloss: Gloss::new(roughness),
            optional: match optional {
                Some(lobes) => Some(Optional::new(&lobes, normal)),
                None => None,
            },
        }
    }

    /// Derivatives by the two slopes from the derivative by the unit normal.
    #[inline(always)]
    pub fn by_slopes(&self, by_normal: [V; 3]) -> [V; 2] {
        let along = dot(by_normal, self.normal);
        [
            (by_normal[0] - along * self.normal[0]) * self.inverse_length,
            (by_normal[1] - along * self.normal[1]) * self.inverse_length,
        ]
    }
}

/// Parts of a reflection common to the colour channels.
#[derive(Clone, Copy)]
pub(crate) struct Lobes<V> {
    /// NoL, NoV, NoH, limited to the least cosine, and unlimited.
    cosines: [V; 3],
    raw: [V; 3],
    base: Microfacets<V>,
    /// D G / (4 NoL NoV), reduced by coat and sheen.
    pub specular: V,
    /// 1 / pi, reduced by coat and sheen.
    pub diffuse: V,
    /// 1 - fresnel.
    pub one_minus_fresnel: V,
    fresnel: V,
    /// NoL times attenuation: irradiance for unit power.
    pub irradiance: V,
    optional: Option<OptionalLobes<V>>,
}

impl<V: Lanes> Lobes<V> {
    #[inline(always)]
    pub fn new(material: &Material<V>, directions: &Directions<V>) -> Self {
        let (n, h) = (material.normal, directions.half);
        let least = V::splat(MIN_COSINE);
        let raw = [dot(n, directions.light), dot(n, directions.view), dot(n, h)];
        let cosines = [raw[0].max(least), raw[1].max(least), raw[2].max(least)];
        // den = NoH² (a² - 1) + 1 = sin² + NoH² a². The sum would lose its digits in `f32` for
        // narrow lobes, so sin² comes from the cross product.
        let cross = [
            n[1].mul_add(h[2], -(n[2] * h[1])),
            n[2].mul_add(h[0], -(n[0] * h[2])),
            n[0].mul_add(h[1], -(n[1] * h[0])),
        ];
        let behind = V::splat(1.0 - MIN_COSINE * MIN_COSINE);
        let sin2 = raw[2].if_greater(least, dot(cross, cross), behind);
        let one = V::splat(1.0);
        let (mut across, mut through, mut optional) = (sin2, one, None);
        if let Some(material) = &material.optional {
            let own = OptionalLobes::new(material, n, directions, cosines, sin2);
            across = raw[2].if_greater(least, own.stretched, behind);
            through = own.through_all;
            optional = Some(own);
        }
        let base = Microfacets::new(&material.gloss, cosines, across);
        Self {
            cosines,
            raw,
            base,
            specular: base.value * through,
            diffuse: V::splat(FRAC_1_PI) * through,
            one_minus_fresnel: one - directions.fresnel,
            fresnel: directions.fresnel,
            irradiance: cosines[0] * directions.attenuation,
            optional,
        }
    }

    /// Fresnel term of a colour channel.
    #[inline(always)]
    pub fn fresnel(&self, specular_albedo: V) -> V {
        specular_albedo.mul_add(self.one_minus_fresnel, self.fresnel)
    }

    /// Reflection of the base in a colour channel, and its Fresnel term.
    #[inline(always)]
    fn below(&self, material: &Material<V>, c: usize) -> (V, V) {
        let fresnel = self.fresnel(material.specular[c]);
        (fresnel.mul_add(self.specular, material.diffuse[c] * self.diffuse), fresnel)
    }

    /// BRDF of a colour channel, and its Fresnel term.
    #[inline(always)]
    pub fn brdf(&self, material: &Material<V>, c: usize) -> (V, V) {
        let (below, fresnel) = self.below(material, c);
        match &self.optional {
            Some(optional) => (below + optional.above[c], fresnel),
            None => (below, fresnel),
        }
    }

    /// Derivative of ln `specular` by roughness.
    #[inline(always)]
    pub fn log_specular_by_roughness(&self, material: &Material<V>) -> V {
        self.base.log_by_roughness(&material.gloss, self.cosines)
    }

    /// Derivative by the unit normal of `specular_weight * ln specular + irradiance_weight * irradiance`
    /// where coat and sheen transmit the same.
    #[inline(always)]
    pub fn by_normal(
        &self,
        material: &Material<V>,
        directions: &Directions<V>,
        specular_weight: V,
        irradiance_weight: V,
    ) -> [V; 3] {
        let [by_nl, by_nv, by_nh] = self.base.log_by_cosines(&material.gloss, self.cosines);
        let by_nl = specular_weight.mul_add(by_nl, irradiance_weight * directions.attenuation);
        let by = [by_nl, specular_weight * by_nv, specular_weight * by_nh];
        match &self.optional {
            None => self.of_cosines(directions, by),
            Some(optional) => {
                let by_sin2 = specular_weight * self.base.log_by_sin2();
                // By NoH at a constant stretched square.
                let by_nh = by[2] - by_sin2 * self.cosines[2] * V::splat(-2.0);
                let mut out = self.of_cosines(directions, [by[0], by[1], by_nh]);
                let live = self.raw[2].if_greater(V::splat(MIN_COSINE), by_sin2, V::splat(0.0));
                let stretched = optional.stretched_by_normal(material.normal, directions.half);
                for (out, by) in out.iter_mut().zip(stretched) {
                    *out = live.mul_add(by, *out);
                }
                out
            }
        }
    }

    /// Derivative by the unit normal of each colour's BRDF, as far as it is due to the optional lobes:
    /// reflection of coat and sheen, and dimming of the base by sheen. `None` without optional lobes.
    #[inline(always)]
    pub fn above_by_normal(
        &self,
        material: &Material<V>,
        directions: &Directions<V>,
    ) -> Option<[[V; 3]; 3]> {
        let (own, optional) = (self.optional.as_ref()?, material.optional.as_ref()?);
        let mut coat = own.microfacets.log_by_cosines(&optional.gloss, self.cosines);
        for by in &mut coat {
            *by = own.coat * *by;
        }
        if own.sheen.is_none() {
            return Some([self.of_cosines(directions, coat); 3]);
        }
        let mut out = [coat; 3];
        for (c, out) in out.iter_mut().enumerate() {
            let by = self.by_cosines_above(material, own, coat, c);
            *out = self.of_cosines(directions, by);
        }
        Some(out)
    }

    /// Adds a colour's derivatives by NoL, NoV and NoH that are due to sheen to those of the coat.
    #[inline(always)]
    fn by_cosines_above(
        &self,
        material: &Material<V>,
        own: &OptionalLobes<V>,
        coat: [V; 3],
        c: usize,
    ) -> [V; 3] {
        let Some(sheen) = &own.sheen else { return coat };
        let mut out = coat;
        let (gleam, below) = (own.above[c] - own.coat, self.below(material, c).0);
        for (out, by) in out.iter_mut().zip(sheen.log_by_cosines) {
            *out = gleam.mul_add(by, *out);
        }
        for (out, by) in out.iter_mut().zip(sheen.log_through_by_cosines) {
            *out = below.mul_add(by, *out);
        }
        out
    }

    /// Derivatives of a colour's BRDF by the parameters of the optional lobes, in the order of
    /// [`lobe`](crate::svbrdf::lobe), for a BRDF with this value and Fresnel term. Those by sheen are zero for
    /// materials without planes of sheen.
    #[inline(always)]
    pub fn by_lobes(
        &self,
        material: &Material<V>,
        c: usize,
        (brdf, fresnel): (V, V),
    ) -> [V; LOBES] {
        let (zero, least) = (V::splat(0.0), V::splat(MIN_COSINE));
        let mut out = [zero; LOBES];
        let (Some(own), Some(optional)) = (&self.optional, &material.optional) else { return out };
        let by_sin2 = fresnel * self.specular * self.base.log_by_sin2();
        let by_sin2 = self.raw[2].if_greater(least, by_sin2, zero);
        let [u, v] = own.stretched_by_anisotropy(optional);
        let below = (brdf - own.coat) * own.through.reciprocal();
        let by_roughness = own.microfacets.log_by_roughness(&optional.gloss, self.cosines);
        out[lobe::ANISOTROPY_X] = by_sin2 * u;
        out[lobe::ANISOTROPY_Y] = by_sin2 * v;
        out[lobe::COAT] = own.fresnel * (own.microfacets.value - below);
        out[lobe::COAT_ROUGHNESS] = own.coat * by_roughness;
        if let (Some(own_sheen), Some(sheen)) = (&own.sheen, &optional.sheen) {
            // The base below sheen and coat, undimmed by the sheen.
            let base = (brdf - own.above[c]) * own_sheen.through.reciprocal();
            let [by_roughness, albedo_by_roughness] = own_sheen.by_roughness(sheen);
            for (out, is_most) in out[lobe::SHEEN..].iter_mut().zip(sheen.is_most) {
                *out = -(base * own_sheen.albedo * is_most);
            }
            out[lobe::SHEEN + c] += own.through * own_sheen.value;
            out[lobe::SHEEN_ROUGHNESS] =
                (own.above[c] - own.coat) * by_roughness - base * sheen.most * albedo_by_roughness;
        }
        out
    }

    /// Derivative by the unit normal from those by NoL, NoV and NoH.
    #[inline(always)]
    fn of_cosines(&self, directions: &Directions<V>, [by_nl, by_nv, by_nh]: [V; 3]) -> [V; 3] {
        let (zero, least) = (V::splat(0.0), V::splat(MIN_COSINE));
        let by_nl = self.raw[0].if_greater(least, by_nl, zero);
        let by_nv = self.raw[1].if_greater(least, by_nv, zero);
        let by_nh = self.raw[2].if_greater(least, by_nh, zero);
        let mut out = [zero; 3];
        for i in 0..3 {
            let lv = by_nl.mul_add(directions.light[i], by_nv * directions.view[i]);
            out[i] = by_nh.mul_add(directions.half[i], lv);
        }
        out
    }
}

/// Derivatives by the unit vector to the light; each part is valid only perpendicular to that vector.
#[derive(Clone, Copy)]
pub(crate) struct ByLight<V> {
    /// Of the light's cosine.
    pub cosine: [V; 3],
    /// Of ln `specular`.
    pub log_specular: [V; 3],
    /// Of the Fresnel power.
    pub fresnel: [V; 3],
    /// Of each colour's BRDF, as far as it is due to the optional lobes, without the coat's Fresnel term,
    /// which varies by a thousandth between all positions of a flash beside the lens.
    pub above: [[V; 3]; 3],
}

impl<V: Lanes> Lobes<V> {
    /// The derivatives by the unit vector to the light.
    #[inline(always)]
    pub fn by_light(&self, material: &Material<V>, directions: &Directions<V>) -> ByLight<V> {
        let (zero, one, least) = (V::splat(0.0), V::splat(1.0), V::splat(MIN_COSINE));
        let (n, h, v) = (material.normal, directions.half, directions.view);
        let vh = dot(v, h).max(least);
        // The half vector rotates with the light, perpendicular to itself, by 1 / |l + v| = 1 / (2 VoH).
        let turn = (vh + vh).reciprocal();
        let live = self.raw[0].if_greater(least, one, zero);
        let slope = vh.mul_add(V::splat(2.0 * FRESNEL[0]), V::splat(FRESNEL[1]));
        let by_vh = slope * self.fresnel * turn * V::splat(std::f32::consts::LN_2);
        let nh = dot(n, h);
        let [by_nl, _, by_nh] = self.base.log_by_cosines(&material.gloss, self.cosines);
        let mut half = [by_nh * n[0], by_nh * n[1], by_nh * n[2]];
        let mut above = [[zero; 3]; 3];
        if let (Some(own), Some(optional)) = (&self.optional, &material.optional) {
            let by_sin2 = self.base.log_by_sin2();
            let by_nh = by_nh - by_sin2 * self.cosines[2] * V::splat(-2.0);
            let stretched = own.stretched_by_half(n);
            for i in 0..3 {
                half[i] = by_sin2.mul_add(stretched[i], by_nh * n[i]);
            }
            let mut coat = own.microfacets.log_by_cosines(&optional.gloss, self.cosines);
            for by in &mut coat {
                *by = own.coat * *by;
            }
            for (c, above) in above.iter_mut().enumerate() {
                let [by_nl, _, by_nh] = self.by_cosines_above(material, own, coat, c);
                let by_nh = self.raw[2].if_greater(least, by_nh * turn, zero);
                for (i, above) in above.iter_mut().enumerate() {
                    *above = (by_nl * live).mul_add(n[i], by_nh * (n[i] - nh * h[i]));
                }
            }
        }
        let along = dot(half, h);
        let turned = self.raw[2].if_greater(least, turn, zero);
        let mut out = ByLight { cosine: n, log_specular: n, fresnel: n, above };
        for i in 0..3 {
            out.cosine[i] = live * n[i];
            let of_half = turned * (half[i] - along * h[i]);
            out.log_specular[i] = (by_nl * live).mul_add(n[i], of_half);
            out.fresnel[i] = by_vh * (v[i] - vh * h[i]);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::scalar::reflect;
    use super::*;
    use crate::random::Random;
    use crate::simd::{Kernel, dispatch};

    /// A texel, and the derivative of its first colour along a direction perpendicular to the light.
    struct ByLightAlong {
        parameters: [f64; CHANNELS],
        lobes: [f64; LOBES],
        light: [f64; 3],
        view: [f64; 3],
        across: [f64; 3],
    }

    impl Kernel for ByLightAlong {
        type Output = f64;

        #[inline(always)]
        fn run<V: Lanes>(self) -> f64 {
            let lane = |v: f64| V::splat(v as f32);
            let [x, y, coat, roughness, sheen @ ..] = self.lobes.map(lane);
            let optional = LobeParameters { base: [x, y, coat, roughness], sheen: Some(sheen) };
            let material = Material::new(&self.parameters.map(lane), Some(optional));
            let (light, view) = (self.light.map(lane), self.view.map(lane));
            let sum = [light[0] + view[0], light[1] + view[1], light[2] + view[2]];
            let inverse = dot(sum, sum).reciprocal_sqrt();
            let vh = V::splat(0.5) * inverse.reciprocal();
            let power = vh.mul_add(V::splat(FRESNEL[0]), V::splat(FRESNEL[1])) * vh;
            let half = [sum[0] * inverse, sum[1] * inverse, sum[2] * inverse];
            let attenuation = V::splat(1.0);
            let directions = Directions { light, view, half, fresnel: power.exp2(), attenuation };
            let lobes = Lobes::new(&material, &directions);
            let (brdf, fresnel) = lobes.brdf(&material, 0);
            let by = lobes.by_light(&material, &directions);
            let along = |of: [V; 3]| dot(of, self.across.map(lane));
            let lobe = lobes.specular * lobes.irradiance;
            let total = along(by.cosine) * brdf
                + along(by.log_specular) * fresnel * lobe
                + along(by.fresnel) * lobe * (V::splat(1.0) - material.specular[0])
                + along(by.above[0]) * lobes.irradiance;
            f64::from(total.to_array()[0])
        }
    }

    /// Differences in double precision, except the coat's Fresnel term.
    #[test]
    fn derivatives_by_the_light_are_those_of_differences() {
        let mut random = Random::new(3);
        for case in 0..200 {
            let mut r = |low: f64, high: f64| low + (high - low) * random.uniform();
            let mut parameters: [f64; CHANNELS] = std::array::from_fn(|_| r(0.1, 0.6));
            let unit = |v: [f64; 3]| {
                let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
                v.map(|x| x / length)
            };
            (parameters[0], parameters[1]) = (r(-0.2, 0.2), r(-0.2, 0.2));
            let mut lobes =
                [r(-1.0, 1.0), r(-1.0, 1.0), r(0.0, 1.0), r(0.3, 0.6), 0.0, 0.0, 0.0, 0.5];
            if case % 2 == 0 {
                lobes[lobe::SHEEN..].copy_from_slice(&[r(0.0, 1.0), r(0.0, 1.0), 0.1, r(0.3, 1.0)]);
            }
            let view = unit([r(-0.3, 0.3), r(-0.3, 0.3), 1.0]);
            let light = unit([view[0] + r(-0.1, 0.1), view[1] + r(-0.1, 0.1), view[2]]);
            let other = [0.3, -0.4, 0.2];
            let along: f64 = (0..3).map(|i| other[i] * light[i]).sum();
            let across = unit(std::array::from_fn(|i| other[i] - along * light[i]));
            let value = |h: f64| {
                let light = unit(std::array::from_fn(|i| light[i] + h * across[i]));
                reflect(&parameters, &lobes, light, view).value[0]
            };
            let numeric = (value(1e-5) - value(-1e-5)) / 2e-5;
            let found = dispatch(ByLightAlong { parameters, lobes, light, view, across });
            let tolerance = 1e-3 * (numeric.abs() + value(0.0));
            assert!((found - numeric).abs() < tolerance, "{case}: {found} {numeric}");
        }
    }
}
