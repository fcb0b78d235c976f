//! Folders with `capture.json`.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use svbrdf::capture;

use crate::camera::Camera;
use crate::errors::detached;
use crate::photo::Photo;

/// A position in the board frame, mm.
type Position = (f32, f32, f32);

/// One photograph of a capture.
#[pyclass(frozen, module = "svbrdf")]
pub struct Frame(capture::Frame);

#[pymethods]
impl Frame {
    /// The picture file.
    #[getter]
    fn path(&self) -> PathBuf {
        self.0.path.clone()
    }

    /// Transfer curve of its values.
    #[getter]
    fn encoding(&self) -> &'static str {
        self.0.encoding.name()
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

    /// Reads the photograph, less what its view without flash shows.
    fn read(&self, py: Python<'_>) -> PyResult<Photo> {
        Ok(Photo(Arc::new(detached(py, || self.0.read())?)))
    }

    fn __repr__(&self) -> String {
        format!("<Frame {}>", self.0.path.display())
    }
}

/// A folder with ``capture.json``: what its photographs show. They are read one at a time.
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

    /// The photographs.
    #[getter]
    fn frames(&self) -> Vec<Frame> {
        self.0.frames.iter().cloned().map(Frame).collect()
    }

    fn __repr__(&self) -> String {
        format!("<Capture of {} photographs>", self.0.frames.len())
    }
}
