//! Captures in progress.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use glam::DVec3;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use svbrdf::networks::Networks;
use svbrdf::observation::Falloff;
use svbrdf::session::Settings;
use svbrdf::session::{
    self, AcceptedPhoto, Budget, Method, Outcome, RectifiedFalloff, RestoreOptions, Scene,
};

use crate::board::Board;
use crate::camera::Camera;
use crate::capture::Capture;
use crate::errors::{argument, choice, detached, to_python};
use crate::maps::{Maps, lengths};
use crate::photo::Photo;
use crate::records::{self, Accepted, Hint, NextView, Probe, Progress, Rejected};
use crate::watch;

/// The networks, which all sessions share.
fn networks() -> svbrdf::Result<Arc<Networks>> {
    static NETWORKS: OnceLock<Arc<Networks>> = OnceLock::new();
    match NETWORKS.get() {
        Some(networks) => Ok(networks.clone()),
        None => {
            let networks = Arc::new(Networks::embedded()?);
            Ok(NETWORKS.get_or_init(|| networks).clone())
        }
    }
}

/// A capture in progress: push photographs, take maps at any time.
///
/// Photographs show a sample of ``sample_mm`` (width, height) in the hole of ``board``. ``camera`` and ``flash_offset_mm`` (the
/// flash in the camera's frame: x right, y down, z forward) are estimated where they are not given, and so is
/// ``elevation_mm``, the height of the sample above the board. ``resolution`` is 256, 512, 1024 or 2048 texels along each
/// side, ``method`` ``deep`` or ``classic``. ``threads=0`` takes one for each core, at most four.
///
/// All methods may be called from any thread. The fit runs on threads of its own; leaving a ``with`` block ends it.
#[pyclass(frozen, module = "svbrdf")]
pub struct Session(Option<Arc<session::Session>>);

/// Options that all constructors share.
struct Options<'a> {
    resolution: usize,
    method: &'a str,
    refine: bool,
    threads: usize,
    memory_limit_mib: Option<u64>,
}

impl Options<'_> {
    fn start(self, py: Python<'_>, scene: Scene, sample_mm: [f32; 2]) -> PyResult<Session> {
        let found = match self.method {
            "deep" => Some(Method::Deep),
            "classic" => Some(Method::Classic),
            _ => None,
        };
        let settings = Settings {
            sample_mm,
            resolution: self.resolution,
            method: choice("method", self.method, found, &["deep", "classic"])?,
            refine: self.refine,
            threads: self.threads,
            memory_limit_bytes: self.memory_limit_mib.map(|mib| mib << 20),
            ..Settings::default()
        };
        let started =
            detached(py, || session::Session::with_networks(scene, settings, networks()?))?;
        Ok(Session(Some(Arc::new(started))))
    }
}

impl Session {
    fn native(&self) -> &session::Session {
        self.0.as_deref().expect("held until dropped")
    }

    fn answer(py: Python<'_>, pushed: Outcome<AcceptedPhoto>) -> PyResult<Py<PyAny>> {
        Ok(match pushed {
            Outcome::Accepted(accepted) => Py::new(py, Accepted::new(py, &accepted)?)?.into_any(),
            Outcome::Rejected(rejection) => Py::new(py, Rejected::from(rejection))?.into_any(),
        })
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        // The last one waits for the step in progress; others may run Python meanwhile.
        let held = self.0.take();
        Python::attach(|py| py.detach(|| drop(held)));
    }
}

