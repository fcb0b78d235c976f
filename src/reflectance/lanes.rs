//! The reflection of eight texels at once; equations and names as in the parent module.

use super::scalar::{FRESNEL, MIN_COSINE};
use crate::observation::{Falloff, View};
use crate::simd::Lanes;
use crate::svbrdf::{CHANNELS, MIN_ROUGHNESS, channel};
use std::f32::consts::FRAC_1_PI;

/// A [`View`] together with the grid of texels it looks at.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TexelView {
    camera: [f32; 3],
    light: [f32; 3],
    origin: [f32; 2],
    step: [f32; 2],
    /// Irradiance is `power * (inverse_square / distance² + constant)`.
    pub power: [f32; 3],
    /// 1 where irradiance falls off, else 0.
    pub inverse_square: f32,
    constant: f32,
    /// Radiance of the surround for the diffuse albedo.
    pub ambient: [f32; 3],
    /// The same for the specular albedo.
    pub mirrored: [f32; 3],
}

impl TexelView {
    /// For maps of `width * height`.
    pub fn new(view: &View, width: usize, height: usize) -> Self {
        let (power, inverse_square) = match view.falloff {
            Falloff::None { power } => (power, 0.0),
            Falloff::InverseSquare { power_mm2 } => (power_mm2, 1.0),
        };
        Self {
            camera: view.camera_mm,
            light: view.light_mm,
            origin: view.texel_mm(width, height, 0, 0),
            step: [view.sample_mm[0] / width as f32, -view.sample_mm[1] / height as f32],
            power,
            inverse_square,
            constant: 1.0 - inverse_square,
            ambient: view.ambient,
            mirrored: view.ambient.map(|a| a * view.mirrored),
        }
    }
}

/// Parameters of eight texels, prepared for any number of views.
#[derive(Clone, Copy)]
pub(crate) struct Material<V> {
    pub normal: [V; 3],
    /// `n.z`: one over the length of (p, q, 1).
    pub inverse_length: V,
    pub diffuse: [V; 3],
    pub specular: [V; 3],
    alpha2: V,
    inverse_alpha2: V,
    alpha2_minus_1: V,
    k: V,
    one_minus_k: V,
    /// d alpha² / d roughness and dk / d roughness, zero where roughness is clamped.
    alpha2_by_roughness: V,
    k_by_roughness: V,
}

