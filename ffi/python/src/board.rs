//! The board round the sample.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyBytes;
use svbrdf::board_sheet::{BoardSheet, Paper, SheetFormat};
use svbrdf::calibration::{Hole, Target, TargetKind, TopLeft};
use svbrdf::export::write_atomic;

use crate::errors::{argument, choice, detached};

/// Side of a marker over that of its square, unless stated.
const MARKER_SHARE: f64 = 0.72;

/// The printed board round the sample, as ``capture.json`` describes it; by default the one that
/// ``svbrdf board`` prints on A4 paper, with a hole of 115 x 126.5 mm.
///
/// ``hole_squares`` is the missing block: first row, first column, end row, end column (half open).
///
/// >>> Board().rows, Board().square_mm
/// (17, 11.5)
/// >>> Board().encode("pdf")[:5]
/// b'%PDF-'
#[pyclass(frozen, eq, module = "svbrdf", from_py_object)]
#[derive(Debug, Clone, PartialEq)]
pub struct Board(pub Target);

#[pymethods]
impl Board {
    #[new]
    #[pyo3(signature = (kind = "checkerboard-ring", *, rows = 17, cols = 16, square_mm = 11.5,
        hole_squares = (3, 3, 14, 13), white_albedo = 0.8, black_albedo = 0.05,
        top_left = "black", patches = true, dictionary = "DICT_4X4_250", marker_mm = None))]
    fn new(
        kind: &str,
        rows: u32,
        cols: u32,
        square_mm: f64,
        hole_squares: (u32, u32, u32, u32),
        white_albedo: f64,
        black_albedo: f64,
        top_left: &str,
        patches: bool,
        dictionary: &str,
        marker_mm: Option<f64>,
    ) -> PyResult<Self> {
        let charuco = TargetKind::CharucoRing {
            dictionary: dictionary.to_owned(),
            marker_mm: marker_mm.unwrap_or(MARKER_SHARE * square_mm),
        };
        let kinds = ["checkerboard-ring", "charuco-ring"];
        let found = match kind {
            "checkerboard-ring" => Some(TargetKind::CheckerboardRing),
            "charuco-ring" => Some(charuco),
            _ => None,
        };
        let kind = choice("kind", kind, found, &kinds)?;
        let colour = match top_left {
            "black" => Some(TopLeft::Black),
            "white" => Some(TopLeft::White),
            _ => None,
        };
        let top_left = choice("top_left", top_left, colour, &["black", "white"])?;
        let (row_start, col_start, row_end, col_end) = hole_squares;
        let hole = Hole { row_start, col_start, row_end, col_end };
        let target = Target {
            kind,
            rows,
            cols,
            square_mm,
            hole,
            white_albedo,
            black_albedo,
            top_left,
            patches,
        };
        match target.fault() {
            None => Ok(Self(target)),
            Some((field, expected)) => Err(argument(field, format!("{expected} expected"))),
        }
    }

    /// ``checkerboard-ring`` or ``charuco-ring``.
    #[getter]
    fn kind(&self) -> &'static str {
        match self.0.kind {
            TargetKind::CheckerboardRing => "checkerboard-ring",
            TargetKind::CharucoRing { .. } => "charuco-ring",
        }
    }

    /// Rows of squares, the hole's included.
    #[getter]
    fn rows(&self) -> u32 {
        self.0.rows
    }

    /// Columns of squares, the hole's included.
    #[getter]
    fn cols(&self) -> u32 {
        self.0.cols
    }

    /// Side of a square, mm.
    #[getter]
    fn square_mm(&self) -> f64 {
        self.0.square_mm
    }

    /// Width and height of the hole, mm.
    #[getter]
    fn hole_mm(&self) -> (f64, f64) {
        self.0.hole_mm().into()
    }

    /// Width and height of a sample whose size is not stated, mm.
    #[getter]
    fn usual_sample_mm(&self) -> (f32, f32) {
        self.0.usual_sample_mm().into()
    }

    /// The sheet to print, at true scale: ``format`` is ``pdf``, ``svg`` or ``png``, ``paper`` is ``a4``
    /// or ``letter``.
    #[pyo3(signature = (format = "pdf", *, paper = "a4"))]
    fn encode<'py>(
        &self,
        py: Python<'py>,
        format: &str,
        paper: &str,
    ) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.sheet(py, format, paper)?))
    }

    /// Writes the sheet to a file ending in ``.pdf``, ``.svg`` or ``.png``.
    #[pyo3(signature = (path, *, paper = "a4"))]
    fn write(&self, py: Python<'_>, path: PathBuf, paper: &str) -> PyResult<()> {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let bytes = self.sheet(py, &ending, paper)?;
        detached(py, || write_atomic(path, &bytes))
    }

    fn __repr__(&self) -> String {
        let Target { rows, cols, square_mm, .. } = &self.0;
        format!("<Board {} of {rows} x {cols} squares of {square_mm} mm>", self.kind())
    }
}

impl Board {
    fn sheet(&self, py: Python<'_>, format: &str, paper: &str) -> PyResult<Vec<u8>> {
        let found = match format {
            "pdf" => Some(SheetFormat::Pdf),
            "svg" => Some(SheetFormat::Svg),
            "png" => Some(SheetFormat::Png),
            _ => None,
        };
        let format = choice("format", format, found, &["pdf", "svg", "png"])?;
        let found = match paper {
            "a4" => Some(Paper::A4),
            "letter" => Some(Paper::Letter),
            _ => None,
        };
        let paper = choice("paper", paper, found, &["a4", "letter"])?;
        detached(py, || BoardSheet::new(&self.0, paper)?.encode(format))
    }
}
