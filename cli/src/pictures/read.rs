//! Photographs of a capture with the colours that their profiles mean.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use image::{ColorType, ImageDecoder, ImageReader};
use svbrdf::Error;
use svbrdf::capture::Frame;
use svbrdf::frame::{Encoding, Photo};

use super::profile::Profile;
use crate::dng;

/// Smallest stored value that counts as clipped, 8 bits: lossy compression moves 255 by one.
const CLIPPED_8: f32 = 254.0 / 255.0;
/// The same with 16 bits.
const CLIPPED_16: f32 = 65_472.0 / 65_535.0;

/// Linear value that counts as clipped, that of 254 in sRGB: pictures that were clipped before they
/// got their profile have no clipped value left.
const SATURATED: f32 = 0.991;
/// Where the headers of a JPEG file end at the latest in practice, bytes.
const HEADERS: u64 = 256 << 10;
/// Name of a segment that holds a part of a profile.
const PART: &[u8] = b"ICC_PROFILE\0";

/// What a file says of its colours.
enum Colours {
    /// Nothing, or sRGB.
    Srgb,
    /// Another profile, and the smallest stored value that counts as clipped.
    Profile(Box<Profile>, f32),
    /// A profile that cannot be used, and why.
    Unreadable(String),
}

/// Reads a photograph. Where the capture calls it `srgb`, an ICC profile inside says what its values
/// are; the other encodings are taken at their word. Also returns what is to be said about the
/// profile, if it cannot be used.
pub fn read(frame: &Frame) -> svbrdf::Result<(Photo, Option<String>)> {
    let photo = Frame { ambient: None, ..frame.clone() };
    let (photo, remark) = with_profile(&photo)?;
    let Some((path, exposure)) = &frame.ambient else { return Ok((photo, remark)) };
    let ambient = Frame { path: path.clone(), exposure: *exposure, ambient: None, ..frame.clone() };
    let (ambient, _) = with_profile(&ambient)?;
    let less = photo.without_ambient(&ambient);
    let less = less.map_err(|e| Error::Image { path: path.clone(), message: e.to_string() })?;
    Ok((less, remark))
}

fn with_profile(frame: &Frame) -> svbrdf::Result<(Photo, Option<String>)> {
    if dng::is_named(&frame.path) {
        return Ok((developed(frame)?, None));
    }
    if frame.encoding != Encoding::Srgb {
        return Ok((frame.read()?, None));
    }
    match colours(&frame.path) {
        Colours::Srgb => Ok((frame.read()?, None)),
        Colours::Unreadable(why) => {
            let remark = format!("its ICC profile cannot be used ({why}); taken as sRGB");
            Ok((frame.read()?, Some(remark)))
        }
        Colours::Profile(profile, clipped) => {
            let stored = Frame { encoding: Encoding::Linear, ..frame.clone() }.read()?;
            let mut rgb = stored.to_linear();
            profile.apply(&mut rgb, clipped);
            let (width, height, focal) = (stored.width(), stored.height(), stored.focal_35mm());
            drop(stored);
            let photo = Photo::from_linear(width, height, rgb, frame.exposure, SATURATED)?;
            Ok((photo.with_focal_35mm(focal), None))
        }
    }
}

/// A raw photograph, whose values have no curve.
fn developed(frame: &Frame) -> svbrdf::Result<Photo> {
    if frame.encoding != Encoding::Linear {
        return Err(Error::Field {
            path: frame.path.clone(),
            field: "encoding".into(),
            message: format!("`{}` stated for a DNG file", frame.encoding.name()),
            expected: "`linear`: raw values are linear".into(),
        });
    }
    Ok(dng::read(&frame.path, frame.exposure)?.turned(frame.turn))
}

/// Looks for a profile; files that cannot be read are left to the reader of pictures.
fn colours(path: &Path) -> Colours {
    let Some((bytes, clipped)) = profile(path) else { return Colours::Srgb };
    match bytes.and_then(|bytes| Profile::parse(&bytes)) {
        Ok(profile) if profile.is_srgb() => Colours::Srgb,
        Ok(profile) => Colours::Profile(Box::new(profile), clipped),
        Err(why) => Colours::Unreadable(why),
    }
}

/// The profile's bytes, and the smallest value that counts as clipped.
fn profile(path: &Path) -> Option<(Result<Vec<u8>, String>, f32)> {
    let reader = ImageReader::open(path).ok()?.with_guessed_format().ok()?;
    let mut decoder = reader.into_decoder().ok()?;
    let clipped = match decoder.color_type() {
        ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => CLIPPED_8,
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => CLIPPED_16,
        _ => return None,
    };
    let bytes = match decoder.icc_profile() {
        Ok(None) if has_parts(path) => Err("its parts do not make a whole".into()),
        found => found.map_err(|e| e.to_string()).transpose()?,
    };
    Some((bytes, clipped))
}

/// Whether a JPEG file holds parts of a profile: the decoder keeps silent about missing ones.
fn has_parts(path: &Path) -> bool {
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEADERS).read_to_end(&mut start));
    let parts = start.windows(PART.len()).any(|bytes| bytes == PART);
    read.is_ok() && start.starts_with(&[0xFF, 0xD8]) && parts
}
