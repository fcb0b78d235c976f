//! The module `svbrdf._native`, which the Python package `svbrdf` wraps. It works with the interpreter's lock
//! released.

extern crate svbrdf as engine;

mod arrays;
mod board;
mod camera;
mod capture;
mod errors;
mod maps;
mod photo;
mod records;
mod session;
mod watch;

/// Native part of the package `svbrdf`.
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use super::board::Board;
    #[pymodule_export]
    use super::camera::Camera;
    #[pymodule_export]
    use super::capture::{_choose, _pictures, Capture, PhotoFile};
    #[pymodule_export]
    use super::maps::Maps;
    #[pymodule_export]
    use super::photo::Photo;
    #[pymodule_export]
    use super::records::{Accepted, Hint, NextView, Probe, Progress, Rejected};
    #[pymodule_export]
    use super::session::Session;

    /// Version of the library.
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
