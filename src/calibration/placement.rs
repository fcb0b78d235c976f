//! Identifies corners: places grown pieces of lattice on the known board.

use super::board_model::BoardModel;
use super::lattice::Node;
use super::layout::{CELL_MIN_PX, Labelling, Layout};
use super::luma::LumaImage;
use super::subpixel::Refiner;
use super::turns::{lattice_of_board, rotate};
use crate::Rejection;
use glam::{DVec2, IVec2};

/// Fewest corners of a reliable placement.
pub(super) const CORNERS_MIN: usize = 20;
/// Fewest corners of a piece that starts a placement.
const PIECE_MIN: usize = 6;
const PIECES_TRIED: usize = 12;
const PLACEMENTS_GROWN: usize = 4;
/// Largest share of a piece's corners outside the board's corners.
const PHANTOM_SHARE_MAX: f64 = 0.12;

impl Layout<'_> {
    /// Finds the one placement of the pieces that the picture supports.
    ///
    /// # Errors
    /// [`Rejection::BoardNotFound`] if no placement fits, [`Rejection::TooFewCorners`] if one fits
    /// but too little is visible, [`Rejection::PlacementAmbiguous`] if several fit equally.
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
            // Narrower squares look right anywhere.
            if self.usual_cell(&labelling) < CELL_MIN_PX {
                continue;
            }
            let visible = self.visible(image, &labelling.model);
            let seen = visible.iter().filter(|v| **v).count();
            let found = labelling.count();
            let score = 1.5 * found as f64 - 0.5 * seen as f64;
            // Placements that grow into the same labelling, or that a symmetry of the board
            // exchanges, are one.
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
            return Err(Rejection::PlacementAmbiguous { found: found as u32 });
        }
        Ok(best.clone())
    }

    /// Whether two labellings agree on most corners, up to a symmetry of the board.
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
}

/// Smallest and largest number without `left_out` numbers at each end.
fn extent(values: impl Iterator<Item = i32>, left_out: usize) -> (i32, i32) {
    let mut sorted: Vec<i32> = values.collect();
    sorted.sort_unstable();
    (sorted[left_out], sorted[sorted.len() - 1 - left_out])
}
