//! Metadata of a photograph's file.

use std::io::Cursor;
use std::path::Path;

use exif::{Context, Exif, Field, In, Reader, Tag, Value};

use super::dng;
use super::kind::Kind;
use crate::photo::{Limits, look_at};

/// Plausible exposure times, seconds.
const SECONDS: std::ops::RangeInclusive<f64> = 1e-6..=1e4;
/// Plausible sensitivities.
const ISO: std::ops::RangeInclusive<f64> = 1.0..=1e7;
/// Plausible apertures.
const F_NUMBER: std::ops::RangeInclusive<f64> = 0.5..=128.0;
/// Plausible digital zooms.
const ZOOM: std::ops::RangeInclusive<f64> = 1.0..=100.0;
/// Marks a sensitivity beyond 16 bits, which is stored elsewhere.
const ISO_ELSEWHERE: f64 = 65_535.0;

/// Metadata of a photograph; every field may be missing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metadata {
    /// Maker of the camera.
    pub make: Option<String>,
    /// Model of the camera.
    pub model: Option<String>,
    /// Model of the lens.
    pub lens: Option<String>,
    /// Focal length of the lens, mm.
    pub focal_mm: Option<f64>,
    /// Focal length with the same field of view on 36 x 24 mm film, mm.
    pub focal_35mm: Option<f64>,
    /// Magnification by digital zoom; 1: none.
    pub digital_zoom: Option<f64>,
    /// Width and height as stored, px.
    pub size: Option<[u32; 2]>,
    /// Whether the pixels are linear, as floats and raw values are.
    pub is_linear: bool,
    /// Clockwise rotation to upright, degrees; of a mirrored picture, after mirroring it left to right.
    pub upright_deg: Option<u32>,
    /// Whether the stored picture is mirrored.
    pub mirrored: bool,
    /// Relative exposure: seconds * ISO / F-number².
    pub exposure: Option<f64>,
    /// Whether the flash fired.
    pub flash_fired: Option<bool>,
    /// Local time of capture by the camera's clock, in digits that sort by time.
    pub taken: Option<String>,
    /// Offset of that clock from universal time, minutes.
    pub utc_offset_min: Option<i32>,
    /// Whether the file states Adobe RGB (1998).
    pub adobe_rgb: bool,
}

impl Metadata {
    /// Reads a file's metadata; all fields are empty for unreadable files.
    pub fn read(path: impl AsRef<Path>) -> Self {
        Limits::default().read(path.as_ref()).map_or_else(|_| Self::default(), |b| Self::of(&b))
    }

    /// Metadata of a file's content, without damaged fields.
    pub fn of(bytes: &[u8]) -> Self {
        let known = Self::of_exif(bytes);
        let (size, is_linear) = pixels(bytes).unzip();
        Self { size, is_linear: is_linear.unwrap_or(false), ..known }
    }

    pub(super) fn of_exif(bytes: &[u8]) -> Self {
        let mut reader = Reader::new();
        reader.continue_on_error(true);
        let read = match block(bytes) {
            Some(block) => reader.read_raw(block),
            None => reader.read_from_container(&mut Cursor::new(bytes)),
        };
        let exif = read.or_else(|fault| fault.distill_partial_result(|_| ())).ok();
        exif.map_or_else(Self::default, |exif| Self::within(&exif))
    }

    fn within(exif: &Exif) -> Self {
        let positive = |tag| number(exif, tag).filter(|v| *v > 0.0);
        let orientation = number(exif, Tag::Orientation).map_or(0, |v| v as u32);
        Self {
            make: text(exif, Tag::Make),
            model: text(exif, Tag::Model),
            lens: text(exif, Tag::LensModel),
            focal_mm: positive(Tag::FocalLength),
            focal_35mm: positive(Tag::FocalLengthIn35mmFilm),
            // 0 means unused.
            digital_zoom: number(exif, Tag::DigitalZoomRatio)
                .map(|zoom| if zoom == 0.0 { 1.0 } else { zoom })
                .filter(|zoom| ZOOM.contains(zoom)),
            size: None,
            is_linear: false,
            upright_deg: match orientation {
                1 | 2 => Some(0),
                6 | 7 => Some(90),
                3 | 4 => Some(180),
                8 | 5 => Some(270),
                _ => None,
            },
            mirrored: [2, 4, 5, 7].contains(&orientation),
            exposure: exposure(exif),
            flash_fired: number(exif, Tag::Flash).map(|bits| bits as u32 & 1 == 1),
            taken: taken(exif),
            utc_offset_min: utc_offset_min(exif),
            adobe_rgb: text(exif, Tag::InteroperabilityIndex).is_some_and(|index| index == "R03"),
        }
    }
}

