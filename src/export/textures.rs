//! Textures: texel values to PNG and JPEG with their physical size.

use std::sync::{Arc, OnceLock};

use image::ExtendedColorType;
use image::codecs::jpeg::{JpegEncoder, PixelDensity, PixelDensityUnit};

use crate::parallel;
use crate::photo::Encoding;
use crate::{Error, Result};

/// Quality of JPEG textures, 1 to 100.
const JPEG_QUALITY: u8 = 95;

/// Storage of textures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TextureFormat {
    /// PNG with 8 bits per channel.
    #[default]
    Png8,
    /// PNG with 16 bits per channel.
    Png16,
    /// JPEG at quality 95. Textures with four channels become [`TextureFormat::Png8`].
    Jpeg,
}

impl TextureFormat {
    /// Every format.
    pub const ALL: [Self; 3] = [Self::Png8, Self::Png16, Self::Jpeg];

    /// `png8`, `png16`, `jpeg`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Png8 => "png8",
            Self::Png16 => "png16",
            Self::Jpeg => "jpeg",
        }
    }

    /// The format of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// File extension.
    pub fn extension(self) -> &'static str {
        if self == Self::Jpeg { "jpg" } else { "png" }
    }

    /// MIME type.
    pub fn mime_type(self) -> &'static str {
        if self == Self::Jpeg { "image/jpeg" } else { "image/png" }
    }
}

/// Texels per metre along x and y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Density(pub [f64; 2]);

impl Density {
    /// Density of `texels` over a rectangle of `size_mm`.
    pub fn of(texels: [usize; 2], size_mm: [f32; 2]) -> Self {
        Self(std::array::from_fn(|i| 1000.0 * texels[i] as f64 / f64::from(size_mm[i])))
    }
}

/// A texture in memory: linear values, texel by texel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Texture {
    width: usize,
    height: usize,
    /// 1, 3 or 4.
    channels: usize,
    /// Whether the first three channels are stored with the sRGB curve.
    colour: bool,
    /// Shared by copies.
    values: Arc<Vec<f32>>,
}

impl Texture {
    /// A texture of one channel, stored linearly.
    pub fn gray(width: usize, height: usize, value: impl Fn(usize) -> f32 + Sync) -> Self {
        Self::new(width, height, false, |i| [value(i)])
    }

    /// A texture of three channels, stored linearly.
    pub fn data(width: usize, height: usize, value: impl Fn(usize) -> [f32; 3] + Sync) -> Self {
        Self::new(width, height, false, value)
    }

    /// A texture of three linear channels, stored with the sRGB curve.
    pub fn colour(width: usize, height: usize, value: impl Fn(usize) -> [f32; 3] + Sync) -> Self {
        Self::new(width, height, true, value)
    }

    /// A texture of four channels; with `colour`, the first three are stored with the sRGB curve.
    pub fn rgba(
        width: usize,
        height: usize,
        colour: bool,
        value: impl Fn(usize) -> [f32; 4] + Sync,
    ) -> Self {
        Self::new(width, height, colour, value)
    }

    fn new<const C: usize>(
        width: usize,
        height: usize,
        colour: bool,
        value: impl Fn(usize) -> [f32; C] + Sync,
    ) -> Self {
        let mut values = vec![0.0; C * width * height];
        parallel::parts(values.chunks_mut(C * width), |row, out| {
            for (x, texel) in out.as_chunks_mut::<C>().0.iter_mut().enumerate() {
                *texel = value(row * width + x);
            }
        });
        Self { width, height, channels: C, colour, values: Arc::new(values) }
    }

    /// A value of a texel.
    pub fn value(&self, texel: usize, channel: usize) -> f32 {
        self.values[texel * self.channels + channel]
    }

    /// The actual format for `wanted`; JPEG has no fourth channel.
    pub fn format(&self, wanted: TextureFormat) -> TextureFormat {
        match wanted {
            TextureFormat::Jpeg if self.channels == 4 => TextureFormat::Png8,
            _ => wanted,
        }
    }

    /// Encodes the file, see [`Texture::format`].
    pub fn encode(&self, wanted: TextureFormat, density: Option<Density>) -> Result<Vec<u8>> {
        match self.format(wanted) {
            TextureFormat::Png8 => self.png(png::BitDepth::Eight, &self.bytes(true), density),
            TextureFormat::Png16 => self.png(png::BitDepth::Sixteen, &self.words(), density),
            TextureFormat::Jpeg => self.jpeg(density),
        }
    }

    /// Whether a channel is stored with the sRGB curve.
    fn curved(&self, channel: usize) -> bool {
        self.colour && channel < 3
    }

