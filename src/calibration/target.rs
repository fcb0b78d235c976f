//! The printed board around the sample.

use super::markers::{Dictionary, Marker};
use crate::photo::Encoding;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Gap between the lowest row of squares and the patches, side of a patch, and spacing of the patches, mm.
const PATCH_GAP_MM: f64 = 8.0;
const PATCH_SIDE_MM: f64 = 15.0;
const PATCH_STEP_MM: f64 = 20.0;
/// sRGB value of the middle patch.
const PATCH_GRAY: f64 = 0.5;

/// A patch printed below the ring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Centre in the board frame, mm.
    pub centre_mm: DVec2,
    /// Side, mm.
    pub side_mm: f64,
    /// Printed sRGB value: 0 black, 1 paper.
    pub gray: f64,
}

/// Kind of board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum TargetKind {
    /// A checkerboard with a rectangular hole for the sample.
    CheckerboardRing,
    /// The same with an ArUco marker in every printed white square.
    CharucoRing {
        /// OpenCV's dictionary name, e.g. `DICT_4X4_250`.
        dictionary: String,
        /// Side of a marker, mm.
        marker_mm: f64,
    },
}

/// Colour of the printed top-left square.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum TopLeft {
    /// Black.
    Black,
    /// White.
    White,
}

/// Squares left out for the sample: half-open ranges of rows and columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hole {
    /// First missing row; row 0 is the printed top.
    pub row_start: u32,
    /// First missing column; column 0 is the left.
    pub col_start: u32,
    /// Row after the last missing one.
    pub row_end: u32,
    /// Column after the last missing one.
    pub col_end: u32,
}

/// The printed board around the sample. Its centre is the origin of the board frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Kind of board.
    pub kind: TargetKind,
    /// Rows of squares, including the hole. `rows + cols` is odd, so that colours distinguish half-turns.
    pub rows: u32,
    /// Columns of squares, including the hole.
    pub cols: u32,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// The hole.
    pub hole: Hole,
    /// Diffuse albedo of white squares.
    pub white_albedo: f64,
    /// Diffuse albedo of black squares.
    pub black_albedo: f64,
    /// Colour of the top-left square.
    pub top_left: TopLeft,
    /// Whether [`Target::patches`] are printed below the ring, as `svbrdf board` does.
    pub patches: bool,
}

impl Default for Target {
    /// The board that `svbrdf board` prints: A4, 17 x 16 squares of 11.5 mm, ring three squares
    /// wide, hole 115 x 126.5 mm.
    fn default() -> Self {
        Self {
            kind: TargetKind::CheckerboardRing,
            rows: 17,
            cols: 16,
            square_mm: 11.5,
            hole: Hole { row_start: 3, col_start: 3, row_end: 14, col_end: 13 },
            white_albedo: 0.8,
            black_albedo: 0.05,
            top_left: TopLeft::Black,
            patches: true,
        }
    }
}

/// Default margin between a sample and the hole on each side, mm.
const MARGIN_MM: f64 = 5.0;

impl Target {
    /// Width and height of the hole, mm.
    pub fn hole_mm(&self) -> [f64; 2] {
        let Hole { row_start, col_start, row_end, col_end } = self.hole;
        [(col_start, col_end), (row_start, row_end)]
            .map(|(start, end)| f64::from(end.saturating_sub(start)) * self.square_mm)
    }

    /// Default width and height of a sample, mm: the largest square with a margin of 5 mm in the
    /// hole, or of a tenth of the hole's shorter side if that is less.
    pub fn usual_sample_mm(&self) -> [f32; 2] {
        let [width, height] = self.hole_mm();
        let side = width.min(height);
        [(side - 2.0 * MARGIN_MM).max(0.8 * side) as f32; 2]
    }

    /// Whether a square is printed (inside the grid, not in the hole).
    pub fn has_square(&self, row: i64, col: i64) -> bool {
        let inside = row >= 0 && col >= 0 && row < self.rows.into() && col < self.cols.into();
        let hole = &self.hole;
        inside
            && !((i64::from(hole.row_start)..hole.row_end.into()).contains(&row)
                && (i64::from(hole.col_start)..hole.col_end.into()).contains(&col))
    }

