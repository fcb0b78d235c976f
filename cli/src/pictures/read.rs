//! Photographs of a capture with the colours that their profiles mean.

use std::fmt;
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
/// What a JPEG file with a gain map has in its headers: the namespaces of Ultra HDR and of Apple, the
/// name of ISO 21496-1.
const GAIN_MAPS: [&[u8]; 3] = [
    b"http://ns.adobe.com/hdr-gain-map/1.0/",
    b"http://ns.apple.com/HDRGainMap/1.0/",
    b"urn:iso:std:iso:ts:21496:-1",
];

/// What is to be said about a photograph's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Remark {
    /// Its ICC profile cannot be used, and why.
    ProfileUnusable(String),
    /// It has a gain map (Ultra HDR), which is left out.
    GainMap,
}

impl Remark {
    /// Its name in `report.json`.
    pub fn code(&self) -> &'static str {
        match self {
            Self::ProfileUnusable(_) => "profile_unusable",
            Self::GainMap => "gain_map",
        }
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ProfileUnusable(why) => {
                write!(f, "its ICC profile cannot be used ({why}); taken as sRGB")
            }
            Self::GainMap => f.write_str(
                "it has a gain map (Ultra HDR); its base picture is used, which the camera has tone-mapped",
            ),
        }
    }
}

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
/// file.
pub fn read(frame: &Frame) -> svbrdf::Result<(Photo, Vec<Remark>)> {
    let photo = Frame { ambient: None, ..frame.clone() };
    let (photo, remark) = with_profile(&photo)?;
    let gain_map = has_gain_map(&frame.path).then_some(Remark::GainMap);
    let remarks = remark.into_iter().chain(gain_map).collect();
    let Some((path, exposure)) = &frame.ambient else { return Ok((photo, remarks)) };
    let ambient = Frame { path: path.clone(), exposure: *exposure, ambient: None, ..frame.clone() };
    let (ambient, _) = with_profile(&ambient)?;
    let less = photo.without_ambient(&ambient);
    let less = less.map_err(|e| Error::Image { path: path.clone(), message: e.to_string() })?;
    Ok((less, remarks))
}

fn with_profile(frame: &Frame) -> svbrdf::Result<(Photo, Option<Remark>)> {
    if dng::is_named(&frame.path) {
        return Ok((developed(frame)?, None));
    }
    if frame.encoding != Encoding::Srgb {
        return Ok((frame.read()?, None));
    }
    match colours(&frame.path) {
        Colours::Srgb => Ok((frame.read()?, None)),
        Colours::Unreadable(why) => Ok((frame.read()?, Some(Remark::ProfileUnusable(why)))),
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
    holds(&headers(path), PART)
}

/// Whether a JPEG file has a gain map.
fn has_gain_map(path: &Path) -> bool {
    let headers = headers(path);
    GAIN_MAPS.iter().any(|name| holds(&headers, name))
}

fn holds(bytes: &[u8], name: &[u8]) -> bool {
    bytes.windows(name.len()).any(|part| part == name)
}

/// The headers of a JPEG file and some of what follows; nothing of other files.
fn headers(path: &Path) -> Vec<u8> {
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEADERS).read_to_end(&mut start));
    if read.is_err() || !start.starts_with(&[0xFF, 0xD8]) {
        start.clear();
    }
    start
}
