//! Pictures inside of the page.

use std::io::Cursor;
use std::sync::LazyLock;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use svbrdf::Svbrdf;
use svbrdf::export::resized;
use svbrdf::photo::{Encoding, Photo};
use svbrdf::svbrdf::{LOBE_RANGE, lobe};

use crate::failure::{Failure, Result};

/// Quality of the maps' colours, 0 to 100: errs by one step of 8 bits.
const MAPS_QUALITY: u8 = 94;
/// Quality of everything small.
const SMALL_QUALITY: u8 = 82;

/// A JPEG picture from interleaved 8-bit RGB.
pub fn jpeg(width: usize, height: usize, rgb: &[u8]) -> Result<String> {
    jpeg_of(width, height, rgb, SMALL_QUALITY)
}

fn jpeg_of(width: usize, height: usize, rgb: &[u8], quality: u8) -> Result<String> {
    let mut bytes = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .write_image(rgb, width as u32, height as u32, ExtendedColorType::Rgb8)
        .map_err(|e| Failure::Other(format!("report.html: {e}")))?;
    Ok(uri("image/jpeg", bytes.get_ref()))
}

fn png(width: usize, height: usize, data: &[u8], colour: ExtendedColorType) -> Result<String> {
    let mut bytes = Cursor::new(Vec::new());
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(data, width as u32, height as u32, colour)
        .map_err(|e| Failure::Other(format!("report.html: {e}")))?;
    Ok(uri("image/png", bytes.get_ref()))
}

fn uri(kind: &str, bytes: &[u8]) -> String {
    format!("data:{kind};base64,{}", STANDARD.encode(bytes))
}

fn byte(value: f32) -> u8 {
    (255.0 * value).round() as u8
}

/// The sRGB curve as a table: its 16-bit steps are a twentieth of an 8-bit one where it is steepest.
static SRGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
    (0..=65535).map(|i| byte(Encoding::Srgb.encode(f64::from(i) / 65535.0) as f32)).collect()
});

fn srgb(linear: f32) -> u8 {
    // NaN becomes 0.
    SRGB[usize::from((65535.0 * linear).round() as u16)]
}

/// Maps of at most so many texels along each side.
pub fn at_most(maps: &Svbrdf, longest: usize) -> Svbrdf {
    let scale = (longest as f64 / maps.width().max(maps.height()) as f64).min(1.0);
    let side = |n: usize| ((n as f64 * scale).round() as usize).max(1);
    resized(maps, side(maps.width()), side(maps.height()))
}

/// The pictures from which the viewer makes its textures.
#[derive(serde::Serialize)]
pub struct MapPictures {
    width: usize,
    height: usize,
    /// PNG: x and y of the normal with 12 bits each, (n + 1) / 2 * 4095: the upper eight of them in
    /// red and green, the lower four in blue. Eight bits would show as steps in highlights.
    normal: String,
    /// JPEG, sRGB.
    diffuse: String,
    /// JPEG, sRGB.
    specular: String,
    /// Gray PNG, linear.
    roughness: String,
    /// Parameter of anisotropy for 127 steps of its picture.
    scale: f32,
    /// PNG: the two parameters of anisotropy in red and green, 128 is 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    anisotropy: Option<String>,
    /// PNG: weight and roughness of the coat in red and green, linear.
    #[serde(skip_serializing_if = "Option::is_none")]
    coat: Option<String>,
    /// PNG: colour of the sheen, sRGB.
    #[serde(skip_serializing_if = "Option::is_none")]
    sheen: Option<String>,
    /// PNG: roughness of the sheen in every channel, linear.
    #[serde(skip_serializing_if = "Option::is_none")]
    sheen_roughness: Option<String>,
}

/// Parameter of anisotropy for 127 steps of 8 bits.
const SCALE: f32 = LOBE_RANGE[lobe::ANISOTROPY_X].1;

/// The optional lobes that maps have: name and interleaved 8-bit RGB.
fn lobes(maps: &Svbrdf) -> Vec<(&'static str, Vec<u8>)> {
    let step = |v: f32| (128.0 + 127.0 / SCALE * v).round() as u8;
    let rgb = |planes: [&[f32]; 2], value: &dyn Fn(f32) -> u8| {
        planes[0].iter().zip(planes[1]).flat_map(|(a, b)| [value(*a), value(*b), 0]).collect()
    };
    let anisotropy = maps.anisotropy().map(|planes| ("anisotropy", rgb(planes, &step)));
    let coat = maps.coat().map(|planes| ("coat", rgb(planes, &byte)));
    let mut lobes: Vec<_> = anisotropy.into_iter().chain(coat).collect();
    if let Some([r, g, b, roughness]) = maps.sheen() {
        lobes.push(("sheen", colours([r, g, b])));
        lobes.push(("sheen_roughness", roughness.iter().flat_map(|v| [byte(*v); 3]).collect()));
    }
    lobes
}

impl MapPictures {
    /// Size inside of the page.
    pub fn bytes(&self) -> usize {
        let lobes = [&self.anisotropy, &self.coat, &self.sheen, &self.sheen_roughness];
        let lobes = lobes.into_iter().flatten().map(String::len).sum::<usize>();
        let maps = [&self.normal, &self.diffuse, &self.specular, &self.roughness];
        lobes + maps.map(|p| p.len()).iter().sum::<usize>()
    }

