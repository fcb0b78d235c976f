//! `capture.json` of photographs that came without one.

use std::path::{Component, Path, PathBuf};

use serde_json::{Value, json};
use svbrdf::capture::FORMAT;
use svbrdf::files::Chosen;
use svbrdf::geometry::Camera;

use crate::failure::{Failure, Result};

/// Facts that photographs do not contain.
pub struct Setup {
    /// Width and height of the sample, mm.
    pub sample_mm: [f32; 2],
    /// The `board` object.
    pub board: Value,
    pub camera: Option<Camera>,
}

/// Describes photographs for a file in folder `dir`, which exists: those beside the folder or below
/// are named relative to it, others from the root on.
pub fn describe(setup: &Setup, photographs: &[Chosen], dir: &Path) -> Result<Value> {
    let dir = absolute(dir)?;
    let frames: Vec<Value> = photographs
        .iter()
        .map(|photograph| {
            let path = relative(&absolute(&photograph.path)?, &dir);
            let name = path.to_str().ok_or_else(|| {
                let path = photograph.path.display();
                Failure::Input(format!(
                    "{path}: the name is not valid Unicode; expected one that is"
                ))
            })?;
            let encoding = if photograph.is_linear { "linear" } else { "srgb" };
            let exposure = photograph.exposure;
            let mut frame = json!({ "image": name, "encoding": encoding, "exposure": exposure });
            if photograph.turn_deg != 0 {
                frame["turn"] = json!(photograph.turn_deg);
            }
            Ok(frame)
        })
        .collect::<Result<_>>()?;
    let [width_mm, height_mm] = setup.sample_mm;
    let mut capture = json!({
        "format": FORMAT,
        "sample": { "width_mm": width_mm, "height_mm": height_mm },
        "board": setup.board,
        "frames": frames,
    });
    if let Some(camera) = &setup.camera {
        capture["camera"] = json!(camera);
    }
    Ok(capture)
}

/// Whether the description in folder `dir` can name a file: its text is Unicode.
pub fn can_name(file: &Path, dir: &Path) -> bool {
    let paths = absolute(file).ok().zip(absolute(dir).ok());
    paths.is_some_and(|(file, dir)| relative(&file, &dir).to_str().is_some())
}

/// The absolute path. The file need not exist any more.
fn absolute(path: &Path) -> Result<PathBuf> {
    let fault = |e| Failure::Input(format!("{}: {e}", path.display()));
    path.canonicalize().or_else(|_| std::path::absolute(path)).map_err(fault)
}

/// A file's path seen from a folder, if the folder's parent leads to it.
fn relative(file: &Path, dir: &Path) -> PathBuf {
    if let Ok(below) = file.strip_prefix(dir) {
        return below.to_owned();
    }
    let beside = dir.parent().filter(|parent| parent.parent().is_some());
    match beside.and_then(|parent| file.strip_prefix(parent).ok()) {
        Some(below) => Path::new(&Component::ParentDir).join(below),
        None => file.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_named_relative_to_the_folder() {
        let seen = |file: &str, dir| relative(Path::new(file), Path::new(dir));
        assert_eq!(seen("/home/shoot/maps/a.jpg", "/home/shoot/maps"), Path::new("a.jpg"));
        assert_eq!(seen("/home/shoot/a.jpg", "/home/shoot/maps"), Path::new("../a.jpg"));
        assert_eq!(seen("/home/shoot/in/a.jpg", "/home/shoot/maps"), Path::new("../in/a.jpg"));
        assert_eq!(seen("/data/a.jpg", "/home/shoot/maps"), Path::new("/data/a.jpg"));
        assert_eq!(seen("/data/a.jpg", "/maps"), Path::new("/data/a.jpg"));
    }
}
