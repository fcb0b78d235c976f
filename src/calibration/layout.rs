//! Tells which corner is which: places grown pieces of lattice on the known board, then labels all
//! corners that the placement predicts.

use super::board_model::BoardModel;
use super::lattice::Node;
use super::luma::LumaImage;
use super::marker_reading;
use super::markers::Placed;
use super::subpixel::{Refiner, Window};
use super::target::{Target, TargetKind};
use crate::Rejection;
use glam::{DMat3, DVec2, DVec3, IVec2};

/// Corners without which no placement is trusted.
pub(super) const CORNERS_MIN: usize = 20;
/// Pieces of lattice smaller than this start no placement.
const PIECE_MIN: usize = 6;
const PIECES_TRIED: usize = 12;
const PLACEMENTS_GROWN: usize = 4;
/// Share of a piece's corners that may lie where the board has none.
const PHANTOM_SHARE_MAX: f64 = 0.12;
/// Side of squares at the level at which the board is found, px.
const CELL_MIN_PX: f64 = 5.0;
/// A predicted corner is looked for, and a found one kept, within this part of a cell.
const SEARCH_CELLS: f64 = 0.25;
/// Corners are predicted this many cells beyond labelled ones, further when none is found there.
const REACHES: [i64; 3] = [2, 5, i64::MAX];
/// Part of the distance to a marker that is sampled and gathered for edges.
const PLAIN_PART: f64 = 0.8;
/// Length of edge gathered on each side of a corner, in cells.
const ARM_CELLS: f64 = 0.45;
/// Bright minus dark relative to bright (square-root scale).
const CONTRAST_MIN: f32 = 0.1;

/// A board with the lists that labelling needs.
pub(super) struct Layout<'a> {
    pub target: &'a Target,
    /// (row, col) of every X-corner.
    pub corners: Vec<(u32, u32)>,
    /// Corner that each corner goes to, for every turn that maps the board to itself. None for
    /// boards whose colours tell half-turns apart.
    symmetries: Vec<Vec<usize>>,
    /// How far from a corner, in squares, the four squares round it are plain.
    plain: f64,
    /// Markers that can be read.
    pub markers: Vec<Placed>,
    /// White squares (column, row) in and round the grid without one.
    pub unprinted: Vec<IVec2>,
}

