//! The known board, and the labelling of a picture's corners with its grid points.

use super::board_model::BoardModel;
use super::luma::LumaImage;
use super::markers::Placed;
use super::subpixel::{Refiner, Window};
use super::target::{Target, TargetKind};
use super::turns::symmetry;
use crate::statistics::median;
use glam::{DVec2, IVec2};

/// Least side of squares at the detection level, px.
pub(super) const CELL_MIN_PX: f64 = 5.0;
/// Search radius around predicted corners, and largest shift of detected ones, in cells.
const SEARCH_CELLS: f64 = 0.25;
/// Successive distances from labelled corners, in cells, at which corners are predicted.
const REACHES: [i64; 3] = [2, 5, i64::MAX];
/// Part of the distance to a marker that is used for edges.
const PLAIN_PART: f64 = 0.8;
/// Length of edge used on each side of a corner, in cells.
const ARM_CELLS: f64 = 0.45;
/// Bright minus dark relative to bright, on the square-root scale.
const CONTRAST_MIN: f32 = 0.1;

/// A board with the lists that labelling needs.
pub(super) struct Layout<'a> {
    pub target: &'a Target,
    /// (row, col) of every X-corner.
    pub corners: Vec<(u32, u32)>,
    /// For every turn that maps the board to itself, the image of each corner. Empty if the colours
    /// distinguish half-turns.
    pub symmetries: Vec<Vec<usize>>,
    /// Radius around a corner, in squares, within which the four squares are plain.
    plain: f64,
    /// Legible markers.
    pub markers: Vec<Placed>,
    /// White squares (column, row) in and around the grid without a marker.
    pub unprinted: Vec<IVec2>,
}

/// Detected corners, in the order of [`Layout::corners`], and the model that predicts them.
#[derive(Debug, Clone)]
pub(super) struct Labelling {
    pub px: Vec<Option<DVec2>>,
    pub model: BoardModel,
}

impl Labelling {
    pub fn count(&self) -> usize {
        self.px.iter().flatten().count()
    }
}

impl<'a> Layout<'a> {
    pub fn new(target: &'a Target) -> Self {
        let gap = match target.kind {
            TargetKind::CheckerboardRing => 0.5,
            TargetKind::CharucoRing { marker_mm, .. } => 0.5 * (1.0 - marker_mm / target.square_mm),
        };
        let corners = target.corners();
        let symmetries = (1..4).filter_map(|turn| symmetry(target, &corners, turn)).collect();
        Self {
            target,
            corners,
            symmetries,
            plain: PLAIN_PART * gap.clamp(0.08, 0.27),
            markers: printed(target),
            unprinted: unprinted(target),
        }
    }

    /// Distance from an edge, in squares, within which its two sides are plain.
    pub fn plain(&self) -> f64 {
        self.plain
    }

    /// Median of the labelled corners' smaller cell sides, px.
    pub fn usual_cell(&self, labelling: &Labelling) -> f64 {
        let labelled = labelling.px.iter().enumerate().filter(|(_, p)| p.is_some());
        median(labelled.map(|(i, _)| smallest_side(&labelling.model, self.grid(i)))).unwrap_or(0.0)
    }

    /// Printed squares around a grid point: 4 at X-corners, 3 at the corners of the hole. The
    /// latter look like X-corners if the paper in the hole has the colour of the missing square.
    pub fn squares_round(&self, row: i64, col: i64) -> usize {
        let round = [(row - 1, col - 1), (row - 1, col), (row, col - 1), (row, col)];
        round.iter().filter(|(r, c)| self.target.has_square(*r, *c)).count()
    }

    /// (column, row) of a corner.
    pub fn grid(&self, corner: usize) -> DVec2 {
        let (row, col) = self.corners[corner];
        DVec2::new(col.into(), row.into())
    }

    /// Which corners the model places inside the picture.
    pub fn visible(&self, image: &LumaImage, model: &BoardModel) -> Vec<bool> {
        (0..self.corners.len())
            .map(|i| {
                let cell = smallest_side(model, self.grid(i));
                image.contains(model.project(self.grid(i)), (0.3 * cell).max(4.0))
            })
            .collect()
    }

