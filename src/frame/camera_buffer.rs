//! Buffers as cameras and graphics interfaces hand them over: planes with strides, in any of the
//! usual layouts, turned upright.

mod bayer;

use half::f16;

use super::encoding::Encoding;
use super::photo::Photo;
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
            Self::Rgba8 => 4,
            Self::Rgb16 => 6,
            Self::Rgba16 | Self::RgbaF16 => 8,
            Self::RgbF32 => 12,
            Self::RgbaF32 => 16,
        }
    }
}

/// How luma and chroma were made from R'G'B'.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum YuvMatrix {
    /// ITU-R BT.601, luma and chroma use all 256 values: JPEG, and Android's `YUV_420_888`.
    Bt601Full,
    /// ITU-R BT.601, luma 16 to 235, chroma 16 to 240.
    Bt601Limited,
    /// ITU-R BT.709, all 256 values.
    Bt709Full,
    /// ITU-R BT.709, luma 16 to 235, chroma 16 to 240.
    Bt709Limited,
}

impl Photo {
    /// Copies interleaved pixels. `saturation` is the level at which floats are clipped (infinite:
    /// never); integers are clipped as in [`Photo::from_rgb8`] and [`Photo::from_rgb16`].
    ///
    /// # Errors
    /// When the sizes do not fit the plane, a number is out of range, or a curve is stated for
    /// floats.
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

    /// Converts luma and half-resolution chroma (`YUV_420_888`, NV12, NV21, I420: the strides tell
    /// them apart). Chroma samples lie between four pixels and are interpolated. `encoding` is the
    /// curve of the resulting R'G'B'.
    ///
    /// # Errors
    /// When the sizes do not fit the planes or the exposure is not positive.
    pub fn from_yuv420(
        [width, height]: [u32; 2],
        planes: [Plane; 3],
        matrix: YuvMatrix,
        encoding: Encoding,
        rotation: Rotation,
        exposure: f32,
    ) -> Result<Self> {
        let half = [width.div_ceil(2), height.div_ceil(2)];
        let luma = Reader::new([width, height], planes[0], 1)?;
        let chroma = [Reader::new(half, planes[1], 1)?, Reader::new(half, planes[2], 1)?];
        let coefficients = matrix.coefficients();
        let mut rgb = Vec::with_capacity(3 * luma.pixels());
        for y in 0..height as usize {
            for x in 0..width as usize {
                let [u, v] = [0, 1].map(|i| between(&chroma[i], x, y));
                let luma = f32::from(luma.at(x, y)[0]);
                rgb.extend(coefficients.rgb(luma, u, v));
            }
        }
        let [w, h] = rotation.size([width, height]);
        Self::from_u8(w, h, rotation.apply([width, height], rgb), encoding, exposure)
    }
}

/// Chroma at a pixel from the four samples round it: they lie in the middle of 2 x 2 pixels.
#[inline]
fn between(plane: &Reader, x: usize, y: usize) -> f32 {
    let neighbour = |i: usize, n: usize| {
        let other = if i.is_multiple_of(2) { (i / 2).saturating_sub(1) } else { i / 2 + 1 };
        other.min(n - 1)
    };
    let (x0, y0) = (x / 2, y / 2);
    let (x1, y1) = (neighbour(x, plane.width), neighbour(y, plane.height));
    let value = |x, y| f32::from(plane.at(x, y)[0]);
    (9.0 * value(x0, y0) + 3.0 * (value(x1, y0) + value(x0, y1)) + value(x1, y1)) / 16.0
}

/// R'G'B' of luma and chroma.
struct YuvCoefficients {
    luma_offset: f32,
    luma: f32,
    red_v: f32,
    green_u: f32,
    green_v: f32,
    blue_u: f32,
}

impl YuvMatrix {
    fn coefficients(self) -> YuvCoefficients {
        let (kr, kb) = match self {
            Self::Bt601Full | Self::Bt601Limited => (0.299, 0.114),
            Self::Bt709Full | Self::Bt709Limited => (0.2126, 0.0722),
        };
        let full = matches!(self, Self::Bt601Full | Self::Bt709Full);
        let (luma_offset, luma, chroma) =
            if full { (0.0, 1.0, 1.0) } else { (16.0, 255.0 / 219.0, 255.0 / 224.0) };
        let (red_v, blue_u) = (2.0 * (1.0 - kr) * chroma, 2.0 * (1.0 - kb) * chroma);
        let kg = 1.0 - kr - kb;
        YuvCoefficients {
            luma_offset,
            luma,
            red_v,
            green_u: -blue_u * kb / kg,
            green_v: -red_v * kr / kg,
            blue_u,
        }
    }
}

impl YuvCoefficients {
    #[inline]
    fn rgb(&self, luma: f32, u: f32, v: f32) -> [u8; 3] {
        let y = (luma - self.luma_offset) * self.luma;
        let (u, v) = (u - 128.0, v - 128.0);
        [y + self.red_v * v, y + self.green_u * u + self.green_v * v, y + self.blue_u * u]
            // The conversion saturates: below 0 and above 255 are cut off.
            .map(|v| (v + 0.5) as u8)
    }
}

#[cfg(test)]
mod tests;
