//! Folders with `capture.json`.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pyo3::prelude::*;
use svbrdf::capture;
use svbrdf::files::{Choice, Chosen, HEAD_BYTES, Kind, Metadata};
use svbrdf::photo::{Encoding, Rotation};

use crate::camera::Camera;
use crate::errors::detached;
use crate::photo::Photo;
use crate::records::Hint;

/// A position in the board frame, mm.
type Position = (f32, f32, f32);

/// One photograph of a capture.
#[pyclass(frozen, module = "svbrdf")]
pub struct PhotoFile(capture::PhotoFile);

#[pymethods]
impl PhotoFile {
    /// The image file.
    #[getter]
    fn path(&self) -> PathBuf {
        self.0.path.clone()
    }

    /// Transfer curve of its values.
    #[getter]
    fn encoding(&self) -> Option<&'static str> {
        self.0.encoding.map(Encoding::name)
    }

    /// Relative exposure.
    #[getter]
    fn exposure(&self) -> f32 {
        self.0.exposure
    }

    /// Positions of camera and light of an already rectified photograph, mm; ``None`` for one of a board.
    #[getter]
    fn rectified(&self) -> Option<(Position, Position)> {
        self.0.rectified.map(|view| (view.camera_mm.into(), view.light_mm.into()))
    }

    /// Reads the photograph, without the light of its view without flash.
    fn read(&self, py: Python<'_>) -> PyResult<Photo> {
        Ok(Photo(Arc::new(detached(py, || self.0.read())?)))
    }

    /// Reads the photograph, and hints about the file.
    fn _read_with_hints(&self, py: Python<'_>) -> PyResult<(Photo, Vec<Hint>)> {
        let (photo, remarks) = detached(py, || self.0.read_with_remarks())?;
        let hints = remarks.iter().map(|remark| Hint::new(remark.code(), remark.to_string()));
        Ok((Photo(Arc::new(photo)), hints.collect()))
    }

    fn __repr__(&self) -> String {
        format!("<PhotoFile {}>", self.0.path.display())
    }
}

/// A folder with ``capture.json``: a description of its photographs, which are read one at a time.
#[pyclass(frozen, module = "svbrdf")]
pub struct Capture(pub capture::Capture);

#[pymethods]
impl Capture {
    /// Reads and checks ``capture.json`` of a folder. ``camera`` takes the place of the file's.
    #[staticmethod]
    #[pyo3(signature = (folder, *, camera = None))]
    fn load(py: Python<'_>, folder: PathBuf, camera: Option<Camera>) -> PyResult<Self> {
        let camera = camera.map(|camera| camera.native());
        detached(py, || capture::Capture::load_with_camera(folder, camera)).map(Self)
    }

    /// Width and height of the sample, mm.
    #[getter]
    fn sample_mm(&self) -> (f32, f32) {
        self.0.sample_mm.into()
    }

    /// Parts of the description that were ignored, a sentence each.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.warnings.clone()
    }

    /// The photographs.
    #[getter]
    fn photos(&self) -> Vec<PhotoFile> {
        self.0.photos.iter().cloned().map(PhotoFile).collect()
    }

    fn __repr__(&self) -> String {
        format!("<Capture of {} photographs>", self.0.photos.len())
    }
}

/// Photographs to be used, others with why they are not, and remarks.
type Chose = (Vec<PhotoFile>, Vec<(PathBuf, String)>, Vec<String>);

/// Photographs of one camera among image files, in the order in which they were taken, with their exposures:
/// frames; files left out, and why; remarks.
#[pyfunction]
pub fn _choose(py: Python<'_>, paths: Vec<PathBuf>) -> Chose {
    py.detach(|| {
        let mut choice = Choice::default();
        let mut left_out = Vec::new();
        let mut read = Vec::new();
        for path in paths {
            match kind(&path) {
                Some(kind) if !kind.is_read() => {
                    left_out.push((
                        path,
                        format!("{}, which is not read: {}", kind.name(), kind.advice()),
                    ));
                }
                _ => read.push((Metadata::read(&path), path)),
            }
        }
        choice.add(read);
        left_out.extend(choice.left_out.into_iter().map(|l| (l.path, l.reason)));
        (choice.chosen.into_iter().map(photo_file).collect(), left_out, choice.remarks)
    })
}

/// Files of a folder that are images by their content, by name.
#[pyfunction]
pub fn _pictures(py: Python<'_>, folder: PathBuf) -> PyResult<Vec<PathBuf>> {
    detached(py, || {
        let entries = std::fs::read_dir(&folder).map_err(|e| svbrdf::Error::io(&folder, e))?;
        let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
        let mut found: Vec<PathBuf> =
            paths.filter(|path| path.is_file() && kind(path).is_some()).collect();
        found.sort();
        Ok(found)
    })
}

fn kind(path: &Path) -> Option<Kind> {
    let mut head = Vec::new();
    File::open(path).ok()?.take(HEAD_BYTES as u64).read_to_end(&mut head).ok()?;
    match Kind::of(&head)? {
        // The directory that names the camera of a raw file may lie anywhere in the file.
        Kind::Tiff => Kind::of(&std::fs::read(path).ok()?),
        kind => Some(kind),
    }
}

fn photo_file(chosen: Chosen) -> PhotoFile {
    PhotoFile(capture::PhotoFile {
        path: chosen.path,
        encoding: chosen.is_linear.then_some(Encoding::Linear),
        exposure: chosen.exposure,
        rectified: None,
        turn: Rotation::from_degrees(chosen.turn_deg).unwrap_or_default(),
        ambient: None,
    })
}