    /// Whether a square is white.
    pub fn is_white(&self, row: i64, col: i64) -> bool {
        ((row + col).rem_euclid(2) == 0) == (self.top_left == TopLeft::White)
    }

    /// Whether grid point (`row`, `col`), the upper left corner of that square, is an X-corner: all
    /// four squares around it are printed.
    pub fn has_corner(&self, row: i64, col: i64) -> bool {
        self.has_square(row - 1, col - 1)
            && self.has_square(row - 1, col)
            && self.has_square(row, col - 1)
            && self.has_square(row, col)
    }

    /// All X-corners, row by row, as (row, col) of [`Target::has_corner`].
    pub fn corners(&self) -> Vec<(u32, u32)> {
        (1..self.rows)
            .flat_map(|r| (1..self.cols).map(move |c| (r, c)))
            .filter(|&(r, c)| self.has_corner(r.into(), c.into()))
            .collect()
    }

    /// Board position of a grid point, mm; fractions lie inside squares.
    pub fn grid_mm(&self, row: f64, col: f64) -> DVec2 {
        DVec2::new(
            (col - 0.5 * f64::from(self.cols)) * self.square_mm,
            (0.5 * f64::from(self.rows) - row) * self.square_mm,
        )
    }

    /// The marker of a white square; `None` for squares without one, and for dictionaries other
    /// than `DICT_nXn_50`, `_100` and `_250` with `n` from 4 to 7. Ids count the white squares of
    /// the full grid row by row, including the hole.
    pub fn marker(&self, row: i64, col: i64) -> Option<Marker> {
        let TargetKind::CharucoRing { dictionary, .. } = &self.kind else { return None };
        if !self.has_square(row, col) || !self.is_white(row, col) {
            return None;
        }
        let cols = i64::from(self.cols);
        // Every other square is white, also from one row to the next of an odd grid.
        let id = (row * cols + col) / 2;
        Dictionary::named(dictionary).get(id as usize)
    }

    /// Black, gray and white patch below the ring, for a test of linearity.
    pub fn patches(&self) -> [Patch; 3] {
        let corner = self.grid_mm(self.rows.into(), 0.0);
        [0.0, PATCH_GRAY, 1.0].map(|gray| {
            let step = PATCH_STEP_MM * (gray * 2.0_f64).round();
            let half = 0.5 * PATCH_SIDE_MM;
            let centre_mm = corner + DVec2::new(step + half, -PATCH_GAP_MM - half);
            Patch { centre_mm, side_mm: PATCH_SIDE_MM, gray }
        })
    }

    /// Nominal diffuse albedo of a patch: interpolated between black and white squares by its linear value.
    pub fn patch_albedo(&self, patch: &Patch) -> f64 {
        let share = Encoding::Srgb.decode(patch.gray);
        self.black_albedo + (self.white_albedo - self.black_albedo) * share
    }

    /// Fault of the layout, if any: the field and the expected values.
    pub fn fault(&self) -> Option<(&'static str, String)> {
        let positive = |v: f64| v.is_finite() && v > 0.0;
        let h = &self.hole;
        if !(3..=200).contains(&self.rows) {
            return Some(("rows", "3 to 200 rows of squares".into()));
        }
        if !(3..=200).contains(&self.cols) {
            return Some(("cols", "3 to 200 columns of squares".into()));
        }
        if (self.rows + self.cols).is_multiple_of(2) {
            return Some(("cols", "rows + cols odd, so that colours tell a half-turn".into()));
        }
        if !positive(self.square_mm) {
            return Some(("square_mm", "a positive length in mm".into()));
        }
        if h.row_start >= h.row_end
            || h.col_start >= h.col_end
            || h.row_end > self.rows
            || h.col_end > self.cols
        {
            return Some((
                "hole_squares",
                format!(
                    "[first row, first column, end row, end column], half open, inside {} x {}",
                    self.rows, self.cols
                ),
            ));
        }
        let albedo = |v: f64| v.is_finite() && v > 0.0 && v <= 1.0;
        if !albedo(self.white_albedo) {
            return Some(("white_albedo", "an albedo in (0, 1]".into()));
        }
        if !(self.black_albedo.is_finite() && (0.0..self.white_albedo).contains(&self.black_albedo))
        {
            return Some(("black_albedo", "an albedo of at least 0, below white_albedo".into()));
        }
        if let TargetKind::CharucoRing { marker_mm, .. } = &self.kind
            && (!positive(*marker_mm) || *marker_mm >= self.square_mm)
        {
            return Some(("marker_mm", "a positive length below square_mm".into()));
        }
        if self.corners().len() < 20 {
            return Some(("hole_squares", "a ring with at least 20 inner corners".into()));
        }
        None
    }

