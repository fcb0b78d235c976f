//! Boards as the command line names them.

use svbrdf::calibration::{Hole, Target, TargetKind, TopLeft};

use crate::failure::{Failure, Result};

/// Squares of the default ring that are printed on each side of the hole.
const RING_WIDTH: u32 = 3;
/// Marker of a charuco ring relative to its square, unless stated.
const MARKER_SHARE: f64 = 0.72;
const DICTIONARY: &str = "DICT_4X4_250";

/// Boards that the text may mean: those whose colours cannot be told from it come in both.
pub fn targets(text: &str) -> Result<Vec<Target>> {
    let fault = |message: String| {
        Failure::Input(format!(
            "--board {text}: {message}; expected checkerboard:ROWSxCOLS:SQUARE_MM (inner corners), \
             ring:ROWSxCOLS:SQUARE_MM:R0,C0,R1,C1 or charuco-ring:... (squares)"
        ))
    };
    let parts: Vec<&str> = text.split(':').collect();
    let counts = |part: &str| -> Option<(u32, u32)> {
        let (rows, cols) = part.split_once(['x', 'X'])?;
        Some((rows.parse().ok()?, cols.parse().ok()?))
    };
    let length =
        |part: &str| part.parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0 && *v < 1e6);
    let sizes = |least: u32| -> Result<(u32, u32, f64)> {
        let (rows, cols) = parts
            .get(1)
            .and_then(|p| counts(p))
            .filter(|(r, c)| (least..=200).contains(r) && (least..=200).contains(c))
            .ok_or_else(|| fault(format!("ROWSxCOLS are two whole numbers from {least} to 200")))?;
        let square = parts.get(2).and_then(|p| length(p));
        Ok((rows, cols, square.ok_or_else(|| fault("SQUARE_MM is a positive length".into()))?))
    };
    match parts[0] {
        "checkerboard" => {
            let (rows, cols, square_mm) = sizes(2)?;
            if parts.len() > 3 {
                return Err(fault("three parts are enough".into()));
            }
            if rows * cols < 20 {
                return Err(fault("at least 20 inner corners are needed".into()));
            }
            let (rows, cols) = (rows + 1, cols + 1);
            let hole = Hole { row_start: 0, col_start: 0, row_end: 0, col_end: 0 };
            let board = |top_left| Target {
                kind: TargetKind::CheckerboardRing,
                rows,
                cols,
                square_mm,
                hole,
                top_left,
                ..Target::default()
            };
            // With an odd sum a half-turn swaps the colours: one of them stands for both.
            if (rows + cols) % 2 == 1 {
                Ok(vec![board(TopLeft::Black)])
            } else {
                Ok(vec![board(TopLeft::Black), board(TopLeft::White)])
            }
        }
        "ring" if parts.len() == 1 => Ok(vec![Target::default()]),
        kind @ ("ring" | "charuco-ring") => {
            let (rows, cols, square_mm) = sizes(3)?;
            let hole = match parts.get(3) {
                None => [
                    RING_WIDTH,
                    RING_WIDTH,
                    rows.saturating_sub(RING_WIDTH),
                    cols.saturating_sub(RING_WIDTH),
                ],
                Some(part) => part
                    .split(',')
                    .map(|v| v.parse().ok())
                    .collect::<Option<Vec<u32>>>()
                    .and_then(|v| v.try_into().ok())
                    .ok_or_else(|| fault("R0,C0,R1,C1 are four whole numbers".into()))?,
            };
            let [row_start, col_start, row_end, col_end] = hole;
            let marker_mm = match parts.get(4) {
                None => MARKER_SHARE * square_mm,
                Some(part) => {
                    length(part).ok_or_else(|| fault("MARKER_MM is a positive length".into()))?
                }
            };
            let dictionary = (*parts.get(5).unwrap_or(&DICTIONARY)).to_owned();
            let charuco = kind == "charuco-ring";
            if parts.len() > if charuco { 6 } else { 4 } {
                return Err(fault("there are too many parts".into()));
            }
            let board = |top_left| Target {
                kind: if charuco {
                    TargetKind::CharucoRing { dictionary: dictionary.clone(), marker_mm }
                } else {
                    TargetKind::CheckerboardRing
                },
                rows,
                cols,
                square_mm,
                hole: Hole { row_start, col_start, row_end, col_end },
                top_left,
                ..Target::default()
            };
            if let Some((field, expected)) = board(TopLeft::Black).fault() {
                return Err(fault(format!("{field}: {expected}")));
            }
            Ok(vec![board(TopLeft::Black), board(TopLeft::White)])
        }
        other => Err(fault(format!("`{other}` is no kind of board"))),
    }
}
