//! Reports of a session.

use pyo3::prelude::*;
use svbrdf::session;

/// Something to tell about a photograph.
#[pyclass(frozen, get_all, eq, module = "svbrdf")]
#[derive(Debug, Clone, PartialEq)]
pub struct Hint {
    /// Stable name for programs.
    code: &'static str,
    /// The sentence for people.
    message: String,
}

impl Hint {
    /// A hint with its name.
    pub fn new(code: &'static str, message: String) -> Self {
        Self { code, message }
    }
}

#[pymethods]
impl Hint {
    fn __repr__(&self) -> String {
        format!("<Hint {}: {}>", self.code, self.message)
    }
}

/// The same for Python.
pub fn hints(hints: &[session::Hint], py: Python<'_>) -> PyResult<Vec<Py<Hint>>> {
    let of = |hint: &session::Hint| Hint { code: hint.code(), message: hint.to_string() };
    hints.iter().map(|hint| Py::new(py, of(hint))).collect()
}

/// A photograph that takes part in the fit.
#[pyclass(frozen, get_all, module = "svbrdf")]
pub struct Accepted {
    /// Number of accepted photographs before this one.
    index: usize,
    /// Reprojection error of the board, px; ``None`` for rectified photographs.
    reprojection_rms_px: Option<f64>,
    /// Centre of the camera in the board frame, mm; ``None`` for rectified photographs.
    camera_mm: Option<(f64, f64, f64)>,
    /// Remarks for the user.
    hints: Vec<Py<Hint>>,
}

impl Accepted {
    /// From the library's.
    pub fn new(py: Python<'_>, accepted: &session::AcceptedPhoto) -> PyResult<Self> {
        Ok(Self {
            index: accepted.index,
            reprojection_rms_px: accepted.pose.map(|board| board.reprojection_rms_px),
            camera_mm: accepted.pose.map(|board| board.pose.camera_centre().into()),
            hints: hints(&accepted.hints, py)?,
        })
    }
}

#[pymethods]
impl Accepted {
    /// True: an accepted photograph counts as true, a rejected one as false.
    fn __bool__(&self) -> bool {
        true
    }

    fn __repr__(&self) -> String {
        format!("<Accepted {}>", self.index)
    }
}

/// A photograph that was not used; nothing changed.
#[pyclass(frozen, get_all, eq, module = "svbrdf")]
#[derive(Debug, Clone, PartialEq)]
pub struct Rejected {
    /// Stable name of the reason for programs, such as ``board_not_found``.
    code: &'static str,
    /// The sentence for people.
    message: String,
}

impl From<svbrdf::Rejection> for Rejected {
    fn from(rejection: svbrdf::Rejection) -> Self {
        Self { code: rejection.code(), message: rejection.to_string() }
    }
}

#[pymethods]
impl Rejected {
    /// False.
    fn __bool__(&self) -> bool {
        false
    }

    fn __repr__(&self) -> String {
        format!("<Rejected {}: {}>", self.code, self.message)
    }
}

/// State of a fit.
#[pyclass(frozen, get_all, eq, module = "svbrdf")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Accepted photographs.
    photos: usize,
    /// Fraction of the work that is done, 0 to 1: on the photographs of ``Session.announce``, without on the latest one.
    fraction: f32,
    /// Mean difference of the logarithms of photographs and renderings.
    loss: f32,
    /// Estimated seconds left on the photographs so far, if known.
    seconds_left: Option<f32>,
    /// Whether the fit has finished on all photographs so far.
    settled: bool,
}

impl From<session::Progress> for Progress {
    fn from(p: session::Progress) -> Self {
        let session::Progress { photos, fraction, loss, seconds_left, settled, .. } = p;
        Self { photos, fraction, loss, seconds_left, settled }
    }
}

#[pymethods]
impl Progress {
    fn __repr__(&self) -> String {
        let Self { photos, fraction, .. } = self;
        format!("<Progress {:.0} % of {photos} photographs>", 100.0 * fraction)
    }
}

/// Where the next photograph tells most.
#[pyclass(frozen, get_all, eq, module = "svbrdf")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NextView {
    /// Unit vector from the sample towards the camera, board frame.
    direction: (f32, f32, f32),
    /// Angle off the top, degrees.
    tilt_deg: f32,
    /// Side to go to: degrees counter-clockwise from the sample's +X.
    azimuth_deg: f32,
}

impl From<session::NextView> for NextView {
    fn from(view: session::NextView) -> Self {
        let session::NextView { direction, tilt_deg, azimuth_deg } = view;
        Self { direction: direction.into(), tilt_deg, azimuth_deg }
    }
}

#[pymethods]
impl NextView {
    fn __repr__(&self) -> String {
        format!("<NextView {:.0} degrees off the top, side {:.0}>", self.tilt_deg, self.azimuth_deg)
    }
}

/// The verdict on a photograph that is not added.
#[pyclass(frozen, get_all, module = "svbrdf")]
pub struct Probe {
    /// Why a photograph like it would not be used; ``None``: it would.
    rejection: Option<Py<Rejected>>,
    /// Remarks, whether it would be accepted or not.
    hints: Vec<Py<Hint>>,
    /// Corners of the board found.
    corners: usize,
    /// Corners that the board has.
    corners_expected: usize,
    /// Edge spread (one sigma), px.
    blur_px: Option<f32>,
    /// Angle of the view off the top, degrees.
    tilt_deg: Option<f32>,
    /// Side of the camera: degrees counter-clockwise from the sample's +X.
    azimuth_deg: Option<f32>,
    /// From the sample to the camera, mm.
    distance_mm: Option<f32>,
    /// Angle to the view that would tell most, degrees.
    off_next_deg: Option<f32>,
    /// Share of the sample inside the image, 0 to 1.
    sample_seen: Option<f32>,
    /// The sample's corners in the image, px, clockwise from the upper left of the maps.
    sample_px: Option<Vec<(f32, f32)>>,
    /// Median level of the white squares, share of full scale.
    white_level: Option<f32>,
}

impl Probe {
    /// From the library's.
    pub fn new(py: Python<'_>, probe: &session::Probe) -> PyResult<Self> {
        let rejection = probe.rejection.map(|r| Py::new(py, Rejected::from(r))).transpose()?;
        let view = probe.view.as_ref();
        let outline = view.and_then(|v| v.sample_px);
        Ok(Self {
            rejection,
            hints: hints(&probe.hints, py)?,
            corners: probe.corners.len(),
            corners_expected: probe.corners_expected,
            blur_px: probe.blur_px,
            tilt_deg: view.map(|v| v.tilt_deg),
            azimuth_deg: view.map(|v| v.azimuth_deg),
            distance_mm: view.map(|v| v.distance_mm),
            off_next_deg: view.and_then(|v| v.off_next_deg),
            sample_seen: view.map(|v| v.sample_seen),
            sample_px: outline.map(|px| px.map(|[x, y]| (x, y)).to_vec()),
            white_level: probe.light.map(|l| l.white_level),
        })
    }
}
