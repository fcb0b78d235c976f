//! Photographs.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::PyArray3;
use numpy::ndarray::Ix3;
use pyo3::prelude::*;
use svbrdf::files;
use svbrdf::photo::{self, Encoding, Rotation};

use crate::arrays::{array, exactly, floats, size};
use crate::errors::{argument, choice, detached, to_python};

/// A photograph: an array of shape (height, width, 3), RGB with Rec. 709 primaries, row 0 at the top.
///
/// Values are ``uint8``, ``uint16`` (full scale: 65535) or floats (full scale: 1). ``encoding`` is their transfer
/// curve: ``srgb``, ``gamma2.2`` or ``linear``; by default ``srgb`` for integers and ``linear`` for floats, which have
/// no other. ``exposure`` is relative: value = radiance * exposure. A linear float of at least ``saturation`` counts
/// as clipped. ``focal_35mm`` is the focal length in terms of 35 mm film, which helps to estimate a camera.
///
/// >>> import numpy as np
/// >>> Photo(np.zeros((30, 40, 3), np.uint8)).width
/// 40
/// >>> Photo(np.zeros((30, 40), np.uint8))
/// Traceback (most recent call last):
///     ...
/// svbrdf.errors.ArgumentError: pixels: shape [30, 40] given; (height, width, 3) expected
#[pyclass(frozen, module = "svbrdf", from_py_object)]
#[derive(Debug, Clone)]
pub struct Photo(pub Arc<photo::Photo>);

/// The encoding of that name.
pub fn encoding(name: &str) -> PyResult<Encoding> {
    let names = Encoding::ALL.map(Encoding::name);
    choice("encoding", name, Encoding::from_name(name), &names)
}

#[pymethods]
impl Photo {
    #[new]
    #[pyo3(signature = (pixels, encoding = None, *, exposure = 1.0, saturation = None, focal_35mm = None))]
    fn new(
        pixels: &Bound<'_, PyAny>,
        encoding: Option<&str>,
        exposure: f32,
        saturation: Option<f32>,
        focal_35mm: Option<f32>,
    ) -> PyResult<Self> {
        let given = encoding.map(self::encoding).transpose()?;
        let curve = given.unwrap_or(Encoding::Srgb);
        let size = |shape: &[usize]| {
            let [height, width] = size("pixels", shape, 3)?;
            let length = |n: usize| u32::try_from(n).map_err(|_| argument("pixels", "too large"));
            PyResult::Ok((length(width)?, length(height)?))
        };
        let integers = || match saturation {
            Some(_) => Err(argument("saturation", "is for floats; integers have their own")),
            None => Ok(()),
        };
        let py = pixels.py();
        let photo = if let Some((shape, values)) = exactly::<u8>(pixels) {
            let (width, height) = size(&shape)?;
            integers()?;
            let row = 3 * width as usize;
            detached(py, || photo::Photo::from_rgb8(width, height, &values, row, curve, exposure))?
        } else if let Some((shape, values)) = exactly::<u16>(pixels) {
            let (width, height) = size(&shape)?;
            integers()?;
            let row = 3 * width as usize;
            detached(py, || photo::Photo::from_rgb16(width, height, &values, row, curve, exposure))?
        } else if is_float(pixels) {
            let (shape, values) = floats("pixels", pixels)?;
            let (width, height) = size(&shape)?;
            if given.is_some_and(|given| given != Encoding::Linear) {
                return Err(argument("encoding", "floats are linear values"));
            }
            let saturation = saturation.unwrap_or(f32::INFINITY);
            detached(py, || photo::Photo::from_linear(width, height, values, exposure, saturation))?
        } else {
            return Err(argument("pixels", "an array of uint8, uint16 or floats is expected"));
        };
        Ok(Self(Arc::new(photo.with_focal_35mm(focal_35mm))))
    }

    /// Reads a JPEG, PNG, TIFF, OpenEXR or DNG file, upright as its orientation tag says, colours as its profile means
    /// them.
    ///
    /// ``encoding`` is the transfer curve of its values; by default that of the file. ``exposure`` is by default that of
    /// the metadata (seconds * ISO / F-number²), or 1.
    #[staticmethod]
    #[pyo3(signature = (path, encoding = None, *, exposure = None))]
    fn read(
        py: Python<'_>,
        path: PathBuf,
        encoding: Option<&str>,
        exposure: Option<f32>,
    ) -> PyResult<Self> {
        let encoding = encoding.map(self::encoding).transpose()?;
        let options = files::Options { encoding, exposure, ..files::Options::default() };
        let decoded = detached(py, || files::read(path, &options))?;
        Ok(Self(Arc::new(decoded.photo)))
    }

    /// Width, px.
    #[getter]
    fn width(&self) -> u32 {
        self.0.width()
    }

    /// Height, px.
    #[getter]
    fn height(&self) -> u32 {
        self.0.height()
    }

    /// Relative exposure: value = radiance * exposure.
    #[getter]
    fn exposure(&self) -> f32 {
        self.0.exposure()
    }

    /// The linear values, of shape (height, width, 3), not divided by the exposure.
    fn linear<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f32>> {
        let values = py.detach(|| self.0.to_linear());
        array(py, Ix3(self.0.height() as usize, self.0.width() as usize, 3), values)
    }

    /// Turned clockwise by 0, 90, 180 or 270 degrees.
    fn turned(&self, degrees: u32) -> PyResult<Self> {
        let turn = Rotation::from_degrees(degrees)
            .ok_or_else(|| argument("degrees", "0, 90, 180 or 270 expected"))?;
        Ok(Self(Arc::new((*self.0).clone().turned(turn))))
    }

    /// Without the light of another photograph of the same view, taken without flash.
    fn without_ambient(&self, ambient: &Photo) -> PyResult<Self> {
        let less = self.0.without_ambient(&ambient.0).map_err(to_python)?;
        Ok(Self(Arc::new(less)))
    }

    fn __repr__(&self) -> String {
        format!("<Photo of {} x {} px>", self.0.width(), self.0.height())
    }
}

/// Whether the elements are floats.
fn is_float(pixels: &Bound<'_, PyAny>) -> bool {
    let kind = pixels.getattr("dtype").and_then(|dtype| dtype.getattr("kind"));
    kind.and_then(|kind| kind.extract::<String>()).is_ok_and(|kind| kind == "f")
}
