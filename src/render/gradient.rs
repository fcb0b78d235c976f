//! Fused log-L1 loss of maps against photographs and its gradient, without stored renderings or Jacobians.

use super::prepared::{BAND_ROWS, Prepared, find_directions, load_lobes, load_texels};
use crate::loss::{EPSILON, OffsetPair};
use crate::observation::Observation;
use crate::parallel;
use crate::reflectance::{Directions, Lobes, Material};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, Svbrdf, bands, channel};

/// Log-L1 loss: weighted mean over photographs, texels and channels of `|ln(rendered + 0.01) -
/// ln(observed + 0.01)|`; 0 if all weights are 0.
///
/// Parameters must lie in their physical ranges. Measurements that are NaN must have weight 0.
///
/// # Panics
/// If the size of an observation differs from that of the maps.
pub fn loss(maps: &Svbrdf, observations: &[Observation]) -> f64 {
    let prepared = Prepared::new(maps, observations);
    let rows: Vec<[f64; 2]> = parallel::map(maps.height().div_ceil(BAND_ROWS), |band| {
        let first_row = band * BAND_ROWS;
        dispatch(LossBand { maps, observations: &prepared, first_row, scale: 1.0, sink: NoSink })
    });
    let [sum, weight] = total(&rows);
    if weight > 0.0 { sum / (3.0 * weight) } else { 0.0 }
}

/// [`loss`] and its gradient by the maps' nine planes, which is written to `gradient`. The gradient
/// is zero where rendering and measurement agree or the rendering explains a saturated measurement.
///
/// # Panics
/// If the size of an observation differs from that of the maps, or `gradient` does not hold `9 *
/// maps.texels()` values.
pub fn loss_and_gradient(maps: &Svbrdf, observations: &[Observation], gradient: &mut [f32]) -> f64 {
    assert_eq!(gradient.len(), maps.planes().len(), "nine planes of {} texels", maps.texels());
    let prepared = Prepared::new(maps, observations);
    let weight: f64 = observations.iter().map(Observation::total_weight).sum();
    if weight <= 0.0 {
        gradient.fill(0.0);
        return 0.0;
    }
    let scale = 1.0 / (3.0 * weight);
    let parts = bands::<CHANNELS, _>(gradient, maps.width(), maps.height(), BAND_ROWS);
    let rows: Vec<[f64; 2]> = parallel::map_parts(parts, |band, sink| {
        let first_row = band * BAND_ROWS;
        let scale = scale as f32;
        dispatch(LossBand { maps, observations: &prepared, first_row, scale, sink })
    });
    scale * total(&rows)[0]
}

fn total(rows: &[[f64; 2]]) -> [f64; 2] {
    rows.iter().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d])
}

/// Destination of the gradient.
trait Sink {
    const WANTED: bool;
    /// Texels `from..to` of the band.
    fn put<V: Lanes>(&mut self, from: usize, to: usize, gradient: [V; CHANNELS]);
}

struct NoSink;

impl Sink for NoSink {
    const WANTED: bool = false;
    #[inline(always)]
    fn put<V: Lanes>(&mut self, _: usize, _: usize, _: [V; CHANNELS]) {}
}

impl Sink for [&mut [f32]; CHANNELS] {
    const WANTED: bool = true;
    #[inline(always)]
    fn put<V: Lanes>(&mut self, from: usize, to: usize, gradient: [V; CHANNELS]) {
        for (plane, g) in self.iter_mut().zip(gradient) {
            g.store(&mut plane[from..to]);
        }
    }
}

struct LossBand<'a, S> {
    maps: &'a Svbrdf,
    observations: &'a [Prepared<'a>],
    first_row: usize,
    scale: f32,
    sink: S,
}

impl<S: Sink> Kernel for LossBand<'_, S> {
    /// Sums of weighted losses and of weights.
    type Output = [f64; 2];

    #[inline(always)]
    fn run<V: Lanes>(mut self) -> [f64; 2] {
        let (width, height) = (self.maps.width(), self.maps.height());
        let rows = BAND_ROWS.min(height - self.first_row);
        let mut sums = [0.0; 2];
        let mut directions = vec![Directions::none(); self.observations.len()];
        for r in 0..rows {
            let row = self.first_row + r;
            // Single precision suffices for a row: at most a few thousand values per lane.
            let mut row_sums = [V::splat(0.0); 2];
            for column in (0..width).step_by(LANES) {
                let end = (column + LANES).min(width);
                let texels = row * width + column..row * width + end;
                let parameters = load_texels(self.maps, texels.start, texels.end);
                let lobes = load_lobes(self.maps, texels.start, texels.end);
                let mut gradient = Gradient::new(Material::new(&parameters, lobes));
                find_directions(self.observations, column, row, &mut directions);
                for (observation, directions) in self.observations.iter().zip(&directions) {
                    let [l, w] = gradient.add::<S>(observation, directions, texels.clone());
                    row_sums[0] += l;
                    row_sums[1] += w;
                }
                if S::WANTED {
                    let at = r * width;
                    self.sink.put(at + column, at + end, gradient.finish(self.scale));
                }
            }
            for (sum, row_sum) in sums.iter_mut().zip(row_sums) {
                *sum += row_sum.sum();
            }
        }
        sums
    }
}

