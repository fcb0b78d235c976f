//! Faults of the library as Python's exceptions, which the package defines itself.

use pyo3::prelude::*;
use svbrdf::Error;

/// The exceptions, under their names in `svbrdf.errors`.
mod raised {
    #![allow(missing_docs)]
    pyo3::import_exception!(svbrdf.errors, ArgumentError);
    pyo3::import_exception!(svbrdf.errors, CancelledError);
    pyo3::import_exception!(svbrdf.errors, FieldError);
    pyo3::import_exception!(svbrdf.errors, FileError);
    pyo3::import_exception!(svbrdf.errors, InternalError);
    pyo3::import_exception!(svbrdf.errors, MemoryLimitError);
    pyo3::import_exception!(svbrdf.errors, ModelError);
    pyo3::import_exception!(svbrdf.errors, NoMapsError);
    pyo3::import_exception!(svbrdf.errors, StateError);
}

/// A fault as an exception with the same words.
pub fn to_python(error: Error) -> PyErr {
    let text = error.to_string();
    match error {
        Error::Io { .. } | Error::Image { .. } => raised::FileError::new_err(text),
        Error::Field { .. } => raised::FieldError::new_err(text),
        Error::Argument { .. } => raised::ArgumentError::new_err(text),
        Error::Model { .. } => raised::ModelError::new_err(text),
        Error::State(_) => raised::StateError::new_err(text),
        Error::MemoryLimit { .. } => raised::MemoryLimitError::new_err(text),
        Error::NoMaps => raised::NoMapsError::new_err(text),
        Error::Cancelled => raised::CancelledError::new_err(text),
        // A fault that this module does not know yet counts as one of its own.
        _ => raised::InternalError::new_err(text),
    }
}

/// An argument out of range.
pub fn argument(name: &str, message: impl std::fmt::Display) -> PyErr {
    raised::ArgumentError::new_err(format!("{name}: {message}"))
}

/// One of several names.
pub fn choice<T>(
    argument_name: &str,
    given: &str,
    found: Option<T>,
    expected: &[&str],
) -> PyResult<T> {
    let expected = expected.join(", ");
    found.ok_or_else(|| {
        argument(argument_name, format!("`{given}` given; one of {expected} expected"))
    })
}

/// Runs work without the interpreter's lock, and raises its error.
pub fn detached<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> svbrdf::Result<T> + Send,
) -> PyResult<T> {
    py.detach(work).map_err(to_python)
}
