//! A contact sheet of maps: the maps and the material relit, with captions.

use std::f32::consts::{FRAC_PI_2, PI};
use std::path::Path;

use image::{DynamicImage, Rgb, RgbImage};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use super::files::{encode_png, write_atomic};
use super::lobes;
use super::resample::at_most;
use super::textures::srgb_byte as srgb;
use crate::observation::View;
use crate::render::render;
use crate::{Result, Svbrdf};

/// Longer side of one picture, px. Larger maps are averaged, smaller ones magnified by an integer.
const CELL: usize = 256;
/// Space between pictures, px.
const GAP: usize = 12;
/// Height of a caption, px.
const CAPTION: usize = 24;
const FONT: RasterHeight = RasterHeight::Size16;
const BACKGROUND: [u8; 3] = [28, 29, 32];
const TEXT: [u8; 3] = [222, 223, 226];

/// Distance of camera and light from the sample's centre, in longer sides of the sample.
const DISTANCE: f32 = 2.5;
/// Angles from the normal for side lights, degrees. The lowest light with a visible effect shows relief best.
const RAKING_DEG: [f32; 8] = [68.0, 60.0, 50.0, 40.0, 31.0, 23.0, 16.0, 10.0];
/// Share of pixels that must reach [`BRIGHT`] for a visible effect.
const BRIGHT_SHARE: f32 = 0.25;
/// Level that counts as bright, sRGB values in [0, 1].
const BRIGHT: f32 = 0.2;
/// Texels along each side for the choice of lights.
const TRIAL: usize = 64;
/// The exposure keeps this share of the pixels below [`EXPOSED_LEVEL`].
const EXPOSED_SHARE: f32 = 0.93;
/// Linear level, 1 = white.
const EXPOSED_LEVEL: f32 = 0.8;
/// Range of exposures: at most two stops brighter, to keep dark materials dark; five darker.
const EXPOSURES: [f32; 2] = [1.0 / 32.0, 4.0];

/// A rendering of a material under one light, for display.
#[derive(Debug, Clone, PartialEq)]
pub struct Relit {
    /// Short description of the light.
    pub label: &'static str,
    /// Camera and light. The picture is always the top view; the camera's position affects only the
    /// reflection.
    pub view: View,
    /// Factor on radiances: the sRGB curve is applied to `exposure * radiance`.
    pub exposure: f32,
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Interleaved 8-bit sRGB.
    pub rgb: Vec<u8>,
}

/// Renders a material under four lights that together show highlights and relief, at most `longest`
/// texels along each side. Side lights are as low as the material's gloss allows; without other
/// brightness they lie near the mirror direction of some texels.
///
/// # Panics
/// If `longest` is 0.
pub fn relit(maps: &Svbrdf, sample_mm: [f32; 2], longest: usize) -> Vec<Relit> {
    let small = at_most(maps, TRIAL.min(longest), 1);
    let maps = at_most(maps, longest, 1);
    let top = [0.0, 0.0, DISTANCE];
    let low = |azimuth| lowest_light(&small, sample_mm, azimuth);
    [
        ("Flash beside the camera", top, [0.3, 0.3, DISTANCE]),
        ("Light from the left", top, low(PI)),
        ("Light from behind", top, low(FRAC_PI_2)),
        ("Seen against the light", direction(46.0, -FRAC_PI_2), direction(46.0, FRAC_PI_2)),
    ]
    .into_iter()
    .map(|(label, camera, light)| picture(label, &maps, view(sample_mm, camera, light)))
    .collect()
}

/// A position at [`DISTANCE`], `off_top_deg` from the normal, azimuth counter-clockwise from +X.
fn direction(off_top_deg: f32, azimuth: f32) -> [f32; 3] {
    let (s, c) = off_top_deg.to_radians().sin_cos();
    [s * azimuth.cos(), s * azimuth.sin(), c].map(|v| v * DISTANCE)
}

/// Camera and light, given in longer sides of the sample.
fn view(sample_mm: [f32; 2], camera: [f32; 3], light: [f32; 3]) -> View {
    let unit = sample_mm[0].max(sample_mm[1]);
    View {
        sample_mm,
        camera_mm: camera.map(|v| v * unit),
        light_mm: light.map(|v| v * unit),
        ..View::default()
    }
}

/// The lowest side light that makes enough pixels bright, or else the one with the most bright pixels.
fn lowest_light(maps: &Svbrdf, sample_mm: [f32; 2], azimuth: f32) -> [f32; 3] {
    let mut best = (0.0, direction(RAKING_DEG[RAKING_DEG.len() - 1], azimuth));
    for off_top in RAKING_DEG {
        let light = direction(off_top, azimuth);
        let lit = picture("", maps, view(sample_mm, [0.0, 0.0, DISTANCE], light));
        let share = bright_share(&lit);
        if share >= BRIGHT_SHARE {
            return light;
        }
        if share > best.0 {
            best = (share, light);
        }
    }
    best.1
}

