//! Layout of a sheet.

use super::lettering::text;
use super::page::{Page, Rect};
use crate::calibration::{Marker, Target, TargetKind};

/// Unprintable margin of printers, mm.
const MARGIN_MM: f64 = 4.0;
/// Space above the ring if the page is long enough, mm.
const TOP_MM: f64 = 20.0;
/// Gaps below the ring's patches and between lines, mm.
const GAP_MM: f64 = 7.0;
const RULER_MM: f64 = 100.0;

/// Lays out black squares, markers, patches, ruler and name; the error states the size that would
/// have fitted.
pub(super) fn layout(target: &Target, size_mm: [f64; 2]) -> Result<Page, String> {
    let s = target.square_mm;
    let (width, height) = (f64::from(target.cols) * s, f64::from(target.rows) * s);
    let patches = if target.patches { target.patches().to_vec() } else { Vec::new() };
    let lowest = patches.iter().map(|p| p.centre_mm.y - 0.5 * p.side_mm);
    let below = -0.5 * height - lowest.fold(-0.5 * height, f64::min) + 2.0 * GAP_MM + 8.0;
    let room = size_mm[1] - height - below - MARGIN_MM;
    if room < MARGIN_MM || width.max(RULER_MM + 55.0) + 2.0 * MARGIN_MM > size_mm[0] {
        let (w, h) = (size_mm[0] - 2.0 * MARGIN_MM, size_mm[1] - 2.0 * MARGIN_MM - below);
        return Err(format!("at most {w:.1} x {h:.1} mm of squares"));
    }
    let (left, top) = (0.5 * (size_mm[0] - width), room.min(TOP_MM));
    let mut rects = Vec::new();
    for row in 0..i64::from(target.rows) {
        for col in 0..i64::from(target.cols) {
            let (x, y) = (left + col as f64 * s, top + row as f64 * s);
            if target.has_square(row, col) && !target.is_white(row, col) {
                rects.push(Rect(x, y, s, s, 0.0));
            }
            if let (Some(printed), TargetKind::CharucoRing { marker_mm, .. }) =
                (target.marker(row, col), &target.kind)
            {
                let margin = 0.5 * (s - marker_mm);
                marker(&mut rects, printed, x + margin, y + margin, *marker_mm);
            }
        }
    }
    let mut y = top + height;
    // A frame makes the white patch visible.
    for patch in patches {
        let side = patch.side_mm;
        let x = left + 0.5 * width + patch.centre_mm.x - 0.5 * side;
        let patch_top = top + 0.5 * height - patch.centre_mm.y - 0.5 * side;
        rects.push(Rect(x, patch_top, side, side, 0.0));
        rects.push(Rect(x + 0.3, patch_top + 0.3, side - 0.6, side - 0.6, patch.gray));
        y = y.max(patch_top + side);
    }
    y += GAP_MM;
    // The ruler may be wider than a small ring.
    let left = left.min(0.5 * (size_mm[0] - RULER_MM) - 27.0);
    rects.push(Rect(left, y + 4.8, RULER_MM, 0.2, 0.0));
    for mm in (0..=RULER_MM as u32).step_by(5) {
        let tick = if mm % 10 == 0 { 4.8 } else { 2.8 };
        rects.push(Rect(left + f64::from(mm) - 0.1, y + 5.0 - tick, 0.2, tick, 0.0));
    }
    rects.extend(text(left + RULER_MM + 4.0, y + 1.5, "100 MM - PRINT AT 100%"));
    rects.extend(text(left, y + 5.0 + 0.6 * GAP_MM, &name(target)));
    Ok(Page { size_mm, rects })
}

/// The layout's printed name.
fn name(target: &Target) -> String {
    let hole = &target.hole;
    let (kind, markers) = match &target.kind {
        TargetKind::CheckerboardRing => ("CHECKERBOARD-RING", String::new()),
        TargetKind::CharucoRing { dictionary, marker_mm } => {
            let dictionary = dictionary.trim_start_matches("DICT_").replace('_', "-");
            ("CHARUCO-RING", format!(" MARKER {marker_mm:.3} MM {dictionary}"))
        }
    };
    format!(
        "SVBRDF {kind} {}X{} SQUARE {} MM HOLE {},{},{},{}{markers}",
        target.rows,
        target.cols,
        target.square_mm,
        hole.row_start,
        hole.col_start,
        hole.row_end,
        hole.col_end
    )
}

/// Black modules of a marker; adjacent ones in a row form one rectangle.
fn marker(rects: &mut Vec<Rect>, marker: Marker, left: f64, top: f64, side: f64) {
    let modules = marker.modules();
    let module = side / f64::from(modules);
    for row in 0..modules {
        let mut col = 0;
        while col < modules {
            let run = (col..modules).take_while(|c| !marker.is_white(row, *c)).count() as u32;
            if run > 0 {
                let (x, y) = (left + f64::from(col) * module, top + f64::from(row) * module);
                rects.push(Rect(x, y, f64::from(run) * module, module, 0.0));
            }
            col += run.max(1);
        }
    }
}
