//! Pictures of photograph, prediction and difference, and of maps by number of photographs.

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, Rgb, RgbImage};
use svbrdf::export::{self, resized, write_atomic};
use svbrdf::photo::Encoding;
use svbrdf::{Error, Result, Svbrdf};

use super::score::{HeldOut, SIDE};
use super::table::Record;

/// Black columns between the pictures.
const GAP: usize = 4;

/// Writes `CAPTURE-METHOD-nN-orderK-PHOTOGRAPH.png` into `out`; creates a missing folder.
pub fn write(
    out: &Path,
    record: &Record,
    photograph: &HeldOut,
    radiance: &[f32],
    gain: bool,
) -> Result<()> {
    std::fs::create_dir_all(out).map_err(|e| Error::io(out, e))?;
    let (predicted, _) = photograph.prediction(radiance, gain);
    let image = side_by_side(&photograph.picture(), &predicted, photograph.side);
    let path = out.join(format!(
        "{}-{}-{}{}-order{}-{}.png",
        record.capture,
        record.variant.name(),
        record.part.short(),
        record.fitted,
        record.order,
        record.photograph
    ));
    save(&image, &path)
}

/// Writes maps by number of photographs into `CAPTURE-nN`, and an overview with the true maps last
/// into `CAPTURE.png`.
pub fn write_maps(
    out: &Path,
    capture: &str,
    maps: &[(usize, &Svbrdf)],
    truth: Option<&Svbrdf>,
) -> Result<()> {
    for (fitted, maps) in maps {
        export::write_maps(
            out.join(format!("{capture}-n{fitted}")),
            maps,
            &export::MapsOptions::default(),
        )?;
    }
    let rows: Vec<&Svbrdf> = maps.iter().map(|(_, maps)| *maps).chain(truth).collect();
    save(&sheet(&rows), &out.join(format!("{capture}.png")))
}

fn save(image: &RgbImage, path: &Path) -> Result<()> {
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, ImageFormat::Png)
        .map_err(|e| Error::Image { path: path.to_owned(), message: e.to_string() })?;
    write_atomic(path, bytes.get_ref())
}

/// One row per set of maps: normal, diffuse, F0, roughness.
fn sheet(rows: &[&Svbrdf]) -> RgbImage {
    let step = SIDE + GAP;
    let (width, height) = (4 * step - GAP, (rows.len() * step).saturating_sub(GAP));
    let mut image = RgbImage::new(width as u32, height as u32);
    for (row, maps) in rows.iter().enumerate() {
        let maps = resized(maps, SIDE, SIDE);
        for i in 0..SIDE * SIDE {
            let (x, y) = (i % SIDE, i / SIDE);
            let shown = |plane: &[f32]| Encoding::Srgb.encode(plane[i].into()) as f32;
            let panels = [
                maps.normal(x, y).map(|v| 0.5 * (v + 1.0)),
                maps.diffuse().map(shown),
                maps.specular().map(shown),
                [maps.roughness()[i]; 3],
            ];
            for (panel, values) in panels.into_iter().enumerate() {
                let at = [(panel * step + x) as u32, (row * step + y) as u32];
                image.put_pixel(at[0], at[1], Rgb(values.map(byte)));
            }
        }
    }
    image
}

fn byte(v: f32) -> u8 {
    (255.0 * v.clamp(0.0, 1.0)).round() as u8
}

/// Three planes each with values in [0, 1]. A difference of 0 is gray, one of ±0.5 white or black.
fn side_by_side(photograph: &[f32], predicted: &[f32], side: usize) -> RgbImage {
    let n = side * side;
    let width = 3 * side + 2 * GAP;
    let mut image = RgbImage::new(width as u32, side as u32);
    for i in 0..n {
        let (x, y) = (i % side, i / side);
        let values = |plane: &dyn Fn(usize) -> f32| Rgb([0, 1, 2].map(|c| byte(plane(c * n + i))));
        let panels: [&dyn Fn(usize) -> f32; 3] =
            [&|k| photograph[k], &|k| predicted[k], &|k| 0.5 + (predicted[k] - photograph[k])];
        for (panel, plane) in panels.into_iter().enumerate() {
            let left = panel * (side + GAP);
            image.put_pixel((left + x) as u32, y as u32, values(plane));
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_shows_four_maps_in_a_row() {
        let mut tilted = Svbrdf::new(8, 8);
        tilted.normal_slopes_mut()[0].fill(1.0);
        let image = sheet(&[&Svbrdf::new(8, 8), &tilted]);
        let (side, gap) = (SIDE as u32, GAP as u32);
        assert_eq!(image.dimensions(), (4 * side + 3 * gap, 2 * side + gap));
        let middle = |panel: u32, row: u32| {
            let at = |k: u32| k * (side + gap) + side / 2;
            image.get_pixel(at(panel), at(row)).0
        };
        assert_eq!(middle(0, 0), [128, 128, 255]);
        // normal (1, 0, 1) / sqrt 2
        assert_eq!(middle(0, 1), [218, 128, 218]);
        // sRGB of 0.5 and 0.04
        assert_eq!((middle(1, 0), middle(2, 0), middle(3, 0)), ([188; 3], [56; 3], [128; 3]));
    }

    #[test]
    fn three_pictures_stand_side_by_side() {
        let photograph: Vec<f32> = (0..12).map(|i| i as f32 / 255.0).collect();
        let predicted: Vec<f32> = photograph.iter().map(|v| v + 51.0 / 255.0).collect();
        let image = side_by_side(&photograph, &predicted, 2);
        assert_eq!(image.dimensions(), (6 + 2 * GAP as u32, 2));
        let gap = GAP as u32;
        // texel (1, 0) of the planes 0..4, 4..8, 8..12
        assert_eq!(image.get_pixel(1, 0).0, [1, 5, 9]);
        assert_eq!(image.get_pixel(3 + gap, 0).0, [52, 56, 60]);
        assert_eq!(image.get_pixel(2 + gap / 2, 0).0, [0; 3]);
        // 127.5 + 51
        assert!(image.get_pixel(5 + 2 * gap, 0).0.iter().all(|v| (178..=179).contains(v)));
    }
}
