//! Boards as the command line names them.

use svbrdf::calibration::{Hole, Target, TargetKind, TopLeft};

use crate::failure::{Failure, Result};

/// Squares of the default ring that are printed on each side of the hole.
const RING_WIDTH: u32 = 3;
/// Marker of a charuco ring relative to its square, unless stated.
const MARKER_SHARE: f64 = 0.72;
const DICTIONARY: &str = "DICT_4X4_250";

/// The parts of a board's text, between colons.
struct Text<'a> {
    whole: &'a str,
    parts: Vec<&'a str>,
}

/// Boards that the text may describe: both colours, if it does not state them.
pub fn targets(text: &str) -> Result<Vec<Target>> {
    let text = Text { whole: text, parts: text.split(':').collect() };
    match text.parts[0] {
        "checkerboard" => text.checkerboard(),
        "ring" if text.parts.len() == 1 => Ok(vec![Target::default()]),
        "ring" => text.ring(false),
        "charuco-ring" => text.ring(true),
        other => Err(text.fault(format!("`{other}` is not a kind of board"))),
    }
}

fn length(part: &str) -> Option<f64> {
    part.parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0 && *v < 1e6)
}

fn counts(part: &str) -> Option<(u32, u32)> {
    let (rows, cols) = part.split_once(['x', 'X'])?;
    Some((rows.parse().ok()?, cols.parse().ok()?))
}

impl Text<'_> {
    fn fault(&self, message: impl Into<String>) -> Failure {
        Failure::Input(format!(
            "--board {}: {}; expected checkerboard:ROWSxCOLS:SQUARE_MM (inner corners), \
             ring:ROWSxCOLS:SQUARE_MM:R0,C0,R1,C1 or charuco-ring:... (squares)",
            self.whole,
            message.into()
        ))
    }

    /// Rows, columns, side of a square.
    fn sizes(&self, least: u32) -> Result<(u32, u32, f64)> {
        let (rows, cols) = self
            .parts
            .get(1)
            .and_then(|p| counts(p))
            .filter(|(r, c)| (least..=200).contains(r) && (least..=200).contains(c))
            .ok_or_else(|| {
                self.fault(format!("ROWSxCOLS are two whole numbers from {least} to 200"))
            })?;
        let square = self.parts.get(2).and_then(|p| length(p));
        Ok((rows, cols, square.ok_or_else(|| self.fault("SQUARE_MM is a positive length"))?))
    }

    fn checkerboard(&self) -> Result<Vec<Target>> {
        let (rows, cols, square_mm) = self.sizes(2)?;
        if self.parts.len() > 3 {
            return Err(self.fault("there are too many parts"));
        }
        if rows * cols < 20 {
            return Err(self.fault("at least 20 inner corners are needed"));
        }
        let (rows, cols) = (rows + 1, cols + 1);
        let hole = Hole { row_start: 0, col_start: 0, row_end: 0, col_end: 0 };
        let kind = TargetKind::CheckerboardRing;
        let black = Target { kind, rows, cols, square_mm, hole, ..Target::default() };
        let black = Target { top_left: TopLeft::Black, ..black };
        // With an odd sum a half-turn swaps the colours: one of them stands for both.
        if (rows + cols) % 2 == 1 { Ok(vec![black]) } else { Ok(both_colours(black)) }
    }

    fn ring(&self, charuco: bool) -> Result<Vec<Target>> {
        let (rows, cols, square_mm) = self.sizes(3)?;
        let [row_start, col_start, row_end, col_end] = self.hole(rows, cols)?;
        let hole = Hole { row_start, col_start, row_end, col_end };
        let marker_mm = match self.parts.get(4) {
            None => MARKER_SHARE * square_mm,
            Some(part) => {
                length(part).ok_or_else(|| self.fault("MARKER_MM is a positive length"))?
            }
        };
        if self.parts.len() > if charuco { 6 } else { 4 } {
            return Err(self.fault("there are too many parts"));
        }
        let dictionary = (*self.parts.get(5).unwrap_or(&DICTIONARY)).to_owned();
        let kind = match charuco {
            true => TargetKind::CharucoRing { dictionary, marker_mm },
            false => TargetKind::CheckerboardRing,
        };
        let black = Target { kind, rows, cols, square_mm, hole, ..Target::default() };
        let black = Target { top_left: TopLeft::Black, ..black };
        if let Some((field, expected)) = black.fault() {
            return Err(self.fault(format!("{field}: {expected}")));
        }
        Ok(both_colours(black))
    }

    /// First row, first column, end row, end column.
    fn hole(&self, rows: u32, cols: u32) -> Result<[u32; 4]> {
        let Some(part) = self.parts.get(3) else {
            let end = |count: u32| count.saturating_sub(RING_WIDTH);
            return Ok([RING_WIDTH, RING_WIDTH, end(rows), end(cols)]);
        };
        let numbers: Option<Vec<u32>> = part.split(',').map(|v| v.parse().ok()).collect();
        numbers
            .and_then(|v| v.try_into().ok())
            .ok_or_else(|| self.fault("R0,C0,R1,C1 are four whole numbers"))
    }
}

fn both_colours(black: Target) -> Vec<Target> {
    let white = Target { top_left: TopLeft::White, ..black.clone() };
    vec![black, white]
}
