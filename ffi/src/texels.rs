//! Texels in the formats of the header.

use std::ffi::c_void;
use std::ops::Range;

use engine::export::srgb_byte;
use half::f16;

use crate::status::Fault;

/// Layout of a map's texels. Numbers of more than a byte are in the machine's byte order.
pub type svbrdf_map_format = u32;
/// Floats: three channels, or one for SVBRDF_MAP_ROUGHNESS and SVBRDF_MAP_SHEEN_ROUGHNESS.
pub const SVBRDF_MAP_FORMAT_F32: svbrdf_map_format = 1;
/// Three bytes a texel.
pub const SVBRDF_MAP_FORMAT_RGB8: svbrdf_map_format = 2;
/// Four bytes a texel, the fourth 255.
pub const SVBRDF_MAP_FORMAT_RGBA8: svbrdf_map_format = 3;
/// Bytes: one channel, for SVBRDF_MAP_ROUGHNESS and SVBRDF_MAP_SHEEN_ROUGHNESS.
pub const SVBRDF_MAP_FORMAT_R8: svbrdf_map_format = 4;
/// Four half floats a texel, the fourth 1. Roughness: 1 (occlusion), roughness, 0 (metalness).
/// Values beyond 65504, the largest half float, are clamped.
pub const SVBRDF_MAP_FORMAT_RGBA16F: svbrdf_map_format = 5;
/// Four floats a texel, the fourth 1. Roughness as in SVBRDF_MAP_FORMAT_RGBA16F.
pub const SVBRDF_MAP_FORMAT_RGBA32F: svbrdf_map_format = 6;

/// Number of formats.
pub(crate) const FORMATS: usize = 6;

/// Coding of values as bytes.
#[derive(Clone, Copy)]
pub(crate) enum Coding {
    /// 0 to 1.
    Linear,
    /// -1 to 1.
    Signed,
    /// Red and green -1 to 1, the others 0 to 1.
    Direction,
    /// sRGB, clipped to 0 to 1.
    Srgb,
}

/// A source of texels.
pub(crate) trait Picture {
    fn width(&self) -> usize;
    fn height(&self) -> usize;
    /// The place of the only channel, where it has just one: formats of one channel take that.
    fn single(&self) -> Option<usize>;
    fn coding(&self) -> Coding;
    /// Red, green, blue, alpha of a row, `width` texels.
    fn row(&self, y: usize, out: &mut [[f32; 4]]);
}

#[derive(Clone, Copy)]
enum Sample {
    Byte,
    Half,
    Float,
}

/// A format as it applies to an image.
pub(crate) struct Layout {
    sample: Sample,
    channels: Range<usize>,
}

impl Layout {
    pub(crate) fn new(format: svbrdf_map_format, picture: &impl Picture) -> Result<Self, Fault> {
        let single = picture.single().map(|channel| channel..channel + 1);
        let (sample, channels) = match format {
            SVBRDF_MAP_FORMAT_F32 => (Sample::Float, single.unwrap_or(0..3)),
            SVBRDF_MAP_FORMAT_RGB8 => (Sample::Byte, 0..3),
            SVBRDF_MAP_FORMAT_RGBA8 => (Sample::Byte, 0..4),
            SVBRDF_MAP_FORMAT_RGBA16F => (Sample::Half, 0..4),
            SVBRDF_MAP_FORMAT_RGBA32F => (Sample::Float, 0..4),
            SVBRDF_MAP_FORMAT_R8 => {
                let only = "format: SVBRDF_MAP_FORMAT_R8 given, which only roughness has";
                (Sample::Byte, single.ok_or_else(|| Fault::argument(only))?)
            }
            _ => return Err(Fault::argument(format!("format: {format} is not a known value"))),
        };
        Ok(Self { sample, channels })
    }

    pub(crate) fn channels(&self) -> usize {
        self.channels.len()
    }

    /// Bytes of a row without a gap.
    pub(crate) fn row_bytes(&self, picture: &impl Picture) -> usize {
        let sample = match self.sample {
            Sample::Byte => 1,
            Sample::Half => 2,
            Sample::Float => 4,
        };
        picture.width() * self.channels.len() * sample
    }

