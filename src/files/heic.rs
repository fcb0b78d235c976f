//! HEIC: HEVC pictures in HEIF, as written by iPhones and some Android phones.

use std::path::Path;

use heic_decoder::{ColorInfo, DecodedImage, RgbOptions};

use super::colours::Colours;
use super::guard;
use crate::photo::{Encoding, Limits, Photo};
use crate::{Error, Result};

/// Memory per pixel during decoding: planes of tiles and of the picture, and 16-bit RGB twice.
const BYTES_PER_PIXEL: u64 = 2 * 3 * 4 + 2 * 6;
/// Default for unlabelled colours, as in JPEG.
const UNLABELLED: ColorInfo = ColorInfo {
    color_primaries: 1,
    transfer_characteristics: 13,
    matrix_coefficients: 6,
    full_range: true,
};
/// Names of auxiliary pictures that are gain maps.
const GAIN_MAPS: [&[u8]; 2] =
    [b"urn:com:apple:photo:2020:aux:hdrgainmap", b"urn:iso:std:iso:ts:21496:-1"];
/// Search range for the boxes before the pixels, bytes.
const BOXES: usize = 256 << 10;

/// A decoded picture, upright.
pub struct Heic {
    image: DecodedImage,
}

/// Width and height as stored, before the rotation to upright.
pub fn size(bytes: &[u8]) -> Option<[u32; 2]> {
    let info = guarded(|| heic_decoder::probe(bytes)).ok()?;
    Some([u32::try_from(info.coded_width).ok()?, u32::try_from(info.coded_height).ok()?])
}

/// The Exif block, from its TIFF header on.
pub fn exif(bytes: &[u8]) -> Option<Vec<u8>> {
    guarded(|| heic_decoder::read_metadata(bytes)).ok()?.exif
}

/// Whether the file has a gain map.
pub fn has_gain_map(bytes: &[u8]) -> bool {
    let boxes = &bytes[..bytes.len().min(BOXES)];
    GAIN_MAPS.iter().any(|name| boxes.windows(name.len()).any(|part| part == *name))
}

impl Heic {
    /// Decodes a file.
    pub fn decode(path: &Path, bytes: &[u8], limits: &Limits) -> Result<Self> {
        let image = |message: String| Error::Image { path: path.to_owned(), message };
        let info = guarded(|| heic_decoder::probe(bytes)).map_err(image)?;
        for (width, height) in [(info.coded_width, info.coded_height), (info.width, info.height)] {
            let size = [width, height].map(|n| u32::try_from(n).unwrap_or(u32::MAX));
            limits.check_picture(path, size, BYTES_PER_PIXEL)?;
        }
        let image = guarded(|| heic_decoder::decode(bytes)).map_err(image)?;
        Ok(Self { image })
    }

    /// Colours stated by the file.
    pub fn colours(&self) -> Colours {
        let code = |code: u16| u8::try_from(code).unwrap_or(u8::MAX);
        match (&self.image.metadata.icc_profile, self.image.color_info) {
            (Some(profile), _) => Colours::of_icc(profile),
            (None, Some(info)) => Colours::of_code_points(
                code(info.color_primaries),
                code(info.transfer_characteristics),
            ),
            (None, None) => Colours::Srgb,
        }
    }

    /// Whether its values have more than 8 bits.
    pub fn is_deep(&self) -> bool {
        self.image.bit_depth_luma > 8
    }

    /// The photograph, with the given transfer curve.
    pub fn photo(&self, path: &Path, encoding: Encoding, exposure: f32) -> Result<Photo> {
        let image = |message: String| Error::Image { path: path.to_owned(), message };
        let options = RgbOptions {
            color: self.image.color_info.is_none().then_some(UNLABELLED),
            ..RgbOptions::default()
        };
        let size = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let (width, height) = (size(self.image.width), size(self.image.height));
        let stride = 3 * self.image.width;
        if self.is_deep() {
            let rgb = guarded(|| self.image.to_rgb16_with_options(&options)).map_err(image)?;
            Photo::from_rgb16(width, height, &rgb.data, stride, encoding, exposure)
        } else {
            let rgb = guarded(|| self.image.to_rgb8_with_options(&options)).map_err(image)?;
            Photo::from_rgb8(width, height, &rgb.data, stride, encoding, exposure)
        }
    }
}

fn guarded<T>(body: impl FnOnce() -> heic_decoder::Result<T>) -> std::result::Result<T, String> {
    guard::guarded("HEIC", body)
}
