//! TIFF files: selection of the largest page, and sample types that the crate `image` does not support.

use std::io::{self, BufRead, Read, Seek, SeekFrom};

use image::codecs::tiff::TiffDecoder;
use image::error::{
    DecodingError, ImageFormatHint, LimitError, LimitErrorKind, UnsupportedError,
    UnsupportedErrorKind,
};
use image::metadata::Orientation;
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use tiff::TiffError;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{IfdPointer, Tag};

/// Bytes of the longest header.
const HEADER: usize = 16;
/// Most pages examined.
const MOST_PAGES: usize = 1000;
/// Values of `SampleFormat`.
const UNSIGNED: u16 = 1;
const FLOAT: u16 = 3;

/// Whether a file has TIFF format, including BigTIFF.
pub fn is_tiff(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|start| bytes.starts_with(*start))
}

/// A decoder of the largest page (the first of several); thumbnails may come before and after.
/// Allocates at most `memory` bytes.
pub fn decoder<'a>(bytes: &'a [u8], memory: u64) -> ImageResult<Box<dyn ImageDecoder + 'a>> {
    let page = Page::new(bytes, largest(bytes, memory).unwrap_or(None));
    if let Some(wide) = Wide::of(page.clone(), memory).map_err(fault)? {
        return Ok(Box::new(wide));
    }
    Ok(Box::new(TiffDecoder::new(page)?))
}

/// Position of the directory of the largest page unless it is the first. Pages form a chain, and
/// each may have sub-pages.
fn largest(bytes: &[u8], memory: u64) -> Result<Option<u64>, TiffError> {
    let mut decoder = Decoder::new(io::Cursor::new(bytes))?.with_limits(limits(memory));
    let area = |(width, height): (u32, u32)| u64::from(width) * u64::from(height);
    let mut best = (area(decoder.dimensions()?), None);
    for page in 0..MOST_PAGES {
        let own = decoder.ifd_pointer().filter(|_| page > 0);
        let below = decoder.find_tag_unsigned_vec::<u64>(Tag::SubIfd).ok().flatten();
        let mut pages: Vec<(u64, Option<u64>)> = own
            .iter()
            .map(|own| (area(decoder.dimensions().unwrap_or((0, 0))), Some(own.0)))
            .collect();
        for at in below.unwrap_or_default().into_iter().take(MOST_PAGES) {
            // Skip damaged pages.
            let Ok(directory) = decoder.read_directory(IfdPointer(at)) else { continue };
            let mut tags = decoder.read_directory_tags(&directory);
            let mut side = |tag| tags.get_tag_unsigned::<u32>(tag).unwrap_or(0);
            pages.push((area((side(Tag::ImageWidth), side(Tag::ImageLength))), Some(at)));
        }
        for page in pages {
            if page.0 > best.0 {
                best = page;
            }
        }
        if !decoder.more_images() || decoder.next_image().is_err() {
            break;
        }
    }
    Ok(best.1)
}

fn limits(memory: u64) -> Limits {
    let bytes = usize::try_from(memory / 2).unwrap_or(usize::MAX);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = bytes;
    limits.intermediate_buffer_size = bytes;
    limits.ifd_value_size = bytes;
    limits
}

fn fault(fault: TiffError) -> ImageError {
    match fault {
        TiffError::IoError(fault) => ImageError::IoError(fault),
        TiffError::LimitsExceeded => {
            ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory))
        }
        TiffError::UnsupportedError(what) => unsupported(what.to_string()),
        other => ImageError::Decoding(DecodingError::new(ImageFormat::Tiff.into(), other)),
    }
}

fn unsupported(what: String) -> ImageError {
    let kind = UnsupportedErrorKind::GenericFeature(what);
    let format = ImageFormatHint::Exact(ImageFormat::Tiff);
    ImageError::Unsupported(UnsupportedError::from_format_and_kind(format, kind))
}

/// A file whose header points to another first directory.
#[derive(Clone)]
struct Page<'a> {
    header: Vec<u8>,
    bytes: &'a [u8],
    at: u64,
}

impl<'a> Page<'a> {
    fn new(bytes: &'a [u8], directory: Option<u64>) -> Self {
        let mut header = bytes[..bytes.len().min(HEADER)].to_vec();
        if let Some(at) = directory.filter(|_| header.len() == HEADER) {
            let is_little = header[0] == b'I';
            let is_big_tiff = header[2..4].contains(&b'+');
            let whole = if is_little { at.to_le_bytes() } else { at.to_be_bytes() };
            let half = if is_little { &whole[..4] } else { &whole[4..] };
            match is_big_tiff {
                true => header[8..].copy_from_slice(&whole),
                false => header[4..8].copy_from_slice(half),
            }
        }
        Self { header, bytes, at: 0 }
    }
}

