//! Writing files whole, and single pictures.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use image::codecs::png::PngEncoder;
use image::{DynamicImage, ImageBuffer};

use crate::{Error, Result};

/// Writes a file under a temporary name in the same folder, then renames it, so that nothing
/// half-written stands under `path`.
///
/// # Errors
/// [`Error::Io`] naming `path`; what stood there before is untouched.
pub fn write_atomic(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    let path = path.as_ref();
    let temporary = temporary_name(path);
    let written = fs::File::create(&temporary)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| fs::rename(&temporary, path));
    written.map_err(|fault| {
        // The first fault is the one to tell.
        let _ = fs::remove_file(&temporary);
        Error::io(path, fault)
    })
}

/// Creates a folder if it is missing and checks that files can be made in it.
///
/// # Errors
/// [`Error::Io`] naming the folder.
pub fn check_writable(dir: impl AsRef<Path>) -> Result<()> {
    let dir = dir.as_ref();
    let probe = temporary_name(&dir.join("probe"));
    fs::create_dir_all(dir)
        .and_then(|()| fs::File::create(&probe))
        .and_then(|_| fs::remove_file(&probe))
        .map_err(|e| Error::io(dir, e))
}

/// A hidden name beside `path` that nobody else uses.
fn temporary_name(path: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let (process, count) = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{process}-{count}.tmp"))
}

/// Encodes a picture as PNG and writes it.
pub(super) fn write_png(path: &Path, picture: &DynamicImage) -> Result<()> {
    let mut bytes = Vec::new();
    picture
        .write_with_encoder(PngEncoder::new(&mut bytes))
        .map_err(|e| Error::Image { path: path.to_owned(), message: e.to_string() })?;
    write_atomic(path, &bytes)
}

/// A 16-bit RGB picture whose pixel `i` has the channels `value(i)`, each clipped to [0, 1].
pub(super) fn rgb16(
    width: usize,
    height: usize,
    value: impl Fn(usize) -> [f32; 3],
) -> DynamicImage {
    let data = (0..width * height).flat_map(|i| value(i).map(quantise)).collect();
    let buffer = ImageBuffer::from_raw(width as u32, height as u32, data);
    DynamicImage::ImageRgb16(buffer.expect("three values a pixel"))
}

/// The nearest 16-bit value; what is not a number becomes 0.
pub(super) fn quantise(value: f32) -> u16 {
    (f64::from(value) * 65535.0).round() as u16
}

/// Checks that `rgb` holds three planes.
pub(super) fn check_planes(width: usize, height: usize, rgb: &[f32]) -> Result<()> {
    if width == 0 || height == 0 || rgb.len() != 3 * width * height {
        let found = rgb.len();
        let message = format!("{found} values given, three planes of {width} x {height} expected");
        return Err(Error::argument("rgb", message));
    }
    Ok(())
}

/// Writes three planes (R, G, B) of linear values as a 16-bit linear PNG, clipped to [0, 1].
///
/// # Errors
/// When the sizes do not fit or the file cannot be written.
pub fn write_png16_image(
    path: impl AsRef<Path>,
    width: usize,
    height: usize,
    rgb: &[f32],
) -> Result<()> {
    check_planes(width, height, rgb)?;
    let n = width * height;
    write_png(path.as_ref(), &rgb16(width, height, |i| [rgb[i], rgb[n + i], rgb[2 * n + i]]))
}