    /// Whether the four squares around `px` have the colours of the board, or of its continuation
    /// beyond the grid.
    pub fn looks_right(
        &self,
        image: &LumaImage,
        model: &BoardModel,
        grid: DVec2,
        px: DVec2,
    ) -> bool {
        let (row, col) = (grid.y as i64, grid.x as i64);
        let cell = model.cell(grid);
        let (u, v) = (self.plain * cell.x_axis, self.plain * cell.y_axis);
        let same = [image.sample(px + u + v), image.sample(px - u - v)];
        let other = [image.sample(px + u - v), image.sample(px - u + v)];
        let lower_right_white = self.target.is_white(row, col);
        let (bright, dark) = if lower_right_white { (same, other) } else { (other, same) };
        let contrast = 0.5 * ((bright[0] + bright[1]) - (dark[0] + dark[1]));
        contrast > CONTRAST_MIN * 0.5 * (bright[0] + bright[1])
            && bright[0].min(bright[1]) - dark[0].max(dark[1]) > 0.3 * contrast
    }

    /// Searches for predicted corners outward from labelled ones until none is added.
    pub fn extend(&self, refiner: &mut Refiner, image: &LumaImage, labelling: &mut Labelling) {
        let mut reach = 0;
        for _ in 0..20 {
            if !self.refit(image, labelling) {
                return;
            }
            let visible = self.visible(image, &labelling.model);
            let near = self.within_reach(labelling, REACHES[reach]);
            let mut added = false;
            for i in 0..self.corners.len() {
                if labelling.px[i].is_some() || !visible[i] || !near[i] {
                    continue;
                }
                let start = labelling.model.project(self.grid(i));
                labelling.px[i] =
                    self.locate(refiner, image, &labelling.model, self.grid(i), start);
                added |= labelling.px[i].is_some();
            }
            if added {
                reach = 0;
            } else if reach + 1 < REACHES.len() {
                reach += 1;
            } else {
                return;
            }
        }
    }

    /// Refines every labelled corner on this image and drops those that move away.
    pub fn refine(&self, refiner: &mut Refiner, image: &LumaImage, labelling: &mut Labelling) {
        for i in 0..self.corners.len() {
            if let Some(px) = labelling.px[i] {
                labelling.px[i] = self.locate(refiner, image, &labelling.model, self.grid(i), px);
            }
        }
        self.refit(image, labelling);
    }

    /// The corner near `start`, if there is one with the right colours.
    fn locate(
        &self,
        refiner: &mut Refiner,
        image: &LumaImage,
        model: &BoardModel,
        grid: DVec2,
        start: DVec2,
    ) -> Option<DVec2> {
        let cell = model.cell(grid);
        let side = cell.x_axis.length().min(cell.y_axis.length());
        let reach = (SEARCH_CELLS * side).max(1.5);
        // The square window has the larger capture range, the cross is more precise.
        let across = self.plain / PLAIN_PART;
        let square = Window { along: across, across };
        let cross = Window { along: ARM_CELLS, across: across.min(ARM_CELLS) };
        let px = refiner.refine(image, start, cell, square, reach)?;
        let px = refiner.refine(image, px, cell, cross, 0.5 * reach)?;
        let predicted = model.project(grid);
        ((px - predicted).length() < reach && self.looks_right(image, model, grid, px))
            .then_some(px)
    }

    /// Share of the visible grid points off the printed squares (in the hole and one square beyond
    /// the outline) that show corners. A large share means another board.
    pub fn phantom_share(
        &self,
        refiner: &mut Refiner,
        image: &LumaImage,
        labelling: &Labelling,
    ) -> f64 {
        let (rows, cols) = (i64::from(self.target.rows), i64::from(self.target.cols));
        let points = (-1..=rows + 1).flat_map(|row| (-1..=cols + 1).map(move |col| (row, col)));
        let (mut looked, mut phantoms) = (0, 0);
        for (row, col) in points.filter(|&(row, col)| self.squares_round(row, col) < 3) {
            let grid = DVec2::new(col as f64, row as f64);
            let start = labelling.model.project(grid);
            let cell = smallest_side(&labelling.model, grid);
            if cell < CELL_MIN_PX || !image.contains(start, (0.3 * cell).max(4.0)) {
                continue;
            }
            looked += 1;
            let found = self.locate(refiner, image, &labelling.model, grid, start);
            phantoms += usize::from(found.is_some());
        }
        f64::from(phantoms as u32) / f64::from(looked.max(1))
    }

