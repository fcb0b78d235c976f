//! The printed board and the camera.

use std::ffi::{CStr, c_char};
use std::mem::offset_of;

use engine::calibration::{Hole, Target, TargetKind, TopLeft};
use engine::geometry::Camera;

use crate::status::{Fault, entry, svbrdf_status};
use crate::values::{truth, unknown};
use crate::versioned::{self, defaults, versioned};

/// Kind of board.
pub type svbrdf_board_kind = u32;
/// A checkerboard with a rectangular hole for the sample.
pub const SVBRDF_BOARD_CHECKERBOARD_RING: svbrdf_board_kind = 1;
/// The same with an ArUco marker in every printed white square.
pub const SVBRDF_BOARD_CHARUCO_RING: svbrdf_board_kind = 2;

/// The printed board round the sample.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_board {
    /// Size of this struct.
    pub size: usize,
    /// One of SVBRDF_BOARD_.
    pub kind: svbrdf_board_kind,
    /// Rows of squares, the hole's included; rows + cols is odd.
    pub rows: u32,
    /// Columns of squares, the hole's included.
    pub cols: u32,
    /// First row of the hole, counted from the printed top.
    pub hole_row_start: u32,
    /// First column of the hole, counted from the left.
    pub hole_col_start: u32,
    /// Row after the hole's last.
    pub hole_row_end: u32,
    /// Column after the hole's last.
    pub hole_col_end: u32,
    /// 1 when the printed top-left square is white, 0 when it is black.
    pub top_left_white: u32,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// Diffuse albedo of white squares.
    pub white_albedo: f64,
    /// Diffuse albedo of black squares.
    pub black_albedo: f64,
    /// For ChArUco: side of a marker, mm.
    pub marker_mm: f64,
    /// For ChArUco: OpenCV's dictionary name, e.g. "DICT_4X4_250"; needed during the call only.
    pub dictionary: *const c_char,
    /// 1: black, gray and white patches are printed below the ring, as `svbrdf board` does; they show
    /// whether photos are linear. Default: 1. Set 0 for boards from elsewhere.
    pub patches: u32,
    /// 0.
    pub reserved: u32,
}

impl Default for svbrdf_board {
    fn default() -> Self {
        let target = Target::default();
        Self {
            kind: SVBRDF_BOARD_CHECKERBOARD_RING,
            rows: target.rows,
            cols: target.cols,
            hole_row_start: target.hole.row_start,
            hole_col_start: target.hole.col_start,
            hole_row_end: target.hole.row_end,
            hole_col_end: target.hole.col_end,
            top_left_white: (target.top_left == TopLeft::White).into(),
            square_mm: target.square_mm,
            white_albedo: target.white_albedo,
            black_albedo: target.black_albedo,
            patches: target.patches.into(),
            ..versioned::zeroed()
        }
    }
}
versioned!(svbrdf_board, offset_of!(svbrdf_board, patches));

/// Fills a board with the default one (A4, 17 x 16 squares of 11.5 mm): pass
/// sizeof(svbrdf_board).
///
/// # Safety
/// `board` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_board_init(board: *mut svbrdf_board, size: usize) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(board, size) })
}

impl svbrdf_board {
    /// # Safety
    /// `dictionary` is NULL or a C string.
    pub(crate) unsafe fn target(&self) -> Result<Target, Fault> {
        let kind = match self.kind {
            SVBRDF_BOARD_CHECKERBOARD_RING => TargetKind::CheckerboardRing,
            SVBRDF_BOARD_CHARUCO_RING => {
                if self.dictionary.is_null() {
                    return Err(Fault::argument("svbrdf_board.dictionary: NULL given"));
                }
                // SAFETY: not NULL, and the caller vouches for the rest.
                let name = unsafe { CStr::from_ptr(self.dictionary) };
                let dictionary = name.to_str().unwrap_or_default().to_owned();
                if !dictionary.starts_with("DICT_") {
                    return Err(Fault::argument(
                        "svbrdf_board.dictionary: a name such as DICT_4X4_250 is expected",
                    ));
                }
                TargetKind::CharucoRing { dictionary, marker_mm: self.marker_mm }
            }
            other => return Err(unknown("svbrdf_board.kind", other)),
        };
        let white = truth("svbrdf_board.top_left_white", self.top_left_white)?;
        Ok(Target {
            kind,
            rows: self.rows,
            cols: self.cols,
            square_mm: self.square_mm,
            hole: Hole {
                row_start: self.hole_row_start,
                col_start: self.hole_col_start,
                row_end: self.hole_row_end,
                col_end: self.hole_col_end,
            },
            white_albedo: self.white_albedo,
            black_albedo: self.black_albedo,
            top_left: if white { TopLeft::White } else { TopLeft::Black },
            patches: truth("svbrdf_board.patches", self.patches)?,
        })
    }
}

/// Intrinsics of a camera. Pixel (0, 0) is the centre of the top-left pixel.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_camera {
    /// Size of this struct.
    pub size: usize,
    /// Width of the photos, px, after svbrdf_image.rotation.
    pub width: u32,
    /// Height of the photos, px, after svbrdf_image.rotation.
    pub height: u32,
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, px.
    pub cx: f64,
    /// Principal point, px.
    pub cy: f64,
    /// OpenCV's k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

defaults!(svbrdf_camera {});
versioned!(svbrdf_camera, size_of::<svbrdf_camera>());

impl svbrdf_camera {
    pub(crate) fn new(camera: Camera) -> Self {
        let Camera { width, height, fx, fy, cx, cy, distortion } = camera;
        Self { size: size_of::<Self>(), width, height, fx, fy, cx, cy, distortion }
    }
}

/// Fills a camera with zeros: pass sizeof(svbrdf_camera).
///
/// # Safety
/// `camera` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_camera_init(
    camera: *mut svbrdf_camera,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(camera, size) })
}
