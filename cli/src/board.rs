//! `svbrdf board`: the target at true scale.

use std::fmt::Write;
use std::io::Cursor;
use std::path::PathBuf;

use serde_json::{Value, json};
use svbrdf::calibration::{Marker, Target, TargetKind, TopLeft};
use svbrdf::export::write_atomic;

use crate::board_text::targets;
use crate::failure::{Failure, Result};

/// Resolution of the PNG, px per inch.
const DPI: f64 = 600.0;
/// What printers leave blank, mm.
const MARGIN_MM: f64 = 4.0;
/// Room above the ring, where the page is long enough for it, mm.
const TOP_MM: f64 = 20.0;
/// Gaps below the ring's patches and from one line to the next, mm.
const GAP_MM: f64 = 7.0;
const RULER_MM: f64 = 100.0;

/// Print the board, to be printed at 100 %
#[derive(clap::Args)]
#[command(after_help = "Boards:
  ring[:ROWSxCOLS:SQUARE_MM[:R0,C0,R1,C1]]    ring of squares round a hole, squares; the
                                              missing block half open (default: ring three wide)
  charuco-ring:ROWSxCOLS:SQUARE_MM[:R0,C0,R1,C1[:MARKER_MM[:DICTIONARY]]]

Prints what capture.json says under `board`.

Examples:
  svbrdf board --out board.pdf
  svbrdf board --out board.pdf --paper letter --board charuco-ring:17x16:11.5")]
pub struct Arguments {
    /// File to write: .svg, .png (600 dpi) or .pdf
    #[arg(long)]
    out: PathBuf,
    /// Paper
    #[arg(long, default_value = "a4", value_parser = ["a4", "letter"])]
    paper: String,
    /// What is printed, see below
    #[arg(long, default_value = "ring")]
    board: String,
}

/// A filled rectangle on the page: left, top, width, height in mm from the top left; gray 0 to 1.
struct Rect(f64, f64, f64, f64, f64);

/// What is printed, and on what.
struct Page {
    size_mm: [f64; 2],
    rects: Vec<Rect>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let target = target(&arguments.board)?;
    let size_mm = if arguments.paper == "letter" { [215.9, 279.4] } else { [210.0, 297.0] };
    let page = layout(&target, size_mm).map_err(|expected| {
        let (board, paper) = (&arguments.board, &arguments.paper);
        Failure::Input(format!("--board {board}: too large for {paper}; expected {expected}"))
    })?;
    let extension = arguments.out.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let bytes = match extension.to_ascii_lowercase().as_str() {
        "svg" => svg(&page).into_bytes(),
        "pdf" => pdf(&page).into_bytes(),
        "png" => png(&page)?,
        _ => {
            let out = arguments.out.display();
            let message = format!("--out {out}: a name ending in .svg, .png or .pdf expected");
            return Err(Failure::Input(message));
        }
    };
    write_atomic(&arguments.out, &bytes)?;
    println!("{}", json!({ "board": description(&target) }));
    Ok(())
}

/// The board to print: top left black, patches below.
pub fn target(text: &str) -> Result<Target> {
    let fault = |message: &str| Failure::Input(format!("--board {text}: {message}"));
    let target = targets(text)?.swap_remove(0);
    if target.hole.row_start == target.hole.row_end {
        return Err(fault("it has no hole for the sample; expected ring or charuco-ring"));
    }
    if let TargetKind::CharucoRing { .. } = target.kind {
        let squares = (0..i64::from(target.rows))
            .flat_map(|row| (0..i64::from(target.cols)).map(move |col| (row, col)));
        let white =
            |(row, col): &(i64, i64)| target.has_square(*row, *col) && target.is_white(*row, *col);
        if !squares.filter(white).all(|(row, col)| target.marker(row, col).is_some()) {
            return Err(fault(
                "too many white squares for the dictionary; expected DICT_4X4_250 or \
                 another of 4X4 to 7X7 and _50 to _250 with a marker for each, the hole's included",
            ));
        }
    }
    Ok(Target { top_left: TopLeft::Black, patches: true, ..target })
}

/// The `board` object of `capture.json`.
pub fn description(target: &Target) -> Value {
    let hole = &target.hole;
    let mut board = json!({
        "kind": "checkerboard-ring",
        "rows": target.rows,
        "cols": target.cols,
        "square_mm": target.square_mm,
        "hole_squares": [hole.row_start, hole.col_start, hole.row_end, hole.col_end],
        "white_albedo": target.white_albedo,
        "black_albedo": target.black_albedo,
        "top_left": "black",
        "patches": true,
    });
    if let TargetKind::CharucoRing { dictionary, marker_mm } = &target.kind {
        board["kind"] = "charuco-ring".into();
        board["dictionary"] = dictionary.as_str().into();
        board["marker_mm"] = (*marker_mm).into();
    }
    board
}

