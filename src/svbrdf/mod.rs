//! The four maps, their encodings and resampling.

use serde::{Deserialize, Serialize};

use crate::parallel;
use crate::{Error, Result};

mod anisotropy;
#[doc(hidden)]
pub mod gltf;
mod lobes;

pub use anisotropy::Anisotropy;
pub use lobes::{LOBES, MIN_SHEEN_ROUGHNESS, NO_LOBES, lobe};

/// Number of parameters of a texel.
pub const CHANNELS: usize = 9;

/// Index of each parameter plane in [`Svbrdf`].
pub mod channel {
    /// `n.x / n.z`.
    pub const SLOPE_X: usize = 0;
    /// `n.y / n.z`.
    pub const SLOPE_Y: usize = 1;
    /// Diffuse albedo, red; green and blue follow.
    pub const DIFFUSE: usize = 2;
    /// Specular albedo (F0), red; green and blue follow.
    pub const SPECULAR: usize = 5;
    /// Roughness, `alpha = roughness²`.
    pub const ROUGHNESS: usize = 8;
}

/// Smallest roughness rendered. Below it the highlight of a point light is thinner than a pixel,
/// and `f32` loses the GGX denominator.
pub const MIN_ROUGHNESS: f32 = 0.02;

/// Spatially varying BRDF: normal, diffuse albedo, specular albedo and roughness of every texel.
///
/// Nine planes of `width * height` values, row 0 at the sample's +Y edge: two slopes of the normal (`n.x /
/// n.z`, `n.y / n.z`; X right, Y up), diffuse albedo RGB, specular albedo RGB (both linear, 0 to 1),
/// roughness (0 to 1). Some materials also have planes of optional [lobes](Self::lobes).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SavedMaps")]
pub struct Svbrdf {
    width: usize,
    height: usize,
    #[serde(with = "crate::little_endian")]
    data: Vec<f32>,
    /// Empty without optional lobes.
    #[serde(with = "crate::little_endian")]
    lobes: Vec<f32>,
}

/// Saved form, whose values need checks.
#[derive(Deserialize)]
struct SavedMaps {
    width: usize,
    height: usize,
    #[serde(with = "crate::little_endian")]
    data: Vec<f32>,
    #[serde(with = "crate::little_endian", default)]
    lobes: Vec<f32>,
}

/// Least roughness of the baseline, whose iterations may fall below [`MIN_ROUGHNESS`].
const BASELINE_ROUGHNESS: f32 = 0.004;

/// Longest side of saved maps and photographs, texels.
pub(crate) const MAX_SAVED_SIDE: usize = 4096;

impl TryFrom<SavedMaps> for Svbrdf {
    type Error = Error;

    fn try_from(saved: SavedMaps) -> Result<Self> {
        let SavedMaps { width, height, data, lobes } = saved;
        if width.max(height) > MAX_SAVED_SIDE {
            return Err(Error::argument("maps", format!("{width}x{height} texels")));
        }
        let mut maps = Self::from_planes(width, height, data)?;
        maps.set_lobes(lobes)?;
        maps.clamp_with(BASELINE_ROUGHNESS);
        Ok(maps)
    }
}

impl Svbrdf {
    /// A flat gray material of medium roughness.
    pub fn new(width: usize, height: usize) -> Self {
        let n = width * height;
        let mut data = vec![0.0; CHANNELS * n];
        data[channel::DIFFUSE * n..channel::SPECULAR * n].fill(0.5);
        data[channel::SPECULAR * n..channel::ROUGHNESS * n].fill(0.04);
        data[channel::ROUGHNESS * n..].fill(0.5);
        Self { width, height, data, lobes: Vec::new() }
    }

