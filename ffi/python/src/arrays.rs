//! Arrays of numpy to the library's planes and back.

use numpy::ndarray::{ArrayD, Dimension, IxDyn};
use numpy::{
    AllowTypeChange, Element, PyArray, PyArrayLikeDyn, PyArrayMethods, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::{Bound, PyAny};

use crate::errors::argument;

/// Values as an array of that shape.
pub fn array<'py, T: Element, D: Dimension>(
    py: Python<'py>,
    shape: D,
    values: Vec<T>,
) -> Bound<'py, PyArray<T, D>> {
    let array = numpy::ndarray::Array::from_shape_vec(shape, values);
    PyArray::from_owned_array(py, array.expect("as many values as the shape holds"))
}

/// Anything that numpy takes for an array, as floats in the order of rows.
pub fn floats(name: &'static str, given: &Bound<'_, PyAny>) -> PyResult<(Vec<usize>, Vec<f32>)> {
    let like: PyArrayLikeDyn<'_, f32, AllowTypeChange> =
        given.extract().map_err(|_| argument(name, "an array of numbers is expected"))?;
    let shape = like.shape().to_vec();
    Ok((shape, values(&like.as_array().to_owned())))
}

fn values<T: Clone>(array: &ArrayD<T>) -> Vec<T> {
    array.iter().cloned().collect()
}

/// An array whose elements have this type, in the order of rows; `None`: it is of another type.
pub fn exactly<T: Element + Clone>(given: &Bound<'_, PyAny>) -> Option<(Vec<usize>, Vec<T>)> {
    let array = given.cast::<PyArray<T, IxDyn>>().ok()?;
    let read = array.try_readonly().ok()?;
    let values = match read.as_slice() {
        Ok(slice) => slice.to_vec(),
        Err(_) => read.as_array().iter().cloned().collect(),
    };
    Some((array.shape().to_vec(), values))
}

/// Height and width of an array of pixels with `channels` values each.
pub fn size(name: &'static str, shape: &[usize], channels: usize) -> PyResult<[usize; 2]> {
    let expected = if channels == 1 {
        "(height, width)".into()
    } else {
        format!("(height, width, {channels})")
    };
    match *shape {
        [height, width] if channels == 1 && height * width > 0 => Ok([height, width]),
        [height, width, c] if c == channels && channels > 1 && height * width > 0 => {
            Ok([height, width])
        }
        _ => Err(argument(name, format!("shape {shape:?} given; {expected} expected"))),
    }
}
