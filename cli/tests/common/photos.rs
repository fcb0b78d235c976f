//! Photographs as phones write them: metadata, profiles, colours.
#![allow(dead_code)] // each test file uses its part

use std::io::Cursor;
use std::path::Path;

use exif::experimental::Writer;
use exif::{Field, In, Rational, Tag, Value};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use svbrdf::frame::Encoding;

/// What is written into a file beside the pixels.
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

/// CIE L*a*b* (D65) of linear Rec. 709.
pub fn lab(rgb: [f64; 3]) -> [f64; 3] {
    const ROWS: [[f64; 3]; 3] = [
        [0.412_456, 0.357_576, 0.180_438],
        [0.212_673, 0.715_152, 0.072_175],
        [0.019_334, 0.119_192, 0.950_304],
    ];
    let root = |t: f64| {
        if t > 216.0 / 24_389.0 { t.cbrt() } else { (24_389.0 / 27.0 * t + 16.0) / 116.0 }
    };
    let [x, y, z] = ROWS.map(|row| {
        let white: f64 = row.iter().sum();
        root(row.iter().zip(rgb).map(|(a, b)| a * b).sum::<f64>() / white)
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// CIEDE2000 with all weights 1.
pub fn delta_e(first: [f64; 3], second: [f64; 3]) -> f64 {
    let ([l1, a1, b1], [l2, a2, b2]) = (first, second);
    let seventh = |c: f64| (c.powi(7) / (c.powi(7) + 25f64.powi(7))).sqrt();
    let mean_chroma = 0.5 * (a1.hypot(b1) + a2.hypot(b2));
    let stretch = 1.0 + 0.5 * (1.0 - seventh(mean_chroma));
    let (a1, a2) = (stretch * a1, stretch * a2);
    let (c1, c2) = (a1.hypot(b1), a2.hypot(b2));
    let hue = |a: f64, b: f64| b.atan2(a).to_degrees().rem_euclid(360.0);
    let (h1, h2) = (hue(a1, b1), hue(a2, b2));
    let gray = c1 * c2 == 0.0;
    let turn = match h2 - h1 {
        _ if gray => 0.0,
        d if d > 180.0 => d - 360.0,
        d if d < -180.0 => d + 360.0,
        d => d,
    };
    let (dl, dc) = (l2 - l1, c2 - c1);
    let dh = 2.0 * (c1 * c2).sqrt() * (0.5 * turn).to_radians().sin();
    let (l, c) = (0.5 * (l1 + l2), 0.5 * (c1 + c2));
    let h = match h1 + h2 {
        sum if gray => sum,
        sum if (h1 - h2).abs() <= 180.0 => 0.5 * sum,
        sum if sum < 360.0 => 0.5 * (sum + 360.0),
        sum => 0.5 * (sum - 360.0),
    };
    let cos = |degrees: f64| degrees.to_radians().cos();
    let t = 1.0 - 0.17 * cos(h - 30.0) + 0.24 * cos(2.0 * h) + 0.32 * cos(3.0 * h + 6.0)
        - 0.20 * cos(4.0 * h - 63.0);
    let off = (l - 50.0).powi(2);
    let sl = 1.0 + 0.015 * off / (20.0 + off).sqrt();
    let (sc, sh) = (1.0 + 0.045 * c, 1.0 + 0.015 * c * t);
    let rotation = 60.0 * (-((h - 275.0) / 25.0).powi(2)).exp();
    let rt = -2.0 * seventh(c) * rotation.to_radians().sin();
    let (l, c, h) = (dl / sl, dc / sc, dh / sh);
    (l * l + c * c + h * h + rt * c * h).sqrt()
}