#[pymethods]
impl Session {
    #[new]
    #[pyo3(signature = (*, sample_mm, board = None, camera = None, flash_offset_mm = None, elevation_mm = None,
        resolution = 256, method = "deep", refine = true, threads = 0, memory_limit_mib = None))]
    fn new(
        py: Python<'_>,
        sample_mm: (f32, f32),
        board: Option<Board>,
        camera: Option<Camera>,
        flash_offset_mm: Option<(f64, f64, f64)>,
        elevation_mm: Option<f64>,
        resolution: usize,
        method: &str,
        refine: bool,
        threads: usize,
        memory_limit_mib: Option<u64>,
    ) -> PyResult<Self> {
        let target = board.map(|board| board.0).unwrap_or_default();
        let scene = Scene::Board {
            target,
            camera: camera.map(|camera| camera.native()),
            flash_offset_mm: flash_offset_mm.map(DVec3::from),
            elevation_mm,
        };
        let options = Options { resolution, method, refine, threads, memory_limit_mib };
        options.start(py, scene, lengths(sample_mm)?)
    }

    /// A session of photographs that show the sample from the top already. ``falloff`` is ``inverse-square`` or ``none``;
    /// ``light_power`` is the light's intensity in mm² for each colour, by default pi * (first camera's distance)².
    #[staticmethod]
    #[pyo3(signature = (*, sample_mm, falloff = "inverse-square", light_power = None, resolution = 256,
        method = "deep", refine = true, threads = 0, memory_limit_mib = None))]
    fn rectified(
        py: Python<'_>,
        sample_mm: (f32, f32),
        falloff: &str,
        light_power: Option<(f32, f32, f32)>,
        resolution: usize,
        method: &str,
        refine: bool,
        threads: usize,
        memory_limit_mib: Option<u64>,
    ) -> PyResult<Self> {
        let power = light_power.map(<[f32; 3]>::from);
        if power.is_some_and(|power| !power.iter().all(|v| v.is_finite() && *v > 0.0)) {
            return Err(argument("light_power", "positive numbers are expected"));
        }
        let found = match (falloff, power) {
            ("inverse-square", None) => Some(RectifiedFalloff::InverseSquareAuto),
            ("inverse-square", Some(power_mm2)) => {
                Some(RectifiedFalloff::Given(Falloff::InverseSquare { power_mm2 }))
            }
            ("none", _) => {
                let power = [std::f32::consts::PI; 3];
                Some(RectifiedFalloff::Given(Falloff::None { power }))
            }
            _ => None,
        };
        let falloff = choice("falloff", falloff, found, &["inverse-square", "none"])?;
        let options = Options { resolution, method, refine, threads, memory_limit_mib };
        options.start(py, Scene::Rectified { falloff }, lengths(sample_mm)?)
    }

    /// A session for the photographs of a capture.
    #[staticmethod]
    #[pyo3(signature = (capture, *, resolution = 256, method = "deep", refine = true, threads = 0,
        memory_limit_mib = None))]
    fn of_capture(
        py: Python<'_>,
        capture: &Capture,
        resolution: usize,
        method: &str,
        refine: bool,
        threads: usize,
        memory_limit_mib: Option<u64>,
    ) -> PyResult<Self> {
        let options = Options { resolution, method, refine, threads, memory_limit_mib };
        options.start(py, capture.0.scene.clone(), capture.0.sample_mm)
    }

    /// Goes on with a session that ``save`` wrote. ``threads`` as in the constructor; ``None``: as saved.
    #[staticmethod]
    #[pyo3(signature = (saved, *, threads = None, memory_limit_mib = None))]
    fn restore(
        py: Python<'_>,
        saved: &[u8],
        threads: Option<usize>,
        memory_limit_mib: Option<u64>,
    ) -> PyResult<Self> {
        let limit = memory_limit_mib.map(|mib| mib << 20);
        let options = RestoreOptions { threads, memory_limit_bytes: limit, ..Default::default() };
        let restored = detached(py, || session::Session::restore(saved, networks()?, options))?;
        Ok(Self(Some(Arc::new(restored))))
    }

    /// The session as bytes, from which ``restore`` goes on. A fit in progress is done again.
    fn save<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &detached(py, || self.native().save())?))
    }

    /// Limits the work on each photograph from now on: seconds, steps of the optimisers, or an end once further
    /// changes are invisible in 8-bit maps.
    #[pyo3(signature = (*, seconds = None, steps = None, stop_when_invisible = false))]
    fn set_budget(
        &self,
        py: Python<'_>,
        seconds: Option<f32>,
        steps: Option<u32>,
        stop_when_invisible: bool,
    ) -> PyResult<()> {
        let budget = Budget { seconds, steps, stop_when_invisible };
        detached(py, || self.native().set_budget(budget))
    }

    /// Adds a photograph of the board: ``Accepted``, or ``Rejected`` with the reason. Maps that know of it are there when
    /// this returns; the fit goes on by itself.
    fn add_photo(&self, py: Python<'_>, photo: &Photo) -> PyResult<Py<PyAny>> {
        Self::answer(py, detached(py, || self.native().add_photo(&photo.0))?)
    }

    /// Adds a photograph that shows the sample from the top already, with the positions of camera and light.
    #[pyo3(signature = (photo, *, camera_mm, light_mm))]
    fn add_rectified_photo(
        &self,
        py: Python<'_>,
        photo: &Photo,
        camera_mm: (f32, f32, f32),
        light_mm: (f32, f32, f32),
    ) -> PyResult<Py<PyAny>> {
        let (camera, light) = (camera_mm.into(), light_mm.into());
        let pushed = detached(py, || self.native().add_rectified_photo(&photo.0, camera, light))?;
        Self::answer(py, pushed)
    }

    /// Judges a photograph or an image of a preview without adding it. ``flash=False``: it is lit by something else, and how
    /// says nothing.
    #[pyo3(signature = (photo, *, flash = true))]
    fn probe(&self, py: Python<'_>, photo: &Photo, flash: bool) -> PyResult<Probe> {
        let probe = detached(py, || match flash {
            true => self.native().probe(&photo.0),
            false => self.native().probe_without_flash(&photo.0),
        })?;
        Probe::new(py, &probe)
    }

    /// Takes an accepted photograph back; later ones move up.
    fn remove_photo(&self, py: Python<'_>, index: usize) -> PyResult<()> {
        detached(py, || self.native().remove_photo(index))
    }

    /// Hints about each accepted photograph from all present knowledge, a list for each. Hints given when a photograph was
    /// added may no longer hold, and others may. Meaningful once the fit has settled.
    fn hints(&self, py: Python<'_>) -> PyResult<Vec<Vec<Py<Hint>>>> {
        let all = detached(py, || self.native().hints())?;
        all.iter().map(|hints| records::hints(hints, py)).collect()
    }

    /// The maps as they are now.
    fn snapshot(&self, py: Python<'_>) -> PyResult<Maps> {
        let maps = self.native().snapshot().map_err(to_python)?;
        Ok(Maps::of(py, maps, None, self.native().settings().sample_mm))
    }

    /// The maps as they are now, with how far they may be off.
    fn snapshot_with_uncertainty(&self, py: Python<'_>) -> PyResult<Maps> {
        let known = detached(py, || self.native().snapshot_with_uncertainty())?;
        let uncertainty = Some(Arc::new(known.uncertainty));
        Ok(Maps::of(py, known.maps, uncertainty, self.native().settings().sample_mm))
    }

    /// Announces that so many photographs are still to come: ``Progress.fraction`` is then that of the work on all of them
    /// together, and never falls before they have come. Each photograph added takes one of them away, whether it is accepted or
    /// rejected. If fewer or more come after all, say so by another call. Without it the fraction is that of each photograph.
    fn announce(&self, photos: usize) {
        self.native().announce(photos);
    }

    /// State of the fit.
    #[getter]
    fn progress(&self) -> Progress {
        self.native().progress().into()
    }

    /// Waits until the fit has settled on all photographs so far, for at most ``timeout`` seconds: whether it has. Ctrl-C
    /// ends the waiting, not the fit.
    #[pyo3(signature = (timeout = None))]
    fn wait(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<bool> {
        let seconds = |s: f64| {
            let expected = "a number of seconds of at least 0 is expected";
            Duration::try_from_secs_f64(s).map_err(|_| argument("timeout", expected))
        };
        watch::wait(py, self.native(), timeout.map(seconds).transpose()?)
    }

    /// Holds the fit after the step in progress.
    fn pause(&self) {
        self.native().pause();
    }

    /// Goes on after ``pause``.
    fn resume(&self) {
        self.native().resume();
    }

    /// Ends the fit after the step in progress; maps stay available, pushes raise ``CancelledError``.
    fn cancel(&self) {
        self.native().cancel();
    }

    /// Where the next photograph tells most; ``None`` before the first one, and for rectified photographs.
    fn next_view(&self, py: Python<'_>) -> Option<NextView> {
        py.detach(|| self.native().next_view()).map(NextView::from)
    }

    /// The camera as used: given, or estimated from the photographs so far.
    #[getter]
    fn camera(&self, py: Python<'_>) -> Option<Camera> {
        py.detach(|| self.native().camera()).map(Camera::from)
    }

    /// The flash in the camera's frame as used, mm.
    #[getter]
    fn flash_offset_mm(&self, py: Python<'_>) -> (f64, f64, f64) {
        py.detach(|| self.native().flash_offset_mm()).into()
    }

    /// Other light as a share of the flash's.
    #[getter]
    fn ambient_fraction(&self, py: Python<'_>) -> f32 {
        py.detach(|| self.native().ambient_fraction())
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, _exception: &Bound<'_, pyo3::types::PyTuple>) {
        self.cancel();
    }

    fn __repr__(&self) -> String {
        let frames = self.native().progress().photos;
        format!("<Session of {frames} photographs>")
    }
}
