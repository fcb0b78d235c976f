//! Detects lengths that are probably not in millimetres.

use std::path::Path;

use super::document::Node;
use crate::Result;
use crate::calibration::Target;

/// Smallest square that a phone could resolve, mm.
pub const LEAST_SQUARE_MM: f64 = 0.5;
/// Smallest usual square, mm: at this size, a board around a sample of 100 mm has a thousand.
const USUAL_SQUARE_MM: f64 = 3.0;
/// Smallest usual side of a sample, as a share of the hole.
const USUAL_SHARE: f64 = 0.12;
const OTHER_UNITS: &str = "lengths are in mm; are these metres, centimetres or inches?";

/// Rejects squares that no camera could resolve.
pub(super) fn check(board: &Node, target: &Target) -> Result<()> {
    let mm = target.square_mm;
    if mm < LEAST_SQUARE_MM {
        return Err(board.get("square_mm").fault(format!(
            "at least {LEAST_SQUARE_MM} mm, not squares of {mm} mm: {OTHER_UNITS}"
        )));
    }
    Ok(())
}

/// A warning about unusual lengths.
pub(super) fn warning(file: &Path, target: &Target, [width, height]: [f32; 2]) -> Option<String> {
    let (file, mm) = (file.display(), target.square_mm);
    if mm < USUAL_SQUARE_MM {
        return Some(format!("{file}: field `board.square_mm`: squares of {mm} mm: {OTHER_UNITS}"));
    }
    let hole = target.hole_mm();
    let longer = |[a, b]: [f64; 2]| a.max(b);
    let sample = longer([width, height].map(f64::from));
    (sample < USUAL_SHARE * longer(hole)).then(|| {
        format!(
            "{file}: field `sample`: {width} x {height} mm in a hole of {} x {} mm: {OTHER_UNITS}",
            hole[0], hole[1]
        )
    })
}
