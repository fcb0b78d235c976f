//! Buffers of cameras and graphics interfaces: planes with strides in common layouts, rotated upright.

mod bayer;

use half::f16;

use super::encoding::Encoding;
use super::pixels::Photo;
use super::plane::{Plane, Reader, Rotation};
use crate::{Error, Result};

pub use bayer::{Bayer, BayerPattern};

/// Layout of interleaved pixels. A fourth channel is ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interleaved {
    /// Three bytes.
    Rgb8,
    /// Four bytes.
    Rgba8,
    /// Four bytes, blue first.
    Bgra8,
    /// Three 16-bit numbers.
    Rgb16,
    /// Four 16-bit numbers.
    Rgba16,
    /// Four half floats, linear.
    RgbaF16,
    /// Three floats, linear.
    RgbF32,
    /// Four floats, linear.
    RgbaF32,
}

impl Interleaved {
    /// Bytes of a pixel.
    pub fn bytes(self) -> usize {
        match self {
            Self::Rgb8 => 3,
            Self::Rgba8 | Self::Bgra8 => 4,
            Self::Rgb16 => 6,
            Self::Rgba16 | Self::RgbaF16 => 8,
            Self::RgbF32 => 12,
            Self::RgbaF32 => 16,
        }
    }
}

/// Conversion of R'G'B' to luma and chroma. Ranges are those of 8 bits; with 10 bits they are four
/// times as large: luma 64 to 940, chroma 64 to 960.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum YuvMatrix {
    /// ITU-R BT.601, full range: JPEG, and Android's `YUV_420_888`.
    Bt601Full,
    /// ITU-R BT.601, luma 16 to 235, chroma 16 to 240.
    Bt601Limited,
    /// ITU-R BT.709, full range.
    Bt709Full,
    /// ITU-R BT.709, luma 16 to 235, chroma 16 to 240.
    Bt709Limited,
    /// ITU-R BT.2020 with non-constant luminance, full range.
    Bt2020Full,
    /// ITU-R BT.2020 with non-constant luminance, luma 16 to 235, chroma 16 to 240.
    Bt2020Limited,
}

impl Photo {
    /// Copies interleaved pixels. `saturation` is the clipping level of floats (infinite: none);
    /// integers are clipped as in [`Photo::from_rgb8`] and [`Photo::from_rgb16`].
    ///
    /// # Errors
    /// If the sizes do not fit the plane, a number is out of range, or a curve is given for floats.
    pub fn from_interleaved(
        [width, height]: [u32; 2],
        plane: Plane,
        layout: Interleaved,
        encoding: Encoding,
        rotation: Rotation,
        exposure: f32,
        saturation: f32,
    ) -> Result<Self> {
        let reader = Reader::new([width, height], plane, layout.bytes())?;
        let [w, h] = rotation.size([width, height]);
        match layout {
            Interleaved::Rgb8 | Interleaved::Rgba8 => {
                let rgb = reader.gather(|p: &[u8]| [p[0], p[1], p[2]]);
                Self::from_u8(w, h, rotation.apply([width, height], rgb), encoding, exposure)
            }
            Interleaved::Bgra8 => {
                let rgb = reader.gather(|p: &[u8]| [p[2], p[1], p[0]]);
                Self::from_u8(w, h, rotation.apply([width, height], rgb), encoding, exposure)
            }
            Interleaved::Rgb16 | Interleaved::Rgba16 => {
                let value = |p: &[u8], c: usize| u16::from_ne_bytes([p[2 * c], p[2 * c + 1]]);
                let rgb = reader.gather(|p| [value(p, 0), value(p, 1), value(p, 2)]);
                Self::from_u16(w, h, rotation.apply([width, height], rgb), encoding, exposure)
            }
            _ if encoding != Encoding::Linear => Err(Error::argument(
                "transfer",
                "floating-point pixels are linear: the linear transfer function is expected",
            )),
            Interleaved::RgbaF16 => {
                let value =
                    |p: &[u8], c: usize| f16::from_ne_bytes([p[2 * c], p[2 * c + 1]]).to_f32();
                let rgb = reader.gather(|p| [value(p, 0), value(p, 1), value(p, 2)]);
                let rgb = rotation.apply([width, height], rgb);
                Self::from_linear(w, h, rgb, exposure, saturation)
            }
            Interleaved::RgbF32 | Interleaved::RgbaF32 => {
                let value = |p: &[u8], c: usize| {
                    f32::from_ne_bytes([p[4 * c], p[4 * c + 1], p[4 * c + 2], p[4 * c + 3]])
                };
                let rgb = reader.gather(|p| [value(p, 0), value(p, 1), value(p, 2)]);
                let rgb = rotation.apply([width, height], rgb);
                Self::from_linear(w, h, rgb, exposure, saturation)
            }
        }
    }

    /// Converts luma and half-resolution chroma (`YUV_420_888`, NV12, NV21, I420, distinguished by
    /// the strides). Chroma samples lie between four pixels and are interpolated. `encoding` is the
    /// curve of the resulting R'G'B'.
    ///
    /// # Errors
    /// If the sizes do not fit the planes or the exposure is not positive.
    pub fn from_yuv420(
        size: [u32; 2],
        planes: [Plane; 3],
        matrix: YuvMatrix,
        encoding: Encoding,
        rotation: Rotation,
        exposure: f32,
    ) -> Result<Self> {
        let coefficients = matrix.coefficients(1.0);
        // The cast saturates to 0 to 255.
        let store = |v: f32| (v + 0.5) as u8;
        let rgb = yuv420::<_, 1>(size, planes, &coefficients, |[v]| f32::from(v), store)?;
        let [w, h] = rotation.size(size);
        Self::from_u8(w, h, rotation.apply(size, rgb), encoding, exposure)
    }

