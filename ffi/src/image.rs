//! Pictures in memory.

use std::ffi::c_void;
use std::slice;

use engine::photo::{
    Bayer, BayerPattern, Encoding, Interleaved, Photo, Plane, Primaries, Rotation, YuvMatrix,
};

use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// Layout of an image in memory. 16-bit numbers and floats are in the machine's byte order.
pub type svbrdf_pixel_format = u32;
/// 3 bytes a pixel.
pub const SVBRDF_PIXEL_RGB8: svbrdf_pixel_format = 1;
/// 4 bytes a pixel, the fourth ignored.
pub const SVBRDF_PIXEL_RGBA8: svbrdf_pixel_format = 2;
/// 3 16-bit numbers a pixel.
pub const SVBRDF_PIXEL_RGB16: svbrdf_pixel_format = 3;
/// 4 16-bit numbers a pixel, the fourth ignored.
pub const SVBRDF_PIXEL_RGBA16: svbrdf_pixel_format = 4;
/// 4 half floats a pixel, linear, the fourth ignored.
pub const SVBRDF_PIXEL_RGBA_F16: svbrdf_pixel_format = 5;
/// 3 floats a pixel, linear.
pub const SVBRDF_PIXEL_RGB_F32: svbrdf_pixel_format = 6;
/// 4 floats a pixel, linear, the fourth ignored.
pub const SVBRDF_PIXEL_RGBA_F32: svbrdf_pixel_format = 7;
/// Three planes: luma, then U (Cb) and V (Cr) at half the size, rounded up. Strides tell NV12,
/// NV21 and I420 apart, as in Android's YUV_420_888.
pub const SVBRDF_PIXEL_YUV420: svbrdf_pixel_format = 8;
/// One plane of 16-bit sensor values behind a Bayer mosaic, as Android's RAW_SENSOR.
pub const SVBRDF_PIXEL_BAYER16: svbrdf_pixel_format = 9;
/// 4 bytes a pixel, blue first, the fourth ignored: iOS's kCVPixelFormatType_32BGRA.
pub const SVBRDF_PIXEL_BGRA8: svbrdf_pixel_format = 10;
/// As SVBRDF_PIXEL_YUV420 in 16-bit words, of which the upper 10 bits count: Android's YCBCR_P010,
/// iOS's 420YpCbCr10BiPlanar. U and V of one plane: the second begins 2 bytes later.
pub const SVBRDF_PIXEL_P010: svbrdf_pixel_format = 11;

/// Transfer curve of stored values.
pub type svbrdf_transfer = u32;
/// Proportional to light: the best choice. Floats and raw values are always linear.
pub const SVBRDF_TRANSFER_LINEAR: svbrdf_transfer = 1;
/// IEC 61966-2-1. The tone curve of a camera is *not* sRGB: turn it off, or let it be estimated from
/// the board.
pub const SVBRDF_TRANSFER_SRGB: svbrdf_transfer = 2;
/// Pure power law of 2.2.
pub const SVBRDF_TRANSFER_GAMMA22: svbrdf_transfer = 3;
/// Hybrid log-gamma of ITU-R BT.2100, scene linear (its inverse OETF): 1 at the largest signal.
pub const SVBRDF_TRANSFER_HLG: svbrdf_transfer = 4;
/// Perceptual quantiser of ITU-R BT.2100: 1 at 203 cd/m2, 49.26 at the largest signal.
pub const SVBRDF_TRANSFER_PQ: svbrdf_transfer = 5;

/// Primaries of RGB, all with white D65. Others than Rec. 709 are converted in linear light to floats
/// (four times the memory of 8 bits); negative values become 0.
pub type svbrdf_primaries = u32;
/// ITU-R BT.709: sRGB.
pub const SVBRDF_PRIMARIES_REC709: svbrdf_primaries = 1;
/// Display P3, common for photos of phones.
pub const SVBRDF_PRIMARIES_DISPLAY_P3: svbrdf_primaries = 2;
/// ITU-R BT.2020 and BT.2100.
pub const SVBRDF_PRIMARIES_REC2020: svbrdf_primaries = 3;

