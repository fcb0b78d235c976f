//! `svbrdf board`: the default target at true scale on A4.

use std::fmt::Write;
use std::io::Cursor;
use std::path::PathBuf;

use svbrdf::calibration::Target;
use svbrdf::export::write_atomic;

use crate::failure::{Failure, Result};

/// A4, mm.
const PAGE_MM: [f64; 2] = [210.0, 297.0];
/// Resolution of the PNG, px per inch.
const DPI: f64 = 600.0;

/// Print the board: A4, to be printed at 100 %
#[derive(clap::Args)]
#[command(after_help = "Example:\n  svbrdf board --out board.pdf")]
pub struct Arguments {
    /// File to write: .svg, .png (600 dpi) or .pdf
    #[arg(long)]
    out: PathBuf,
}

/// A filled rectangle on the page: left, top, width, height in mm from the top left; gray 0 to 1.
struct Rect(f64, f64, f64, f64, f64);

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let rects = layout(&Target::default());
    let extension = arguments.out.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let bytes = match extension.to_ascii_lowercase().as_str() {
        "svg" => svg(&rects).into_bytes(),
        "pdf" => pdf(&rects).into_bytes(),
        "png" => png(&rects)?,
        _ => {
            let out = arguments.out.display();
            let message = format!("--out {out}: a name ending in .svg, .png or .pdf expected");
            return Err(Failure::Input(message));
        }
    };
    write_atomic(&arguments.out, &bytes)?;
    Ok(())
}

/// Black squares, patches, ruler and name.
fn layout(target: &Target) -> Vec<Rect> {
    let s = target.square_mm;
    let (width, height) = (f64::from(target.cols) * s, f64::from(target.rows) * s);
    let (left, top) = (0.5 * (PAGE_MM[0] - width), 20.0);
    let mut rects = Vec::new();
    for row in 0..target.rows {
        for col in 0..target.cols {
            if target.has_square(row.into(), col.into()) && !target.is_white(row.into(), col.into())
            {
                let (x, y) = (left + f64::from(col) * s, top + f64::from(row) * s);
                rects.push(Rect(x, y, s, s, 0.0));
            }
        }
    }
    let mut y = top + height + 8.0;
    // Framed patches: black, middle gray, white.
    for (i, gray) in [0.0, 0.5, 1.0].into_iter().enumerate() {
        let x = left + 20.0 * i as f64;
        rects.push(Rect(x, y, 15.0, 15.0, 0.0));
        rects.push(Rect(x + 0.3, y + 0.3, 14.4, 14.4, gray));
    }
    y += 22.0;
    rects.push(Rect(left, y + 4.8, 100.0, 0.2, 0.0));
    for mm in (0..=100).step_by(5) {
        let tick = if mm % 10 == 0 { 4.8 } else { 2.8 };
        rects.push(Rect(left + f64::from(mm) - 0.1, y + 4.8 - tick, 0.2, tick, 0.0));
    }
    text(&mut rects, left + 104.0, y + 1.5, "100 MM - PRINT AT 100%");
    let hole = &target.hole;
    let name = format!(
        "SVBRDF CHECKERBOARD-RING {}X{} SQUARE {} MM HOLE {},{},{},{}",
        target.rows, target.cols, s, hole.row_start, hole.col_start, hole.row_end, hole.col_end
    );
    text(&mut rects, left, y + 10.0, &name);
    rects
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

fn svg(rects: &[Rect]) -> String {
    let [w, h] = PAGE_MM;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}mm\" height=\"{h}mm\" \
         viewBox=\"0 0 {w} {h}\" shape-rendering=\"crispEdges\">\n\
         <rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>\n"
    );
    for Rect(x, y, w, h, gray) in rects {
        let level = (gray * 255.0).round() as u8;
        let _ = writeln!(
            out,
            "<rect x=\"{x:.3}\" y=\"{y:.3}\" width=\"{w:.3}\" height=\"{h:.3}\" fill=\"#{level:02x}{level:02x}{level:02x}\"/>"
        );
    }
    out + "</svg>\n"
}

fn pdf(rects: &[Rect]) -> String {
    let points = 72.0 / 25.4;
    let [page_w, page_h] = PAGE_MM.map(|v| v * points);
    let mut drawing = String::new();
    for Rect(x, y, w, h, gray) in rects {
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

fn png(rects: &[Rect]) -> Result<Vec<u8>> {
    let px = |mm: f64| (mm * DPI / 25.4).round() as u32;
    let mut page = image::GrayImage::from_pixel(px(PAGE_MM[0]), px(PAGE_MM[1]), image::Luma([255]));
    for Rect(x, y, w, h, gray) in rects {
        let level = image::Luma([(gray * 255.0).round() as u8]);
        for row in px(*y)..px(y + h) {
            for column in px(*x)..px(x + w) {
                page.put_pixel(column, row, level);
            }
        }
    }
    let mut bytes = Cursor::new(Vec::new());
    page.write_to(&mut bytes, image::ImageFormat::Png)
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
