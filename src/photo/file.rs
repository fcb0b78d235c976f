//! Reading photographs from files.

use std::io::Cursor;
use std::path::Path;

use image::codecs::jpeg::JpegDecoder;
use image::codecs::openexr::OpenExrDecoder;
use image::codecs::png::PngDecoder;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat};

use super::encoding::Encoding;
use super::exif;
use super::jpeg;
use super::pixels::{MAX_PIXELS, Photo};
use super::tiff;
use crate::{Error, Result};

/// Name of data without a file.
pub(crate) const MEMORY: &str = "(memory)";
/// Largest PNG chunk other than pixels, bytes.
const MAX_CHUNK_BYTES: u64 = 64 << 20;

/// Limits of reading and decoding a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Size of the file, bytes.
    pub file_bytes: u64,
    /// Pixels, at most [`MAX_PIXELS`].
    pub pixels: u64,
    /// Peak memory of decoding besides the file itself, bytes.
    pub memory_bytes: u64,
}

impl Default for Limits {
    /// Files of 2 GiB, [`MAX_PIXELS`], and memory for the largest of them.
    fn default() -> Self {
        Self { file_bytes: 2 << 30, pixels: MAX_PIXELS, memory_bytes: 6 << 30 }
    }
}

impl Limits {
    /// Checks the size of a file.
    ///
    /// # Errors
    /// [`Error::Image`] if it is empty or too large.
    pub(crate) fn check_file(&self, path: &Path, bytes: u64) -> Result<()> {
        let fault = |message: String| Error::Image { path: path.to_owned(), message };
        if bytes == 0 {
            return Err(fault("the file is empty".into()));
        }
        if bytes > self.file_bytes {
            let most = self.file_bytes;
            return Err(fault(format!("{bytes} bytes; at most {most} are supported")));
        }
        Ok(())
    }

    /// Checks a picture that needs `bytes` bytes of memory per pixel.
    ///
    /// # Errors
    /// [`Error::Image`] if it is empty or too large, [`Error::MemoryLimit`].
    pub(crate) fn check_picture(&self, path: &Path, size: [u32; 2], bytes: u64) -> Result<()> {
        let [width, height] = size;
        let (pixels, most) = (u64::from(width) * u64::from(height), self.pixels.min(MAX_PIXELS));
        if pixels == 0 || pixels > most {
            return Err(Error::Image { path: path.to_owned(), message: size_fault(size, most) });
        }
        let needed = pixels.saturating_mul(bytes);
        if needed > self.memory_bytes {
            return Err(Error::MemoryLimit { needed, limit: self.memory_bytes });
        }
        Ok(())
    }

    /// Reads a file after a check of its size.
    ///
    /// # Errors
    /// As [`Limits::check_file`], and [`Error::Io`].
    pub(crate) fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
        self.check_file(path, size)?;
        std::fs::read(path).map_err(|e| Error::io(path, e))
    }
}

/// Fault of a size, with advice.
pub(crate) fn size_fault([width, height]: [u32; 2], most: u64) -> String {
    let advice = if width == 0 || height == 0 {
        ""
    } else {
        ": let the camera take photos of 12 to 50 megapixels, or scale all of them to half the size"
    };
    format!("{width} x {height} px; 1 to {most} pixels are supported{advice}")
}

/// A decoded picture, upright.
pub(crate) struct Picture {
    pub image: DynamicImage,
    pub focal_35mm: Option<f32>,
    /// The embedded ICC profile.
    #[cfg_attr(not(feature = "files"), expect(dead_code))]
    pub profile: Option<Vec<u8>>,
    /// Whether the file lacks only its end marker.
    #[cfg_attr(not(feature = "files"), expect(dead_code))]
    pub end_missing: bool,
}

impl Photo {
    /// Reads a PNG, JPEG, TIFF (integers of 8, 16 or 32 bits, or floats; the largest page) or OpenEXR file
    /// and rotates it upright by its orientation tag. Gray pictures become RGB, alpha is dropped. Float files
    /// are linear and never saturated. Ignores colour profiles; `files` applies them.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be opened, [`Error::Image`] if it is empty, damaged,
    /// truncated, too large ([`MAX_PIXELS`]) or of another format, [`Error::Field`] about
    /// `encoding` if a curve is given for floats.
    pub fn read(path: impl AsRef<Path>, encoding: Encoding, exposure: f32) -> Result<Self> {
        let path = path.as_ref();
        let limits = Limits::default();
        let picture = decode(path, &limits.read(path)?, &limits)?;
        Self::from_picture(path, picture, encoding, exposure)
    }