/// Corners found, in the order of [`Layout::corners`], and the model that predicts them.
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
            markers: marker_reading::printed(target),
            unprinted: marker_reading::unprinted(target),
        }
    }

    /// Distance from an edge, in squares, within which its two sides are plain.
    pub fn plain(&self) -> f64 {
        self.plain
    }

    /// Median of the labelled corners' smaller cell sides, px.
    pub fn usual_cell(&self, labelling: &Labelling) -> f64 {
        let labelled = labelling.px.iter().enumerate().filter(|(_, p)| p.is_some());
        let mut cells: Vec<f64> =
            labelled.map(|(i, _)| smallest_side(&labelling.model, self.grid(i))).collect();
        cells.sort_unstable_by(f64::total_cmp);
        cells.get(cells.len() / 2).copied().unwrap_or(0.0)
    }

    /// Printed squares round a grid point: 4 at X-corners, 3 at the hole's corners, which look
    /// like X-corners when the paper in the hole has the missing square's colour.
    fn squares_round(&self, row: i64, col: i64) -> usize {
        let round = [(row - 1, col - 1), (row - 1, col), (row, col - 1), (row, col)];
        round.iter().filter(|(r, c)| self.target.has_square(*r, *c)).count()
    }

    /// (column, row) of a corner.
    pub fn grid(&self, corner: usize) -> DVec2 {
        let (row, col) = self.corners[corner];
        DVec2::new(col.into(), row.into())
    }

    /// Which corners the model puts inside the picture.
    pub fn visible(&self, image: &LumaImage, model: &BoardModel) -> Vec<bool> {
        (0..self.corners.len())
            .map(|i| {
                let cell = smallest_side(model, self.grid(i));
                image.contains(model.project(self.grid(i)), (0.3 * cell).max(4.0))
            })
            .collect()
    }

    /// Whether the four squares round `px` look as the board has them, or would have them where
    /// the grid goes on.
    fn looks_right(&self, image: &LumaImage, model: &BoardModel, grid: DVec2, px: DVec2) -> bool {
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

    /// Finds the one placement of the pieces on the board that the picture supports.
    ///
    /// # Errors
    /// [`Rejection::BoardNotFound`] when no placement fits, [`Rejection::TooFewCorners`] when one
    /// fits but too little is seen, or several fit equally.
    pub fn place(&self, image: &LumaImage, pieces: &[Vec<Node>]) -> Result<Labelling, Rejection> {
        let mut placements: Vec<(f64, Labelling)> = Vec::new();
        for piece in pieces.iter().filter(|p| p.len() >= PIECE_MIN).take(PIECES_TRIED) {
            self.placements_of(image, piece, &mut placements);
        }
        placements.sort_by(|a, b| b.0.total_cmp(&a.0));
        placements.truncate(PLACEMENTS_GROWN);
        let mut refiner = Refiner::default();
        let mut grown: Vec<(f64, Labelling)> = Vec::new();
        for (_, mut labelling) in placements {
            self.extend(&mut refiner, image, &mut labelling);
            // Squares narrower than what tells a corner look right anywhere.
            if self.usual_cell(&labelling) < CELL_MIN_PX {
                continue;
            }
            let visible = self.visible(image, &labelling.model);
            let seen = visible.iter().filter(|v| **v).count();
            let found = labelling.count();
            let score = 1.5 * found as f64 - 0.5 * seen as f64;
            // Placements that grow into the same labelling are one, and so are those that a
            // symmetry of the board exchanges.
            if !grown.iter().any(|(_, other)| self.same_labels(other, &labelling)) {
                grown.push((score, labelling));
            }
        }
        grown.sort_by(|a, b| b.0.total_cmp(&a.0));
        let expected = self.corners.len();
        let Some((score, best)) = grown.first() else { return Err(Rejection::BoardNotFound) };
        let found = best.count();
        let too_few = |needed: usize| {
            Err(Rejection::TooFewCorners {
                found: found as u32,
                expected: expected as u32,
                needed: needed.min(expected) as u32,
            })
        };
        if found < CORNERS_MIN {
            return if found >= 2 * PIECE_MIN {
                too_few(CORNERS_MIN)
            } else {
                Err(Rejection::BoardNotFound)
            };
        }
        if let Some((second, _)) = grown.get(1)
            && score - second < (0.08 * found as f64).max(3.0)
        {
            return too_few(found + 4);
        }
        Ok(best.clone())
    }

    /// Whether two labellings name most corners alike, up to a symmetry of the board.
    fn same_labels(&self, a: &Labelling, b: &Labelling) -> bool {
        let alike = |target: &dyn Fn(usize) -> usize| {
            let both = a.px.iter().enumerate().filter_map(|(i, p)| Some(((*p)?, b.px[target(i)]?)));
            let (mut same, mut all) = (0, 0);
            for (p, q) in both {
                all += 1;
                same += usize::from(p.distance(q) < 1.0);
            }
            2 * same > all
        };
        alike(&|i| i) || self.symmetries.iter().any(|s| alike(&|i| s[i]))
    }

    /// Scores every placement of a piece by rotation and shift.
    fn placements_of(
        &self,
        image: &LumaImage,
        piece: &[Node],
        placements: &mut Vec<(f64, Labelling)>,
    ) {
        let lattice: Vec<DVec2> = piece.iter().map(|n| n.at.as_dvec2()).collect();
        let px: Vec<DVec2> = piece.iter().map(|n| n.px).collect();
        let Some(model) = BoardModel::fit((image.width, image.height), &lattice, &px) else {
            return;
        };
        let size = IVec2::new(self.target.cols as i32, self.target.rows as i32);
        let phantoms_max = PHANTOM_SHARE_MAX * piece.len() as f64;
        for turn in 0..4 {
            let turned: Vec<IVec2> = piece.iter().map(|n| rotate(n.at, turn)).collect();
            // Phantoms may stick out on any side.
            let (left, right) = extent(turned.iter().map(|at| at.x), phantoms_max as usize);
            let (top, bottom) = extent(turned.iter().map(|at| at.y), phantoms_max as usize);
            for dy in -top..=size.y - bottom {
                for dx in -left..=size.x - right {
                    let shift = IVec2::new(dx, dy);
                    let phantoms = turned.iter().zip(piece).filter(|(at, node)| {
                        let p = **at + shift;
                        let (row, col) = (i64::from(p.y), i64::from(p.x));
                        let white = self.target.is_white(row, col) ^ (turn % 2 == 1);
                        node.bright != white || self.squares_round(row, col) < 3
                    });
                    let phantoms = phantoms.count();
                    if phantoms as f64 > phantoms_max {
                        continue;
                    }
                    // Board grid to lattice: shift back, turn back.
                    let board = model.in_grid(lattice_of_board(turn, shift));
                    let visible = self.visible(image, &board);
                    let (mut matched, mut missed) = (0.0, 0.0);
                    for i in (0..self.corners.len()).filter(|&i| visible[i]) {
                        if self.looks_right(
                            image,
                            &board,
                            self.grid(i),
                            board.project(self.grid(i)),
                        ) {
                            matched += 1.0;
                        } else {
                            missed += 1.0;
                        }
                    }
                    let mut found = vec![None; self.corners.len()];
                    for (at, node) in turned.iter().zip(piece) {
                        let p = *at + shift;
                        let at = (p.y.max(0) as u32, p.x.max(0) as u32);
                        if let Ok(i) = self.corners.binary_search(&at)
                            && self.looks_right(image, &board, self.grid(i), node.px)
                        {
                            found[i] = Some(node.px);
                        }
                    }
                    let score = matched - 0.5 * missed - 2.0 * phantoms as f64;
                    placements.push((score, Labelling { px: found, model: board }));
                }
            }
        }
    }

    /// Looks for predicted corners, outward from labelled ones, until none is added.
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

    /// Refines every labelled corner on this image and drops those that do not stay.
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
        // A square window draws the start in, the cross is the more precise.
        let across = self.plain / PLAIN_PART;
        let square = Window { along: across, across };
        let cross = Window { along: ARM_CELLS, across: across.min(ARM_CELLS) };
        let px = refiner.refine(image, start, cell, square, reach)?;
        let px = refiner.refine(image, px, cell, cross, 0.5 * reach)?;
        let predicted = model.project(grid);
        ((px - predicted).length() < reach && self.looks_right(image, model, grid, px))
            .then_some(px)
    }

    /// Share of the visible grid points off the printed squares, in the hole and one square beyond
    /// the outline, that show corners: where the checks go on it is not this board.
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

    /// Fits the model to the labelled corners and drops those that do not fit; false when too few
    /// are left for a model.
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
            let mut sorted = residuals.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            let usual = 5.0 * sorted[sorted.len() / 2];
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