    /// Fits the model to the labelled corners and drops outliers; false if too few remain.
    fn refit(&self, image: &LumaImage, labelling: &mut Labelling) -> bool {
        for _ in 0..3 {
            let labelled: Vec<(usize, DVec2)> =
                labelling.px.iter().enumerate().filter_map(|(i, p)| Some((i, (*p)?))).collect();
            let grid: Vec<DVec2> = labelled.iter().map(|(i, _)| self.grid(*i)).collect();
            let px: Vec<DVec2> = labelled.iter().map(|(_, p)| *p).collect();
            let Some(model) = BoardModel::fit((image.width, image.height), &grid, &px) else {
                return false;
            };
            labelling.model = model;
            let residuals: Vec<f64> =
                grid.iter().zip(&px).map(|(g, p)| (model.project(*g) - *p).length()).collect();
            let usual = median(residuals.iter().copied()).map_or(0.0, |middle| 5.0 * middle);
            let mut dropped = false;
            for ((i, _), (g, r)) in labelled.iter().zip(grid.iter().zip(residuals)) {
                let cell = smallest_side(&model, *g);
                let limit = usual.max(0.1 * cell).max(0.5).min((SEARCH_CELLS * cell).max(1.5));
                if r > limit {
                    labelling.px[*i] = None;
                    dropped = true;
                }
            }
            if !dropped {
                return true;
            }
        }
        true
    }

    /// Which corners have a labelled one within `reach` cells.
    fn within_reach(&self, labelling: &Labelling, reach: i64) -> Vec<bool> {
        let labelled: Vec<(u32, u32)> = (0..self.corners.len())
            .filter(|&i| labelling.px[i].is_some())
            .map(|i| self.corners[i])
            .collect();
        let near = |a: u32, b: u32| i64::from(a.abs_diff(b)) <= reach;
        self.corners
            .iter()
            .map(|c| labelled.iter().any(|l| near(c.0, l.0) && near(c.1, l.1)))
            .collect()
    }
}

/// Shorter side of the cell at a grid point, px.
fn smallest_side(model: &BoardModel, grid: DVec2) -> f64 {
    let cell = model.cell(grid);
    cell.x_axis.length().min(cell.y_axis.length())
}

/// Markers of the ring as (column, row); empty without known markers.
fn printed(target: &Target) -> Vec<Placed> {
    let squares = (0..i64::from(target.rows))
        .flat_map(|row| (0..i64::from(target.cols)).map(move |col| (row, col)));
    squares
        .filter_map(|(row, col)| {
            let marker = target.marker(row, col)?;
            Some(Placed { square: IVec2::new(col as i32, row as i32), marker })
        })
        .collect()
}

/// White squares of the grid and of two rows and columns beyond it that hold no marker.
fn unprinted(target: &Target) -> Vec<IVec2> {
    if printed(target).is_empty() {
        return Vec::new();
    }
    let squares = (-2..i64::from(target.rows) + 2)
        .flat_map(|row| (-2..i64::from(target.cols) + 2).map(move |col| (row, col)));
    squares
        .filter(|&(row, col)| target.is_white(row, col) && !target.has_square(row, col))
        .map(|(row, col)| IVec2::new(col as i32, row as i32))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::target::Hole;
    use super::*;

    #[test]
    fn boards_that_look_alike_after_a_turn_are_known() {
        let ring = Target::default();
        assert!(Layout::new(&ring).symmetries.is_empty());
        let none = Hole { row_start: 0, col_start: 0, row_end: 0, col_end: 0 };
        let full = |rows, cols| Target { rows, cols, hole: none, ..Target::default() };
        assert_eq!(Layout::new(&full(7, 10)).symmetries.len(), 0);
        assert_eq!(Layout::new(&full(7, 9)).symmetries.len(), 1);
        assert_eq!(Layout::new(&full(6, 6)).symmetries.len(), 1);
        let square = full(7, 7);
        let layout = Layout::new(&square);
        assert_eq!(layout.symmetries.len(), 3);
        for symmetry in &layout.symmetries {
            let mut sorted = symmetry.clone();
            sorted.sort_unstable();
            assert!(sorted.into_iter().eq(0..layout.corners.len()));
        }
    }
}