    /// 8-bit values. Colours are rounded in the encoded domain. Linear channels are dithered
    /// between the two nearest values to preserve local means: normals and roughness of smooth
    /// glossy maps would show steps otherwise.
    fn bytes(&self, dithered: bool) -> Vec<u8> {
        let mut bytes = vec![0; self.values.len()];
        let row = self.width * self.channels;
        let table = SrgbBytes::get();
        let dithered = [0, 1, 2, 3].map(|channel| dithered && self.is_to_dither(channel));
        let parts = bytes.chunks_mut(row).zip(self.values.chunks(row));
        parallel::parts(parts, |y, (out, values)| {
            for (i, (out, &v)) in out.iter_mut().zip(values).enumerate() {
                let (x, channel) = (i / self.channels, i % self.channels);
                *out = if self.curved(channel) {
                    table.encode(v)
                } else if dithered[channel] {
                    dithered_byte(v, threshold(x, y, channel))
                } else {
                    (v * 255.0 + 0.5) as u8
                };
            }
        });
        bytes
    }

    /// Whether a channel is linear and not constant.
    fn is_to_dither(&self, channel: usize) -> bool {
        let mut values = self.values.iter().skip(channel).step_by(self.channels);
        let first = values.next();
        channel < self.channels && !self.curved(channel) && values.any(|v| Some(v) != first)
    }

    /// 16-bit values, high byte first.
    fn words(&self) -> Vec<u8> {
        let mut bytes = vec![0; 2 * self.values.len()];
        let row = self.width * self.channels;
        let parts = bytes.chunks_mut(2 * row).zip(self.values.chunks(row));
        parallel::parts(parts, |_, (out, values)| {
            for (i, (out, &v)) in out.as_chunks_mut::<2>().0.iter_mut().zip(values).enumerate() {
                let curve =
                    if self.curved(i % self.channels) { Encoding::Srgb } else { Encoding::Linear };
                *out = ((curve.encode(f64::from(v)) * 65535.0).round() as u16).to_be_bytes();
            }
        });
        bytes
    }

    fn png(&self, depth: png::BitDepth, data: &[u8], density: Option<Density>) -> Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(data.len() / 2);
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(match self.channels {
            1 => png::ColorType::Grayscale,
            3 => png::ColorType::Rgb,
            _ => png::ColorType::Rgba,
        });
        encoder.set_depth(depth);
        encoder.set_compression(png::Compression::Fast);
        encoder.set_pixel_dims(density.map(|density| {
            let [xppu, yppu] = density.0.map(|d| d.round() as u32);
            png::PixelDimensions { xppu, yppu, unit: png::Unit::Meter }
        }));
        let mut writer = encoder.write_header().map_err(encoding_fault)?;
        writer.write_image_data(data).map_err(encoding_fault)?;
        writer.finish().map_err(encoding_fault)?;
        Ok(bytes)
    }

    fn jpeg(&self, density: Option<Density>) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY);
        let per_inch = |d: f64| (0.0254 * d).round().clamp(1.0, 65535.0) as u16;
        if let Some(Density([x, y])) = density {
            let density = (per_inch(x), per_inch(y));
            encoder.set_pixel_density(PixelDensity { density, unit: PixelDensityUnit::Inches });
        }
        let kind = if self.channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
        let size = |n: usize| {
            u16::try_from(n).map_err(|_| {
                Error::argument("texture", format!("JPEG ends at 65535 texels a side, {n} given"))
            })
        };
        let (width, height) = (size(self.width)?, size(self.height)?);
        encoder
            .encode(&self.bytes(false), width.into(), height.into(), kind)
            .map_err(encoding_fault)?;
        Ok(bytes)
    }
}

/// One of the two nearest bytes: the upper one if fraction plus `threshold` (0 to 1) reach 1.
/// Values within rounding of a byte are not dithered.
fn dithered_byte(value: f32, threshold: f32) -> u8 {
    const ROUNDING: f32 = 1.0 / 256.0;
    let scaled = value * 255.0;
    let is_byte = (scaled - scaled.round()).abs() < ROUNDING;
    (scaled + if is_byte { 0.5 } else { threshold }) as u8
}

/// Dither thresholds, 0 to 1, evenly distributed over every neighbourhood: the additive recurrence
/// of the plastic number (Roberts 2018). Each channel has its own pattern.
fn threshold(x: usize, y: usize, channel: usize) -> f32 {
    const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
    let place = STEPS[0] * x as f64 + STEPS[1] * y as f64 + channel as f64 / 3.0;
    place.fract() as f32
}

/// An encoding error; encoders write to memory, so the caller cannot cause one.
fn encoding_fault(fault: impl std::fmt::Display) -> Error {
    Error::Internal(format!("a picture could not be encoded: {fault}"))
}

/// The nearest 8-bit sRGB value of a linear one. Values beyond 0 to 1 are clipped; NaN becomes 0.
pub fn srgb_byte(linear: f32) -> u8 {
    SrgbBytes::get().encode(linear)
}

/// Nearest 8-bit sRGB values of linear ones, without a power function.
struct SrgbBytes {
    /// Smallest linear value for which each byte is the nearest.
    from: [f32; 256],
    /// Byte of the lowest value in each of equal cells of [0, 1].
    cells: Vec<u8>,
}

impl SrgbBytes {
    const CELLS: usize = 8192;

