//! The four maps as files.

use std::path::{Path, PathBuf};

use super::files::write_files;
use super::floats::{encode_channels, read_channels};
use super::textures::{Density, Texture, TextureFormat};
use crate::confidence::Confidence;
use crate::frame::{Encoding, read_picture};
use crate::parallel;
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

/// Channels with the standard deviations, in the order of [`Confidence::planes`].
const DEVIATIONS: [&str; 4] =
    ["deviation.normal", "deviation.diffuse", "deviation.specular", "deviation.roughness"];

/// Writes `normal.png` (16-bit, (n + 1) / 2, Y up), `diffuse.png` and `specular.png` (16-bit, sRGB
/// curve), `roughness.png` (16-bit gray, linear) and `maps.exr` (float: `normal.X/Y/Z`,
/// `diffuse.R/G/B`, `specular.R/G/B`, `roughness.Y`) into a folder, which is made if missing: all
/// files or none.
///
/// # Errors
/// [`Error::Io`] naming the file that cannot be written.
pub fn write_maps(dir: impl AsRef<Path>, maps: &Svbrdf) -> Result<()> {
    write_files(dir, &map_files(maps, None)?)
}

/// As [`write_maps`]; the width and height of the sample go into every file (PNG: `pHYs`, OpenEXR:
/// the attributes `sampleSizeMm`, `xDensity` and `pixelAspectRatio`).
///
/// # Errors
/// As [`write_maps`]; [`Error::Argument`] where a length is not positive.
pub fn write_sized_maps(dir: impl AsRef<Path>, maps: &Svbrdf, sample_mm: [f32; 2]) -> Result<()> {
    check_size(sample_mm)?;
    write_files(dir, &map_files(maps, Some(sample_mm))?)
}

/// As [`write_sized_maps`]; `maps.exr` has the standard deviations as well, in the channels
/// `deviation.normal` (of each slope), `deviation.diffuse` and `deviation.specular` (of each colour,
/// linear), `deviation.roughness`.
///
/// # Errors
/// As [`write_sized_maps`]; [`Error::Argument`] where the sizes differ.
pub fn write_assessed_maps(
    dir: impl AsRef<Path>,
    maps: &Svbrdf,
    confidence: &Confidence,
    sample_mm: [f32; 2],
) -> Result<()> {
    write_files(dir, &encode_maps(maps, Some(confidence), Some(sample_mm))?)
}

/// The files of [`write_sized_maps`], or of [`write_assessed_maps`], in memory: names and bytes.
///
/// # Errors
/// [`Error::Argument`] as those.
pub fn encode_maps(
    maps: &Svbrdf,
    confidence: Option<&Confidence>,
    sample_mm: Option<[f32; 2]>,
) -> Result<Vec<(String, Vec<u8>)>> {
    sample_mm.map_or(Ok(()), check_size)?;
    let size = [maps.width(), maps.height()];
    let other = confidence.map(|c| [c.width(), c.height()]).filter(|found| *found != size);
    if let Some(found) = other {
        let message = format!("{found:?} texels given, {size:?} expected");
        return Err(Error::argument("confidence", message));
    }
    files(maps, confidence, sample_mm)
}

/// Checks that both lengths are positive.
pub(super) fn check_size(sample_mm: [f32; 2]) -> Result<()> {
    if sample_mm.iter().all(|v| v.is_finite() && *v > 0.0) {
        return Ok(());
    }
    let message = format!("{sample_mm:?} given, two positive lengths in mm expected");
    Err(Error::argument("sample_mm", message))
}

/// Names and bytes of the files of [`write_maps`].
pub(super) fn map_files(
    maps: &Svbrdf,
    sample_mm: Option<[f32; 2]>,
) -> Result<Vec<(String, Vec<u8>)>> {
    files(maps, None, sample_mm)
}

fn files(
    maps: &Svbrdf,
    confidence: Option<&Confidence>,
    sample_mm: Option<[f32; 2]>,
) -> Result<Vec<(String, Vec<u8>)>> {
    let density = sample_mm.map(|mm| Density::of([maps.width(), maps.height()], mm));
    let mut files = pictures(maps, density)?;
    files.push(("maps.exr".into(), floats(maps, confidence, sample_mm)?));
    Ok(files)
}