/// How luma and chroma were made. Numbers are of 8 bits: of 10 bits, they are four times that.
pub type svbrdf_yuv_matrix = u32;
/// BT.601, all 256 values: JPEG and Android.
pub const SVBRDF_YUV_BT601_FULL: svbrdf_yuv_matrix = 1;
/// BT.601, luma 16 to 235.
pub const SVBRDF_YUV_BT601_LIMITED: svbrdf_yuv_matrix = 2;
/// BT.709, all 256 values.
pub const SVBRDF_YUV_BT709_FULL: svbrdf_yuv_matrix = 3;
/// BT.709, luma 16 to 235.
pub const SVBRDF_YUV_BT709_LIMITED: svbrdf_yuv_matrix = 4;
/// BT.2020 with non-constant luminance, all values.
pub const SVBRDF_YUV_BT2020_FULL: svbrdf_yuv_matrix = 5;
/// BT.2020 with non-constant luminance, luma 16 to 235.
pub const SVBRDF_YUV_BT2020_LIMITED: svbrdf_yuv_matrix = 6;

/// Colours of the top-left 2 x 2 sensor pixels, row by row.
pub type svbrdf_bayer_pattern = u32;
/// Red, green; green, blue.
pub const SVBRDF_BAYER_RGGB: svbrdf_bayer_pattern = 1;
/// Green, red; blue, green.
pub const SVBRDF_BAYER_GRBG: svbrdf_bayer_pattern = 2;
/// Green, blue; red, green.
pub const SVBRDF_BAYER_GBRG: svbrdf_bayer_pattern = 3;
/// Blue, green; green, red.
pub const SVBRDF_BAYER_BGGR: svbrdf_bayer_pattern = 4;

/// A plane of an image. Its layout never changes.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_plane {
    /// First pixel. Any alignment.
    pub data: *const c_void,
    /// Readable bytes from there on. The last row may end with its last pixel.
    pub bytes: usize,
    /// Bytes from a row to the next.
    pub row_stride: usize,
    /// Bytes from a pixel to the next; 0: no gap.
    pub pixel_stride: usize,
}

/// An image in memory. Nothing of it is kept after the call. Unused fields are ignored.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_image {
    /// Size of this struct.
    pub size: usize,
    /// Layout: one of SVBRDF_PIXEL_.
    pub format: svbrdf_pixel_format,
    /// Pixels in a row, as stored.
    pub width: u32,
    /// Rows, as stored.
    pub height: u32,
    /// Curve of 8- and 16-bit RGB and of YUV: one of SVBRDF_TRANSFER_. Default: sRGB.
    pub transfer: svbrdf_transfer,
    /// Clockwise rotation of the image before use: 0, 90, 180 or 270 degrees. The session's camera
    /// describes the rotated image. Boards need no rotation.
    pub rotation: u32,
    /// For YUV and P010: one of SVBRDF_YUV_. Default: BT.601, all values.
    pub yuv_matrix: svbrdf_yuv_matrix,
    /// The planes: three for YUV and P010, otherwise the first.
    pub planes: [svbrdf_plane; 3],
    /// For floats: the level at which a channel is clipped. Default: infinite, never.
    pub saturation: f32,
    /// For Bayer: one of SVBRDF_BAYER_. Default: RGGB.
    pub bayer_pattern: svbrdf_bayer_pattern,
    /// For Bayer: value of darkness at the four places of the pattern, row by row.
    pub black_level: [f32; 4],
    /// For Bayer: value of full scale; at and above it a sample is clipped. Default: 65535.
    pub white_level: f32,
    /// For Bayer: gains of R, G and B that make neutral gray neutral. Default: 1.
    pub white_balance: [f32; 3],
    /// For Bayer: matrix from white-balanced sensor colours to linear Rec. 709, row by row.
    /// Default: identity.
    pub color_matrix: [f32; 9],
    /// Of all but Bayer: one of SVBRDF_PRIMARIES_. Default: Rec. 709.
    pub primaries: svbrdf_primaries,
}