    /// As [`Photo::read`], from the content of a file.
    ///
    /// # Errors
    /// As [`Photo::read`]; the file is called `(memory)`.
    pub fn decode(bytes: &[u8], encoding: Encoding, exposure: f32) -> Result<Self> {
        let path = Path::new(MEMORY);
        let picture = decode(path, bytes, &Limits::default())?;
        Self::from_picture(path, picture, encoding, exposure)
    }

    pub(crate) fn from_picture(
        path: &Path,
        Picture { image, focal_35mm, .. }: Picture,
        encoding: Encoding,
        exposure: f32,
    ) -> Result<Self> {
        let (width, height) = (image.width(), image.height());
        let photo = match image.color() {
            ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => {
                let data = image.into_rgb8().into_raw();
                Self::from_u8(width, height, data, encoding, exposure)
            }
            ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
                let data = image.into_rgb16().into_raw();
                Self::from_u16(width, height, data, encoding, exposure)
            }
            _ if encoding != Encoding::Linear => Err(Error::Field {
                path: path.to_owned(),
                field: "encoding".into(),
                message: format!("`{}` stated for a file of floats", encoding.name()),
                expected: "`linear`: float files hold linear values".into(),
            }),
            _ => {
                let data = image.into_rgb32f().into_raw();
                Self::from_linear(width, height, data, exposure, f32::INFINITY)
            }
        };
        Ok(photo?.with_focal_35mm(focal_35mm))
    }
}

/// Decodes a picture of at most [`MAX_PIXELS`] and rotates it upright.
pub(crate) fn read_picture(path: &Path) -> Result<DynamicImage> {
    let limits = Limits::default();
    Ok(decode(path, &limits.read(path)?, &limits)?.image)
}

pub(crate) fn decode(path: &Path, bytes: &[u8], limits: &Limits) -> Result<Picture> {
    let fault = |message: String| Error::Image { path: path.to_owned(), message };
    limits.check_file(path, bytes.len() as u64)?;
    let fault_of = |e: image::ImageError| match e {
        image::ImageError::Unsupported(e) => {
            fault(format!("{e}; convert it to RGB of 8 or 16 bits"))
        }
        e => fault(e.to_string()),
    };
    let open = |bytes| {
        decoder(bytes, limits)
            .map_err(fault_of)?
            .ok_or_else(|| fault("not a PNG, JPEG, TIFF or OpenEXR file".into()))
    };
    // It must outlive the decoder.
    #[allow(clippy::needless_late_init)]
    let mended;
    let mut decoder = open(bytes)?;
    let size = decoder.dimensions();
    let pixel = u64::from(decoder.color_type().bytes_per_pixel());
    // Memory: as stored, rotated, and as RGB.
    limits.check_picture(path, size.into(), 2 * pixel + 3 * pixel.div_ceil(4).max(1))?;
    let end_missing = bytes.starts_with(&[0xFF, 0xD8]) && !jpeg::is_complete(bytes);
    mended = if end_missing { jpeg::with_end(bytes, jpeg_pixels) } else { None };
    if let Some(mended) = &mended {
        decoder = open(mended)?;
    } else if end_missing {
        return Err(fault("the file is truncated: its end is missing".into()));
    }
    let orientation = decoder.orientation().map_err(fault_of)?;
    // Unreadable metadata do not make the picture unusable.
    let metadata = decoder.exif_metadata().ok().flatten();
    let focal_35mm = metadata.and_then(exif::focal_35mm);
    let profile = decoder.icc_profile().ok().flatten();
    let mut image = DynamicImage::from_decoder(decoder).map_err(fault_of)?;
    image.apply_orientation(orientation);
    Ok(Picture { image, focal_35mm, profile, end_missing })
}

fn jpeg_pixels(bytes: &[u8]) -> Option<Vec<u8>> {
    let decoder = JpegDecoder::new(Cursor::new(bytes)).ok()?;
    Some(DynamicImage::from_decoder(decoder).ok()?.into_bytes())
}

/// A decoder for the format of the content; `None` if unsupported.
fn decoder<'a>(
    bytes: &'a [u8],
    limits: &Limits,
) -> image::ImageResult<Option<Box<dyn ImageDecoder + 'a>>> {
    let allowed = |bytes: u64| {
        let mut limits = image::Limits::no_limits();
        limits.max_alloc = Some(bytes);
        limits
    };
    let reader = Cursor::new(bytes);
    let mut decoder: Box<dyn ImageDecoder + 'a> = match image::guess_format(bytes).ok() {
        _ if tiff::is_tiff(bytes) => tiff::decoder(bytes, limits.memory_bytes)?,
        // The decoder unpacks ancillary chunks immediately.
        Some(ImageFormat::Png) => {
            Box::new(PngDecoder::with_limits(reader, allowed(MAX_CHUNK_BYTES))?)
        }
        Some(ImageFormat::Jpeg) => Box::new(JpegDecoder::new(reader)?),
        Some(ImageFormat::OpenExr) => Box::new(OpenExrDecoder::new(reader)?),
        _ => return Ok(None),
    };
    decoder.set_limits(allowed(limits.memory_bytes))?;
    Ok(Some(decoder))
}

