//! A picture to judge maps by: the maps themselves and renderings under new light.

use std::path::Path;

use image::{DynamicImage, Rgb, RgbImage};

use super::files::write_png;
use super::resample::resized;
use crate::frame::Encoding;
use crate::observation::{Falloff, View};
use crate::render::render;
use crate::svbrdf::channel;
use crate::{Result, Svbrdf};

/// Longer side of one picture of the sheet, px.
const CELL: usize = 256;
/// Space between pictures, px.
const GAP: usize = 8;

/// Camera and light of the renderings in units of the sample's longer side: light from above,
/// raking from the left, raking from the top edge, a highlight seen from the side.
const VIEWS: [([f32; 3], [f32; 3]); 4] = [
    ([0.0, 0.0, 2.0], [0.2, 0.2, 2.0]),
    ([0.0, 0.0, 2.0], [-2.0, 0.3, 0.7]),
    ([0.0, 0.0, 2.0], [0.3, 2.0, 0.7]),
    ([0.0, -1.6, 1.2], [0.0, 1.6, 1.2]),
];

/// Writes a sheet (8-bit sRGB PNG): normal, diffuse, specular and roughness in the first row, the
/// material relit from four directions below.
///
/// # Errors
/// When the file cannot be written.
pub fn write_preview(path: impl AsRef<Path>, maps: &Svbrdf, sample_mm: [f32; 2]) -> Result<()> {
    let longer = maps.width().max(maps.height());
    let scale = CELL.min(longer) as f64 / longer as f64;
    let side = |n: usize| ((n as f64 * scale).round() as usize).max(1);
    let (w, h) = (side(maps.width()), side(maps.height()));
    let maps = resized(maps, w, h);
    let n = w * h;
    let (sheet_w, sheet_h) = (4 * w + 5 * GAP, 2 * h + 3 * GAP);
    let mut sheet = RgbImage::from_pixel(sheet_w as u32, sheet_h as u32, Rgb([40; 3]));
    let mut put = |column: usize, row: usize, value: &dyn Fn(usize) -> [f32; 3]| {
        let (x0, y0) = (GAP + column * (w + GAP), GAP + row * (h + GAP));
        for i in 0..n {
            let pixel = value(i).map(|v| (v * 255.0).round() as u8);
            sheet.put_pixel((x0 + i % w) as u32, (y0 + i / w) as u32, Rgb(pixel));
        }
    };
    let srgb = |v: f32| Encoding::Srgb.encode(f64::from(v)) as f32;
    let colour = |first: usize, i: usize| [0, 1, 2].map(|c| srgb(maps.plane(first + c)[i]));
    put(0, 0, &|i| maps.normal(i % w, i / w).map(|v| 0.5 * v + 0.5));
    put(1, 0, &|i| colour(channel::DIFFUSE, i));
    put(2, 0, &|i| colour(channel::SPECULAR, i));
    put(3, 0, &|i| [maps.plane(channel::ROUGHNESS)[i]; 3]);
    let unit = sample_mm[0].max(sample_mm[1]);
    let mut radiance = vec![0.0; 3 * n];
    for (column, (camera, light)) in VIEWS.into_iter().enumerate() {
        let view = View {
            sample_mm,
            camera_mm: camera.map(|v| v * unit),
            light_mm: light.map(|v| v * unit),
            falloff: Falloff::None { power: [std::f32::consts::PI; 3] },
            ambient: [0.0; 3],
            mirrored: 1.0,
        };
        render(&maps, &view, &mut radiance);
        put(column, 1, &|i| [0, 1, 2].map(|c| srgb(radiance[c * n + i])));
    }
    write_png(path.as_ref(), &DynamicImage::ImageRgb8(sheet))
}