defaults!(svbrdf_image {
    transfer: SVBRDF_TRANSFER_SRGB,
    yuv_matrix: SVBRDF_YUV_BT601_FULL,
    saturation: f32::INFINITY,
    bayer_pattern: SVBRDF_BAYER_RGGB,
    white_level: 65535.0,
    white_balance: [1.0; 3],
    color_matrix: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    primaries: SVBRDF_PRIMARIES_REC709,
});
versioned!(svbrdf_image, size_of::<svbrdf_image>());

/// Fills an image description with defaults: pass sizeof(svbrdf_image).
///
/// # Safety
/// `image` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_image_init(image: *mut svbrdf_image, size: usize) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(image, size) })
}

/// A caller's bytes.
///
/// # Safety
/// NULL, or as many readable bytes as said, unchanged while the result is used.
pub(crate) unsafe fn bytes<'a>(
    name: &str,
    data: *const c_void,
    bytes: usize,
) -> Result<&'a [u8], Fault> {
    if data.is_null() {
        return Err(Fault::argument(format!("{name}: NULL given")));
    }
    if bytes > isize::MAX as usize {
        return Err(Fault::argument(format!("{name}: {bytes} bytes given, more than fit memory")));
    }
    // SAFETY: not NULL, a size that memory may have, bytes need no alignment.
    Ok(unsafe { slice::from_raw_parts(data.cast(), bytes) })
}

fn unknown<T>(field: &str, value: u32) -> Result<T, Fault> {
    Err(Fault::argument(format!("svbrdf_image.{field}: {value} is not a known value")))
}

/// Bytes of a pixel in floats.
pub(crate) const FLOATS: u64 = 12;

/// The curve that a field of a struct names.
pub(crate) fn encoding(field: &'static str, transfer: svbrdf_transfer) -> Result<Encoding, Fault> {
    Ok(match transfer {
        SVBRDF_TRANSFER_LINEAR => Encoding::Linear,
        SVBRDF_TRANSFER_SRGB => Encoding::Srgb,
        SVBRDF_TRANSFER_GAMMA22 => Encoding::Gamma22,
        SVBRDF_TRANSFER_HLG => Encoding::Hlg,
        SVBRDF_TRANSFER_PQ => Encoding::Pq,
        other => return Err(crate::values::unknown(field, other)),
    })
}

impl svbrdf_image {
    /// Bytes of a pixel of the photo that [`svbrdf_image::photo`] makes.
    pub(crate) fn photo_bytes(&self) -> u64 {
        match self.format {
            SVBRDF_PIXEL_BAYER16 => 6,
            _ if self.primaries != SVBRDF_PRIMARIES_REC709 => FLOATS,
            SVBRDF_PIXEL_RGB8 | SVBRDF_PIXEL_RGBA8 | SVBRDF_PIXEL_BGRA8 | SVBRDF_PIXEL_YUV420 => 3,
            SVBRDF_PIXEL_RGB16 | SVBRDF_PIXEL_RGBA16 | SVBRDF_PIXEL_P010 => 6,
            _ => FLOATS,
        }
    }

    /// Copies the image.
    ///
    /// # Safety
    /// The planes that the format needs are NULL or have as many readable bytes as said.
    pub(crate) unsafe fn photo(&self, exposure: f32) -> Result<Photo, Fault> {
        let plane = |i: usize| -> Result<Plane, Fault> {
            let p = &self.planes[i];
            let name = ["planes[0].data", "planes[1].data", "planes[2].data"][i];
            // SAFETY: the caller vouches for the planes that are asked for.
            let data = unsafe { bytes(name, p.data, p.bytes) }?;
            Ok(Plane { data, row_stride: p.row_stride, pixel_stride: p.pixel_stride })
        };
        let size = [self.width, self.height];
        let (rotation, primaries) = (self.rotation()?, self.primaries()?);
        let photo = match self.format {
            SVBRDF_PIXEL_YUV420 | SVBRDF_PIXEL_P010 => {
                let convert = match self.format {
                    SVBRDF_PIXEL_P010 => Photo::from_p010,
                    _ => Photo::from_yuv420,
                };
                let planes = [plane(0)?, plane(1)?, plane(2)?];
                let (matrix, encoding) = (self.yuv_matrix()?, self.encoding()?);
                convert(size, planes, matrix, encoding, rotation, exposure)
            }
            SVBRDF_PIXEL_BAYER16 => {
                let bayer = self.bayer()?;
                return Ok(Photo::from_bayer16(size, plane(0)?, &bayer, rotation, exposure)?);
            }
            _ => {
                let layout = self.layout()?;
                let float = matches!(
                    layout,
                    Interleaved::RgbaF16 | Interleaved::RgbF32 | Interleaved::RgbaF32
                );
                let encoding = if float { Encoding::Linear } else { self.encoding()? };
                Photo::from_interleaved(
                    size,
                    plane(0)?,
                    layout,
                    encoding,
                    rotation,
                    exposure,
                    self.saturation,
                )
            }
        };
        Ok(photo?.with_primaries(primaries))
    }

