//! Picture of adjacent tiles.

use super::resample::resized;
use super::textures::{Texture, TextureFormat};
use crate::observation::View;
use crate::render::render;
use crate::{Result, Svbrdf};

/// A picture (8-bit sRGB PNG) of 3 x 3 tiles under a light from the upper left, with automatic exposure.
pub(super) fn tile_picture(maps: &Svbrdf, sample_mm: [f32; 2]) -> Result<Vec<u8>> {
    /// Longer side of one tile, px.
    const SIDE: usize = 256;
    let longer = maps.width().max(maps.height());
    let scale = SIDE.min(longer) as f64 / longer as f64;
    let side = |n: usize| ((n as f64 * scale).round() as usize).max(1);
    let (w, h) = (side(maps.width()), side(maps.height()));
    let tile = resized(maps, w, h);
    let many = tile.with_planes([3 * w, 3 * h], |planes| {
        let repeated = |i: usize| i / (3 * w) % h * w + i % (3 * w) % w;
        let planes = planes.chunks_exact(w * h);
        planes.flat_map(|plane| (0..9 * w * h).map(move |i| plane[repeated(i)])).collect()
    });
    let distance = 100.0 * sample_mm[0].max(sample_mm[1]);
    let view = View {
        sample_mm: sample_mm.map(|mm| 3.0 * mm),
        camera_mm: [0.0, 0.0, distance],
        light_mm: [-0.5 * distance, 0.5 * distance, 0.8 * distance],
        ..View::default()
    };
    let n = many.texels();
    let mut rgb = vec![0.0; 3 * n];
    render(&many, &view, &mut rgb);
    let mut values = rgb.clone();
    let at = (0.98 * values.len() as f64) as usize;
    let bright = *values.select_nth_unstable_by(at, f32::total_cmp).1;
    let gain = if bright > 0.0 { 0.8 / bright } else { 1.0 };
    let texture = Texture::colour(3 * w, 3 * h, |i| [0, 1, 2].map(|c| gain * rgb[c * n + i]));
    texture.encode(TextureFormat::Png8, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_has_three_tiles_each_way() {
        let picture = tile_picture(&Svbrdf::new(20, 17), [20.0, 17.0]).unwrap();
        let picture = image::load_from_memory(&picture).unwrap();
        assert_eq!((picture.width(), picture.height()), (60, 51));
    }
}