fn bright_share(picture: &Relit) -> f32 {
    let pixels = picture.rgb.as_chunks::<3>().0;
    let level = (255.0 * BRIGHT) as u8;
    let bright = pixels.iter().filter(|p| p.iter().any(|&v| v >= level)).count();
    bright as f32 / pixels.len() as f32
}

/// Renders the top view with automatic exposure.
fn picture(label: &'static str, maps: &Svbrdf, view: View) -> Relit {
    let n = maps.texels();
    let mut radiance = vec![0.0; 3 * n];
    render(maps, &view, &mut radiance);
    let mut brightest: Vec<f32> =
        (0..n).map(|i| radiance[i].max(radiance[n + i]).max(radiance[2 * n + i])).collect();
    let at = ((n - 1) as f32 * EXPOSED_SHARE) as usize;
    let level = *brightest.select_nth_unstable_by(at, f32::total_cmp).1;
    let exposure = (EXPOSED_LEVEL / level.max(1e-6)).clamp(EXPOSURES[0], EXPOSURES[1]);
    let rgb = (0..3 * n).map(|i| srgb(exposure * radiance[i % 3 * n + i / 3])).collect();
    Relit { label, view, exposure, width: maps.width(), height: maps.height(), rgb }
}

fn byte(value: f32) -> u8 {
    (255.0 * value).round() as u8
}

/// Writes a sheet (8-bit sRGB PNG) with captions. First row: normal, diffuse, specular and
/// roughness. Second row, for materials with lobes: anisotropy (direction and strength as RGB),
/// weight of the coat, colour of the sheen. Last row: the material under the four lights of [`relit`].
///
/// # Errors
/// If the file cannot be written.
pub fn write_preview(path: impl AsRef<Path>, maps: &Svbrdf, sample_mm: [f32; 2]) -> Result<()> {
    write_atomic(path, &encode_preview(maps, sample_mm)?)
}

/// Encodes the sheet of [`write_preview`].
///
/// # Errors
/// Internal faults only.
pub fn encode_preview(maps: &Svbrdf, sample_mm: [f32; 2]) -> Result<Vec<u8>> {
    let relit = relit(maps, sample_mm, CELL);
    let maps = at_most(maps, CELL, 1);
    let w = maps.width();
    let (anisotropy, coat, sheen) = (lobes::anisotropy(&maps), maps.coat(), maps.sheen());
    let lit = if anisotropy.is_some() || coat.is_some() || sheen.is_some() { 2 } else { 1 };
    let mut sheet = Sheet::new(w, maps.height(), lit + 1);
    let (diffuse, specular) = (maps.diffuse(), maps.specular());
    sheet.put(0, 0, "Normal", |i| maps.normal(i % w, i / w).map(|v| byte(0.5 * v + 0.5)));
    sheet.put(1, 0, "Diffuse albedo", |i| diffuse.map(|plane| srgb(plane[i])));
    sheet.put(2, 0, "Specular albedo (F0)", |i| specular.map(|plane| srgb(plane[i])));
    sheet.put(3, 0, "Roughness", |i| [byte(maps.roughness()[i]); 3]);
    if let Some(texels) = &anisotropy {
        sheet.put(0, 1, "Anisotropy", |i| {
            let [x, y] = lobes::direction(&texels[i], 1.0);
            [x, y, texels[i].strength()].map(byte)
        });
    }
    if let Some([weight, _]) = coat {
        sheet.put(usize::from(anisotropy.is_some()), 1, "Coat", |i| [byte(weight[i]); 3]);
    }
    if let Some([r, g, b, _]) = sheen {
        let column = usize::from(anisotropy.is_some()) + usize::from(coat.is_some());
        sheet.put(column, 1, "Sheen", |i| [r, g, b].map(|plane| srgb(plane[i])));
    }
    for (column, picture) in relit.iter().enumerate() {
        sheet.put(column, lit, picture.label, |i| picture.rgb.as_chunks::<3>().0[i]);
    }
    encode_png(&DynamicImage::ImageRgb8(sheet.pixels))
}

/// Rows of four pictures with captions.
struct Sheet {
    pixels: RgbImage,
    width: usize,
    height: usize,
    /// Magnification of a picture along both axes.
    enlarged: usize,
    /// Width of a column: that of the wider of picture and caption.
    column: usize,
}

impl Sheet {
    fn new(width: usize, height: usize, rows: usize) -> Self {
        let enlarged = (CELL / width.max(height)).max(1);
        let longest = 24 * get_raster_width(FontWeight::Regular, FONT);
        let column = (width * enlarged).max(longest);
        let sheet = [4 * column + 5 * GAP, rows * (height * enlarged + CAPTION) + (rows + 1) * GAP];
        let pixels = RgbImage::from_pixel(sheet[0] as u32, sheet[1] as u32, Rgb(BACKGROUND));
        Self { pixels, width, height, enlarged, column }
    }