    /// As [`Photo::from_yuv420`], for 10 bits in the upper bits of 16-bit words (P010); the result
    /// is 16-bit R'G'B'.
    ///
    /// # Errors
    /// If the sizes do not fit the planes or the exposure is not positive.
    pub fn from_p010(
        size: [u32; 2],
        planes: [Plane; 3],
        matrix: YuvMatrix,
        encoding: Encoding,
        rotation: Rotation,
        exposure: f32,
    ) -> Result<Self> {
        let coefficients = matrix.coefficients(4.0);
        let sample = |bytes| f32::from(u16::from_ne_bytes(bytes) >> 6);
        let store = |v: f32| (v * (65535.0 / 1023.0) + 0.5) as u16;
        let rgb = yuv420::<_, 2>(size, planes, &coefficients, sample, store)?;
        let [w, h] = rotation.size(size);
        Self::from_u16(w, h, rotation.apply(size, rgb), encoding, exposure)
    }
}

/// Interleaved R'G'B' from luma and half-resolution chroma with `N` bytes per sample.
fn yuv420<T, const N: usize>(
    [width, height]: [u32; 2],
    planes: [Plane; 3],
    coefficients: &YuvCoefficients,
    sample: impl Fn([u8; N]) -> f32,
    store: impl Fn(f32) -> T,
) -> Result<Vec<T>> {
    let half = [width.div_ceil(2), height.div_ceil(2)];
    let luma = Reader::new([width, height], planes[0], N)?;
    let chroma = [Reader::new(half, planes[1], N)?, Reader::new(half, planes[2], N)?];
    let value = |plane: &Reader, x, y| sample(std::array::from_fn(|i| plane.at(x, y)[i]));
    let mut rgb = Vec::with_capacity(3 * luma.pixels());
    for y in 0..height as usize {
        for x in 0..width as usize {
            let [u, v] = [0, 1].map(|i| between(&chroma[i], x, y, &value));
            rgb.extend(coefficients.rgb(value(&luma, x, y), u, v).map(&store));
        }
    }
    Ok(rgb)
}

/// Chroma at a pixel, from the four samples around it; each lies in the middle of 2 x 2 pixels.
#[inline]
fn between(
    plane: &Reader,
    x: usize,
    y: usize,
    value: &impl Fn(&Reader, usize, usize) -> f32,
) -> f32 {
    let neighbour = |i: usize, n: usize| {
        let other = if i.is_multiple_of(2) { (i / 2).saturating_sub(1) } else { i / 2 + 1 };
        other.min(n - 1)
    };
    let (x0, y0) = (x / 2, y / 2);
    let (x1, y1) = (neighbour(x, plane.width), neighbour(y, plane.height));
    let value = |x, y| value(plane, x, y);
    (9.0 * value(x0, y0) + 3.0 * (value(x1, y0) + value(x0, y1)) + value(x1, y1)) / 16.0
}

/// R'G'B' of luma and chroma.
struct YuvCoefficients {
    luma_offset: f32,
    luma: f32,
    chroma_offset: f32,
    red_v: f32,
    green_u: f32,
    green_v: f32,
    blue_u: f32,
}

impl YuvMatrix {
    /// Coefficients for samples with `step` units per 8-bit unit.
    fn coefficients(self, step: f32) -> YuvCoefficients {
        let (kr, kb) = match self {
            Self::Bt601Full | Self::Bt601Limited => (0.299, 0.114),
            Self::Bt709Full | Self::Bt709Limited => (0.2126, 0.0722),
            Self::Bt2020Full | Self::Bt2020Limited => (0.2627, 0.0593),
        };
        let full = matches!(self, Self::Bt601Full | Self::Bt709Full | Self::Bt2020Full);
        let largest = 256.0 * step - 1.0;
        let (luma_offset, luma, chroma) = if full {
            (0.0, 1.0, 1.0)
        } else {
            (16.0 * step, largest / (219.0 * step), largest / (224.0 * step))
        };
        let (red_v, blue_u) = (2.0 * (1.0 - kr) * chroma, 2.0 * (1.0 - kb) * chroma);
        let kg = 1.0 - kr - kb;
        YuvCoefficients {
            luma_offset,
            luma,
            chroma_offset: 128.0 * step,
            red_v,
            green_u: -blue_u * kb / kg,
            green_v: -red_v * kr / kg,
            blue_u,
        }
    }
}

impl YuvCoefficients {
    #[inline]
    fn rgb(&self, luma: f32, u: f32, v: f32) -> [f32; 3] {
        let y = (luma - self.luma_offset) * self.luma;
        let (u, v) = (u - self.chroma_offset, v - self.chroma_offset);
        [y + self.red_v * v, y + self.green_u * u + self.green_v * v, y + self.blue_u * u]
    }
}

#[cfg(test)]
mod tests;
