//! Anything as a photograph's file. The first byte chooses how it is read, and whether the rest is an
//! ICC profile, which is then put into a small JPEG file.

use std::io::Cursor;

use engine::files::{Decoded, Kind, Limits, Options, decode};
use engine::photo::{Encoding, Rotation};

/// Whether something was made of it.
pub fn run(data: &[u8]) -> bool {
    let Some((&choice, data)) = data.split_first() else { return false };
    let encodings = [None, Some(Encoding::Srgb), Some(Encoding::Linear), Some(Encoding::Pq)];
    let options = Options {
        encoding: encodings[usize::from(choice >> 1) % 4],
        exposure: if choice & 8 == 0 { None } else { Some(0.5) },
        turn: Rotation::from_degrees(u32::from(choice >> 4 & 3) * 90).expect("a quarter"),
        limits: Limits { file_bytes: 1 << 20, pixels: 1 << 20, memory_bytes: 64 << 20 },
    };
    let profiled = (choice & 1 == 1).then(|| with_profile(data));
    let file = profiled.as_deref().unwrap_or(data);
    let Ok(Decoded { photo, metadata, remarks }) = decode(file, &options) else { return false };
    assert!(Kind::of(file).is_some_and(Kind::is_read));
    assert!(photo.width() > 0 && photo.height() > 0);
    let values = photo.to_linear();
    assert_eq!(values.len(), 3 * (photo.width() * photo.height()) as usize);
    if photo.is_finite() {
        assert!(values.iter().all(|v| v.is_finite()));
    }
    assert!(metadata.exposure.is_none_or(|v| v.is_finite() && v > 0.0));
    assert!(metadata.focal_mm.is_none_or(|v| v.is_finite() && v > 0.0));
    assert!(metadata.digital_zoom.is_none_or(|v| v >= 1.0));
    assert!(remarks.iter().all(|remark| !remark.to_string().is_empty()));
    true
}

/// A JPEG file of a few pixels with a profile.
fn with_profile(profile: &[u8]) -> Vec<u8> {
    let pixels =
        image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([x as u8 * 36, y as u8 * 36, 90]));
    let mut bytes = Cursor::new(Vec::new());
    pixels.write_to(&mut bytes, image::ImageFormat::Jpeg).expect("eight pixels");
    let bytes = bytes.into_inner();
    let part = &profile[..profile.len().min(60_000)];
    let content = [b"ICC_PROFILE\0\x01\x01", part].concat();
    let length = (content.len() as u16 + 2).to_be_bytes();
    [&bytes[..2], &[0xFF, 0xE2], &length, &content, &bytes[2..]].concat()
}
