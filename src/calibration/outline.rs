//! Checks whether the outermost rows and columns of a board are printed as described.

use super::board_model::BoardModel;
use super::layout::Layout;
use super::luma::LumaImage;
use crate::Side;
use glam::DVec2;

/// Contrast of two squares along the outline relative to the two squares behind them, below which
/// they count as not printed.
const CONTRAST_SHARE: f32 = 0.3;
/// Least contrast of visible squares, white minus black relative to white, on the square-root scale.
const CONTRAST_MIN: f32 = 0.2;
/// Fewest pairs checked, and the share that must be missing.
const LOOKED_MIN: usize = 4;
const MISSING_SHARE: f64 = 0.85;
/// Narrower squares are not checked, px.
const SQUARE_MIN_PX: f64 = 5.0;

/// The side of the board without squares although the next row or column is printed.
pub(super) fn missing(layout: &Layout, image: &LumaImage, model: &BoardModel) -> Option<Side> {
    // A full checkerboard for camera calibration is often printed up to the edge of its sheet,
    // where its outer squares merge with the background.
    let hole = &layout.target.hole;
    if hole.row_start == hole.row_end {
        return None;
    }
    let (rows, cols) = (i64::from(layout.target.rows), i64::from(layout.target.cols));
    // Each line of squares by its first square, the step along it and the step to the next line.
    [
        (Side::Top, (0, 0), (0, 1), (1, 0), cols),
        (Side::Bottom, (rows - 1, 0), (0, 1), (-1, 0), cols),
        (Side::Left, (0, 0), (1, 0), (0, 1), rows),
        (Side::Right, (0, cols - 1), (1, 0), (0, -1), rows),
    ]
    .into_iter()
    .find(|&(_, first, along, inward, count)| {
        let (mut looked, mut missing) = (0, 0);
        for k in 0..count - 1 {
            let step = |from: (i64, i64), by: (i64, i64)| (from.0 + by.0, from.1 + by.1);
            let square = (first.0 + k * along.0, first.1 + k * along.1);
            let pair = [square, step(square, along)];
            let Some(outer) = contrast(layout, image, model, pair) else { continue };
            let Some(inner) = contrast(layout, image, model, pair.map(|s| step(s, inward))) else {
                continue;
            };
            // Skip pairs whose inner neighbours are not visible either.
            if inner > CONTRAST_MIN {
                looked += 1;
                missing += usize::from(outer < CONTRAST_SHARE * inner);
            }
        }
        looked >= LOOKED_MIN && missing as f64 >= MISSING_SHARE * looked as f64
    })
    .map(|line| line.0)
}

/// Contrast of two neighbouring squares, white minus black relative to white; `None` if not printed
/// or not visible.
fn contrast(
    layout: &Layout,
    image: &LumaImage,
    model: &BoardModel,
    pair: [(i64, i64); 2],
) -> Option<f32> {
    if !pair.iter().all(|(row, col)| layout.target.has_square(*row, *col)) {
        return None;
    }
    let [a, b] = pair;
    let [a, b] = [level(layout, image, model, a)?, level(layout, image, model, b)?];
    let (white, black) = if layout.target.is_white(pair[0].0, pair[0].1) { (a, b) } else { (b, a) };
    Some((white - black) / white.max(1e-6))
}

/// Level of a square in its middle, or beside the marker in white ones. `None` outside the picture,
/// or if squares are too small.
fn level(
    layout: &Layout,
    image: &LumaImage,
    model: &BoardModel,
    (row, col): (i64, i64),
) -> Option<f32> {
    let at = |x: f64, y: f64| model.project(DVec2::new(col as f64 + x, row as f64 + y));
    let corners = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
    let side = (corners[1] - corners[0]).length().min((corners[2] - corners[0]).length());
    if side < SQUARE_MIN_PX || !corners.iter().all(|c| image.contains(*c, 0.0)) {
        return None;
    }
    let sample = |x: f64, y: f64| image.sample(at(x, y));
    if !layout.target.is_white(row, col) || layout.markers.is_empty() {
        let d = 0.15;
        let points = [(0.5, 0.5), (0.5 - d, 0.5), (0.5 + d, 0.5), (0.5, 0.5 - d), (0.5, 0.5 + d)];
        return Some(points.iter().map(|(x, y)| sample(*x, *y)).sum::<f32>() / 5.0);
    }
    let rim = 0.6 * layout.plain();
    let points = [(0.5, rim), (0.5, 1.0 - rim), (rim, 0.5), (1.0 - rim, 0.5)];
    Some(points.iter().map(|(x, y)| sample(*x, *y)).fold(0.0, f32::max))
}

#[cfg(test)]
mod tests {
    use super::super::target::{Hole, Target};
    use super::*;

    /// A picture of a board from above, 20 px per square.
    fn picture(target: &Target) -> LumaImage {
        let (width, height) = (20 * target.cols as usize + 80, 20 * target.rows as usize + 80);
        let data = (0..width * height)
            .map(|i| {
                let square = |v: usize| (v as i64 - 40).div_euclid(20);
                let (row, col) = (square(i / width), square(i % width));
                let black = target.has_square(row, col) && !target.is_white(row, col);
                if black { 0.22 } else { 0.9 }
            })
            .collect();
        LumaImage { width, height, data }
    }

    /// Model of the grid in such a picture, with the description's first square at `[row, col]`.
    fn model(image: &LumaImage, [row, col]: [f64; 2]) -> BoardModel {
        let grid: Vec<DVec2> =
            (0..100).map(|i| DVec2::new(f64::from(i % 10), f64::from(i / 10))).collect();
        let px = |g: &DVec2| 20.0 * (*g + DVec2::new(col, row)) + 39.5;
        let px: Vec<DVec2> = grid.iter().map(px).collect();
        BoardModel::fit((image.width, image.height), &grid, &px).unwrap()
    }

    #[test]
    fn a_row_or_column_too_many_is_missing() {
        let hole = Hole { row_start: 3, col_start: 2, row_end: 16, col_end: 12 };
        let printed = Target { rows: 19, cols: 14, hole, ..Target::default() };
        let image = picture(&printed);
        let layout = Layout::new(&printed);
        assert_eq!(missing(&layout, &image, &model(&image, [0.0; 2])), None);
        let larger = |row: u32, col: u32, rows, cols| {
            let hole = Hole {
                row_start: hole.row_start + row,
                row_end: hole.row_end + row,
                col_start: hole.col_start + col,
                col_end: hole.col_end + col,
            };
            // The shift determines the colour of the first square.
            let top_left = if printed.is_white(-i64::from(row), -i64::from(col)) {
                super::super::target::TopLeft::White
            } else {
                super::super::target::TopLeft::Black
            };
            Target { rows, cols, hole, top_left, ..printed.clone() }
        };
        for (row, col, rows, cols, side) in [
            (1, 1, 20, 15, Side::Top),
            (0, 0, 20, 14, Side::Bottom),
            (0, 1, 19, 15, Side::Left),
            (0, 0, 19, 15, Side::Right),
        ] {
            let stated = larger(row, col, rows, cols);
            let layout = Layout::new(&stated);
            let model = model(&image, [-f64::from(row), -f64::from(col)]);
            assert_eq!(missing(&layout, &image, &model), Some(side), "{rows} x {cols}");
        }
    }
}
