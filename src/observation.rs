//! A rectified photograph: radiance of every texel seen from above, with the geometry of camera and light.

use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::sync::Arc;

use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};

use crate::parallel;
use crate::svbrdf::{MAX_SAVED_SIDE, bands, strided};
use crate::{Error, Result};

/// Dependence of the light's strength on distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Falloff {
    /// The same irradiance at every texel, before the cosine: the light of the reference renderer.
    None {
        /// Irradiance per channel. At pi, a white Lambertian texel facing the light has its albedo
        /// as radiance.
        power: [f32; 3],
    },
    /// `power / distance²`.
    InverseSquare {
        /// Intensity per channel times mm²: the irradiance at 1 mm.
        power_mm2: [f32; 3],
    },
}

/// Camera and light of one photograph in the board frame.
///
/// Radiance of a texel: `BRDF * NoL * E(texel) + ambient * (kd + mirrored * ks)` with `E` from
/// [`Falloff`]. With `power_mm2 = pi * d²`, a white Lambertian texel facing a light at distance `d`
/// has its albedo as radiance. All photographs of a capture share one `d`, so that albedos are
/// absolute and radiances lie near [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Width and height of the sample, mm.
    pub sample_mm: [f32; 2],
    /// Camera centre, mm, board frame.
    pub camera_mm: [f32; 3],
    /// Light position, mm, board frame.
    pub light_mm: [f32; 3],
    /// Strength of the light over distance.
    pub falloff: Falloff,
    /// Radiance of the surroundings per channel in the same units: the mean, weighted by the cosine.
    pub ambient: [f32; 3],
    /// Radiance of the surroundings in the mirror direction over their mean; 1 if they are uniform.
    pub mirrored: f32,
}

impl Default for View {
    /// A sample of 100 x 100 mm, seen and lit from 300 mm above its centre: uniform irradiance pi, no ambient light.
    fn default() -> Self {
        let (camera_mm, light_mm) = ([0.0, 0.0, 300.0], [0.0, 0.0, 300.0]);
        let falloff = Falloff::None { power: [PI; 3] };
        Self {
            sample_mm: [100.0; 2],
            camera_mm,
            light_mm,
            falloff,
            ambient: [0.0; 3],
            mirrored: 1.0,
        }
    }
}

impl View {
    /// Whether all values are finite, the camera is above the sample and the light has power.
    fn is_possible(&self) -> bool {
        let Self { sample_mm, camera_mm, light_mm, falloff, ambient, mirrored } = self;
        let (Falloff::None { power } | Falloff::InverseSquare { power_mm2: power }) = falloff;
        let positive = sample_mm.iter().chain(power).chain([&camera_mm[2]]);
        let others = camera_mm[..2].iter().chain(light_mm).chain(ambient).chain([mirrored]);
        positive.clone().all(|v| *v > 0.0) && positive.chain(others).all(|v| v.is_finite())
    }

    /// Position of a texel's centre on the sample, mm: `[x, y]`, for maps of `width * height`.
    pub fn texel_mm(&self, width: usize, height: usize, x: usize, y: usize) -> [f32; 2] {
        [
            self.sample_mm[0] * ((x as f32 + 0.5) / width as f32 - 0.5),
            self.sample_mm[1] * (0.5 - (y as f32 + 0.5) / height as f32),
        ]
    }
}

/// A rectified photograph: linear radiance and weight of each texel, with its [`View`].
///
/// A capture holds many of them at full resolution, so a texel takes six bytes (see `Packed`).
/// Clones share the texels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SavedObservation")]
pub struct Observation {
    width: usize,
    height: usize,
    /// Camera and light.
    pub view: View,
    /// Standard deviation of log radiances as measured by the calibration, see
    /// [`Radiometry::log_sigma`](crate::calibration::photometry::Radiometry::log_sigma); 0 if not measured.
    pub log_sigma: f32,
    /// Three planes.
    #[serde(serialize_with = "crate::little_endian::serialize")]
    packed: Arc<Vec<Packed>>,
}

/// Saved form, whose values need checks.
#[derive(Deserialize)]
struct SavedObservation {
    width: usize,
    height: usize,
    view: View,
    log_sigma: f32,
    #[serde(with = "crate::little_endian")]
    packed: Vec<Packed>,
}

impl TryFrom<SavedObservation> for Observation {
    type Error = Error;

