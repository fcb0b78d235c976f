//! Residuals of a photograph at eight texels, and their derivatives.

use crate::estimate::noise::Noise;
use crate::loss::{EPSILON, OffsetPair};
use crate::reflectance::{Directions, Lobes, Material, TexelView};
use crate::simd::Lanes;
use crate::svbrdf::{CHANNELS, channel};

/// A measured radiance in one colour, its noise and weight.
pub(in crate::estimate) struct Measurement<V> {
    pub noise: Noise,
    pub radiance: V,
    pub weight: V,
}

/// Coordinates of a texel that determine a colour, in ascending order.
pub(in crate::estimate) const fn coordinates_of(c: usize) -> [usize; 5] {
    [
        channel::SLOPE_X,
        channel::SLOPE_Y,
        channel::DIFFUSE + c,
        channel::SPECULAR + c,
        channel::ROUGHNESS,
    ]
}

/// A residual in one colour, and its terms of the objective.
pub(in crate::estimate) struct Residual<V> {
    pub value: V,
    /// 1 / (rendered + 0.01).
    pub inverse: V,
    /// Weight of the squared residual in reweighted least squares.
    pub square_weight: V,
    /// Objective, and plain log-L1 loss.
    pub cost: V,
    pub loss: V,
}

impl<V: Lanes> Residual<V> {
    /// The residual of a material in a view.
    #[inline(always)]
    pub fn of(
        lobes: &Lobes<V>,
        material: &Material<V>,
        view: &TexelView,
        c: usize,
        seen: &Measurement<V>,
    ) -> Self {
        let (brdf, _) = lobes.brdf(material, c);
        let ambient = material.diffuse[c] * V::splat(view.ambient[c])
            + material.specular[c] * V::splat(view.mirrored[c]);
        let irradiance = lobes.irradiance * V::splat(view.power[c]);
        Self::new(brdf.mul_add(irradiance, ambient + V::splat(EPSILON)), seen)
    }

    #[inline(always)]
    fn new(offset_rendered: V, seen: &Measurement<V>) -> Self {
        let &Measurement { noise: Noise { scale, huber }, radiance: observed, weight } = seen;
        let (zero, threshold) = (V::splat(0.0), V::splat(huber));
        let pair = OffsetPair::new(offset_rendered, observed);
        // The radiance of an unseen texel is arbitrary.
        let value = weight.if_greater(zero, pair.log_residual(), zero);
        let size = value.abs();
        let scaled = weight * V::splat(scale.recip());
        let inner = value * value * V::splat(0.5 / huber);
        let outer = size - V::splat(0.5 * huber);
        let square_weight = scaled / size.max(threshold);
        Self {
            value,
            inverse: pair.rendered.reciprocal(),
            // A saturated measurement that the rendering reaches does not constrain the coordinates.
            square_weight: offset_rendered.if_greater(pair.rendered, zero, square_weight),
            cost: scaled * size.if_greater(threshold, outer, inner),
            loss: weight * size,
        }
    }
}

/// Terms that the colours of a photograph share, at eight texels.
pub(in crate::estimate) struct Shading<V> {
    pub lobes: Lobes<V>,
    lobe_by_slopes: [V; 2],
    irradiance_by_slopes: [V; 2],
    lobe_by_roughness: V,
    /// Of each colour's BRDF.
    above_by_slopes: Option<[[V; 2]; 3]>,
}

/// Residual and derivatives in one colour, at eight texels.
pub(in crate::estimate) struct LinearResidual<V> {
    pub residual: Residual<V>,
    /// Derivatives of ln(rendered + 0.01) by the [`coordinates_of`] the colour.
    pub by: [V; 5],
    pub brdf: V,
    pub fresnel: V,
    /// The irradiance, with the light's power.
    pub irradiance: V,
}

impl<V: Lanes> Shading<V> {
    #[inline(always)]
    pub fn new(material: &Material<V>, directions: &Directions<V>) -> Self {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let lobes = Lobes::new(material, directions);
        let by_normal = lobes.by_normal(material, directions, one, zero);
        let lobe_by_slopes = material.by_slopes(by_normal);
        let by_normal = lobes.by_normal(material, directions, zero, one);
        let irradiance_by_slopes = material.by_slopes(by_normal);
        let lobe_by_roughness = lobes.log_specular_by_roughness(material);
        let mut above_by_slopes = None;
        if let Some(by_normal) = lobes.above_by_normal(material, directions) {
            let mut by_slopes = [[zero; 2]; 3];
            for (by_slopes, by_normal) in by_slopes.iter_mut().zip(by_normal) {
                *by_slopes = material.by_slopes(by_normal);
            }
            above_by_slopes = Some(by_slopes);
        }
        Self { lobes, lobe_by_slopes, irradiance_by_slopes, lobe_by_roughness, above_by_slopes }
    }

    /// One colour at coordinates `x`, those of the material.
    #[inline(always)]
    pub fn line(
        &self,
        material: &Material<V>,
        view: &TexelView,
        c: usize,
        x: &[V; CHANNELS],
        seen: &Measurement<V>,
    ) -> LinearResidual<V> {
        let lobes = &self.lobes;
        let power = V::splat(view.power[c]);
        let ambient = V::splat(view.ambient[c]);
        let mirrored = V::splat(view.mirrored[c]);
        let (brdf, fresnel) = lobes.brdf(material, c);
        let irradiance = lobes.irradiance * power;
        let surround = material.diffuse[c] * ambient + material.specular[c] * mirrored;
        let rendered = brdf.mul_add(irradiance, surround + V::splat(EPSILON));
        let residual = Residual::new(rendered, seen);

        let lobe = fresnel * lobes.specular * irradiance * residual.inverse;
        let lit = brdf * power * residual.inverse;
        let mut by_slopes = [V::splat(0.0); 2];
        for (i, by) in by_slopes.iter_mut().enumerate() {
            *by = lobe.mul_add(self.lobe_by_slopes[i], lit * self.irradiance_by_slopes[i]);
        }
        if let Some(above) = self.above_by_slopes {
            for (by, above) in by_slopes.iter_mut().zip(above[c]) {
                *by = (irradiance * residual.inverse).mul_add(above, *by);
            }
        }
        let twice = residual.inverse * V::splat(2.0);
        let by_diffuse = irradiance.mul_add(lobes.diffuse, ambient);
        let by_specular = irradiance.mul_add(lobes.specular * lobes.one_minus_fresnel, mirrored);
        let by = [
            by_slopes[0],
            by_slopes[1],
            by_diffuse * twice * x[channel::DIFFUSE + c],
            by_specular * twice * x[channel::SPECULAR + c],
            lobe * self.lobe_by_roughness,
        ];
        LinearResidual { residual, by, brdf, fresnel, irradiance }
    }
}