/// Width and height, and whether the values are linear (floats or raw).
fn pixels(bytes: &[u8]) -> Option<([u32; 2], bool)> {
    match Kind::of(bytes)? {
        Kind::Dng => Some((dng::size(bytes)?, true)),
        #[cfg(feature = "heic")]
        Kind::Heic => Some((super::heic::size(bytes)?, false)),
        _ => look_at(bytes),
    }
}

/// The Exif block of file types that the Exif reader supports incompletely.
fn block(bytes: &[u8]) -> Option<Vec<u8>> {
    match Kind::of(bytes)? {
        #[cfg(feature = "heic")]
        Kind::Heic => super::heic::exif(bytes),
        _ => None,
    }
}

/// A field of the Exif directory or of the first one; Android's raw files have all fields there.
fn field(exif: &Exif, tag: Tag) -> Option<&Field> {
    let field = |tag| exif.get_field(tag, In::PRIMARY);
    field(tag).or_else(|| field(Tag(Context::Tiff, tag.number())))
}

fn text(exif: &Exif, tag: Tag) -> Option<String> {
    let Value::Ascii(parts) = &field(exif, tag)?.value else { return None };
    let text = String::from_utf8_lossy(parts.first()?).trim_matches(['\0', ' ']).to_owned();
    (!text.is_empty()).then_some(text)
}

fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let value = &field(exif, tag)?.value;
    let number = match value {
        Value::Rational(v) => v.first()?.to_f64(),
        Value::SRational(v) => v.first()?.to_f64(),
        // Non-standard, but some programs write them.
        Value::Float(v) => f64::from(*v.first()?),
        Value::Double(v) => *v.first()?,
        other => f64::from(other.get_uint(0)?),
    };
    number.is_finite().then_some(number)
}

/// Relative exposure. Needs time and sensitivity; phones with a fixed aperture may omit it.
fn exposure(exif: &Exif) -> Option<f64> {
    let within = |tag, range: &std::ops::RangeInclusive<f64>| {
        number(exif, tag).filter(|v| range.contains(v))
    };
    let seconds = within(Tag::ExposureTime, &SECONDS).or_else(|| {
        let seconds = (-number(exif, Tag::ShutterSpeedValue)?).exp2();
        SECONDS.contains(&seconds).then_some(seconds)
    })?;
    let iso = within(Tag::PhotographicSensitivity, &ISO)
        .filter(|v| *v < ISO_ELSEWHERE)
        .or_else(|| within(Tag::ISOSpeed, &ISO))
        .or_else(|| within(Tag::RecommendedExposureIndex, &ISO))?;
    let f_number = within(Tag::FNumber, &F_NUMBER).or_else(|| {
        let f_number = (0.5 * number(exif, Tag::ApertureValue)?).exp2();
        F_NUMBER.contains(&f_number).then_some(f_number)
    });
    Some(seconds * iso / f_number.unwrap_or(1.0).powi(2))
}

/// `2024:05:06 07:08:09` with a fraction of a second.
fn taken(exif: &Exif) -> Option<String> {
    let time = text(exif, Tag::DateTimeOriginal)
        .filter(|t| t.starts_with(|c: char| c.is_ascii_digit()))?;
    let fraction = text(exif, Tag::SubSecTimeOriginal).unwrap_or_default();
    Some(format!("{time}.{fraction}"))
}

/// `+02:00`
fn utc_offset_min(exif: &Exif) -> Option<i32> {
    let stated = text(exif, Tag::OffsetTimeOriginal).or_else(|| text(exif, Tag::OffsetTime))?;
    let (sign, rest) = match stated.as_bytes().first()? {
        b'+' => (1, &stated[1..]),
        b'-' => (-1, &stated[1..]),
        _ => return None,
    };
    let (hours, minutes) = rest.split_once(':')?;
    let minutes =
        60 * i32::from(hours.parse::<u8>().ok()?) + i32::from(minutes.parse::<u8>().ok()?);
    Some(sign * minutes)
}