/// Least and greatest of the numbers when so many are left out at each end.
fn extent(values: impl Iterator<Item = i32>, left_out: usize) -> (i32, i32) {
    let mut sorted: Vec<i32> = values.collect();
    sorted.sort_unstable();
    (sorted[left_out], sorted[sorted.len() - 1 - left_out])
}

/// Quarter turns clockwise as displayed.
fn rotate(p: IVec2, turn: usize) -> IVec2 {
    match turn {
        0 => p,
        1 => IVec2::new(-p.y, p.x),
        2 => -p,
        _ => IVec2::new(p.y, -p.x),
    }
}

/// Grid point of the board at a lattice position of a piece placed by turn and shift.
pub(super) fn board_of_lattice(at: IVec2, turn: usize, shift: IVec2) -> IVec2 {
    rotate(at, turn) + shift
}

/// Homogeneous map from board grid to lattice positions; undoes `rotate` by `turn`, then `shift`.
fn lattice_of_board(turn: usize, shift: IVec2) -> DMat3 {
    let back = (4 - turn) % 4;
    let (x, y) = (rotate(IVec2::X, back).as_dvec2(), rotate(IVec2::Y, back).as_dvec2());
    let origin = rotate(-shift, back).as_dvec2();
    DMat3::from_cols(x.extend(0.0), y.extend(0.0), DVec3::new(origin.x, origin.y, 1.0))
}

/// Where corners go when the board is turned by quarter turns about its centre, if that leaves it
/// unchanged.
fn symmetry(target: &Target, corners: &[(u32, u32)], turn: usize) -> Option<Vec<usize>> {
    if turn % 2 == 1 && target.rows != target.cols {
        return None;
    }
    // Twice the offset from the centre stays whole for corners and squares alike.
    let (rows, cols) = (target.rows as i32, target.cols as i32);
    let turned = |row2: i32, col2: i32| {
        let p = rotate(IVec2::new(col2 - cols, row2 - rows), turn) + IVec2::new(cols, rows);
        (p.y, p.x)
    };
    for row in 0..rows {
        for col in 0..cols {
            let (row2, col2) = turned(2 * row + 1, 2 * col + 1);
            let (r, c) = (i64::from(row2 / 2), i64::from(col2 / 2));
            let (row, col) = (i64::from(row), i64::from(col));
            let printed = target.has_square(row, col);
            if printed != target.has_square(r, c)
                || (printed && target.is_white(row, col) != target.is_white(r, c))
            {
                return None;
            }
        }
    }
    corners
        .iter()
        .map(|&(row, col)| {
            let (row2, col2) = turned(2 * row as i32, 2 * col as i32);
            corners.binary_search(&((row2 / 2) as u32, (col2 / 2) as u32)).ok()
        })
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

    #[test]
    fn quarter_turns_and_shifts_are_undone() {
        for turn in 0..4 {
            let shift = IVec2::new(3, -7);
            let back = lattice_of_board(turn, shift);
            for p in [IVec2::new(0, 0), IVec2::new(5, 2), IVec2::new(-1, 4)] {
                let board = (rotate(p, turn) + shift).as_dvec2();
                assert_eq!((back * board.extend(1.0)).truncate(), p.as_dvec2());
            }
        }
    }
}
