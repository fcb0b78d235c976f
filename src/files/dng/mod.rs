//! Digital negatives (Adobe DNG): raw photographs of Bayer sensors and demosaicked ones
//! (`LinearRaw`), developed to linear Rec. 709.
//!
//! This module reads the container itself. The crate `tiff` (0.11) rejects files whose first directory is not
//! a picture of a known kind, and the raw files of Android's cameras begin with a Bayer picture.

mod colour;
#[cfg(feature = "jxl")]
mod jpeg_xl;
mod linear;
mod lossless_jpeg;
mod raw;
mod shading;
mod tiff;

use crate::photo::{Bayer, Photo, Plane, Rotation};

use self::raw::{Area, Raw};
use self::tiff::{Directory, Tiff};

/// Memory per pixel during development: sensor values (twice for reordering), their bytes, floats
/// with a flag, gains, and the result twice.
pub const BYTES_PER_PIXEL: u64 = 2 * 6 + 2 + 5 + 4 + 2 * 12;
const PHOTOMETRIC: u16 = 262;
const ORIENTATION: u16 = 274;
const SUB_DIRECTORIES: u16 = 330;
const EXIF_DIRECTORY: u16 = 34665;
const FOCAL_35MM: u16 = 0xA405;
const DNG_VERSION: u16 = 50706;
const CROP_ORIGIN: u16 = 50719;
const CROP_SIZE: u16 = 50720;
const ACTIVE_AREA: u16 = 50829;
/// Values of `PhotometricInterpretation`.
const COLOUR_FILTERS: u32 = 32803;
const LINEAR_RAW: u32 = 34892;
/// Plausible focal lengths, mm in 35 mm terms.
const FOCAL_LENGTHS: std::ops::RangeInclusive<f64> = 5.0..=2000.0;

/// Contents of a file in TIFF format.
pub enum Content {
    /// A digital negative.
    Negative,
    /// Raw values without DNG tags: a camera maker's format.
    OtherRaw,
    /// Pictures.
    Picture,
}

/// Inspects a file in TIFF format.
pub fn content(bytes: &[u8]) -> Content {
    let look = || -> Result<Content, String> {
        let tiff = Tiff::parse(bytes)?;
        let first = tiff.first()?;
        if first.bytes(DNG_VERSION)?.is_some() {
            return Ok(Content::Negative);
        }
        let below = tiff.below(&first, SUB_DIRECTORIES)?;
        let is_raw = |d: &Directory| d.whole(PHOTOMETRIC) == Ok(Some(COLOUR_FILTERS));
        Ok(if std::iter::once(&first).chain(&below).any(is_raw) {
            Content::OtherRaw
        } else {
            Content::Picture
        })
    };
    look().unwrap_or(Content::Picture)
}

/// Width and height before the rotation to upright; `None` if unreadable.
pub fn size(bytes: &[u8]) -> Option<[u32; 2]> {
    let file = File::parse(bytes).ok()?;
    let area = file.active().and_then(|active| file.crop(active)).ok()?;
    Some([area.width, area.height])
}

/// Develops the bytes of a file to an upright photograph; the error states the fault.
pub fn develop(bytes: &[u8], exposure: f32) -> Result<Photo, String> {
    let file = File::parse(bytes)?;
    let (active, rotation) = (file.active()?, file.rotation()?);
    let crop = file.crop(active)?;
    let size = [active.width as usize, active.height as usize];
    let photo = if file.is_linear {
        let raw = raw::read(&file.tiff, &file.raw, 3)?;
        let gains = shading::gains(&file.raw, size, 3)?;
        linear::developed(&file.camera, &file.raw, &raw, active, gains.as_deref(), exposure)?
    } else {
        let raw = raw::read(&file.tiff, &file.raw, 1)?;
        let bayer = colour::read(&file.camera, &file.raw, raw.bits)?;
        let gains = shading::gains(&file.raw, size, 1)?;
        demosaicked(&raw, active, &bayer, gains.as_deref(), exposure)?
    };
    let photo = photo.cropped(crop.x, crop.y, crop.width, crop.height).turned(rotation);
    Ok(photo.with_focal_35mm(file.focal_35mm()))
}