    fn layout(&self) -> Result<Interleaved, Fault> {
        Ok(match self.format {
            SVBRDF_PIXEL_RGB8 => Interleaved::Rgb8,
            SVBRDF_PIXEL_RGBA8 => Interleaved::Rgba8,
            SVBRDF_PIXEL_BGRA8 => Interleaved::Bgra8,
            SVBRDF_PIXEL_RGB16 => Interleaved::Rgb16,
            SVBRDF_PIXEL_RGBA16 => Interleaved::Rgba16,
            SVBRDF_PIXEL_RGBA_F16 => Interleaved::RgbaF16,
            SVBRDF_PIXEL_RGB_F32 => Interleaved::RgbF32,
            SVBRDF_PIXEL_RGBA_F32 => Interleaved::RgbaF32,
            other => return unknown("format", other),
        })
    }

    fn encoding(&self) -> Result<Encoding, Fault> {
        encoding("svbrdf_image.transfer", self.transfer)
    }

    fn rotation(&self) -> Result<Rotation, Fault> {
        Ok(match self.rotation {
            0 => Rotation::None,
            90 => Rotation::Quarter,
            180 => Rotation::Half,
            270 => Rotation::ThreeQuarters,
            other => return unknown("rotation", other),
        })
    }

    fn yuv_matrix(&self) -> Result<YuvMatrix, Fault> {
        Ok(match self.yuv_matrix {
            SVBRDF_YUV_BT601_FULL => YuvMatrix::Bt601Full,
            SVBRDF_YUV_BT601_LIMITED => YuvMatrix::Bt601Limited,
            SVBRDF_YUV_BT709_FULL => YuvMatrix::Bt709Full,
            SVBRDF_YUV_BT709_LIMITED => YuvMatrix::Bt709Limited,
            SVBRDF_YUV_BT2020_FULL => YuvMatrix::Bt2020Full,
            SVBRDF_YUV_BT2020_LIMITED => YuvMatrix::Bt2020Limited,
            other => return unknown("yuv_matrix", other),
        })
    }

    fn primaries(&self) -> Result<Primaries, Fault> {
        Ok(match self.primaries {
            SVBRDF_PRIMARIES_REC709 => Primaries::Rec709,
            SVBRDF_PRIMARIES_DISPLAY_P3 => Primaries::DisplayP3,
            SVBRDF_PRIMARIES_REC2020 => Primaries::Rec2020,
            other => return unknown("primaries", other),
        })
    }

    fn bayer(&self) -> Result<Bayer, Fault> {
        let pattern = match self.bayer_pattern {
            SVBRDF_BAYER_RGGB => BayerPattern::Rggb,
            SVBRDF_BAYER_GRBG => BayerPattern::Grbg,
            SVBRDF_BAYER_GBRG => BayerPattern::Gbrg,
            SVBRDF_BAYER_BGGR => BayerPattern::Bggr,
            other => return unknown("bayer_pattern", other),
        };
        let m = &self.color_matrix;
        Ok(Bayer {
            pattern,
            black_level: self.black_level,
            white_level: self.white_level,
            white_balance: self.white_balance,
            color_matrix: [[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]],
        })
    }
}