    fn try_from(saved: SavedObservation) -> Result<Self> {
        let SavedObservation { width, height, view, log_sigma, packed } = saved;
        let fault = |message: &str| Err(Error::argument("observation", message));
        if width.max(height) > MAX_SAVED_SIDE || packed.len() != 3 * width * height {
            return fault("its size is out of range");
        }
        if !packed.iter().all(|v| f16::from_bits(*v).is_finite()) || !view.is_possible() {
            return fault("a value is not a number, or out of range");
        }
        if !(0.0..=f32::MAX).contains(&log_sigma) {
            return fault("a standard deviation is negative");
        }
        Ok(Self { width, height, view, log_sigma, packed: Arc::new(packed) })
    }
}

/// One channel of a texel: the radiance as a half float whose lowest bit holds one of three bits of
/// the texel's weight (red the lowest, blue the highest), coded as `7 * (1 - weight)` (see
/// [`LEAST_WEIGHT`]). Rounding errs by 0.1 % at most, less than a camera's noise.
pub(crate) type Packed = u16;

/// A weight of 1.
pub(crate) const FULL_WEIGHT: u8 = 7;

/// Meaning of the smallest code above 0, in place of one seventh: the texel counts only where no
/// photograph shows it better.
pub(crate) const LEAST_WEIGHT: f32 = 0.02;

impl Observation {
    /// Takes three planes (R, G, B) of `width * height` radiances in the units of [`View`], and a weight per
    /// texel, 0 (not seen) to 1: validity times foreshortening. A *negative* radiance `-v` marks a saturated
    /// measurement: the true radiance is at least `v`. Texels with values that are not finite get weight 0.
    ///
    /// # Errors
    /// If a length does not fit the size.
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
        let weigh = |i: usize| {
            let finite = (0..3).all(|c| radiance[c * n + i].is_finite());
            if finite { pack_weight(weight[i]) } else { 0 }
        };
        let weight: Vec<u8> = (0..n).map(weigh).collect();
        Ok(Self::from_planes(width, height, view, radiance, &weight))
    }

    /// Takes three planes of radiances and weights coded by [`pack_weight`].
    pub(crate) fn from_planes(
        width: usize,
        height: usize,
        view: View,
        radiance: &[f32],
        weight: &[u8],
    ) -> Self {
        let n = width * height;
        let mut packed = vec![0; 3 * n];
        for c in 0..3 {
            pack(&radiance[c * n..(c + 1) * n], weight, c, &mut packed[c * n..(c + 1) * n]);
        }
        Self { width, height, view, log_sigma: 0.0, packed: Arc::new(packed) }
    }

    /// Takes packed planes.
    pub(crate) fn from_packed(
        width: usize,
        height: usize,
        view: View,
        packed: Vec<Packed>,
    ) -> Self {
        debug_assert_eq!(packed.len(), 3 * width * height);
        Self { width, height, view, log_sigma: 0.0, packed: Arc::new(packed) }
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
        f16::from_bits(self.packed[c * self.texels() + texel]).to_f32()
    }

    /// Weight of a texel, 0 to 1.
    pub fn weight(&self, texel: usize) -> f32 {
        weight_of(self.packed_weight(texel))
    }

    fn packed_weight(&self, texel: usize) -> u8 {
        unpack_weight(std::array::from_fn(|c| self.packed[c * self.texels() + texel]))
    }

    /// Sum of all weights.
    pub fn total_weight(&self) -> f64 {
        (0..self.texels()).map(|i| f64::from(self.weight(i))).sum()
    }

    /// Radiances and weights.
    #[cfg(test)]
    pub(crate) fn planes(&self) -> (Vec<f32>, Vec<f32>) {
        let n = self.texels();
        let radiance = (0..3 * n).map(|i| self.radiance(i / n, i % n)).collect();
        (radiance, (0..n).map(|i| self.weight(i)).collect())
    }

    /// A copy whose radiances and weights `change` has edited.
    #[cfg(test)]
    pub(crate) fn changed(&self, change: impl FnOnce(&mut [f32], &mut [f32])) -> Self {
        let (mut radiance, mut weight) = self.planes();
        change(&mut radiance, &mut weight);
        Self::new(self.width, self.height, self.view, &radiance, &weight).unwrap()
    }

    /// Three packed planes.
    pub(crate) fn packed(&self) -> &[Packed] {
        &self.packed
    }

    /// The packed planes, mutable. Weights of texels with known radiances must not change.
    pub(crate) fn packed_mut(&mut self) -> &mut [Packed] {
        Arc::make_mut(&mut self.packed).as_mut_slice()
    }

    /// Every `2^times`-th texel in each direction, unfiltered.
    pub(crate) fn strided(&self, times: u32) -> Self {
        let packed = strided(&self.packed, self.width, times);
        let (width, height) = (self.width >> times, self.height >> times);
        Self { width, height, packed: Arc::new(packed), ..*self }
    }

    /// A copy without the texels for which `is_out(column, row)` holds.
    pub(crate) fn without(&self, is_out: impl Fn(usize, usize) -> bool) -> Self {
        let mut left = self.clone();
        let (width, texels) = (self.width, self.texels());
        let packed = left.packed_mut();
        for t in (0..texels).filter(|t| is_out(t % width, t / width)) {
            // A weight of 0 sets the lowest bit of each channel.
            (0..3).for_each(|c| packed[c * texels + t] |= 1);
        }
        left
    }

    /// The photograph at half the resolution: weighted means of 2x2 texels, saturated where one of
    /// the four is.
    ///
    /// # Panics
    /// If width or height is odd.
    pub fn downsampled(&self) -> Self {
        let (w, h) = (self.width, self.height);
        assert!(w % 2 == 0 && h % 2 == 0, "{w}x{h} cannot be halved");
        let (w2, h2) = (w / 2, h / 2);
        let mut packed = vec![0; 3 * w2 * h2];
        let buffers = || (vec![0.0; 2 * w], vec![0; 2 * w], vec![0.0; w2], vec![0; w2]);
        parallel::parts_with(
            bands::<3, _>(&mut packed, w2, h2, 1),
            buffers,
            |(two, weights, mean, weight), y, rows| {
                let texels = 2 * y * w..2 * (y + 1) * w;
                for (weight, i) in weights.iter_mut().zip(texels.clone()) {
                    *weight = self.packed_weight(i);
                }
                let four = |x: usize| [2 * x, 2 * x + 1, 2 * x + w, 2 * x + w + 1];
                for (x, weight) in weight.iter_mut().enumerate() {
                    let sum: f32 = four(x).map(|i| weight_of(weights[i])).iter().sum();
                    *weight = pack_weight(0.25 * sum);
                }
                for (c, row) in rows.into_iter().enumerate() {
                    let from = c * w * h;
                    unpack(&self.packed[from + texels.start..from + texels.end], two);
                    for (x, mean) in mean.iter_mut().enumerate() {
                        let (mut sum, mut total, mut saturated) = (0.0, 0.0, false);
                        for i in four(x) {
                            let (value, weight) = (two[i], weight_of(weights[i]));
                            sum += weight * value.abs();
                            total += weight;
                            saturated |= weight > 0.0 && value < 0.0;
                        }
                        *mean = if total <= 0.0 { 0.0 } else { sum / total };
                        if saturated {
                            *mean = -*mean;
                        }
                    }
                    pack(mean, weight, c, row);
                }
            },
        );
        Self { width: w2, height: h2, packed: Arc::new(packed), ..*self }
    }
}