impl<V: Lanes> Material<V> {
    #[inline(always)]
    pub fn new(parameters: &[V; CHANNELS]) -> Self {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let [p, q] = [parameters[channel::SLOPE_X], parameters[channel::SLOPE_Y]];
        let inverse_length = p.mul_add(p, q.mul_add(q, one)).reciprocal_sqrt();
        let min_roughness = V::splat(MIN_ROUGHNESS);
        let roughness = parameters[channel::ROUGHNESS].max(min_roughness);
        let live = parameters[channel::ROUGHNESS].if_greater(min_roughness, roughness, zero);
        let alpha = roughness * roughness;
        let alpha2 = alpha * alpha;
        let k = alpha * V::splat(0.5);
        let [_, _, dr, dg, db, sr, sg, sb, _] = *parameters;
        Self {
            normal: [p * inverse_length, q * inverse_length, inverse_length],
            inverse_length,
            diffuse: [dr, dg, db],
            specular: [sr, sg, sb],
            alpha2,
            inverse_alpha2: alpha2.reciprocal(),
            alpha2_minus_1: alpha2 - one,
            k,
            one_minus_k: one - k,
            alpha2_by_roughness: alpha * live * V::splat(4.0),
            k_by_roughness: live,
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

/// Unit vectors of eight texels to one light and one camera.
#[derive(Clone, Copy)]
pub(crate) struct Directions<V> {
    pub light: [V; 3],
    pub view: [V; 3],
    pub half: [V; 3],
    /// Schlick's power; F = ks (1 - fresnel) + fresnel.
    pub fresnel: V,
    /// Irradiance across the light's direction for unit power.
    pub attenuation: V,
}

impl<V: Lanes> Directions<V> {
    /// To be overwritten.
    pub fn none() -> Self {
        let zero = V::splat(0.0);
        let three = [zero; 3];
        Self { light: three, view: three, half: three, fresnel: zero, attenuation: zero }
    }

    /// Texels `column ..` of a row.
    #[inline(always)]
    pub fn new(view: &TexelView, column: usize, row: usize) -> Self {
        let x = V::iota() + V::splat(column as f32);
        let x = x.mul_add(V::splat(view.step[0]), V::splat(view.origin[0]));
        Self::at(view, x, V::splat(view.origin[1] + row as f32 * view.step[1]))
    }

    /// Inverse distance of the light, 1/mm.
    #[inline(always)]
    pub fn inverse_distance(view: &TexelView, x: V, y: V) -> V {
        towards(view.light, x, y).1
    }

    /// Texels at these places, mm.
    #[inline(always)]
    pub fn at(view: &TexelView, x: V, y: V) -> Self {
        let (l, inverse_distance) = towards(view.light, x, y);
        let (v, _) = towards(view.camera, x, y);
        let sum = [l[0] + v[0], l[1] + v[1], l[2] + v[2]];
        let length2 = dot(sum, sum).max(V::splat(4.0 * MIN_COSINE * MIN_COSINE));
        let inverse_length = length2.reciprocal_sqrt();
        // VoH = |l + v| / 2 for unit vectors; the limit above holds it at the least cosine.
        let vh = length2 * inverse_length * V::splat(0.5);
        let fresnel = (vh.mul_add(V::splat(FRESNEL[0]), V::splat(FRESNEL[1])) * vh).exp2();
        Self {
            light: l,
            view: v,
            half: [sum[0] * inverse_length, sum[1] * inverse_length, sum[2] * inverse_length],
            fresnel,
            attenuation: (inverse_distance * inverse_distance)
                .mul_add(V::splat(view.inverse_square), V::splat(view.constant)),
        }
    }
}

/// Everything of a reflection that the colour channels share.
#[derive(Clone, Copy)]
pub(crate) struct Lobes<V> {
    nl: V,
    nh: V,
    /// D G / (4 NoL NoV).
    pub specular: V,
    /// 1 - fresnel.
    pub one_minus_fresnel: V,
    fresnel: V,
    /// NoL times attenuation: irradiance for unit power.
    pub irradiance: V,
    inverse_den: V,
    inverse_light: V,
    inverse_view: V,
    raw: [V; 3],
    nv: V,
}

impl<V: Lanes> Lobes<V> {
    #[inline(always)]
    pub fn new(material: &Material<V>, directions: &Directions<V>) -> Self {
        let (n, h) = (material.normal, directions.half);
        let least = V::splat(MIN_COSINE);
        let raw = [dot(n, directions.light), dot(n, directions.view), dot(n, h)];
        let [nl, nv, nh] = [raw[0].max(least), raw[1].max(least), raw[2].max(least)];
        // den = NoH² (a² - 1) + 1 = sin² + NoH² a²: for narrow lobes `f32` would lose the sum, so
        // sin² comes from the cross product.
        let cross = [
            n[1].mul_add(h[2], -(n[2] * h[1])),
            n[2].mul_add(h[0], -(n[0] * h[2])),
            n[0].mul_add(h[1], -(n[1] * h[0])),
        ];
        let behind = V::splat(1.0 - MIN_COSINE * MIN_COSINE);
        let sin2 = raw[2].if_greater(least, dot(cross, cross), behind);
        let den = (nh * nh).mul_add(material.alpha2, sin2);
        let shadow_light = nl.mul_add(material.one_minus_k, material.k);
        let shadow_view = nv.mul_add(material.one_minus_k, material.k);
        let inverse_den = den.reciprocal();
        let inverse_both = (shadow_light * shadow_view).reciprocal();
        let specular = material.alpha2
            * (inverse_den * inverse_den)
            * (inverse_both * V::splat(0.25 * FRAC_1_PI));
        Self {
            nl,
            nv,
            nh,
            specular,
            one_minus_fresnel: V::splat(1.0) - directions.fresnel,
            fresnel: directions.fresnel,
            irradiance: nl * directions.attenuation,
            inverse_den,
            inverse_light: inverse_both * shadow_view,
            inverse_view: inverse_both * shadow_light,
            raw,
        }
    }

    /// Fresnel term of a colour channel.
    #[inline(always)]
    pub fn fresnel(&self, specular_albedo: V) -> V {
        specular_albedo.mul_add(self.one_minus_fresnel, self.fresnel)
    }

    /// BRDF of a colour channel, and its Fresnel term.
    #[inline(always)]
    pub fn brdf(&self, material: &Material<V>, c: usize) -> (V, V) {
        let fresnel = self.fresnel(material.specular[c]);
        let diffuse = material.diffuse[c] * V::splat(FRAC_1_PI);
        (fresnel.mul_add(self.specular, diffuse), fresnel)
    }

    /// Derivative of ln `specular` with respect to roughness.
    #[inline(always)]
    pub fn log_specular_by_roughness(&self, material: &Material<V>) -> V {
        let one = V::splat(1.0);
        let by_alpha2 =
            material.inverse_alpha2 - V::splat(2.0) * self.nh * self.nh * self.inverse_den;
        let by_k = (one - self.nl) * self.inverse_light + (one - self.nv) * self.inverse_view;
        by_alpha2 * material.alpha2_by_roughness - by_k * material.k_by_roughness
    }

    /// Derivative by the unit normal of `specular_weight * ln specular + irradiance_weight *
    /// irradiance`.
    #[inline(always)]
    pub fn by_normal(
        &self,
        material: &Material<V>,
        directions: &Directions<V>,
        specular_weight: V,
        irradiance_weight: V,
    ) -> [V; 3] {
        let (zero, least) = (V::splat(0.0), V::splat(MIN_COSINE));
        let shadow = specular_weight * material.one_minus_k;
        let by_nl = irradiance_weight * directions.attenuation - shadow * self.inverse_light;
        let by_nv = -(shadow * self.inverse_view);
        let by_nh = specular_weight
            * self.inverse_den
            * self.nh
            * (material.alpha2_minus_1 * V::splat(-4.0));
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

/// Derivatives by the unit vector to the light, each of its parts live across that vector alone.
#[derive(Clone, Copy)]
pub(crate) struct ByLight<V> {
    /// Of the cosine of the light.
    pub cosine: [V; 3],
    /// Of ln `specular`.
    pub log_specular: [V; 3],
    /// Of the Fresnel power.
    pub fresnel: [V; 3],
}

impl<V: Lanes> Lobes<V> {
    /// The derivatives by the unit vector to the light.
    #[inline(always)]
    pub fn by_light(&self, material: &Material<V>, directions: &Directions<V>) -> ByLight<V> {
        let (zero, one, least) = (V::splat(0.0), V::splat(1.0), V::splat(MIN_COSINE));
        let (n, h, v) = (material.normal, directions.half, directions.view);
        let vh = dot(v, h).max(least);
        // The half vector turns by what the light does, across itself, over |l + v| = 2 VoH.
        let turn = (vh + vh).reciprocal();
        let live = self.raw[0].if_greater(least, one, zero);
        let by_nl = -(material.one_minus_k * self.inverse_light) * live;
        let by_nh = self.inverse_den * self.nh * material.alpha2_minus_1 * V::splat(-4.0) * turn;
        let by_nh = self.raw[2].if_greater(least, by_nh, zero);
        let slope = vh.mul_add(V::splat(2.0 * FRESNEL[0]), V::splat(FRESNEL[1]));
        let by_vh = slope * self.fresnel * turn * V::splat(std::f32::consts::LN_2);
        let nh = dot(n, h);
        let mut out = ByLight { cosine: n, log_specular: n, fresnel: n };
        for i in 0..3 {
            out.cosine[i] = live * n[i];
            out.log_specular[i] = by_nl.mul_add(n[i], by_nh * (n[i] - nh * h[i]));
            out.fresnel[i] = by_vh * (v[i] - vh * h[i]);
        }
        out
    }
}

/// Unit vector and inverse distance to a point from (x, y, 0).
#[inline(always)]
fn towards<V: Lanes>(target: [f32; 3], x: V, y: V) -> ([V; 3], V) {
    let (dx, dy, dz) = (V::splat(target[0]) - x, V::splat(target[1]) - y, V::splat(target[2]));
    let inverse = dx.mul_add(dx, dy * dy + dz * dz).reciprocal_sqrt();
    ([dx * inverse, inverse * dy, inverse * dz], inverse)
}

#[inline(always)]
pub(crate) fn dot<V: Lanes>(a: [V; 3], b: [V; 3]) -> V {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}
