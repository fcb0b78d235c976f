//! Photographs from encoded files.

use std::path::Path;

use super::colours::Colours;
#[cfg(feature = "heic")]
use super::heic;
use super::kind::Kind;
use super::metadata::Metadata;
use super::remark::Remark;
use super::{dng, jpeg, png_colours};
use crate::photo::{Encoding, Limits, MEMORY, Photo, Picture, Rotation, decode as decode_picture};
use crate::{Error, Result};

/// Smallest 8-bit value that counts as clipped; lossy compression changes 255 by one.
const CLIPPED_8: f32 = 254.0 / 255.0;
/// The same for 16 bits.
const CLIPPED_16: f32 = 65_472.0 / 65_535.0;
/// Linear value that counts as clipped, equal to 254 in sRGB. Pictures clipped before their profile
/// was applied contain no clipped stored value.
const SATURATED: f32 = 0.991;

/// Options of reading a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Transfer curve of the stored values, with primaries of Rec. 709: the colours that the file
    /// states are ignored. `None`: the colours that the file states (ICC profile, PNG's cICP and
    /// gAMA), sRGB where it states none, linear for floats and raw values.
    pub encoding: Option<Encoding>,
    /// Relative exposure: value = radiance * exposure. `None`: from the metadata
    /// ([`Metadata::exposure`]), or 1.
    pub exposure: Option<f32>,
    /// Clockwise rotation of the upright picture.
    pub turn: Rotation,
    /// Limits of reading and allocation.
    pub limits: Limits,
}

/// A photograph with the information of its file.
#[derive(Debug, Clone)]
pub struct Decoded {
    /// The photograph in linear Rec. 709: upright, then rotated as requested.
    pub photo: Photo,
    /// Metadata.
    pub metadata: Metadata,
    /// Remarks about the file.
    pub remarks: Vec<Remark>,
}

/// Reads a photograph: JPEG, PNG, TIFF, OpenEXR or DNG by its content, HEIC with feature `heic`.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read; [`Error::Image`] if it is empty, damaged, truncated, too large
/// or of an unsupported format (the message contains advice); [`Error::MemoryLimit`] if decoding needs more
/// than allowed; [`Error::Field`] about `encoding` if a curve is given for floats or raw values.
pub fn read(path: impl AsRef<Path>, options: &Options) -> Result<Decoded> {
    let path = path.as_ref();
    of_bytes(path, &options.limits.read(path)?, options)
}

/// As [`read`], from the content of a file.
///
/// # Errors
/// As [`read`]; the file is called `(memory)`.
pub fn decode(bytes: &[u8], options: &Options) -> Result<Decoded> {
    of_bytes(Path::new(MEMORY), bytes, options)
}

fn of_bytes(path: &Path, bytes: &[u8], options: &Options) -> Result<Decoded> {
    options.limits.check_file(path, bytes.len() as u64)?;
    let image = |message: String| Error::Image { path: path.to_owned(), message };
    let kind = Kind::of(bytes).ok_or_else(|| {
        image(format!("not a picture of a known format; expected {}", Kind::all_read()))
    })?;
    if !kind.is_read() {
        return Err(image(format!("{}, which is not read: {}", kind.name(), kind.advice())));
    }
    let metadata = Metadata::of(bytes);
    let stated = options.exposure.or_else(|| metadata.exposure.map(|v| v as f32));
    let exposure = stated.unwrap_or(1.0);
    let mut remarks = Vec::new();
    let photo = match kind {
        Kind::Dng => negative(path, bytes, options, exposure)?,
        #[cfg(feature = "heic")]
        Kind::Heic => heic(path, bytes, options, exposure, &mut remarks)?
            .with_focal_35mm(metadata.focal_35mm.map(|mm| mm as f32)),
        _ => picture(path, bytes, kind, &metadata, options, exposure, &mut remarks)?,
    };
    if kind == Kind::Jpeg && jpeg::has_gain_map(bytes) {
        remarks.push(Remark::GainMap);
    }
    if metadata.mirrored {
        remarks.push(Remark::Mirrored);
    }
    Ok(Decoded { photo: photo.turned(options.turn), metadata, remarks })
}

/// A raw photograph; its values have no curve.
fn negative(path: &Path, bytes: &[u8], options: &Options, exposure: f32) -> Result<Photo> {
    if let Some(encoding) = options.encoding.filter(|e| *e != Encoding::Linear) {
        return Err(Error::Field {
            path: path.to_owned(),
            field: "encoding".into(),
            message: format!("`{}` stated for a DNG file", encoding.name()),
            expected: "`linear`: raw values are linear".into(),
        });
    }
    if let Some(size) = dng::size(bytes) {
        options.limits.check_picture(path, size, dng::BYTES_PER_PIXEL)?;
    }
    dng::develop(bytes, exposure).map_err(|message| Error::Image {
        path: path.to_owned(),
        message: format!("DNG: {message}"),
    })
}

