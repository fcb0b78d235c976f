//! Pictures of any format. `image::open` would compile every decoder into each program of the tests.

use std::path::Path;

use image::DynamicImage;

/// Reads a PNG, JPEG, TIFF or OpenEXR file.
///
/// # Panics
/// When it is not there, or none of these.
pub fn picture(path: impl AsRef<Path>) -> DynamicImage {
    let path = path.as_ref();
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    image::load_from_memory(&bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}
