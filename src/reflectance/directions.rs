//! Views of eight texels at once.

use super::scalar::{FRESNEL, MIN_COSINE};
use crate::observation::{Falloff, View};
use crate::simd::Lanes;

/// A [`View`] of a grid of texels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TexelView {
    camera: [f32; 3],
    light: [f32; 3],
    origin: [f32; 2],
    step: [f32; 2],
    /// Irradiance is `power * (inverse_square / distance² + constant)`.
    pub power: [f32; 3],
    /// 1 with fall-off, else 0.
    pub inverse_square: f32,
    constant: f32,
    /// Ambient radiance for the diffuse albedo.
    pub ambient: [f32; 3],
    /// Ambient radiance for the specular albedo.
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

/// Unit vectors of eight texels to one light and one camera.
#[derive(Clone, Copy)]
pub(crate) struct Directions<V> {
    pub light: [V; 3],
    pub view: [V; 3],
    pub half: [V; 3],
    /// Schlick's power, with F = ks (1 - fresnel) + fresnel.
    pub fresnel: V,
    /// Irradiance perpendicular to the light for unit power.
    pub attenuation: V,
}

impl<V: Lanes> Directions<V> {
    /// Placeholder values.
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

    /// Texels at positions in mm.
    #[inline(always)]
    pub fn at(view: &TexelView, x: V, y: V) -> Self {
        let (l, inverse_distance) = towards(view.light, x, y);
        let (v, _) = towards(view.camera, x, y);
        let sum = [l[0] + v[0], l[1] + v[1], l[2] + v[2]];
        let length2 = dot(sum, sum).max(V::splat(4.0 * MIN_COSINE * MIN_COSINE));
        let inverse_length = length2.reciprocal_sqrt();
        // VoH = |l + v| / 2 for unit vectors; the limit above keeps it at the least cosine.
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