fn demosaicked(
    raw: &Raw,
    active: Area,
    bayer: &Bayer,
    gains: Option<&[f32]>,
    exposure: f32,
) -> Result<Photo, String> {
    let width = raw.size[0] as usize;
    // Patterns start at the active area.
    let first = active.y as usize * width + active.x as usize;
    let data: Vec<u8> = raw.samples[first..].iter().flat_map(|v| v.to_ne_bytes()).collect();
    let plane = Plane { data: &data, row_stride: 2 * width, pixel_stride: 2 };
    let size = [active.width, active.height];
    let none = Rotation::None;
    match gains {
        None => Photo::from_bayer16(size, plane, bayer, none, exposure),
        Some(gains) => Photo::from_bayer16_shaded(size, plane, bayer, gains, none, exposure),
    }
    .map_err(|fault| fault.to_string())
}

/// Pixels of a picture; 0 if unknown.
fn area(directory: &Directory) -> u64 {
    raw::size(directory).map_or(0, |[w, h]| u64::from(w) * u64::from(h))
}

/// The relevant directories of a file.
struct File<'a> {
    tiff: Tiff<'a>,
    /// Tags of the camera.
    camera: Directory<'a>,
    /// Tags of the raw picture.
    raw: Directory<'a>,
    /// Whether the raw picture is demosaicked.
    is_linear: bool,
}

impl<'a> File<'a> {
    fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        let tiff = Tiff::parse(bytes)?;
        let camera = tiff.first()?;
        if camera.bytes(DNG_VERSION)?.is_none() {
            return Err("not a DNG file: a TIFF file without DNGVersion".into());
        }
        let mut linear = None;
        // Skip previews beside the raw picture.
        for raw in std::iter::once(tiff.first()?).chain(tiff.below(&camera, SUB_DIRECTORIES)?) {
            match raw.whole(PHOTOMETRIC)? {
                Some(COLOUR_FILTERS) => return Ok(Self { tiff, camera, raw, is_linear: false }),
                Some(LINEAR_RAW) => {
                    let is_larger = |known: &Directory| area(&raw) > area(known);
                    if linear.as_ref().is_none_or(is_larger) {
                        linear = Some(raw);
                    }
                }
                _ => (),
            }
        }
        let raw = linear.ok_or("no raw picture inside")?;
        Ok(Self { tiff, camera, raw, is_linear: true })
    }

    /// The light-sensitive part of the sensor.
    fn active(&self) -> Result<Area, String> {
        let [width, height] = raw::size(&self.raw)?;
        let Some(stated) = self.raw.exactly::<4>(ACTIVE_AREA)? else {
            return Ok(Area { x: 0, y: 0, width, height });
        };
        let [top, left, bottom, right] = stated.map(|v| v as u32);
        if top >= bottom || left >= right || bottom > height || right > width {
            return Err(format!("active area {stated:?} of {width} x {height} px"));
        }
        Ok(Area { x: left, y: top, width: right - left, height: bottom - top })
    }

    /// The part of the active area that forms the photograph.
    fn crop(&self, active: Area) -> Result<Area, String> {
        let Area { width, height, .. } = active;
        let origin = self.raw.exactly::<2>(CROP_ORIGIN)?.unwrap_or([0.0; 2]);
        let Some(size) = self.raw.exactly::<2>(CROP_SIZE)? else {
            return Ok(Area { x: 0, y: 0, width, height });
        };
        let ([x, y], [w, h]) = (origin.map(|v| v.round() as u32), size.map(|v| v.round() as u32));
        let fits = |start: u32, count: u32, whole| {
            count > 0 && start.checked_add(count).is_some_and(|end| end <= whole)
        };
        if !fits(x, w, width) || !fits(y, h, height) {
            return Err(format!("crop of {w} x {h} px at {x}, {y} of {width} x {height}"));
        }
        Ok(Area { x, y, width: w, height: h })
    }

    fn rotation(&self) -> Result<Rotation, String> {
        match self.camera.whole(ORIENTATION)?.unwrap_or(1) {
            1 => Ok(Rotation::None),
            3 => Ok(Rotation::Half),
            6 => Ok(Rotation::Quarter),
            8 => Ok(Rotation::ThreeQuarters),
            // Mirrored raw files do not occur.
            other => Err(format!("orientation {other} is not read; 1, 3, 6 and 8 are")),
        }
    }

    /// Focal length in 35 mm terms; `None` if damaged.
    fn focal_35mm(&self) -> Option<f32> {
        let exif = self.tiff.below(&self.camera, EXIF_DIRECTORY).ok()?;
        let stated = exif.iter().chain([&self.camera]).find_map(|d| d.whole(FOCAL_35MM).ok()?);
        let focal = f64::from(stated?);
        FOCAL_LENGTHS.contains(&focal).then_some(focal as f32)
    }
}
