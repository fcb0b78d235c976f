//! The four maps as files.

use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageBuffer};

use super::files::{check_writable, quantise, rgb16, write_png};
use super::floats::{read_channels, write_channels};
use crate::frame::{Encoding, read_picture};
use crate::svbrdf::{CHANNELS, channel};
use crate::{Error, Result, Svbrdf};

/// Channels of `maps.exr` that hold the maps: the unit normal, albedos, roughness.
const NORMAL: [&str; 3] = ["normal.X", "normal.Y", "normal.Z"];
/// Albedos and roughness in the order of [`channel`], from [`channel::DIFFUSE`].
const OTHERS: [&str; 7] = [
    "diffuse.R",
    "diffuse.G",
    "diffuse.B",
    "specular.R",
    "specular.G",
    "specular.B",
    "roughness.Y",
];

/// Writes `normal.png` (16-bit, (n + 1) / 2, Y up), `diffuse.png` and `specular.png` (16-bit, sRGB
/// curve), `roughness.png` (16-bit gray, linear) and `maps.exr` (float: `normal.X/Y/Z`,
/// `diffuse.R/G/B`, `specular.R/G/B`, `roughness.Y`) into a folder, which is made if missing.
///
/// # Errors
/// [`Error::Io`] naming the file that cannot be written.
pub fn write_maps(dir: impl AsRef<Path>, maps: &Svbrdf) -> Result<()> {
    let dir = dir.as_ref();
    check_writable(dir)?;
    let (w, h) = (maps.width(), maps.height());
    let normal = |i: usize| maps.normal(i % w, i / w);
    write_png(&dir.join("normal.png"), &rgb16(w, h, |i| normal(i).map(|v| 0.5 * v + 0.5)))?;
    for (name, first) in [("diffuse.png", channel::DIFFUSE), ("specular.png", channel::SPECULAR)] {
        let planes: [&[f32]; 3] = std::array::from_fn(|c| maps.plane(first + c));
        let picture =
            rgb16(w, h, |i| planes.map(|p| Encoding::Srgb.encode(f64::from(p[i])) as f32));
        write_png(&dir.join(name), &picture)?;
    }
    let roughness = maps.plane(channel::ROUGHNESS).iter().map(|&v| quantise(v)).collect();
    let roughness = ImageBuffer::from_raw(w as u32, h as u32, roughness);
    let roughness = DynamicImage::ImageLuma16(roughness.expect("one value a texel"));
    write_png(&dir.join("roughness.png"), &roughness)?;

    let mut planes = Vec::with_capacity(10);
    for (axis, name) in NORMAL.into_iter().enumerate() {
        planes.push((name, (0..w * h).map(|i| normal(i)[axis]).collect()));
    }
    for (c, name) in OTHERS.into_iter().enumerate() {
        planes.push((name, maps.plane(channel::DIFFUSE + c).to_vec()));
    }
    write_channels(&dir.join("maps.exr"), w, h, planes)
}

/// Reads maps back from a folder: `maps.exr`, or else the four pictures `normal`, `diffuse`,
/// `specular` and `roughness` (PNG, JPEG or TIFF, any depth) in the encodings of [`write_maps`].
/// Values outside their physical range are clamped into it, see [`Svbrdf::clamp`].
///
/// # Errors
/// [`Error::Io`] or [`Error::Image`] naming the file that is missing, damaged or of another size
/// than the rest.
pub fn read_maps(dir: impl AsRef<Path>) -> Result<Svbrdf> {
    let dir = dir.as_ref();
    let float = dir.join("maps.exr");
    let mut maps = if float.is_file() { read_float(&float)? } else { read_pictures(dir)? };
    maps.clamp();
    Ok(maps)
}

fn read_float(path: &Path) -> Result<Svbrdf> {
    let mut file = read_channels(path)?;
    let mut take = |name: &str| {
        file.planes.remove(name).ok_or_else(|| Error::Image {
            path: path.to_owned(),
            message: format!("no channel {name}; expected {NORMAL:?} and {OTHERS:?}"),
        })
    };
    let normal = [take(NORMAL[0])?, take(NORMAL[1])?, take(NORMAL[2])?];
    let n = normal[0].len();
    let mut planes = Vec::with_capacity(CHANNELS * n);
    for axis in 0..2 {
        planes.extend((0..n).map(|i| slope(normal[axis][i], normal[2][i])));
    }
    for name in OTHERS {
        planes.extend(take(name)?);
    }
    Svbrdf::from_planes(file.width, file.height, planes)
}

/// `n.x / n.z`; a normal on the horizon or below it becomes steep.
fn slope(along: f32, up: f32) -> f32 {
    along / up.max(1e-3)
}

fn read_pictures(dir: &Path) -> Result<Svbrdf> {
    let mut size = None;
    let mut read = |stem: &str| -> Result<Vec<f32>> {
        let path = find_picture(dir, stem)?;
        let picture = read_picture(&path)?;
        let found = (picture.width() as usize, picture.height() as usize);
        let (width, height) = *size.get_or_insert(found);
        if found != (width, height) {
            let message =
                format!("{} x {} px, the other maps have {width} x {height}", found.0, found.1);
            return Err(Error::Image { path, message });
        }
        Ok(picture.into_rgb32f().into_raw())
    };
    let normal = read("normal")?;
    let diffuse = read("diffuse")?;
    let specular = read("specular")?;
    let roughness = read("roughness")?;
    let (width, height) = size.expect("set by the first picture");
    let mut planes = Vec::with_capacity(CHANNELS * width * height);
    for axis in 0..2 {
        let texels = normal.as_chunks::<3>().0.iter();
        planes.extend(texels.map(|p| slope(2.0 * p[axis] - 1.0, 2.0 * p[2] - 1.0)));
    }
    for picture in [&diffuse, &specular] {
        for c in 0..3 {
            let texels = picture.as_chunks::<3>().0.iter();
            planes.extend(texels.map(|p| Encoding::Srgb.decode(f64::from(p[c])) as f32));
        }
    }
    planes.extend(roughness.as_chunks::<3>().0.iter().map(|p| p[0]));
    Svbrdf::from_planes(width, height, planes)
}

fn find_picture(dir: &Path, stem: &str) -> Result<PathBuf> {
    let candidates =
        ["png", "jpg", "jpeg", "tif", "tiff"].map(|e| dir.join(stem).with_extension(e));
    candidates.into_iter().find(|path| path.is_file()).ok_or_else(|| {
        let what = "neither maps.exr nor this map as a PNG, JPEG or TIFF file was found";
        Error::io(dir.join(stem), std::io::Error::new(std::io::ErrorKind::NotFound, what))
    })
}