fn picture(
    path: &Path,
    bytes: &[u8],
    kind: Kind,
    metadata: &Metadata,
    options: &Options,
    exposure: f32,
    remarks: &mut Vec<Remark>,
) -> Result<Photo> {
    let mut picture = decode_picture(path, bytes, &options.limits)?;
    if picture.end_missing {
        remarks.push(Remark::EndMissing);
    }
    if is_gray(&picture) {
        remarks.push(Remark::Gray);
    }
    let photo = |picture, encoding| Photo::from_picture(path, picture, encoding, exposure);
    if let Some(encoding) = options.encoding {
        return photo(picture, encoding);
    }
    let Some(clipped) = clipped(&picture) else {
        return photo(picture, Encoding::Linear);
    };
    let colours = match (kind, picture.profile.take()) {
        (Kind::Png, _) => png_colours::read(bytes),
        (_, Some(profile)) => Colours::of_icc(&profile),
        (Kind::Jpeg, None) if jpeg::has_parts_of_profile(bytes) => Colours::Unusable(
            "its ICC profile cannot be used (its parts do not make a whole)".into(),
        ),
        _ if metadata.adobe_rgb => Colours::adobe_rgb(),
        _ => Colours::Srgb,
    };
    coloured(colours, clipped, exposure, remarks, |encoding| photo(picture, encoding))
}

/// A HEIC picture. Its own transformations make it upright, not the Exif orientation.
#[cfg(feature = "heic")]
fn heic(
    path: &Path,
    bytes: &[u8],
    options: &Options,
    exposure: f32,
    remarks: &mut Vec<Remark>,
) -> Result<Photo> {
    let decoded = heic::Heic::decode(path, bytes, &options.limits)?;
    if heic::has_gain_map(bytes) {
        remarks.push(Remark::GainMap);
    }
    let clipped = if decoded.is_deep() { CLIPPED_16 } else { CLIPPED_8 };
    match options.encoding {
        None => coloured(decoded.colours(), clipped, exposure, remarks, |encoding| {
            decoded.photo(path, encoding, exposure)
        }),
        Some(encoding) => decoded.photo(path, encoding, exposure),
    }
}

/// The photograph with the colours stated by its file.
fn coloured(
    colours: Colours,
    clipped: f32,
    exposure: f32,
    remarks: &mut Vec<Remark>,
    photo: impl FnOnce(Encoding) -> Result<Photo>,
) -> Result<Photo> {
    match colours {
        Colours::Srgb => photo(Encoding::Srgb),
        Colours::Named(encoding, primaries) => Ok(photo(encoding)?.with_primaries(primaries)),
        Colours::Unusable(what) => {
            remarks.push(Remark::ProfileUnusable(what));
            photo(Encoding::Srgb)
        }
        Colours::Profile(profile) => {
            let stored = photo(Encoding::Linear)?;
            let mut rgb = stored.to_linear();
            profile.apply(&mut rgb, clipped);
            let (width, height, focal) = (stored.width(), stored.height(), stored.focal_35mm());
            drop(stored);
            let photo = Photo::from_linear(width, height, rgb, exposure, SATURATED)?;
            Ok(photo.with_focal_35mm(focal))
        }
    }
}

/// Whether a picture has no colours: one channel, or three equal ones, as black-and-white filters of phones write.
fn is_gray(picture: &Picture) -> bool {
    use image::DynamicImage::{ImageRgb8, ImageRgb16, ImageRgba8, ImageRgba16};
    fn equal<const N: usize, T: PartialEq>(values: &[T]) -> bool {
        values.as_chunks::<N>().0.iter().all(|pixel| pixel[0] == pixel[1] && pixel[1] == pixel[2])
    }
    match &picture.image {
        ImageRgb8(image) => equal::<3, _>(image.as_raw()),
        ImageRgba8(image) => equal::<4, _>(image.as_raw()),
        ImageRgb16(image) => equal::<3, _>(image.as_raw()),
        ImageRgba16(image) => equal::<4, _>(image.as_raw()),
        image => !image.color().has_color(),
    }
}

/// Smallest stored value that counts as clipped; `None` for floats.
fn clipped(picture: &Picture) -> Option<f32> {
    match picture.image.color() {
        image::ColorType::L8
        | image::ColorType::La8
        | image::ColorType::Rgb8
        | image::ColorType::Rgba8 => Some(CLIPPED_8),
        image::ColorType::L16
        | image::ColorType::La16
        | image::ColorType::Rgb16
        | image::ColorType::Rgba16 => Some(CLIPPED_16),
        _ => None,
    }
}