/// Black squares, markers, patches, ruler and name; what would have fitted where it does not fit.
fn layout(target: &Target, size_mm: [f64; 2]) -> std::result::Result<Page, String> {
    let s = target.square_mm;
    let (width, height) = (f64::from(target.cols) * s, f64::from(target.rows) * s);
    let patches = target.patches();
    let lowest = patches.iter().map(|p| p.centre_mm.y - 0.5 * p.side_mm);
    let below = -0.5 * height - lowest.fold(f64::INFINITY, f64::min) + 2.0 * GAP_MM + 8.0;
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
    // Framed, so that the white one is seen.
    for patch in patches {
        let side = patch.side_mm;
        let x = left + 0.5 * width + patch.centre_mm.x - 0.5 * side;
        let patch_top = top + 0.5 * height - patch.centre_mm.y - 0.5 * side;
        rects.push(Rect(x, patch_top, side, side, 0.0));
        rects.push(Rect(x + 0.3, patch_top + 0.3, side - 0.6, side - 0.6, patch.gray));
        y = y.max(patch_top + side);
    }
    y += GAP_MM;
    // Wider than the ring, where that is a small one.
    let left = left.min(0.5 * (size_mm[0] - RULER_MM) - 27.0);
    rects.push(Rect(left, y + 4.8, RULER_MM, 0.2, 0.0));
    for mm in (0..=RULER_MM as u32).step_by(5) {
        let tick = if mm % 10 == 0 { 4.8 } else { 2.8 };
        rects.push(Rect(left + f64::from(mm) - 0.1, y + 5.0 - tick, 0.2, tick, 0.0));
    }
    text(&mut rects, left + RULER_MM + 4.0, y + 1.5, "100 MM - PRINT AT 100%");
    text(&mut rects, left, y + 5.0 + 0.6 * GAP_MM, &name(target));
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

/// The black modules of a marker, neighbours in a row as one rectangle.
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

/// Capital letters 5 x 7 dots high; each byte is a column, its lowest bit the top dot.
const GLYPHS: &[(char, [u8; 5])] = &[
    ('0', [0x3E, 0x51, 0x49, 0x45, 0x3E]),
    ('1', [0x00, 0x42, 0x7F, 0x40, 0x00]),
    ('2', [0x42, 0x61, 0x51, 0x49, 0x46]),
    ('3', [0x21, 0x41, 0x45, 0x4B, 0x31]),
    ('4', [0x18, 0x14, 0x12, 0x7F, 0x10]),
    ('5', [0x27, 0x45, 0x45, 0x45, 0x39]),
    ('6', [0x3C, 0x4A, 0x49, 0x49, 0x30]),
    ('7', [0x01, 0x71, 0x09, 0x05, 0x03]),
    ('8', [0x36, 0x49, 0x49, 0x49, 0x36]),
    ('9', [0x06, 0x49, 0x49, 0x29, 0x1E]),
    ('A', [0x7E, 0x11, 0x11, 0x11, 0x7E]),
    ('B', [0x7F, 0x49, 0x49, 0x49, 0x36]),
    ('C', [0x3E, 0x41, 0x41, 0x41, 0x22]),
    ('D', [0x7F, 0x41, 0x41, 0x22, 0x1C]),
    ('E', [0x7F, 0x49, 0x49, 0x49, 0x41]),
    ('F', [0x7F, 0x09, 0x09, 0x09, 0x01]),
    ('G', [0x3E, 0x41, 0x49, 0x49, 0x7A]),
    ('H', [0x7F, 0x08, 0x08, 0x08, 0x7F]),
    ('I', [0x00, 0x41, 0x7F, 0x41, 0x00]),
    ('K', [0x7F, 0x08, 0x14, 0x22, 0x41]),
    ('L', [0x7F, 0x40, 0x40, 0x40, 0x40]),
    ('M', [0x7F, 0x02, 0x0C, 0x02, 0x7F]),
    ('N', [0x7F, 0x04, 0x08, 0x10, 0x7F]),
    ('O', [0x3E, 0x41, 0x41, 0x41, 0x3E]),
    ('P', [0x7F, 0x09, 0x09, 0x09, 0x06]),
    ('Q', [0x3E, 0x41, 0x51, 0x21, 0x5E]),
    ('R', [0x7F, 0x09, 0x19, 0x29, 0x46]),
    ('S', [0x46, 0x49, 0x49, 0x49, 0x31]),
    ('T', [0x01, 0x01, 0x7F, 0x01, 0x01]),
    ('U', [0x3F, 0x40, 0x40, 0x40, 0x3F]),
    ('V', [0x1F, 0x20, 0x40, 0x20, 0x1F]),
    ('X', [0x63, 0x14, 0x08, 0x14, 0x63]),
    ('.', [0x00, 0x60, 0x60, 0x00, 0x00]),
    (',', [0x00, 0x50, 0x30, 0x00, 0x00]),
    ('-', [0x08, 0x08, 0x08, 0x08, 0x08]),
    ('%', [0x23, 0x13, 0x08, 0x64, 0x62]),
];

/// Text of dots, 2.8 mm high, so that all three formats look the same and need no fonts.
fn text(rects: &mut Vec<Rect>, left: f64, top: f64, text: &str) {
    const DOT: f64 = 0.4;
    for (i, character) in text.chars().enumerate() {
        let Some((_, columns)) = GLYPHS.iter().find(|(c, _)| *c == character) else { continue };
        for (column, bits) in columns.iter().enumerate() {
            for row in (0..7).filter(|row| bits >> row & 1 == 1) {
                let x = left + DOT * (6 * i + column) as f64;
                rects.push(Rect(x, top + DOT * f64::from(row), DOT, DOT, 0.0));
            }
        }
    }
}

fn svg(page: &Page) -> String {
    let [w, h] = page.size_mm;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}mm\" height=\"{h}mm\" \
         viewBox=\"0 0 {w} {h}\" shape-rendering=\"crispEdges\">\n\
         <rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>\n"
    );
    for Rect(x, y, w, h, gray) in &page.rects {
        let level = (gray * 255.0).round() as u8;
        let _ = writeln!(
            out,
            "<rect x=\"{x:.3}\" y=\"{y:.3}\" width=\"{w:.3}\" height=\"{h:.3}\" fill=\"#{level:02x}{level:02x}{level:02x}\"/>"
        );
    }
    out + "</svg>\n"
}

