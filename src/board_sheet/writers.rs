//! Encodes pages.

use std::fmt::Write;
use std::io::Cursor;

use image::{GrayImage, ImageFormat, Luma};

use super::page::{Page, Rect};
use crate::{Error, Result};

/// Resolution of the PNG, px per inch.
const DPI: f64 = 600.0;

pub(super) fn svg(page: &Page) -> String {
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

pub(super) fn pdf(page: &Page) -> String {
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

pub(super) fn png(page: &Page) -> Result<Vec<u8>> {
    let px = |mm: f64| (mm * DPI / 25.4).round() as u32;
    let [width, height] = page.size_mm.map(px);
    let mut picture = GrayImage::from_pixel(width, height, Luma([255]));
    for Rect(x, y, w, h, gray) in &page.rects {
        let level = Luma([(gray * 255.0).round() as u8]);
        for row in px(*y)..px(y + h) {
            for column in px(*x)..px(x + w) {
                picture.put_pixel(column, row, level);
            }
        }
    }
    let mut bytes = Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, ImageFormat::Png)
        .map_err(|e| Error::Internal(format!("cannot encode the board: {e}")))?;
    let mut bytes = bytes.into_inner();
    // Insert pHYs (px per metre) after IHDR, which ends at byte 33; the encoder writes none.
    let per_metre = ((DPI / 0.0254).round() as u32).to_be_bytes();
    let chunk = [b"pHYs".as_slice(), &per_metre, &per_metre, &[1]].concat();
    let sum = crc32fast::hash(&chunk).to_be_bytes();
    bytes.splice(33..33, [&9u32.to_be_bytes(), chunk.as_slice(), &sum].concat());
    Ok(bytes)
}