/// Code of the nearest weight: sevenths, and [`LEAST_WEIGHT`] for any small weight above 0.
pub(crate) fn pack_weight(weight: f32) -> u8 {
    let full = f32::from(FULL_WEIGHT);
    match weight {
        _ if weight.is_nan() || weight <= 0.0 => 0,
        _ if weight < 0.5 * (LEAST_WEIGHT + 2.0 / full) => 1,
        _ => (full * weight).round().clamp(2.0, full) as u8,
    }
}

/// The weight of a code.
fn weight_of(packed: u8) -> f32 {
    if packed == 1 { LEAST_WEIGHT } else { f32::from(packed) / f32::from(FULL_WEIGHT) }
}

/// Code of the weight in a texel's three channels.
pub(crate) fn unpack_weight(channels: [Packed; 3]) -> u8 {
    let [low, middle, high] = channels.map(|v| v & 1);
    FULL_WEIGHT - (low | middle << 1 | high << 2) as u8
}

/// Packs channel `c`. Radiances too large for half floats become the largest half, NaN becomes
/// zero, and saturated values keep their sign.
pub(crate) fn pack(radiance: &[f32], weight: &[u8], c: usize, to: &mut [Packed]) {
    const BLOCK: usize = 64;
    let (mut block, mut halves) = ([0.0; BLOCK], [0.0; BLOCK]);
    for ((radiance, weight), to) in
        radiance.chunks(BLOCK).zip(weight.chunks(BLOCK)).zip(to.chunks_mut(BLOCK))
    {
        let count = to.len();
        let (block, halves) = (&mut block[..count], &mut halves[..count]);
        for (limited, &v) in block.iter_mut().zip(radiance) {
            let size = v.abs().clamp(LEAST, f16::MAX.to_f32_const());
            *limited = if v == 0.0 || v.is_nan() { 0.0 } else { size.copysign(v) };
        }
        let nearest = to.reinterpret_cast_mut::<f16>();
        nearest.convert_from_f32_slice(block);
        nearest.convert_to_f32_slice(halves);
        for (((packed, &weight), value), half) in to.iter_mut().zip(weight).zip(block).zip(halves) {
            let lacks = Packed::from(FULL_WEIGHT - weight) >> c;
            if (*packed ^ lacks) & 1 == 1 {
                let beyond = value.abs() - half.abs();
                // Ties alternate, to keep the mean unbiased.
                let up = beyond > 0.0 || (beyond == 0.0 && *packed & 2 == 0);
                *packed = if up { *packed + 1 } else { *packed - 1 };
            }
        }
    }
}