    pub fn new(maps: &Svbrdf) -> Result<Self> {
        let (width, height) = (maps.width(), maps.height());
        let normal: Vec<u8> = (0..maps.texels())
            .flat_map(|i| {
                let [x, y, _] = maps.normal(i % width, i / width);
                let [x, y] = [x, y].map(|v| (2047.5 * (v + 1.0)).round() as u16);
                [(x >> 4) as u8, (y >> 4) as u8, ((x & 15) << 4 | (y & 15)) as u8]
            })
            .collect();
        let roughness: Vec<u8> = maps.roughness().iter().map(|v| byte(*v)).collect();
        let colour = |planes| jpeg_of(width, height, &colours(planes), MAPS_QUALITY);
        let lobes = lobes(maps);
        let lobe = |name: &str| {
            let rgb = lobes.iter().find(|(own, _)| *own == name);
            rgb.map(|(_, rgb)| png(width, height, rgb, ExtendedColorType::Rgb8)).transpose()
        };
        Ok(Self {
            width,
            height,
            scale: SCALE,
            anisotropy: lobe("anisotropy")?,
            coat: lobe("coat")?,
            sheen: lobe("sheen")?,
            sheen_roughness: lobe("sheen_roughness")?,
            normal: png(width, height, &normal, ExtendedColorType::Rgb8)?,
            diffuse: colour(maps.diffuse())?,
            specular: colour(maps.specular())?,
            roughness: png(width, height, &roughness, ExtendedColorType::L8)?,
        })
    }
}

/// Planes of red, green and blue as interleaved sRGB.
fn colours(planes: [&[f32]; 3]) -> Vec<u8> {
    (0..planes[0].len()).flat_map(|i| planes.map(|p| srgb(p[i]))).collect()
}

/// Maps of an earlier moment in one JPEG: normal, diffuse, specular and roughness side by side, then the lobes
/// that there are.
#[derive(serde::Serialize)]
pub struct Snapshot {
    photographs: usize,
    /// Size of one of them.
    width: usize,
    height: usize,
    /// As in [`MapPictures`].
    scale: f32,
    /// Names of the lobes.
    lobes: Vec<&'static str>,
    picture: String,
}

impl Snapshot {
    /// Size in the page, with its text.
    pub fn bytes(&self) -> usize {
        self.picture.len() + 100
    }

    /// Longer side of each map, px.
    const SIDE: usize = 256;

    pub fn new(photographs: usize, maps: &Svbrdf) -> Result<Self> {
        let maps = at_most(maps, Self::SIDE);
        let (width, height) = (maps.width(), maps.height());
        let [diffuse, specular] = [maps.diffuse(), maps.specular()].map(colours);
        let roughness = maps.roughness();
        let lobes = lobes(&maps);
        let parts = 4 + lobes.len();
        let mut rgb = Vec::with_capacity(3 * parts * maps.texels());
        for y in 0..height {
            let row = y * width..(y + 1) * width;
            for x in 0..width {
                rgb.extend(maps.normal(x, y).map(|v| byte(0.5 * v + 0.5)));
            }
            rgb.extend(&diffuse[3 * row.start..3 * row.end]);
            rgb.extend(&specular[3 * row.start..3 * row.end]);
            rgb.extend(roughness[row.clone()].iter().flat_map(|&v| [byte(v); 3]));
            for (_, lobe) in &lobes {
                rgb.extend(&lobe[3 * row.start..3 * row.end]);
            }
        }
        let picture = jpeg(parts * width, height, &rgb)?;
        let lobes = lobes.into_iter().map(|(name, _)| name).collect();
        Ok(Self { photographs, width, height, scale: SCALE, lobes, picture })
    }
}

/// A small copy of a photograph.
#[derive(Clone, serde::Serialize)]
pub struct Thumbnail {
    /// Size of the photograph itself, px.
    width: u32,
    height: u32,
    picture: String,
}

impl Thumbnail {
    /// Samples along each axis for a pixel of the copy.
    const SAMPLES: u32 = 3;

    /// A copy `longest` px long. Values far below or above [0, 1], as linear photographs have them,
    /// are scaled to be seen.
    pub fn new(photo: &Photo, longest: u32) -> Result<Self> {
        let (w, h) = (photo.width(), photo.height());
        let scale = (f64::from(longest) / f64::from(w.max(h))).min(1.0);
        let side = |n: u32| ((f64::from(n) * scale).round() as u32).max(1);
        let (width, height) = (side(w), side(h));
        let sample = |i: u32, of: u32, n: u32| {
            let at = (u64::from(2 * i + 1) * u64::from(n)) / u64::from(2 * of);
            (at as u32).min(n - 1)
        };
        let s = Self::SAMPLES;
        let mut linear = Vec::with_capacity((3 * width * height) as usize);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let mut sum = [0.0_f32; 3];
            for (j, i) in (0..s).flat_map(|j| (0..s).map(move |i| (j, i))) {
                let pixel =
                    photo.pixel(sample(s * x + i, s * width, w), sample(s * y + j, s * height, h));
                (0..3).for_each(|c| sum[c] += pixel[c] / (s * s) as f32);
            }
            linear.extend(sum);
        }
        let gain = display_gain(&linear);
        let rgb: Vec<u8> = linear.iter().map(|v| srgb(gain * v)).collect();
        let picture = jpeg(width as usize, height as usize, &rgb)?;
        Ok(Self { width: w, height: h, picture })
    }
}

/// Factor that makes a linear photograph visible; 1 for those that are well exposed.
fn display_gain(linear: &[f32]) -> f32 {
    let mut some: Vec<f32> = linear.iter().step_by(7).copied().collect();
    let at = some.len() * 98 / 100;
    let bright = *some.select_nth_unstable_by(at, f32::total_cmp).1;
    if (0.2..=1.0).contains(&bright) { 1.0 } else { 0.9 / bright.max(1e-6) }
}