    fn get() -> &'static Self {
        static TABLE: OnceLock<SrgbBytes> = OnceLock::new();
        TABLE.get_or_init(|| {
            let mut from = [0.0; 256];
            for (byte, from) in from.iter_mut().enumerate().skip(1) {
                *from = Encoding::Srgb.decode((byte as f64 - 0.5) / 255.0) as f32;
            }
            let byte = |cell: usize| {
                let low = cell as f32 / Self::CELLS as f32;
                (from.partition_point(|&v| v <= low) - 1) as u8
            };
            let cells = (0..=Self::CELLS).map(byte).collect();
            Self { from, cells }
        })
    }

    fn encode(&self, linear: f32) -> u8 {
        let v = linear.clamp(0.0, 1.0);
        let mut byte = self.cells[(v * Self::CELLS as f32) as usize];
        while byte < 255 && v >= self.from[usize::from(byte) + 1] {
            byte += 1;
        }
        byte
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_is_the_nearest_of_the_curve() {
        let table = SrgbBytes::get();
        for i in 0..=100_000 {
            let v = i as f32 / 100_000.0;
            let encoded = Encoding::Srgb.encode(f64::from(v)) * 255.0;
            // Within rounding of a tie, both bytes are correct.
            assert!((f64::from(table.encode(v)) - encoded).abs() < 0.5 + 1e-4, "{v}");
        }
        assert_eq!([-1.0, f32::NAN, 2.0].map(|v| table.encode(v)), [0, 0, 255]);
    }

    /// Slopes of 0.03 over 1024 texels span eight 8-bit values. Steps err by half a value at their
    /// edges; means over 8 x 8 texels, and thus mip maps, by a seventh of that at most.
    #[test]
    fn smooth_normals_and_roughness_have_no_steps() {
        let (w, h) = (1024, 64);
        let value = |i: usize| 0.5 + 0.015 * ((i % w) as f32 / w as f32 * 2.0 - 1.0);
        for channels in [1, 3, 4] {
            let texture = match channels {
                1 => Texture::gray(w, h, value),
                3 => Texture::data(w, h, |i| [value(i); 3]),
                _ => Texture::rgba(w, h, true, |i| [0.5, 0.5, 0.5, value(i)]),
            };
            let linear = if channels == 4 { 3 } else { 0 };
            let worst = |bytes: &[u8]| {
                let mut worst = 0.0f32;
                for (x, y) in (0..w - 7).flat_map(|x| [(x, 0), (x, 31), (x, 56)]) {
                    let block = (0..64).map(|i| (y + i / 8) * w + x + i % 8);
                    let of = |i: usize| f32::from(bytes[channels * i + linear]) - 255.0 * value(i);
                    worst = worst.max((block.map(of).sum::<f32>() / 64.0).abs());
                }
                worst
            };
            let (dithered, nearest) = (worst(&texture.bytes(true)), worst(&texture.bytes(false)));
            assert!(dithered < 0.07 && nearest > 0.4, "{channels}: {dithered} {nearest}");
        }
        // Constant channels, and values that are bytes, are unchanged.
        let flat = Texture::data(w, h, |i| [0.5, 51.0 / 255.0, if i == 0 { 0.0 } else { 1.0 }]);
        let bytes = flat.bytes(true);
        assert_eq!(bytes[..6], [128, 51, 0, 128, 51, 255]);
        assert_eq!(bytes[6..], [128, 51, 255].repeat(w * h - 2));
    }

    #[test]
    fn pictures_state_their_size_and_come_back() {
        let (w, h) = (5, 3);
        let texture = Texture::colour(w, h, |i| [i as f32 / 14.0, 0.5, 0.0]);
        let density = Some(Density::of([w, h], [10.0, 6.0]));
        for format in TextureFormat::ALL {
            assert_eq!(TextureFormat::from_name(format.name()), Some(format));
            let bytes = texture.encode(format, density).unwrap();
            let back = image::load_from_memory(&bytes).unwrap();
            assert_eq!((back.width() as usize, back.height() as usize), (w, h));
            if format == TextureFormat::Jpeg {
                // JFIF: 13 dots per inch.
                assert_eq!(bytes[13..18], [1, 0, 13, 0, 13]);
                continue;
            }
            let at = bytes.windows(4).position(|b| b == b"pHYs").unwrap() + 4;
            assert_eq!(bytes[at..at + 9], [0, 0, 1, 244, 0, 0, 1, 244, 1]);
            let step = if format == TextureFormat::Png8 { 255.0 } else { 65535.0 };
            for (i, texel) in back.into_rgb32f().pixels().enumerate() {
                let expected = Encoding::Srgb.encode(i as f64 / 14.0);
                assert!((f64::from(texel[0]) - expected).abs() <= 0.5 / step + 1e-6);
            }
        }
        let four = Texture::rgba(2, 2, true, |_| [0.5; 4]);
        let bytes = four.encode(TextureFormat::Jpeg, density).unwrap();
        let back = image::load_from_memory(&bytes).unwrap().into_rgba8();
        assert_eq!(back.get_pixel(0, 0).0, [188, 188, 188, 128]);
    }
}