/// Sums over photographs for eight texels.
struct Gradient<V> {
    material: Material<V>,
    by_normal: [V; 3],
    by_diffuse: [V; 3],
    by_specular: [V; 3],
    by_roughness: V,
}

impl<V: Lanes> Gradient<V> {
    #[inline(always)]
    fn new(material: Material<V>) -> Self {
        let zero = V::splat(0.0);
        Self {
            material,
            by_normal: [zero; 3],
            by_diffuse: [zero; 3],
            by_specular: [zero; 3],
            by_roughness: zero,
        }
    }

    /// Adds a photograph; returns its weighted loss (three channels) and its weight.
    #[inline(always)]
    fn add<S: Sink>(
        &mut self,
        observation: &Prepared,
        directions: &Directions<V>,
        texels: std::ops::Range<usize>,
    ) -> [V; 2] {
        let zero = V::splat(0.0);
        let material = &self.material;
        let view = &observation.view;
        let lobes = Lobes::new(material, directions);
        let weight = observation.load_weight::<V>(&texels);

        let mut pairs = [OffsetPair { rendered: zero, observed: zero }; 3];
        let mut brdfs = [(zero, zero); 3];
        for c in 0..3 {
            let observed = observation.load_radiance::<V>(c, &texels);
            brdfs[c] = lobes.brdf(material, c);
            let irradiance = lobes.irradiance * V::splat(view.power[c]);
            let ambient = material.diffuse[c] * V::splat(view.ambient[c])
                + material.specular[c] * V::splat(view.mirrored[c]);
            let rendered = brdfs[c].0.mul_add(irradiance, ambient + V::splat(EPSILON));
            pairs[c] = OffsetPair::new(rendered, observed);
        }

        if S::WANTED {
            // One division for three, 1/a = bc / abc; offset renderings are at least 0.01. The sign
            // is zero where a saturated measurement is explained.
            let [a, b, c] = [pairs[0].rendered, pairs[1].rendered, pairs[2].rendered];
            let all = (a * b * c).reciprocal() * weight;
            let inverse = [all * b * c, all * a * c, all * a * b];
            let (mut by_irradiance, mut by_lobe) = (zero, zero);
            for c in 0..3 {
                let by_radiance = pairs[c].sign() * inverse[c];
                let (brdf, fresnel) = brdfs[c];
                let by_power = by_radiance * V::splat(view.power[c]);
                let by_brdf = by_power * lobes.irradiance;
                let by_ambient = by_radiance * V::splat(view.ambient[c]);
                let by_mirrored = by_radiance * V::splat(view.mirrored[c]);
                by_irradiance = by_power.mul_add(brdf, by_irradiance);
                by_lobe = by_brdf.mul_add(fresnel, by_lobe);
                self.by_diffuse[c] += by_brdf.mul_add(lobes.diffuse, by_ambient);
                self.by_specular[c] +=
                    by_brdf.mul_add(lobes.specular * lobes.one_minus_fresnel, by_mirrored);
            }
            let by_log_lobe = by_lobe * lobes.specular;
            let by_normal = lobes.by_normal(material, directions, by_log_lobe, by_irradiance);
            for (sum, g) in self.by_normal.iter_mut().zip(by_normal) {
                *sum += g;
            }
            if let Some(above) = lobes.above_by_normal(material, directions) {
                for (c, by_normal) in above.into_iter().enumerate() {
                    let by_power = pairs[c].sign() * inverse[c] * V::splat(view.power[c]);
                    let by_brdf = by_power * lobes.irradiance;
                    for (sum, g) in self.by_normal.iter_mut().zip(by_normal) {
                        *sum = by_brdf.mul_add(g, *sum);
                    }
                }
            }
            self.by_roughness =
                by_log_lobe.mul_add(lobes.log_specular_by_roughness(material), self.by_roughness);
        }

        // Select instead of multiplying by weight 0, because unseen texels may hold NaN.
        let loss = OffsetPair::log_l1_of_three(pairs) * weight;
        [weight.if_greater(zero, loss, zero), weight]
    }

    #[inline(always)]
    fn finish(&self, scale: f32) -> [V; CHANNELS] {
        let scale = V::splat(scale);
        let mut out = [V::splat(0.0); CHANNELS];
        let [p, q] = self.material.by_slopes(self.by_normal);
        out[channel::SLOPE_X] = p * scale;
        out[channel::SLOPE_Y] = q * scale;
        for c in 0..3 {
            out[channel::DIFFUSE + c] = self.by_diffuse[c] * scale;
            out[channel::SPECULAR + c] = self.by_specular[c] * scale;
        }
        out[channel::ROUGHNESS] = self.by_roughness * scale;
        out
    }
}