/// Width and height as stored, and whether the values are floats; `None` if unreadable.
#[cfg(feature = "files")]
pub(crate) fn look_at(bytes: &[u8]) -> Option<([u32; 2], bool)> {
    let decoder = decoder(bytes, &Limits::default()).ok()??;
    let is_float = matches!(decoder.color_type(), ColorType::Rgb32F | ColorType::Rgba32F);
    Some((decoder.dimensions().into(), is_float))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::metadata::Orientation;
    use image::{ExtendedColorType, ImageEncoder};
    use std::path::PathBuf;

    const W: u32 = 6;
    const H: u32 = 4;

    fn gradient8() -> Vec<u8> {
        (0..3 * W * H).map(|i| (i * 255 / (3 * W * H - 1)) as u8).collect()
    }

    fn write(dir: &Path, name: &str, bytes: &[u8]) -> PathBuf {
        let path = dir.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn encode(picture: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn lossless_formats_come_back_exactly() {
        let dir = tempfile::tempdir().unwrap();
        let data8 = gradient8();
        let data16: Vec<u16> = data8.iter().map(|&v| u16::from(v) * 256 + 3).collect();
        let float: Vec<f32> = data8.iter().map(|&v| f32::from(v) * 0.1).collect();
        let p8: DynamicImage = image::RgbImage::from_raw(W, H, data8.clone()).unwrap().into();
        let p16 =
            DynamicImage::ImageRgb16(image::ImageBuffer::from_raw(W, H, data16.clone()).unwrap());
        let pf =
            DynamicImage::ImageRgb32F(image::ImageBuffer::from_raw(W, H, float.clone()).unwrap());
        for format in [ImageFormat::Png, ImageFormat::Tiff] {
            let path = write(dir.path(), "p8", &encode(&p8, format));
            let photo = Photo::read(&path, Encoding::Srgb, 1.0).unwrap();
            let exact: Vec<f32> =
                data8.iter().map(|&v| Encoding::Srgb.decode(f64::from(v) / 255.0) as f32).collect();
            assert_eq!(photo.to_linear(), exact);
            assert_eq!((photo.width(), photo.height()), (W, H));
            let path = write(dir.path(), "p16", &encode(&p16, format));
            let photo = Photo::read(&path, Encoding::Linear, 1.0).unwrap();
            let exact: Vec<f32> = data16.iter().map(|&v| (f64::from(v) / 65535.0) as f32).collect();
            assert_eq!(photo.to_linear(), exact);
        }
        for format in [ImageFormat::OpenExr, ImageFormat::Tiff] {
            let path = write(dir.path(), "float", &encode(&pf, format));
            let photo = Photo::read(&path, Encoding::Linear, 1.0).unwrap();
            assert_eq!(photo.to_linear(), float);
            assert_eq!(photo.saturation(), f32::INFINITY);
            let fault = Photo::read(&path, Encoding::Srgb, 1.0).unwrap_err().to_string();
            assert!(fault.contains("encoding") && fault.contains("linear"), "{fault}");
        }
    }

    #[test]
    fn gray_and_alpha_become_rgb() {
        let dir = tempfile::tempdir().unwrap();
        let gray =
            DynamicImage::ImageLuma8(image::GrayImage::from_raw(2, 1, vec![51, 255]).unwrap());
        let path = write(dir.path(), "gray.png", &encode(&gray, ImageFormat::Png));
        let photo = Photo::read(&path, Encoding::Linear, 1.0).unwrap();
        assert_eq!(photo.to_linear(), [0.2, 0.2, 0.2, 1.0, 1.0, 1.0]);
        assert_eq!(photo.clip_mask(), [false, true]);
        let rgba = image::RgbaImage::from_raw(1, 1, vec![51, 102, 153, 0]).unwrap().into();
        let path = write(dir.path(), "rgba.png", &encode(&rgba, ImageFormat::Png));
        let photo = Photo::read(&path, Encoding::Linear, 1.0).unwrap();
        assert_eq!(photo.to_linear(), [0.2, 0.4, 0.6]);
    }

    /// Minimal EXIF block (little-endian TIFF header, one tag).
    fn exif(orientation: u8) -> Vec<u8> {
        let mut block = b"II\x2a\0\x08\0\0\0\x01\0".to_vec();
        block.extend([0x12, 0x01, 0x03, 0, 1, 0, 0, 0, orientation, 0, 0, 0, 0, 0, 0, 0]);
        block
    }

    #[test]
    fn orientation_tags_are_honoured() {
        let dir = tempfile::tempdir().unwrap();
        // The left half is black, the right white; JPEG blocks of 16 px do not mix them.
        let data: Vec<u8> =
            (0..32 * 16).flat_map(|i| [if i % 32 < 16 { 0 } else { 255 }; 3]).collect();
        for tag in 1..=8 {
            let mut jpeg = Vec::new();
            let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 95);
            encoder.set_exif_metadata(exif(tag)).unwrap();
            encoder.write_image(&data, 32, 16, ExtendedColorType::Rgb8).unwrap();
            let mut png = Vec::new();
            let mut encoder = image::codecs::png::PngEncoder::new(&mut png);
            encoder.set_exif_metadata(exif(tag)).unwrap();
            encoder.write_image(&data, 32, 16, ExtendedColorType::Rgb8).unwrap();
            let turned = tag >= 5;
            for bytes in [jpeg, png] {
                let path = write(dir.path(), "turned", &bytes);
                let photo = Photo::read(&path, Encoding::Srgb, 1.0).unwrap();
                let size = if turned { (16, 32) } else { (32, 16) };
                assert_eq!((photo.width(), photo.height()), size, "tag {tag}");
                // Exif: side of the upright picture that shows the stored left column.
                let dark = match tag {
                    1 | 4 => (2, 8),
                    2 | 3 => (29, 8),
                    5 | 6 => (8, 2),
                    _ => (8, 29),
                };
                let bright = (size.0 - 1 - dark.0, size.1 - 1 - dark.1);
                assert!(photo.pixel(dark.0, dark.1)[1] < 0.1, "tag {tag}");
                assert!(photo.pixel(bright.0, bright.1)[1] > 0.9, "tag {tag}");
            }
            assert_eq!(Orientation::from_exif(tag).unwrap().to_exif(), tag);
        }
    }

    #[test]
    fn broken_files_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let picture: DynamicImage = image::RgbImage::from_fn(64, 64, |x, y| {
            image::Rgb([(x * 3) as u8, (y * 3) as u8, ((x * y) % 251) as u8])
        })
        .into();
        let mut cases = vec![("empty.png", Vec::new()), ("text.jpg", b"hello".to_vec())];
        for (name, format) in [
            ("cut.jpg", ImageFormat::Jpeg),
            ("cut.png", ImageFormat::Png),
            ("cut.tif", ImageFormat::Tiff),
        ] {
            let bytes = encode(&picture, format);
            cases.push((name, bytes[..bytes.len() * 3 / 5].to_vec()));
            // Complete files are accepted.
            let path = write(dir.path(), name, &bytes);
            Photo::read(path, Encoding::Srgb, 1.0).unwrap();
        }
        let float = DynamicImage::ImageRgb32F(picture.to_rgb32f());
        let bytes = encode(&float, ImageFormat::OpenExr);
        cases.push(("cut.exr", bytes[..bytes.len() / 2].to_vec()));
        for (name, bytes) in cases {
            let path = write(dir.path(), name, &bytes);
            let fault = Photo::read(&path, Encoding::Linear, 1.0).unwrap_err();
            assert!(matches!(fault, Error::Image { .. }), "{name}: {fault:?}");
            assert!(fault.to_string().contains(name), "{fault}");
        }
        let missing = Photo::read(dir.path().join("no.png"), Encoding::Linear, 1.0).unwrap_err();
        assert!(matches!(missing, Error::Io { .. }) && missing.to_string().contains("no.png"));
    }

    #[test]
    fn a_huge_picture_is_refused_before_it_is_allocated() {
        let dir = tempfile::tempdir().unwrap();
        let small = image::RgbImage::new(1, 1).into();
        let mut bytes = encode(&small, ImageFormat::Png);
        // IHDR: width and height at offset 16, checksum at 29.
        bytes[16..20].copy_from_slice(&16384u32.to_be_bytes());
        bytes[20..24].copy_from_slice(&16384u32.to_be_bytes());
        let checksum = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
        let path = write(dir.path(), "huge.png", &bytes);
        let fault = Photo::read(&path, Encoding::Srgb, 1.0).unwrap_err().to_string();
        assert!(fault.contains("huge.png") && fault.contains("16384 x 16384"), "{fault}");
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0u32, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| (c >> 1) ^ (0xEDB8_8320 * (c & 1)))
        })
    }
}
