//! The camera's model.

use std::path::PathBuf;

use pyo3::prelude::*;
use svbrdf::geometry;

use crate::errors::{argument, detached};

/// Intrinsics of a camera in OpenCV's convention.
///
/// Lengths are in pixels; the centre of the top-left pixel is (0, 0). ``distortion`` holds k1, k2, p1, p2, k3.
///
/// >>> Camera(4032, 3024, 3000.0, 3000.0, 2015.5, 1511.5).distortion
/// (0.0, 0.0, 0.0, 0.0, 0.0)
#[pyclass(frozen, get_all, eq, module = "svbrdf", from_py_object)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Width of its photographs, px.
    width: u32,
    /// Height of its photographs, px.
    height: u32,
    /// Focal length along x, px.
    fx: f64,
    /// Focal length along y, px.
    fy: f64,
    /// Principal point, x, px.
    cx: f64,
    /// Principal point, y, px.
    cy: f64,
    /// k1, k2, p1, p2, k3.
    distortion: (f64, f64, f64, f64, f64),
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, distortion = (0.0, 0.0, 0.0, 0.0, 0.0)))]
    fn new(
        width: u32,
        height: u32,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: (f64, f64, f64, f64, f64),
    ) -> PyResult<Self> {
        let camera = Self { width, height, fx, fy, cx, cy, distortion };
        match camera.native().fault() {
            None => Ok(camera),
            Some((field, expected)) => Err(argument(field, format!("{expected} expected"))),
        }
    }

    /// Reads a file of JSON: the object that ``capture.json`` has under ``camera``.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        detached(py, || svbrdf::capture::read_camera(path)).map(Self::from)
    }

    fn __repr__(&self) -> String {
        let Self { width, height, fx, fy, cx, cy, distortion } = self;
        format!("Camera({width}, {height}, {fx}, {fy}, {cx}, {cy}, {distortion:?})")
    }
}

impl Camera {
    /// The library's form.
    pub fn native(&self) -> geometry::Camera {
        let Self { width, height, fx, fy, cx, cy, distortion: (k1, k2, p1, p2, k3) } = *self;
        geometry::Camera { width, height, fx, fy, cx, cy, distortion: [k1, k2, p1, p2, k3] }
    }
}

impl From<geometry::Camera> for Camera {
    fn from(camera: geometry::Camera) -> Self {
        let geometry::Camera { width, height, fx, fy, cx, cy, distortion } = camera;
        Self { width, height, fx, fy, cx, cy, distortion: distortion.into() }
    }
}
