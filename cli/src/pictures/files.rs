//! Picture files of folders.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::failure::{Failure, Result};

/// Endings of the names of pictures that can be read.
const READ: [&str; 7] = ["jpg", "jpeg", "png", "tif", "tiff", "exr", "dng"];
/// Endings of pictures that cameras write and that cannot be read.
const NOT_READ: [&str; 7] = ["heic", "heif", "cr2", "cr3", "nef", "arw", "webp"];

/// What lies in a folder, by name.
pub struct Folder {
    /// Pictures that can be read.
    pub pictures: Vec<PathBuf>,
    /// Pictures of formats that cannot.
    pub foreign: Vec<PathBuf>,
}

/// Looks for pictures in a folder, not in those inside it; hidden files are passed over.
pub fn look_into(folder: &Path) -> Result<Folder> {
    let fault = |e: std::io::Error| Failure::Input(format!("{}: {e}", folder.display()));
    let mut found = Folder { pictures: Vec::new(), foreign: Vec::new() };
    for entry in std::fs::read_dir(folder).map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        let hidden = path.file_name().is_none_or(|name| name.as_encoded_bytes().starts_with(b"."));
        if hidden || !path.is_file() {
            continue;
        }
        if has_ending(&path, &READ) {
            found.pictures.push(path);
        } else if has_ending(&path, &NOT_READ) {
            found.foreign.push(path);
        }
    }
    found.pictures.sort();
    found.foreign.sort();
    Ok(found)
}

/// All pictures that files and folders name, each once.
pub fn find(inputs: &[PathBuf]) -> Result<Folder> {
    let mut all = Folder { pictures: Vec::new(), foreign: Vec::new() };
    for input in inputs {
        if input.is_dir() {
            let inside = look_into(input)?;
            all.pictures.extend(inside.pictures);
            all.foreign.extend(inside.foreign);
        } else if !input.exists() {
            return Err(Failure::Input(format!(
                "{}: no such file or folder; expected photographs, or a folder with photographs or capture.json",
                input.display()
            )));
        } else if has_ending(input, &NOT_READ) {
            all.foreign.push(input.clone());
        } else {
            all.pictures.push(input.clone());
        }
    }
    let mut seen = BTreeSet::new();
    all.pictures.retain(|path| seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())));
    if all.pictures.is_empty() {
        return Err(none(inputs, &all.foreign));
    }
    Ok(all)
}

fn none(inputs: &[PathBuf], foreign: &[PathBuf]) -> Failure {
    let place = inputs.first().map_or(Path::new("."), |p| p.as_path()).display();
    let formats = "expected JPEG, PNG, TIFF, OpenEXR or DNG files";
    Failure::Input(match foreign.first() {
        Some(file) => format!(
            "{place}: no photographs that can be read: {} such as {} must be converted first \
             (iPhones write JPEG with Settings, Camera, Formats, Most Compatible); {formats}",
            foreign.len(),
            file.display()
        ),
        None => format!("{place}: neither capture.json nor photographs; {formats}"),
    })
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().unwrap_or_default();
    endings.iter().any(|known| ending.eq_ignore_ascii_case(known))
}