impl BufRead for Page<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        let at = usize::try_from(self.at).unwrap_or(usize::MAX);
        Ok(match self.header.get(at..).filter(|rest| !rest.is_empty()) {
            Some(rest) => rest,
            None => self.bytes.get(at..).unwrap_or_default(),
        })
    }

    fn consume(&mut self, amount: usize) {
        self.at += amount as u64;
    }
}

impl Read for Page<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(out)?;
        self.consume(count);
        Ok(count)
    }
}

impl Seek for Page<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let mut cursor = io::Cursor::new(self.bytes);
        cursor.set_position(self.at);
        self.at = cursor.seek(to)?;
        Ok(self.at)
    }
}

/// A page of 32-bit integers, half, gray or double floats.
struct Wide<'a> {
    tiff: Decoder<Page<'a>>,
    size: (u32, u32),
    /// Values of a stored pixel, and how many of them are not alpha.
    channels: usize,
    kept: usize,
    is_float: bool,
}

impl<'a> Wide<'a> {
    /// The page, if it has such values.
    fn of(page: Page<'a>, memory: u64) -> Result<Option<Self>, TiffError> {
        // The other decoder explains files that cannot be opened.
        let Ok(tiff) = Decoder::new(page) else { return Ok(None) };
        let mut tiff = tiff.with_limits(limits(memory));
        let (bits, channels, kept) = match tiff.colortype() {
            Ok(tiff::ColorType::Gray(bits)) => (bits, 1, 1),
            Ok(tiff::ColorType::GrayA(bits)) => (bits, 2, 1),
            Ok(tiff::ColorType::RGB(bits)) => (bits, 3, 3),
            Ok(tiff::ColorType::RGBA(bits)) => (bits, 4, 3),
            _ => return Ok(None),
        };
        let formats = tiff.find_tag_unsigned_vec::<u16>(Tag::SampleFormat)?;
        let format = formats.and_then(|all| all.first().copied()).unwrap_or(UNSIGNED);
        let is_float = match (format, bits) {
            (UNSIGNED, 32) => false,
            (FLOAT, 16 | 64) => true,
            (FLOAT, 32) if kept == 1 => true,
            _ => return Ok(None),
        };
        let size = tiff.dimensions()?;
        Ok(Some(Self { tiff, size, channels, kept, is_float }))
    }

    /// Writes the colour values of each pixel; gray ones are repeated for every channel.
    fn write<T: Copy, const N: usize>(
        &self,
        values: &[T],
        out: &mut [u8],
        stored: impl Fn(T) -> [u8; N],
    ) {
        let written = if self.is_float { 3 } else { self.kept };
        let pixels = values.chunks_exact(self.channels).zip(out.chunks_exact_mut(N * written));
        for (pixel, out) in pixels {
            for (c, out) in out.as_chunks_mut::<N>().0.iter_mut().enumerate() {
                *out = stored(pixel[c.min(self.kept - 1)]);
            }
        }
    }
}

impl ImageDecoder for Wide<'_> {
    fn dimensions(&self) -> (u32, u32) {
        self.size
    }

    fn color_type(&self) -> ColorType {
        match (self.is_float, self.kept) {
            (true, _) => ColorType::Rgb32F,
            (false, 1) => ColorType::L16,
            (false, _) => ColorType::Rgb16,
        }
    }

    fn icc_profile(&mut self) -> ImageResult<Option<Vec<u8>>> {
        Ok(self.tiff.get_tag_u8_vec(Tag::IccProfile).ok())
    }

    fn orientation(&mut self) -> ImageResult<Orientation> {
        let stated = self.tiff.find_tag_unsigned::<u8>(Tag::Orientation).ok().flatten();
        Ok(stated.and_then(Orientation::from_exif).unwrap_or(Orientation::NoTransforms))
    }

    fn read_image(mut self, out: &mut [u8]) -> ImageResult<()> {
        let mut values = DecodingResult::U8(Vec::new());
        let layout = self.tiff.read_image_to_buffer(&mut values).map_err(fault)?;
        if layout.planes > 1 {
            return Err(unsupported("Planes of such wide values one after the other".into()));
        }
        match &values {
            DecodingResult::U32(values) => {
                // Some programs store 16-bit values in 32 bits.
                let is_wide = values.iter().any(|v| *v > u32::from(u16::MAX));
                let shift = if is_wide { 16 } else { 0 };
                self.write(values, out, |v| ((v >> shift) as u16).to_ne_bytes());
            }
            DecodingResult::F16(values) => self.write(values, out, |v| v.to_f32().to_ne_bytes()),
            DecodingResult::F32(values) => self.write(values, out, |v| v.to_ne_bytes()),
            DecodingResult::F64(values) => self.write(values, out, |v| (v as f32).to_ne_bytes()),
            _ => return Err(unsupported("Values of another kind than stated".into())),
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

#[cfg(test)]
#[path = "tiff_tests.rs"]
mod tests;