fn pdf(page: &Page) -> String {
    let points = 72.0 / 25.4;
    let [page_w, page_h] = page.size_mm.map(|v| v * points);
    let mut drawing = String::new();
    for Rect(x, y, w, h, gray) in &page.rects {
        let bottom = page_h - (y + h) * points;
        let (x, w, h) = (x * points, w * points, h * points);
        let _ = writeln!(drawing, "{gray} g {x:.4} {bottom:.4} {w:.4} {h:.4} re f");
    }
    let objects = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {page_w:.4} {page_h:.4}] \
             /Resources << >> /Contents 4 0 R >>"
        ),
        format!("<< /Length {} >>\nstream\n{drawing}endstream", drawing.len()),
    ];
    let mut out = "%PDF-1.6\n".to_owned();
    let mut offsets = Vec::new();
    for (i, object) in objects.iter().enumerate() {
        offsets.push(out.len());
        let _ = writeln!(out, "{} 0 obj\n{object}\nendobj", i + 1);
    }
    let start = out.len();
    let _ = writeln!(out, "xref\n0 {}\n0000000000 65535 f ", objects.len() + 1);
    for offset in offsets {
        let _ = writeln!(out, "{offset:010} 00000 n ");
    }
    let size = objects.len() + 1;
    let _ = writeln!(out, "trailer\n<< /Size {size} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF");
    out
}

fn png(page: &Page) -> Result<Vec<u8>> {
    let px = |mm: f64| (mm * DPI / 25.4).round() as u32;
    let [width, height] = page.size_mm.map(px);
    let mut picture = image::GrayImage::from_pixel(width, height, image::Luma([255]));
    for Rect(x, y, w, h, gray) in &page.rects {
        let level = image::Luma([(gray * 255.0).round() as u8]);
        for row in px(*y)..px(y + h) {
            for column in px(*x)..px(x + w) {
                picture.put_pixel(column, row, level);
            }
        }
    }
    let mut bytes = Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(|e| Failure::Other(e.to_string()))?;
    let mut bytes = bytes.into_inner();
    // The encoder states no scale: pHYs in px per metre, right after the 33 bytes up to IHDR's end.
    let per_metre = ((DPI / 0.0254).round() as u32).to_be_bytes();
    let chunk = [b"pHYs".as_slice(), &per_metre, &per_metre, &[1]].concat();
    let sum = crc32(&chunk).to_be_bytes();
    bytes.splice(33..33, [&9u32.to_be_bytes(), chunk.as_slice(), &sum].concat());
    Ok(bytes)
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| (c >> 1) ^ (0xEDB8_8320 * (c & 1)))
    })
}
