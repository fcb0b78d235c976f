//! Pictures of any format. `image::open` and `save` would compile every decoder and encoder into each program
//! of the tests.
#![allow(dead_code)] // each test file uses its part

use std::path::Path;

use image::DynamicImage;
use image::codecs::png::PngEncoder;

/// Reads a PNG, JPEG, TIFF or OpenEXR file.
///
/// # Panics
/// When it is not there, or none of these.
pub fn picture(path: impl AsRef<Path>) -> DynamicImage {
    let path = path.as_ref();
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    image::load_from_memory(&bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Writes a PNG file.
///
/// # Panics
/// When it cannot be written.
pub fn save_png(path: impl AsRef<Path>, picture: impl Into<DynamicImage>) {
    let mut bytes = Vec::new();
    picture.into().write_with_encoder(PngEncoder::new(&mut bytes)).unwrap();
    std::fs::write(path, bytes).unwrap();
}
