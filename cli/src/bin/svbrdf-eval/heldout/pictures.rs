//! Photograph, prediction and difference side by side.

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, Rgb, RgbImage};
use svbrdf::export::write_atomic;
use svbrdf::{Error, Result};

use super::score::HeldOut;
use super::table::Record;

/// Black columns between the pictures.
const GAP: usize = 4;

/// Writes `CAPTURE-METHOD-nN-orderK-PHOTOGRAPH.png` into `out`, which is made if missing.
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
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, ImageFormat::Png)
        .map_err(|e| Error::Image { path: path.clone(), message: e.to_string() })?;
    write_atomic(&path, bytes.get_ref())
}

/// Values in [0, 1] in three planes each; a difference of 0 is gray, one of 0.5 white or black.
fn side_by_side(photograph: &[f32], predicted: &[f32], side: usize) -> RgbImage {
    let n = side * side;
    let width = 3 * side + 2 * GAP;
    let byte = |v: f32| (255.0 * v.clamp(0.0, 1.0)).round() as u8;
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
