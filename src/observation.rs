//! One photograph as the fit sees it: radiance of every texel from the top, and the geometry of
//! camera and light that produced it.

use std::ops::Range;

use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use crate::{Error, Result};

/// How the light's strength depends on distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Falloff {
    /// The same irradiance at every texel (before the cosine): the reference renderer's light.
    None {
        /// Irradiance per channel; pi makes a white Lambertian texel facing the light come out
        /// at its albedo.
        power: [f32; 3],
    },
    /// `power / distance²`.
    InverseSquare {
        /// Intensity per channel times mm², i.e. irradiance at 1 mm.
        power_mm2: [f32; 3],
    },
}

/// Camera and light of one photograph in the board frame.
///
/// Radiance of a texel: `BRDF * NoL * E(texel) + ambient * (kd + ks)` with `E` from
/// [`Falloff`]. With `power_mm2 = pi * d²` a white Lambertian texel facing a light at distance `d`
/// comes out at its albedo: all of a capture's photographs share one such `d`, so that albedos are
/// absolute and radiances lie near [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Width and height of the sample, mm.
    pub sample_mm: [f32; 2],
    /// Camera centre, mm, board frame.
    pub camera_mm: [f32; 3],
    /// Light position, mm, board frame.
    pub light_mm: [f32; 3],
    /// Strength of the light over distance.
    pub falloff: Falloff,
    /// Radiance of a uniform surround per channel, in the same units.
    pub ambient: [f32; 3],
}

impl View {
    /// Position of a texel's centre on the sample, mm: `[x, y]`, for maps of `width * height`.
    pub fn texel_mm(&self, width: usize, height: usize, x: usize, y: usize) -> [f32; 2] {
        [
            self.sample_mm[0] * ((x as f32 + 0.5) / width as f32 - 0.5),
            self.sample_mm[1] * (0.5 - (y as f32 + 0.5) / height as f32),
        ]
    }

    /// The view of some rows of maps of `height` rows, as if they were the sample.
    pub(crate) fn of_rows(&self, rows: &Range<usize>, height: usize) -> Self {
        let pitch = self.sample_mm[1] / height as f32;
        let centre = pitch * (0.5 * height as f32 - 0.5 * (rows.start + rows.end) as f32);
        let mut view = *self;
        view.sample_mm[1] = pitch * rows.len() as f32;
        view.camera_mm[1] -= centre;
        view.light_mm[1] -= centre;
        view
    }
}

/// A rectified photograph: linear radiance and weight of each texel, with its [`View`].
///
/// A capture has many of them at full resolution, so they are kept small: radiance as half floats
/// (11 bits, finer than a camera's noise), weight as one byte.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    width: usize,
    height: usize,
    /// Camera and light.
    pub view: View,
    radiance: Vec<f16>,
    weight: Vec<u8>,
}

impl Observation {
    /// From three planes (R, G, B) of `width * height` radiances in the units of [`View`], and the
    /// weight of each texel, 0 (not seen) to 1: validity times foreshortening. A *negative*
    /// radiance `-v` marks a saturated measurement: the true one is at least `v`. Texels with
    /// values that are not finite get weight 0.
    ///
    /// # Errors
    /// When lengths do not fit the size.
    pub fn new(
        width: usize,
        height: usize,
        view: View,
        radiance: &[f32],
        weight: &[f32],
    ) -> Result<Self> {
        let n = width * height;
        if (radiance.len(), weight.len()) != (3 * n, n) {
            let message = format!(
                "{} radiances and {} weights, {} and {n} expected",
                radiance.len(),
                weight.len(),
                3 * n
            );
            return Err(Error::argument("observation", message));
        }
        let mut packed = vec![f16::ZERO; 3 * n];
        pack_radiances(radiance, &mut packed);
        let weigh = |i: usize| {
            let finite = (0..3).all(|c| radiance[c * n + i].is_finite());
            if finite { pack_weight(weight[i]) } else { 0 }
        };
        Ok(Self { width, height, view, radiance: packed, weight: (0..n).map(weigh).collect() })
    }