/// Radiances of packed values.
pub(crate) fn unpack(from: &[Packed], radiance: &mut [f32]) {
    from.reinterpret_cast::<f16>().convert_to_f32_slice(radiance);
}

/// The smallest normal half float.
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
        mirrored: 1.0,
    };

    #[test]
    fn values_keep_ten_bits_and_their_sign() {
        let radiance = [0.731, -0.25, 1e-9, -1e-9, 1e9, 0.0, -0.0, f32::NAN, 1.0, 0.5, 0.1, 7.0];
        let weight = [1.0, 0.5, 1e-4, 0.9];
        let o = Observation::new(4, 1, VIEW, &radiance, &weight).unwrap();
        for (i, &v) in radiance.iter().enumerate() {
            let kept = o.radiance(i / 4, i % 4);
            match v {
                v if v.is_nan() => assert!(kept < 1e-7),
                v if v.abs() < 1e-5 => assert!(kept.abs() < 1e-4 && (kept < 0.0) == (v < 0.0)),
                v if v > 1e5 => assert!((65000.0..65505.0).contains(&kept)),
                v => assert!((kept - v).abs() <= v.abs() / 1024.0, "{v}: {kept}"),
            }
        }
        assert!(o.weight(0) == 1.0 && o.weight(2) > 0.0, "seen texels stay seen");
        assert_eq!(o.weight(1), 4.0 / 7.0);
        assert_eq!(o.weight(3), 0.0, "its green is not a number");
        assert!(Observation::new(4, 2, VIEW, &radiance, &weight).is_err());
    }

    #[test]
    fn every_weight_is_coded_and_means_are_unbiased() {
        let mut random = Random::new(3);
        for weight in 0..=FULL_WEIGHT {
            let count = 20_000;
            let radiance: Vec<f32> = (0..count).map(|_| 0.01 + random.uniform() as f32).collect();
            let planes = [0, 1, 2].map(|c| {
                let mut plane = vec![0; count];
                pack(&radiance, &vec![weight; count], c, &mut plane);
                plane
            });
            for plane in &planes {
                let mut kept = vec![0.0; count];
                unpack(plane, &mut kept);
                let error = |(a, b): (&f32, &f32)| f64::from(a - b);
                let errors: Vec<f64> = kept.iter().zip(&radiance).map(error).collect();
                for (error, &v) in errors.iter().zip(&radiance) {
                    assert!(error.abs() <= f64::from(v) / 1024.0, "{v}: {error}");
                }
                // One unit is 2e-4 on average; its mean over all values is smaller by sqrt(count).
                assert!((errors.iter().sum::<f64>() / count as f64).abs() < 4e-6);
            }
            for i in 0..count {
                assert_eq!(unpack_weight(std::array::from_fn(|c| planes[c][i])), weight);
            }
        }
    }

    #[test]
    fn limits_hold_any_weight() {
        for v in [0.0, LEAST, f16::MAX.to_f32_const()] {
            for weight in 0..=FULL_WEIGHT {
                let mut kept = [0];
                pack(&[-v], &[weight], 0, &mut kept);
                let back = f16::from_bits(kept[0]).to_f32();
                assert!((back + v).abs() <= v / 1024.0 + 1e-7, "{v}: {back}");
                assert!(back < 0.0 || v == 0.0);
            }
        }
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
                // Tolerances: one unit of a weight; rounding of a radiance.
                assert!((half.weight(i) - sum / 4.0).abs() < 1.0 / 7.0);
                let found = half.radiance(c, i).abs();
                assert!((found - mean / sum.max(1e-9)).abs() < 1.5e-3 * found.max(0.1));
                assert_eq!(half.radiance(c, i) < 0.0, c == 0 && i == 2, "saturation spreads");
            }
        }
        assert_eq!(half.weight(1), 0.0);
    }
}