/// Names and bytes of the pictures.
fn pictures(maps: &Svbrdf, density: Option<Density>) -> Result<Vec<(String, Vec<u8>)>> {
    let (w, h) = (maps.width(), maps.height());
    let three = |first: usize| [0, 1, 2].map(|c| maps.plane(first + c));
    let (diffuse, specular) = (three(channel::DIFFUSE), three(channel::SPECULAR));
    let roughness = maps.plane(channel::ROUGHNESS);
    let textures = [
        ("normal", Texture::data(w, h, |i| maps.normal(i % w, i / w).map(|v| 0.5 * v + 0.5))),
        ("diffuse", Texture::colour(w, h, |i| diffuse.map(|p| p[i]))),
        ("specular", Texture::colour(w, h, |i| specular.map(|p| p[i]))),
        ("roughness", Texture::gray(w, h, |i| roughness[i])),
    ];
    let files = parallel::map(textures.len(), |i| {
        let (name, texture) = &textures[i];
        Ok((format!("{name}.png"), texture.encode(TextureFormat::Png16, density)?))
    });
    files.into_iter().collect()
}

/// Bytes of `maps.exr`.
fn floats(
    maps: &Svbrdf,
    confidence: Option<&Confidence>,
    sample_mm: Option<[f32; 2]>,
) -> Result<Vec<u8>> {
    let (w, h) = (maps.width(), maps.height());
    let mut planes = Vec::with_capacity(NORMAL.len() + OTHERS.len() + DEVIATIONS.len());
    for (axis, name) in NORMAL.into_iter().enumerate() {
        planes.push((name, (0..w * h).map(|i| maps.normal(i % w, i / w)[axis]).collect()));
    }
    for (c, name) in OTHERS.into_iter().enumerate() {
        planes.push((name, maps.plane(channel::DIFFUSE + c).to_vec()));
    }
    if let Some(confidence) = confidence {
        for (name, plane) in DEVIATIONS.into_iter().zip(confidence.planes().chunks_exact(w * h)) {
            planes.push((name, plane.to_vec()));
        }
    }
    encode_channels(w, h, planes, sample_mm)
}

/// Width and height of the sample, mm, as the files of a folder of maps state them: `maps.exr`, or
/// else `normal.png`. `None` where they do not.
///
/// # Errors
/// [`Error::Io`] or [`Error::Image`] naming the file that is missing or damaged.
pub fn read_sample_mm(dir: impl AsRef<Path>) -> Result<Option<[f32; 2]>> {
    let float = dir.as_ref().join("maps.exr");
    if float.is_file() {
        let stated = read_channels(&float)?.sample_mm;
        return Ok(stated.filter(|mm| mm.iter().all(|v| v.is_finite() && *v > 0.0)));
    }
    let path = find_picture(dir.as_ref(), "normal")?;
    if path.extension().is_none_or(|e| e != "png") {
        return Ok(None);
    }
    let file = std::fs::File::open(&path).map_err(|e| Error::io(&path, e))?;
    let reader = png::Decoder::new(std::io::BufReader::new(file)).read_info();
    let reader = reader.map_err(|e| Error::Image { path, message: e.to_string() })?;
    let info = reader.info();
    let stated = info.pixel_dims.filter(|dims| dims.unit == png::Unit::Meter);
    let stated = stated.filter(|dims| dims.xppu > 0 && dims.yppu > 0);
    let mm = |texels: u32, per_metre: u32| 1000.0 * texels as f32 / per_metre as f32;
    Ok(stated.map(|d| [mm(info.width, d.xppu), mm(info.height, d.yppu)]))
}

/// Reads maps back from a folder: `maps.exr`, or else the four pictures `normal`, `diffuse`,
/// `specular` and `roughness` (PNG, JPEG or TIFF, any depth) in the encodings of [`write_maps`].
/// Values outside their physical range are clamped into it, see [`Svbrdf::clamp`].
///
/// # Errors
/// [`Error::Io`] or [`Error::Image`] naming the file that is missing, damaged or of another size
/// than the rest; [`Error::Field`] naming file and channel that hold values that are not finite.
pub fn read_maps(dir: impl AsRef<Path>) -> Result<Svbrdf> {
    let dir = dir.as_ref();
    let float = dir.join("maps.exr");
    let mut maps = if float.is_file() { read_float(&float)? } else { read_pictures(dir)? };
    maps.clamp();
    Ok(maps)
}

fn read_float(path: &Path) -> Result<Svbrdf> {
    let mut file = read_channels(path)?;
    let width = file.width;
    let mut take = |name: &str| {
        let plane = file.planes.remove(name).ok_or_else(|| Error::Image {
            path: path.to_owned(),
            message: format!("no channel {name}; expected {NORMAL:?} and {OTHERS:?}"),
        })?;
        match plane.iter().position(|v| !v.is_finite()) {
            None => Ok(plane),
            Some(i) => Err(Error::Field {
                path: path.to_owned(),
                field: name.to_owned(),
                message: format!("{} at column {}, row {}", plane[i], i % width, i / width),
                expected: "finite numbers".into(),
            }),
        }
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