    /// From planes as they are kept.
    pub(crate) fn from_packed(
        width: usize,
        height: usize,
        view: View,
        radiance: Vec<f16>,
        weight: Vec<u8>,
    ) -> Self {
        debug_assert_eq!((radiance.len(), weight.len()), (3 * width * height, width * height));
        Self { width, height, view, radiance, weight }
    }

    /// Texels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Texels in a plane.
    pub fn texels(&self) -> usize {
        self.width * self.height
    }

    /// Radiance of channel `c` of a texel; negative where saturated.
    pub fn radiance(&self, c: usize, texel: usize) -> f32 {
        self.radiance[c * self.texels() + texel].to_f32()
    }

    /// Weight of a texel, 0 to 1.
    pub fn weight(&self, texel: usize) -> f32 {
        f32::from(self.weight[texel]) / 255.0
    }

    /// Sum of all weights.
    pub fn total_weight(&self) -> f64 {
        self.weight.iter().map(|&w| u64::from(w)).sum::<u64>() as f64 / 255.0
    }

    /// Radiances and weights.
    #[cfg(test)]
    pub(crate) fn planes(&self) -> (Vec<f32>, Vec<f32>) {
        let radiance = self.radiance.iter().map(|v| v.to_f32()).collect();
        (radiance, (0..self.texels()).map(|i| self.weight(i)).collect())
    }

    /// Another one with these changed.
    #[cfg(test)]
    pub(crate) fn changed(&self, change: impl FnOnce(&mut [f32], &mut [f32])) -> Self {
        let (mut radiance, mut weight) = self.planes();
        change(&mut radiance, &mut weight);
        Self::new(self.width, self.height, self.view, &radiance, &weight).unwrap()
    }

    /// Three planes of radiances as they are kept.
    pub(crate) fn packed_radiance(&self) -> &[f16] {
        &self.radiance
    }

    /// The same, to be changed; texels that are not finite must have no weight.
    pub(crate) fn packed_radiance_mut(&mut self) -> &mut [f16] {
        &mut self.radiance
    }

    /// Weights in units of 1/255.
    pub(crate) fn packed_weight(&self) -> &[u8] {
        &self.weight
    }

    /// The same photograph at half the resolution: weighted means of 2x2 texels; saturated where
    /// one of the four is. Sizes must be even.
    ///
    /// # Panics
    /// When width or height is odd.
    pub fn downsampled(&self) -> Self {
        let (w, h) = (self.width, self.height);
        assert!(w % 2 == 0 && h % 2 == 0, "{w}x{h} cannot be halved");
        let (w2, h2) = (w / 2, h / 2);
        let mut weight = vec![0; w2 * h2];
        let mut radiance = vec![f16::ZERO; 3 * w2 * h2];
        let four = |y: usize, x: usize| {
            let corner = 2 * y * w + 2 * x;
            [corner, corner + 1, corner + w, corner + w + 1]
        };
        weight.par_chunks_mut(w2).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let sum = four(y, x).iter().map(|&i| u16::from(self.weight[i])).sum::<u16>();
                *out = sum.div_ceil(4) as u8;
            }
        });
        let buffers = || (vec![0.0; 2 * w], vec![0.0; w2]);
        radiance.par_chunks_mut(w2).enumerate().for_each_init(
            buffers,
            |(two, mean), (row, out)| {
                let (c, y) = (row / h2, row % h2);
                let from = c * w * h + 2 * y * w;
                self.radiance[from..from + 2 * w].convert_to_f32_slice(two);
                for (x, mean) in mean.iter_mut().enumerate() {
                    let corner = 2 * x;
                    let texels = [corner, corner + 1, corner + w, corner + w + 1];
                    let weights = four(y, x).map(|i| f32::from(self.weight[i]));
                    let values = texels.map(|i| two[i]);
                    let (mut sum, mut total, mut saturated) = (0.0, 0.0, false);
                    for (value, weight) in values.into_iter().zip(weights) {
                        sum += weight * value.abs();
                        total += weight;
                        saturated |= weight > 0.0 && value < 0.0;
                    }
                    *mean = if total <= 0.0 { 0.0 } else { sum / total };
                    if saturated {
                        *mean = -*mean;
                    }
                }
                pack_radiances(mean, out);
            },
        );
        Self { width: w2, height: h2, view: self.view, radiance, weight }
    }
}