    /// Takes nine planes in the order of [`channel`].
    ///
    /// # Errors
    /// If `data` does not hold `9 * width * height` values.
    pub fn from_planes(width: usize, height: usize, data: Vec<f32>) -> Result<Self> {
        if width == 0 || height == 0 || data.len() != CHANNELS * width * height {
            return Err(Error::argument(
                "planes",
                format!("{} values given, {CHANNELS} * {width} * {height} expected", data.len()),
            ));
        }
        Ok(Self { width, height, data, lobes: Vec::new() })
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

    /// All planes, one after the other.
    pub fn planes(&self) -> &[f32] {
        &self.data
    }

    /// All planes, one after the other.
    pub fn planes_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The slopes of the normals along X and Y: `n.x / n.z` and `n.y / n.z`.
    pub fn normal_slopes(&self) -> [&[f32]; 2] {
        self.planes_from(channel::SLOPE_X)
    }

    /// The slopes of the normals along X and Y: `n.x / n.z` and `n.y / n.z`.
    pub fn normal_slopes_mut(&mut self) -> [&mut [f32]; 2] {
        self.planes_from_mut(channel::SLOPE_X)
    }

    /// Red, green and blue of the diffuse albedo, linear.
    pub fn diffuse(&self) -> [&[f32]; 3] {
        self.planes_from(channel::DIFFUSE)
    }

    /// Red, green and blue of the diffuse albedo, linear.
    pub fn diffuse_mut(&mut self) -> [&mut [f32]; 3] {
        self.planes_from_mut(channel::DIFFUSE)
    }

    /// Red, green and blue of the specular albedo (F0), linear.
    pub fn specular(&self) -> [&[f32]; 3] {
        self.planes_from(channel::SPECULAR)
    }

    /// Red, green and blue of the specular albedo (F0), linear.
    pub fn specular_mut(&mut self) -> [&mut [f32]; 3] {
        self.planes_from_mut(channel::SPECULAR)
    }

    /// Roughness, `alpha = roughness²`.
    pub fn roughness(&self) -> &[f32] {
        self.plane(channel::ROUGHNESS)
    }

    /// Roughness, `alpha = roughness²`.
    pub fn roughness_mut(&mut self) -> &mut [f32] {
        self.plane_mut(channel::ROUGHNESS)
    }

    fn planes_from<const N: usize>(&self, first: usize) -> [&[f32]; N] {
        std::array::from_fn(|i| self.plane(first + i))
    }

    fn planes_from_mut<const N: usize>(&mut self, first: usize) -> [&mut [f32]; N] {
        let n = self.texels();
        let mut planes = self.data.chunks_exact_mut(n).skip(first);
        std::array::from_fn(|_| planes.next().unwrap_or_default())
    }

    /// One plane by its index in [`channel`], for loops over all parameters.
    pub fn plane(&self, channel: usize) -> &[f32] {
        let n = self.texels();
        &self.data[channel * n..(channel + 1) * n]
    }

    /// One plane by its index in [`channel`], for loops over all parameters.
    pub fn plane_mut(&mut self, channel: usize) -> &mut [f32] {
        let n = self.texels();
        &mut self.data[channel * n..(channel + 1) * n]
    }

    /// The planes of the optional lobes in the order of [`lobe`]: none, the four of anisotropy and coat, or
    /// all eight for a material with sheen.
    pub fn lobes(&self) -> &[f32] {
        &self.lobes
    }

    /// One plane of the optional lobes, see [`lobe`]; `None` if the material does not have it.
    pub fn lobe(&self, lobe: usize) -> Option<&[f32]> {
        self.lobes.chunks_exact(self.texels()).nth(lobe)
    }

    /// The planes [`lobe::ANISOTROPY_X`] and [`lobe::ANISOTROPY_Y`]; `None` if all texels are isotropic.
    pub fn anisotropy(&self) -> Option<[&[f32]; 2]> {
        let planes = [self.lobe(lobe::ANISOTROPY_X)?, self.lobe(lobe::ANISOTROPY_Y)?];
        planes.iter().any(|plane| plane.iter().any(|v| *v != 0.0)).then_some(planes)
    }

    /// The planes [`lobe::COAT`] and [`lobe::COAT_ROUGHNESS`]; `None` without a coat on any texel.
    pub fn coat(&self) -> Option<[&[f32]; 2]> {
        let planes = [self.lobe(lobe::COAT)?, self.lobe(lobe::COAT_ROUGHNESS)?];
        planes[0].iter().any(|v| *v > 0.0).then_some(planes)
    }

    /// Red, green, blue and roughness of the sheen, from [`lobe::SHEEN`] on; `None` without sheen on any
    /// texel.
    pub fn sheen(&self) -> Option<[&[f32]; 4]> {
        let [r, g, b] =
            [self.lobe(lobe::SHEEN)?, self.lobe(lobe::SHEEN + 1)?, self.lobe(lobe::SHEEN + 2)?];
        let planes = [r, g, b, self.lobe(lobe::SHEEN_ROUGHNESS)?];
        planes[..3].iter().any(|plane| plane.iter().any(|v| *v > 0.0)).then_some(planes)
    }

    /// Optional lobes of a texel in the order of [`lobe`]: [`NO_LOBES`] where there are none.
    pub(crate) fn lobes_at(&self, texel: usize) -> [f64; LOBES] {
        let value = |i| self.lobe(i).map_or(NO_LOBES[i], |plane| f64::from(plane[texel]));
        std::array::from_fn(value)
    }

    /// Sets the planes of optional lobes in the order of [`lobe`]: all, or the four of anisotropy and coat
    /// for a material without sheen. An empty vector removes them.
    ///
    /// # Errors
    /// If `planes` holds neither `4 * width * height` nor `8 * width * height` values.
    pub fn set_lobes(&mut self, planes: Vec<f32>) -> Result<()> {
        let allowed = [0, lobe::SHEEN, LOBES].map(|count| count * self.texels());
        if !allowed.contains(&planes.len()) {
            let [_, few, all] = allowed;
            let message = format!("{} values given, {few} or {all} expected", planes.len());
            return Err(Error::argument("lobes", message));
        }
        self.lobes = planes;
        Ok(())
    }

    /// Unit normal of a texel.
    pub fn normal(&self, x: usize, y: usize) -> [f32; 3] {
        let i = y * self.width + x;
        let (p, q) = (self.plane(channel::SLOPE_X)[i], self.plane(channel::SLOPE_Y)[i]);
        let s = (1.0 + p * p + q * q).sqrt().recip();
        [p * s, q * s, s]
    }

    /// Clamps every parameter to its physical range: albedos 0 to 1, roughness [`MIN_ROUGHNESS`] to
    /// 1, slopes `±MAX_SLOPE`. NaN becomes the value of [`Svbrdf::new`].
    pub fn clamp(&mut self) {
        self.clamp_with(MIN_ROUGHNESS);
    }

    fn clamp_with(&mut self, min_roughness: f32) {
        let width = self.width;
        let rows = self.height;
        let defaults = [0.0, 0.0, 0.5, 0.5, 0.5, 0.04, 0.04, 0.04, 0.5];
        parallel::parts(self.data.chunks_exact_mut(width), |row, values| {
            let c = row / rows;
            let (low, high) = RANGE[c];
            let low = if c == channel::ROUGHNESS { min_roughness } else { low };
            for v in values {
                *v = if v.is_finite() { v.clamp(low, high) } else { defaults[c] };
            }
        });
        parallel::parts(self.lobes.chunks_exact_mut(width), |row, values| {
            let c = row / rows;
            let (low, high) = LOBE_RANGE[c];
            for v in values {
                *v = if v.is_finite() { v.clamp(low, high) } else { NO_LOBES[c] as f32 };
            }
        });
    }
}

/// Steepest slope of a fit (71.6 degrees).
pub const MAX_SLOPE: f32 = 3.0;

/// Physical range of each parameter.
pub const RANGE: [(f32, f32); CHANNELS] = [
    (-MAX_SLOPE, MAX_SLOPE),
    (-MAX_SLOPE, MAX_SLOPE),
    (0.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (MIN_ROUGHNESS, 1.0),
];

/// Physical range of each parameter of the optional lobes; the ratio of alphas is at most 20.
pub const LOBE_RANGE: [(f32, f32); LOBES] = [
    (-3.0, 3.0),
    (-3.0, 3.0),
    (0.0, 1.0),
    (MIN_ROUGHNESS, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (MIN_SHEEN_ROUGHNESS, 1.0),
];

/// Encoding of maps for the networks: every channel in [-1, 1].
///
/// Slopes are halved. Albedos are replaced by their square roots (close to display gamma, to keep
/// the precision of dark materials). Then [0, 1] is stretched to [-1, 1].
pub mod encoding {
    use super::channel;

    /// Slope encoded as 1.
    pub const SLOPE_SCALE: f32 = 2.0;

    /// Encodes a parameter.
    pub fn encode(c: usize, value: f32) -> f32 {
        match c {
            channel::SLOPE_X | channel::SLOPE_Y => (value / SLOPE_SCALE).clamp(-1.0, 1.0),
            channel::ROUGHNESS => 2.0 * value.clamp(0.0, 1.0) - 1.0,
            _ => 2.0 * value.clamp(0.0, 1.0).sqrt() - 1.0,
        }
    }

    /// Decodes a parameter.
    pub fn decode(c: usize, encoded: f32) -> f32 {
        match c {
            channel::SLOPE_X | channel::SLOPE_Y => encoded * SLOPE_SCALE,
            channel::ROUGHNESS => 0.5 * (encoded + 1.0),
            _ => {
                let root = 0.5 * (encoded + 1.0);
                root * root
            }
        }
    }

    /// Derivative of [`decode`] by the encoded value.
    pub fn decode_derivative(c: usize, encoded: f32) -> f32 {
        match c {
            channel::SLOPE_X | channel::SLOPE_Y => SLOPE_SCALE,
            channel::ROUGHNESS => 0.5,
            _ => 0.5 * (encoded + 1.0),
        }
    }
}

impl Svbrdf {
    /// Doubles the resolution by bilinear interpolation with aligned texel rectangles; border
    /// values extend outwards.
    pub fn upsampled(&self) -> Self {
        self.with_planes([2 * self.width, 2 * self.height], |planes| {
            doubled(planes, self.width, self.height)
        })
    }

    /// Every `2^times`-th texel in each direction, unfiltered.
    pub(crate) fn strided(&self, times: u32) -> Self {
        let size = [self.width >> times, self.height >> times];
        self.with_planes(size, |planes| strided(planes, self.width, times))
    }

    /// Halves the resolution by averages of 2x2 texels. Sizes must be even.
    ///
    /// # Panics
    /// If width or height is odd.
    pub fn downsampled(&self) -> Self {
        let (w, h) = (self.width, self.height);
        assert!(w % 2 == 0 && h % 2 == 0, "{w}x{h} cannot be halved");
        self.with_planes([w / 2, h / 2], |planes| averaged(planes, w))
    }

    /// Maps of the given size. `planes` converts any number of consecutive planes; it is called for
    /// the maps' planes and for the lobes' planes, which may be empty.
    pub(crate) fn with_planes(
        &self,
        [width, height]: [usize; 2],
        planes: impl Fn(&[f32]) -> Vec<f32>,
    ) -> Self {
        Self { width, height, data: planes(&self.data), lobes: planes(&self.lobes) }
    }

    /// The maps halved `level` times by averages of 2x2 texels. Averages of slopes keep normals at
    /// unit length. 0: a copy.
    ///
    /// # Errors
    /// [`Error::Argument`] if width or height is not a multiple of `2^level`.
    pub fn reduced(&self, level: u32) -> Result<Self> {
        let multiple = 1_usize
            .checked_shl(level)
            .filter(|n| self.width.is_multiple_of(*n) && self.height.is_multiple_of(*n));
        if multiple.is_none() {
            let (w, h) = (self.width, self.height);
            let message = format!("{level} given, but {w}x{h} texels cannot be halved so often");
            return Err(Error::argument("level", message));
        }
        Ok(halved(self, level, Self::downsampled))
    }
}

/// Doubles planes of `w * h` values.
fn doubled(planes: &[f32], w: usize, h: usize) -> Vec<f32> {
    let mut data = vec![0.0; 4 * planes.len()];
    // Each source row gives two rows of the result.
    parallel::parts_with(
        data.chunks_mut(4 * w),
        || vec![0.0; w],
        |mixed, pair, out| {
            let (plane, y) = (pair / h, pair % h);
            let row = |y: usize| &planes[(plane * h + y) * w..][..w];
            let (above, below) = (row(y.saturating_sub(1)), row((y + 1).min(h - 1)));
            for (other, out) in [above, below].into_iter().zip(out.chunks_exact_mut(2 * w)) {
                for ((m, near), far) in mixed.iter_mut().zip(row(y)).zip(other) {
                    *m = near + 0.25 * (far - near);
                }
                double_row(mixed, out);
            }
        },
    );
    data
}

/// Means of 2x2 texels of planes of `w` columns and an even number of rows.
fn averaged(planes: &[f32], w: usize) -> Vec<f32> {
    let mut data = vec![0.0; planes.len() / 4];
    let parts = data.chunks_mut(w / 2).zip(planes.chunks(2 * w));
    parallel::parts(parts, |_, (out, pair)| {
        let (above, below) = pair.split_at(w);
        let pairs = above.chunks_exact(2).zip(below.chunks_exact(2));
        for (out, (a, b)) in out.iter_mut().zip(pairs) {
            *out = 0.25 * (a[0] + a[1] + b[0] + b[1]);
        }
    });
    data
}

/// Every `2^times`-th value in each direction of planes with `columns` columns. Columns and rows
/// must be multiples of that.
pub(crate) fn strided<T: Copy>(planes: &[T], columns: usize, times: u32) -> Vec<T> {
    let (step, middle) = (1 << times, (1 << times) / 2);
    let rows = planes.chunks_exact(columns).skip(middle).step_by(step);
    rows.flat_map(|row| row.iter().skip(middle).step_by(step).copied()).collect()
}

/// Maps or an observation halved `times` times by `half`.
pub(crate) fn halved<T: Clone>(whole: &T, times: u32, half: impl Fn(&T) -> T) -> T {
    if times == 0 {
        return whole.clone();
    }
    (1..times).fold(half(whole), |small, _| half(&small))
}

/// Number of halvings to at most `texels` along the longer side, as far as the sides are even.
pub(crate) fn halvings_to([width, height]: [usize; 2], texels: usize) -> u32 {
    let even = |halvings: u32| [width, height].iter().all(|n| (n >> halvings).is_multiple_of(2));
    let mut halvings = 0;
    while width.max(height) >> halvings > texels && even(halvings) {
        halvings += 1;
    }
    halvings
}

/// Doubles a row by linear interpolation; border values extend outwards.
fn double_row(row: &[f32], out: &mut [f32]) {
    let last = row.len() - 1;
    for ((pair, &v), x) in out.chunks_exact_mut(2).zip(row).zip(0..) {
        let (left, right) = (row[usize::max(x, 1) - 1], row[usize::min(x + 1, last)]);
        pair[0] = v + 0.25 * (left - v);
        pair[1] = v + 0.25 * (right - v);
    }
}

/// Divides planes of `width * height` values into bands of `rows` rows.
pub(crate) fn bands<const PLANES: usize, T>(
    data: &mut [T],
    width: usize,
    height: usize,
    rows: usize,
) -> impl Iterator<Item = [&mut [T]; PLANES]> {
    let mut planes: Vec<_> =
        data.chunks_mut(width * height).map(|plane| plane.chunks_mut(rows * width)).collect();
    (0..height.div_ceil(rows))
        .map(move |_| std::array::from_fn(|p| planes[p].next().unwrap_or_default()))
}

#[cfg(test)]
mod tests;