    /// Fault that prevents printing, if any: as [`Target::fault`], or white squares without a
    /// marker in the dictionary.
    pub fn print_fault(&self) -> Option<(&'static str, String)> {
        self.fault().or_else(|| {
            let (rows, cols) = (i64::from(self.rows), i64::from(self.cols));
            let mut squares = (0..rows).flat_map(|row| (0..cols).map(move |col| (row, col)));
            let plain = self.kind == TargetKind::CheckerboardRing;
            let lacks = |row, col| {
                let white = self.has_square(row, col) && self.is_white(row, col);
                white && self.marker(row, col).is_none()
            };
            (!plain && squares.any(|(row, col)| lacks(row, col))).then(|| {
                let expected = "DICT_4X4_250 or another of 4X4 to 7X7 and _50 to _250 with a marker \
                                for each white square, the hole's included";
                ("dictionary", expected.into())
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_of_unknown_size_leaves_a_margin_of_the_hole() {
        let usual = |square_mm| {
            let hole = Hole { row_start: 3, col_start: 2, row_end: 11, col_end: 12 };
            let target = Target { square_mm, hole, ..Target::default() };
            (target.hole_mm(), target.usual_sample_mm())
        };
        assert_eq!(usual(10.0), ([100.0, 80.0], [70.0; 2]));
        assert_eq!(usual(2.5), ([25.0, 20.0], [16.0; 2]));
    }

    #[test]
    fn corners_of_a_two_wide_ring_form_one_row_all_round() {
        let target = Target {
            rows: 17,
            cols: 16,
            square_mm: 10.0,
            hole: Hole { row_start: 2, col_start: 2, row_end: 15, col_end: 14 },
            ..Target::default()
        };
        assert_eq!(target.fault(), None);
        assert_eq!(target.corners().len(), 2 * 15 + 2 * 14);
        assert_eq!(target.grid_mm(1.0, 1.0), DVec2::new(-70.0, 75.0));
        assert!(!target.is_white(0, 0) && target.is_white(0, 1));
    }

    #[test]
    fn markers_count_white_squares() {
        let kind = TargetKind::CharucoRing { dictionary: "DICT_4X4_250".into(), marker_mm: 7.0 };
        let hole = Hole { row_start: 3, col_start: 3, row_end: 9, col_end: 9 };
        for (rows, cols) in [(17, 16), (16, 17), (14, 13)] {
            for top_left in [TopLeft::Black, TopLeft::White] {
                let target =
                    Target { kind: kind.clone(), rows, cols, top_left, hole, ..Target::default() };
                let mut id = 0;
                for row in 0..rows.into() {
                    for col in 0..cols.into() {
                        let white = target.is_white(row, col);
                        let printed = white && target.has_square(row, col);
                        let expected =
                            printed.then(|| Dictionary::named("DICT_4X4_250").get(id).unwrap());
                        assert_eq!(target.marker(row, col), expected);
                        id += usize::from(white);
                    }
                }
            }
        }
        assert_eq!(Target::default().marker(0, 1), None);
    }

    #[test]
    fn the_default_is_valid_and_an_even_board_is_not() {
        assert_eq!(Target::default().fault(), None);
        let even = Target { rows: 16, ..Target::default() };
        assert_eq!(even.fault().unwrap().0, "cols");
    }
}