    fn put(&mut self, column: usize, row: usize, caption: &str, pixel: impl Fn(usize) -> [u8; 3]) {
        let (w, h) = (self.width * self.enlarged, self.height * self.enlarged);
        let (x0, y0) = (GAP + column * (self.column + GAP), GAP + row * (h + CAPTION + GAP));
        self.write(x0, y0 + (CAPTION - FONT.val()) / 2 - 2, caption);
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            let i = y / self.enlarged * self.width + x / self.enlarged;
            let at = ((x0 + x) as u32, (y0 + CAPTION + y) as u32);
            self.pixels.put_pixel(at.0, at.1, Rgb(pixel(i)));
        }
    }

    /// Writes a line of ASCII from its top left corner.
    fn write(&mut self, x0: usize, y0: usize, line: &str) {
        for (i, glyph) in
            line.chars().filter_map(|c| get_raster(c, FontWeight::Regular, FONT)).enumerate()
        {
            for (y, row) in glyph.raster().iter().enumerate() {
                for (x, &cover) in row.iter().enumerate() {
                    let at = ((x0 + i * glyph.width() + x) as u32, (y0 + y) as u32);
                    let mixed = std::array::from_fn(|c| {
                        let (from, to) = (u32::from(BACKGROUND[c]), u32::from(TEXT[c]));
                        ((from * u32::from(255 - cover) + to * u32::from(cover)) / 255) as u8
                    });
                    self.pixels.put_pixel(at.0, at.1, Rgb(mixed));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Uniform albedos and gloss; slopes of a given deviation.
    fn material(diffuse: f32, specular: f32, roughness: f32, relief: f32) -> Svbrdf {
        let mut maps = Svbrdf::new(96, 96);
        let mut random = Random::new(5);
        for c in 0..3 {
            maps.diffuse_mut()[c].fill(diffuse);
            maps.specular_mut()[c].fill(specular);
        }
        maps.roughness_mut().fill(roughness);
        for plane in maps.normal_slopes_mut() {
            for v in plane {
                *v = relief * (2.0 * random.uniform() as f32 - 1.0);
            }
        }
        maps
    }

    #[test]
    fn every_material_is_bright_somewhere_under_every_light() {
        for (name, maps) in [
            ("plaster", material(0.7, 0.04, 0.9, 0.1)),
            ("black cloth", material(0.02, 0.04, 0.8, 0.3)),
            ("lacquer", material(0.1, 0.05, 0.15, 0.02)),
            ("polished metal", material(0.0, 0.9, 0.2, 0.0)),
            ("brushed metal", material(0.0, 0.6, 0.4, 0.1)),
            ("hammered metal", material(0.0, 0.8, 0.2, 0.3)),
        ] {
            for lit in relit(&maps, [80.0, 80.0], 96) {
                let pixels = lit.rgb.as_chunks::<3>().0;
                let share = |least: u8| {
                    let count = pixels.iter().filter(|p| p[1] >= least).count();
                    count as f32 / pixels.len() as f32
                };
                let (visible, white) = (share(51), share(255));
                let label = lit.label;
                assert!(visible > 0.1, "{name}, {label}: {visible} of the pixels to be seen");
                assert!(white < 0.1, "{name}, {label}: {white} of the pixels burnt out");
            }
        }
    }

    #[test]
    fn light_from_the_side_is_low_where_the_material_allows() {
        let off_top = |maps: &Svbrdf| {
            let [x, y, z] = relit(maps, [80.0, 80.0], 96)[1].view.light_mm;
            x.hypot(y).atan2(z).to_degrees()
        };
        assert!(off_top(&material(0.7, 0.04, 0.9, 0.1)) > 60.0);
        assert!(off_top(&material(0.0, 0.9, 0.05, 0.0)) < 30.0);
    }

    #[test]
    fn pictures_hold_the_rendering_under_their_light() {
        let maps = material(0.3, 0.2, 0.5, 0.2);
        for lit in relit(&maps, [80.0, 80.0], 96) {
            let mut radiance = vec![0.0; 3 * maps.texels()];
            render(&maps, &lit.view, &mut radiance);
            for i in [0, 777, 9215] {
                for c in 0..3 {
                    assert_eq!(
                        lit.rgb[3 * i + c],
                        srgb(lit.exposure * radiance[c * maps.texels() + i])
                    );
                }
            }
        }
    }

    #[test]
    fn every_caption_fits_its_column() {
        let width = get_raster_width(FontWeight::Regular, FONT);
        for lit in relit(&Svbrdf::new(8, 4), [80.0, 40.0], 8) {
            assert!(lit.label.len() <= 24, "{}", lit.label);
        }
        assert!(24 * width <= CELL);
        // Small and narrow maps also leave room for captions.
        let sheet = Sheet::new(3, 40, 2);
        assert_eq!((sheet.enlarged, sheet.column), (6, 24 * width));
    }
}
