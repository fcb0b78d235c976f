//! Photographs as phones write them: metadata, profiles, colours.
#![allow(dead_code)] // each test file uses its part

use std::io::Cursor;
use std::path::Path;

use exif::experimental::Writer;
use exif::{Field, In, Rational, Tag, Value};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use svbrdf::photo::Encoding;

/// Metadata of a file.
#[derive(Default)]
pub struct Written<'a> {
    pub model: Option<&'a str>,
    /// Seconds as a fraction, ISO, tenths of the F-number.
    pub exposure: Option<([u32; 2], u16, u32)>,
    pub time: Option<&'a str>,
    pub subsec: Option<&'a str>,
    pub orientation: Option<u16>,
    pub flash: Option<u16>,
    /// Digital zoom as a fraction, and the focal length on film that follows, mm.
    pub zoom: Option<([u32; 2], u16)>,
    pub profile: Option<Vec<u8>>,
}

impl Written<'_> {
    /// The Exif block, if it says anything.
    pub fn exif(&self) -> Option<Vec<u8>> {
        let text = |text: &str| Value::Ascii(vec![text.as_bytes().to_vec()]);
        let ratio = |num, denom| Value::Rational(vec![Rational { num, denom }]);
        let mut values = Vec::new();
        values.extend(self.model.map(|v| (Tag::Model, text(v))));
        values.extend(self.model.map(|_| (Tag::Make, text("Maker"))));
        values.extend(self.time.map(|v| (Tag::DateTimeOriginal, text(v))));
        values.extend(self.subsec.map(|v| (Tag::SubSecTimeOriginal, text(v))));
        values.extend(self.orientation.map(|v| (Tag::Orientation, Value::Short(vec![v]))));
        values.extend(self.flash.map(|v| (Tag::Flash, Value::Short(vec![v]))));
        if let Some(([num, denom], iso, tenths)) = self.exposure {
            values.push((Tag::ExposureTime, ratio(num, denom)));
            values.push((Tag::PhotographicSensitivity, Value::Short(vec![iso])));
            values.push((Tag::FNumber, ratio(tenths, 10)));
        }
        if let Some(([num, denom], focal)) = self.zoom {
            values.push((Tag::DigitalZoomRatio, ratio(num, denom)));
            values.push((Tag::FocalLengthIn35mmFilm, Value::Short(vec![focal])));
        }
        if values.is_empty() {
            return None;
        }
        let fields: Vec<Field> = values
            .into_iter()
            .map(|(tag, value)| Field { tag, ifd_num: In::PRIMARY, value })
            .collect();
        let mut writer = Writer::new();
        fields.iter().for_each(|field| writer.push_field(field));
        let mut block = Cursor::new(Vec::new());
        writer.write(&mut block, false).unwrap();
        Some(block.into_inner())
    }

    /// A JPEG or PNG file, as the name says.
    pub fn save(&self, path: &Path, picture: &RgbImage) {
        let mut bytes = Vec::new();
        if path.extension().unwrap() == "png" {
            self.encode(PngEncoder::new(&mut bytes), picture);
        } else {
            self.encode(JpegEncoder::new_with_quality(&mut bytes, 98), picture);
        }
        std::fs::write(path, bytes).unwrap();
    }

    fn encode(&self, mut encoder: impl ImageEncoder, picture: &RgbImage) {
        if let Some(block) = self.exif() {
            encoder.set_exif_metadata(block).unwrap();
        }
        if let Some(profile) = &self.profile {
            encoder.set_icc_profile(profile.clone()).unwrap();
        }
        let (w, h) = picture.dimensions();
        encoder.write_image(picture, w, h, ExtendedColorType::Rgb8).unwrap();
    }
}

/// The picture with every linear colour changed.
pub fn changed(picture: &RgbImage, change: impl Fn([f64; 3]) -> [f64; 3]) -> RgbImage {
    let mut changed = picture.clone();
    for pixel in changed.pixels_mut() {
        let linear = pixel.0.map(|v| Encoding::Srgb.decode(f64::from(v) / 255.0));
        let stored = change(linear).map(|v| Encoding::Srgb.encode(v.clamp(0.0, 1.0)));
        pixel.0 = stored.map(|v| (255.0 * v).round() as u8);
    }
    changed
}

/// Linear Rec. 709 in the primaries of Display P3: from the chromaticities of both and D65.
pub fn to_display_p3(rgb: [f64; 3]) -> [f64; 3] {
    const ROWS: [[f64; 3]; 3] = [
        [0.822_462, 0.177_538, 0.0],
        [0.033_194, 0.966_806, 0.0],
        [0.017_083, 0.072_397, 0.910_520],
    ];
    ROWS.map(|row| row.iter().zip(rgb).map(|(a, b)| a * b).sum())
}