/// A weight as it is kept: what is seen at all stays so.
pub(crate) fn pack_weight(weight: f32) -> u8 {
    (255.0 * weight).clamp(0.0, 255.0).ceil() as u8
}

/// Radiances as they are kept: numbers too large for half floats become the largest, what is
/// not a number zero, and no saturated value loses its sign.
pub(crate) fn pack_radiances(from: &[f32], to: &mut [f16]) {
    const BLOCK: usize = 64;
    let mut block = [0.0; BLOCK];
    for (from, to) in from.chunks(BLOCK).zip(to.chunks_mut(BLOCK)) {
        for (limited, &v) in block.iter_mut().zip(from) {
            let size = v.abs().clamp(LEAST, f16::MAX.to_f32_const());
            *limited = if v == 0.0 || v.is_nan() { 0.0 } else { size.copysign(v) };
        }
        to.convert_from_f32_slice(&block[..from.len()]);
    }
}

/// The least normal half float.
const LEAST: f32 = 6.103_515_6e-5;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const VIEW: View = View {
        sample_mm: [100.0; 2],
        camera_mm: [0.0, 0.0, 200.0],
        light_mm: [5.0, 0.0, 200.0],
        falloff: Falloff::None { power: [1.0; 3] },
        ambient: [0.0; 3],
    };

    #[test]
    fn values_keep_eleven_bits_and_their_sign() {
        let radiance = [0.731, -0.25, 1e-9, -1e-9, 1e9, 0.0, -0.0, f32::NAN, 1.0, 0.5, 0.1, 7.0];
        let weight = [1.0, 0.5, 1e-4, 0.9];
        let o = Observation::new(4, 1, VIEW, &radiance, &weight).unwrap();
        for (i, &v) in radiance.iter().enumerate() {
            let kept = o.radiance(i / 4, i % 4);
            match v {
                v if v.is_nan() => assert_eq!(kept, 0.0),
                v if v.abs() < 1e-5 => assert!(kept.abs() < 1e-4 && (kept < 0.0) == (v < 0.0)),
                v if v > 1e5 => assert_eq!(kept, 65504.0),
                v => assert!((kept - v).abs() <= v.abs() / 2048.0, "{v}: {kept}"),
            }
        }
        assert!(o.weight(0) == 1.0 && o.weight(2) > 0.0, "seen texels stay seen");
        assert_eq!(o.weight(3), 0.0, "its green is not a number");
        assert!(Observation::new(4, 2, VIEW, &radiance, &weight).is_err());
    }

    #[test]
    fn halving_keeps_weighted_means() {
        let (w, h) = (12, 6);
        let mut random = Random::new(8);
        let mut numbers =
            |n: usize| -> Vec<f32> { (0..n).map(|_| random.uniform() as f32).collect() };
        let (mut radiance, mut weight) = (numbers(3 * w * h), numbers(w * h));
        weight[0] = 0.0;
        for i in [2, 3, w + 2, w + 3] {
            weight[i] = 0.0;
        }
        radiance[4] = -1.0;
        let o = Observation::new(w, h, VIEW, &radiance, &weight).unwrap();
        let half = o.downsampled();
        assert_eq!((half.width(), half.height()), (w / 2, h / 2));
        for c in 0..3 {
            for i in 0..half.texels() {
                let corner = 2 * (i / (w / 2)) * w + 2 * (i % (w / 2));
                let four = [corner, corner + 1, corner + w, corner + w + 1];
                let sum: f32 = four.iter().map(|&i| o.weight(i)).sum();
                let mean = four.iter().map(|&i| o.weight(i) * o.radiance(c, i).abs()).sum::<f32>();
                // one unit of a weight; rounding of a half float
                assert!((half.weight(i) - sum / 4.0).abs() < 1.0 / 255.0);
                let found = half.radiance(c, i).abs();
                assert!((found - mean / sum.max(1e-9)).abs() < 1e-3 * found.max(0.1));
                assert_eq!(half.radiance(c, i) < 0.0, c == 0 && i == 2, "saturation spreads");
            }
        }
        assert_eq!(half.weight(1), 0.0);
    }
}
