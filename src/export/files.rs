//! Atomic writing of files, and of single pictures.

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use image::codecs::png::PngEncoder;
use image::{DynamicImage, ImageBuffer};

use super::floats::encode_channels;
use super::temporary;
use crate::{Error, Result};

/// Writes a file under a temporary name in the same folder, then renames it: `path` never holds a
/// partial file.
///
/// # Errors
/// [`Error::Io`] with `path`; an existing file is unchanged.
pub fn write_atomic(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    let path = path.as_ref();
    let temporary = temporary::name(path);
    let written = fs::File::create(&temporary)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| fs::rename(&temporary, path));
    written.map_err(|fault| {
        // Report the first fault.
        let _ = fs::remove_file(&temporary);
        Error::io(path, fault)
    })
}

/// Writes several files below `dir`, all or none: first under temporary names, then renamed.
/// Creates missing folders. Names are relative, with `/` between folders.
///
/// The last file seals the set: it is removed before any other is replaced, and renamed last. A
/// killed process thus never leaves it beside files of another or of an incomplete set.
///
/// # Errors
/// [`Error::Io`] with the file that cannot be written; existing files are unchanged unless a rename fails.
pub fn write_files(dir: impl AsRef<Path>, files: &[(String, Vec<u8>)]) -> Result<()> {
    replace_files(dir, files, &[])
}

/// As [`write_files`], and removes files of an earlier set with the names `gone` unless `files` has
/// them. They go after the file that seals that set.
///
/// # Errors
/// As [`write_files`], or [`Error::Io`] with the file that cannot be removed.
pub fn replace_files(
    dir: impl AsRef<Path>,
    files: &[(String, Vec<u8>)],
    gone: &[&str],
) -> Result<()> {
    let dir = dir.as_ref();
    let mut made = Made::default();
    let gone = gone.iter().filter(|name| files.iter().all(|(written, _)| written != *name));
    let gone: Vec<PathBuf> = gone.map(|name| dir.join(name)).filter(|path| path.exists()).collect();
    let result = made.write(dir, files, &gone);
    if result.is_err() {
        made.undo();
    }
    result
}

/// Files and folders created by [`replace_files`] so far.
#[derive(Default)]
struct Made {
    /// Folders, outermost first.
    folders: Vec<PathBuf>,
    files: Vec<PathBuf>,
}

impl Made {
    fn write(&mut self, dir: &Path, files: &[(String, Vec<u8>)], gone: &[PathBuf]) -> Result<()> {
        let places = files.iter().filter_map(|(name, _)| Some(dir.join(name).parent()?.to_owned()));
        places.collect::<BTreeSet<_>>().iter().for_each(|place| temporary::sweep(place));
        self.folder(dir)?;
        let mut names = Vec::with_capacity(files.len());
        for (name, bytes) in files {
            let path = dir.join(name);
            self.folder(path.parent().unwrap_or(dir))?;
            if path.is_dir() {
                let taken = std::io::Error::other("a folder has this name");
                return Err(Error::io(path, taken));
            }
            let temporary = temporary::name(&path);
            self.files.push(temporary.clone());
            fs::File::create(&temporary)
                .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
                .map_err(|e| Error::io(&path, e))?;
            names.push((temporary, path));
        }
        if let Some((_, seal)) = names.last().filter(|(_, seal)| names.len() > 1 && seal.exists()) {
            fs::remove_file(seal).map_err(|e| Error::io(seal, e))?;
        }
        for path in gone {
            fs::remove_file(path).map_err(|e| Error::io(path, e))?;
        }
        for (temporary, path) in names {
            let new = !path.exists();
            fs::rename(&temporary, &path).map_err(|e| Error::io(&path, e))?;
            if new {
                self.files.push(path);
            }
        }
        Ok(())
    }

    /// Creates a folder and its missing parents.
    fn folder(&mut self, dir: &Path) -> Result<()> {
        let missing = dir.ancestors().take_while(|d| !d.as_os_str().is_empty() && !d.exists());
        let missing: Vec<PathBuf> = missing.map(Path::to_owned).collect();
        for folder in missing.into_iter().rev() {
            fs::create_dir(&folder).map_err(|e| Error::io(&folder, e))?;
            self.folders.push(folder);
        }
        Ok(())
    }

    /// Removes everything again; the first fault is the one reported.
    fn undo(&self) {
        for file in &self.files {
            let _ = fs::remove_file(file);
        }
        for folder in self.folders.iter().rev() {
            let _ = fs::remove_dir(folder);
        }
    }
}

/// Creates a missing folder, removes temporary files of killed processes from it, and checks that
/// it is writable.
///
/// # Errors
/// [`Error::Io`] with the folder.
pub fn check_writable(dir: impl AsRef<Path>) -> Result<()> {
    let dir = dir.as_ref();
    let probe = temporary::name(&dir.join("probe"));
    temporary::sweep(dir);
    fs::create_dir_all(dir)
        .and_then(|()| fs::File::create(&probe))
        .and_then(|_| fs::remove_file(&probe))
        .map_err(|e| Error::io(dir, e))
}

pub(super) fn encode_png(picture: &DynamicImage) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    picture
        .write_with_encoder(PngEncoder::new(&mut bytes))
        .map_err(|e| Error::Internal(format!("a picture could not be encoded: {e}")))?;
    Ok(bytes)
}

/// A 16-bit RGB picture whose pixel `i` has the channels `value(i)`, each clipped to [0, 1].
fn rgb16(width: usize, height: usize, value: impl Fn(usize) -> [f32; 3]) -> DynamicImage {
    let data = (0..width * height).flat_map(|i| value(i).map(quantise)).collect();
    let buffer = ImageBuffer::from_raw(width as u32, height as u32, data);
    DynamicImage::ImageRgb16(buffer.expect("three values a pixel"))
}

/// The nearest 16-bit value; NaN becomes 0.
fn quantise(value: f32) -> u16 {
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
/// If the sizes do not fit or the file cannot be written.
pub fn write_png16_image(
    path: impl AsRef<Path>,
    width: usize,
    height: usize,
    rgb: &[f32],
) -> Result<()> {
    check_planes(width, height, rgb)?;
    let n = width * height;
    let picture = rgb16(width, height, |i| [rgb[i], rgb[n + i], rgb[2 * n + i]]);
    write_atomic(path, &encode_png(&picture)?)
}

/// Writes three planes (R, G, B) of linear values as a float EXR picture.
///
/// # Errors
/// If the sizes do not fit or the file cannot be written.
pub fn write_exr_image(
    path: impl AsRef<Path>,
    width: usize,
    height: usize,
    rgb: &[f32],
) -> Result<()> {
    check_planes(width, height, rgb)?;
    let planes = ["R", "G", "B"].into_iter().zip(rgb.chunks_exact(width * height));
    let planes = planes.map(|(name, plane)| (name, plane.to_vec())).collect();
    let path = path.as_ref();
    write_atomic(path, &encode_channels(width, height, planes, None)?)
}
