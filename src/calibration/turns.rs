//! Quarter turns of the board: positions in a piece of lattice and on the board, and symmetries of the board.

use super::target::Target;
use glam::{DMat3, DVec3, IVec2};

/// Quarter turns clockwise as displayed.
pub(super) fn rotate(p: IVec2, turn: usize) -> IVec2 {
    match turn {
        0 => p,
        1 => IVec2::new(-p.y, p.x),
        2 => -p,
        _ => IVec2::new(p.y, -p.x),
    }
}

/// Board grid point of a lattice position, for a piece placed by turn and shift.
pub(super) fn board_of_lattice(at: IVec2, turn: usize, shift: IVec2) -> IVec2 {
    rotate(at, turn) + shift
}

/// Homogeneous map from board grid to lattice positions: the inverse of `rotate` by `turn` plus `shift`.
pub(super) fn lattice_of_board(turn: usize, shift: IVec2) -> DMat3 {
    let back = (4 - turn) % 4;
    let (x, y) = (rotate(IVec2::X, back).as_dvec2(), rotate(IVec2::Y, back).as_dvec2());
    let origin = rotate(-shift, back).as_dvec2();
    DMat3::from_cols(x.extend(0.0), y.extend(0.0), DVec3::new(origin.x, origin.y, 1.0))
}

/// Image of each corner under quarter turns of the board about its centre, if the board is symmetric.
pub(super) fn symmetry(target: &Target, corners: &[(u32, u32)], turn: usize) -> Option<Vec<usize>> {
    if turn % 2 == 1 && target.rows != target.cols {
        return None;
    }
    // Doubled offsets from the centre are integers for corners and squares.
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
    use super::*;

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