    /// Texels of a row as bytes.
    fn pack(&self, texels: &[[f32; 4]], coding: Coding, out: &mut [u8]) {
        let channels = &self.channels;
        match (self.sample, coding) {
            (Sample::Byte, Coding::Linear) => each(texels, channels, out, |v| [unit_byte(v)]),
            (Sample::Byte, Coding::Signed) => {
                each(texels, channels, out, |v| [unit_byte(0.5 * v + 0.5)]);
            }
            (Sample::Byte, Coding::Direction) => {
                let unsigned = |[x, y, z, a]: &[f32; 4]| [0.5 * x + 0.5, 0.5 * y + 0.5, *z, *a];
                let texels: Vec<_> = texels.iter().map(unsigned).collect();
                each(&texels, channels, out, |v| [unit_byte(v)]);
            }
            (Sample::Byte, Coding::Srgb) => each(texels, channels, out, |v| [srgb_byte(v)]),
            (Sample::Half, _) => {
                let limit = f16::MAX.to_f32();
                each(texels, channels, out, |v| {
                    f16::from_f32(v.clamp(-limit, limit)).to_ne_bytes()
                });
            }
            (Sample::Float, _) => each(texels, channels, out, f32::to_ne_bytes),
        }
    }

    /// Copies an image into rows of `row_stride` bytes (0: no gap); the last row needs no
    /// padding.
    ///
    /// # Safety
    /// `data` is NULL or has `bytes` writable bytes.
    pub(crate) unsafe fn copy(
        &self,
        picture: &impl Picture,
        data: *mut c_void,
        bytes: usize,
        row_stride: usize,
    ) -> Result<(), Fault> {
        if data.is_null() {
            return Err(Fault::argument("data: NULL given"));
        }
        let (row, height) = (self.row_bytes(picture), picture.height());
        let stride = if row_stride == 0 { row } else { row_stride };
        let total = stride.checked_mul(height - 1).and_then(|n| n.checked_add(row));
        if stride < row || total.is_none_or(|total| bytes < total) {
            return Err(Fault::argument(format!(
                "data: {bytes} bytes in rows of {stride} given, {height} rows of {row} expected"
            )));
        }
        let (mut texels, mut packed) = (vec![[0.0; 4]; picture.width()], vec![0; row]);
        for y in 0..height {
            picture.row(y, &mut texels);
            self.pack(&texels, picture.coding(), &mut packed);
            // SAFETY: checked above against the size that the caller vouches for.
            unsafe {
                let to = data.cast::<u8>().add(y * stride);
                to.copy_from_nonoverlapping(packed.as_ptr(), row);
            }
        }
        Ok(())
    }
}

/// Texels of three planes, opaque.
pub(crate) fn interleave([r, g, b]: [&[f32]; 3], out: &mut [[f32; 4]]) {
    for (((out, r), g), b) in out.iter_mut().zip(r).zip(g).zip(b) {
        *out = [*r, *g, *b, 1.0];
    }
}

/// Nearest byte to a value from 0 to 1.
fn unit_byte(v: f32) -> u8 {
    (v * 255.0 + 0.5) as u8
}

/// Writes some channels of each texel.
fn each<const BYTES: usize>(
    texels: &[[f32; 4]],
    channels: &Range<usize>,
    out: &mut [u8],
    write: impl Fn(f32) -> [u8; BYTES],
) {
    match channels.len() {
        1 => each_of::<1, BYTES>(texels, channels.start, out, write),
        3 => each_of::<3, BYTES>(texels, channels.start, out, write),
        _ => each_of::<4, BYTES>(texels, channels.start, out, write),
    }
}

/// The same with their number known to the compiler.
fn each_of<const CHANNELS: usize, const BYTES: usize>(
    texels: &[[f32; 4]],
    first: usize,
    out: &mut [u8],
    write: impl Fn(f32) -> [u8; BYTES],
) {
    for (out, texel) in out.chunks_exact_mut(CHANNELS * BYTES).zip(texels) {
        for (out, v) in out.chunks_exact_mut(BYTES).zip(&texel[first..first + CHANNELS]) {
            out.copy_from_slice(&write(*v));
        }
    }
}
