//! Reads and writes maps as files.

use std::path::{Path, PathBuf};

use super::files::replace_files;
use super::floats::{Channels, encode_channels, read_channels};
use super::lobes;
use super::textures::{Density, Texture, TextureFormat};
use crate::parallel;
use crate::photo::{Encoding, read_picture};
use crate::svbrdf::{Anisotropy, CHANNELS, LOBES, gltf};
use crate::uncertainty::Uncertainty;
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

/// Channels of the optional lobes: direction of the larger alpha and glTF's strength; weight and
/// roughness of a coat; colour and roughness of sheen. With anisotropy, the roughness of the specular lobe is
/// the roughness across the direction.
const ANISOTROPY: [&str; 3] = ["anisotropy.X", "anisotropy.Y", "anisotropy.strength"];
const COAT: [&str; 2] = ["coat.weight", "coat.roughness"];
const SHEEN: [&str; 4] = ["sheen.R", "sheen.G", "sheen.B", "sheen.roughness"];

/// Names of the files that [`write_maps`] writes only for materials with these lobes: anisotropy, coat, colour
/// and roughness of sheen.
pub const LOBE_FILES: [&str; 4] =
    ["anisotropy.png", "coat.png", "sheen.png", "sheen_roughness.png"];

/// Channels with the standard deviations, in the order of [`Uncertainty::planes`]. Those of lobes are written with
/// the lobe.
const DEVIATIONS: [&str; 4 + LOBES] = [
    "deviation.normal",
    "deviation.diffuse",
    "deviation.specular",
    "deviation.roughness",
    "deviation.anisotropy.cosine",
    "deviation.anisotropy.sine",
    "deviation.coat.weight",
    "deviation.coat.roughness",
    "deviation.sheen.R",
    "deviation.sheen.G",
    "deviation.sheen.B",
    "deviation.sheen.roughness",
];

/// Statements in the files of maps beside the maps.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MapsOptions<'a> {
    /// Width and height of the sample, mm: in every file (PNG: `pHYs`, OpenEXR: the attributes
    /// `sampleSizeMm`, `xDensity` and `pixelAspectRatio`).
    pub sample_mm: Option<[f32; 2]>,
    /// Standard deviations: in `maps.exr`, in the channels `deviation.normal` (of each slope),
    /// `deviation.diffuse` and `deviation.specular` (of each colour, linear), `deviation.roughness`; of optional
    /// lobes in `deviation.anisotropy.cosine/sine` (of `lobe::ANISOTROPY_X` and `lobe::ANISOTROPY_Y`),
    /// `deviation.coat.weight/roughness` and `deviation.sheen.R/G/B/roughness`.
    pub uncertainty: Option<&'a Uncertainty>,
}

/// Writes `normal.png` (16-bit, (n + 1) / 2, Y up), `diffuse.png` and `specular.png` (16-bit, sRGB curve),
/// `roughness.png` (16-bit gray, linear) and `maps.exr` (float: `normal.X/Y/Z`, `diffuse.R/G/B`,
/// `specular.R/G/B`, `roughness.Y`) into a folder, all or none. Creates a missing folder.
///
/// An anisotropic lobe adds `anisotropy.png` (16-bit, linear, as the texture of glTF's
/// `KHR_materials_anisotropy`: R, G the direction, (d + 1) / 2, B the strength) and the channels
/// `anisotropy.X/Y/strength`. The roughness of the files is then that across the direction, with `alpha along
/// = mix(roughness², 1, strength²)`. A coat adds `coat.png` (16-bit, linear, as glTF's clear-coat textures: R
/// weight, G roughness) and the channels `coat.weight/roughness`. Sheen adds `sheen.png` (16-bit, sRGB curve)
/// and `sheen_roughness.png` (16-bit gray, linear), as in glTF's `KHR_materials_sheen`, and the channels
/// `sheen.R/G/B/roughness`. Such files of earlier maps are removed.
///
/// # Errors
/// [`Error::Io`] with the file that cannot be written; [`Error::Argument`] if a length is not positive or the
/// deviations are of another size.
pub fn write_maps(dir: impl AsRef<Path>, maps: &Svbrdf, options: &MapsOptions) -> Result<()> {
    replace_files(dir, &encode_maps(maps, options)?, &LOBE_FILES)
}

/// The files of [`write_maps`] in memory, as names and bytes.
///
/// # Errors
/// [`Error::Argument`] as [`write_maps`].
pub fn encode_maps(maps: &Svbrdf, options: &MapsOptions) -> Result<Vec<(String, Vec<u8>)>> {
    let MapsOptions { sample_mm, uncertainty } = *options;
    sample_mm.map_or(Ok(()), check_size)?;
    let size = [maps.width(), maps.height()];
    let other = uncertainty.map(|c| [c.width(), c.height()]).filter(|found| *found != size);
    if let Some(found) = other {
        let message = format!("{found:?} texels given, {size:?} expected");
        return Err(Error::argument("uncertainty", message));
    }
    let density = sample_mm.map(|mm| Density::of(size, mm));
    let anisotropy = lobes::anisotropy(maps);
    let mut files = pictures(maps, anisotropy.as_deref(), density)?;
    let floats = floats(maps, anisotropy.as_deref(), uncertainty, sample_mm)?;
    files.push(("maps.exr".into(), floats));
    Ok(files)
}

/// Checks that both lengths are positive.
pub(super) fn check_size(sample_mm: [f32; 2]) -> Result<()> {
    if sample_mm.iter().all(|v| v.is_finite() && *v > 0.0) {
        return Ok(());
    }
    let message = format!("{sample_mm:?} given, two positive lengths in mm expected");
    Err(Error::argument("sample_mm", message))
}

/// Names and bytes of the pictures.
fn pictures(
    maps: &Svbrdf,
    anisotropy: Option<&[Anisotropy]>,
    density: Option<Density>,
) -> Result<Vec<(String, Vec<u8>)>> {
    let (w, h) = (maps.width(), maps.height());
    let (diffuse, specular) = (maps.diffuse(), maps.specular());
    let mut textures = vec![
        ("normal", Texture::data(w, h, |i| maps.normal(i % w, i / w).map(|v| 0.5 * v + 0.5))),
        ("diffuse", Texture::colour(w, h, |i| diffuse.map(|p| p[i]))),
        ("specular", Texture::colour(w, h, |i| specular.map(|p| p[i]))),
        ("roughness", Texture::gray(w, h, |i| gltf::roughness(maps, i))),
    ];
    textures.extend(anisotropy.map(|lobes| {
        let texel = |i: usize| {
            let [x, y] = lobes::direction(&lobes[i], 1.0);
            [x, y, lobes[i].strength()]
        };
        ("anisotropy", Texture::data(w, h, texel))
    }));
    textures.extend(maps.coat().map(|[weight, roughness]| {
        ("coat", Texture::data(w, h, |i| [weight[i], roughness[i], 0.0]))
    }));
    if let Some([r, g, b, roughness]) = maps.sheen() {
        textures.push(("sheen", Texture::colour(w, h, |i| [r[i], g[i], b[i]])));
        textures.push(("sheen_roughness", Texture::gray(w, h, |i| roughness[i])));
    }
    let files = parallel::map(textures.len(), |i| {
        let (name, texture) = &textures[i];
        Ok((format!("{name}.png"), texture.encode(TextureFormat::Png16, density)?))
    });
    files.into_iter().collect()
}

/// Bytes of `maps.exr`.
fn floats(
    maps: &Svbrdf,
    anisotropy: Option<&[Anisotropy]>,
    uncertainty: Option<&Uncertainty>,
    sample_mm: Option<[f32; 2]>,
) -> Result<Vec<u8>> {
    let (w, h) = (maps.width(), maps.height());
    let mut planes = Vec::new();
    for (axis, name) in NORMAL.into_iter().enumerate() {
        planes.push((name, (0..w * h).map(|i| maps.normal(i % w, i / w)[axis]).collect()));
    }
    let [colours @ .., roughness] = OTHERS;
    let albedos = maps.diffuse().into_iter().chain(maps.specular());
    planes.extend(colours.into_iter().zip(albedos.map(<[f32]>::to_vec)));
    planes.push((roughness, (0..w * h).map(|i| gltf::roughness(maps, i)).collect()));
    if let Some(lobes) = anisotropy {
        let [x, y, strength] = ANISOTROPY;
        planes.push((x, lobes.iter().map(|lobe| lobe.direction()[0]).collect()));
        planes.push((y, lobes.iter().map(|lobe| lobe.direction()[1]).collect()));
        planes.push((strength, lobes.iter().map(Anisotropy::strength).collect()));
    }
    let coat = COAT.into_iter().zip(maps.coat().into_iter().flatten());
    let sheen = SHEEN.into_iter().zip(maps.sheen().into_iter().flatten());
    planes.extend(coat.chain(sheen).map(|(name, plane)| (name, plane.to_vec())));
    if let Some(uncertainty) = uncertainty {
        let deviations = DEVIATIONS.into_iter().zip(uncertainty.planes().chunks_exact(w * h));
        let there =
            |(i, (_, plane)): &(usize, (&str, &[f32]))| *i < 4 || plane.iter().any(|v| *v > 0.0);
        let written = deviations.enumerate().filter(there);
        planes.extend(written.map(|(_, (name, plane))| (name, plane.to_vec())));
    }
    encode_channels(w, h, planes, sample_mm)
}

/// Width and height of the sample, mm, as stated by `maps.exr` or else `normal.png` in a folder of
/// maps; `None` if not stated.
///
/// # Errors
/// [`Error::Io`] or [`Error::Image`] with the file that is missing or damaged.
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

/// Reads maps from a folder: `maps.exr`, or else the four pictures `normal`, `diffuse`, `specular` and
/// `roughness` (PNG, JPEG or TIFF, any depth) in the encodings of [`write_maps`], and if present `anisotropy`,
/// `coat`, and `sheen` with `sheen_roughness`. Clamps values to their physical range, see [`Svbrdf::clamp`].
///
/// # Errors
/// [`Error::Io`] or [`Error::Image`] with a file that is missing, damaged or of another size;
/// [`Error::Field`] with file and channel of values that are not finite.
pub fn read_maps(dir: impl AsRef<Path>) -> Result<Svbrdf> {
    let dir = dir.as_ref();
    let float = dir.join("maps.exr");
    let mut maps = if float.is_file() { read_float(&float)? } else { read_pictures(dir)? };
    maps.clamp();
    Ok(maps)
}

fn read_float(path: &Path) -> Result<Svbrdf> {
    let mut file = read_channels(path)?;
    let [has_anisotropy, has_coat, has_sheen] =
        [ANISOTROPY[2], COAT[0], SHEEN[0]].map(|name| file.planes.contains_key(name));
    let mut take = |name: &str| take(&mut file, path, name);
    let normal = [take(NORMAL[0])?, take(NORMAL[1])?, take(NORMAL[2])?];
    let n = normal[0].len();
    let mut planes = Vec::with_capacity(CHANNELS * n);
    for axis in 0..2 {
        planes.extend((0..n).map(|i| slope(normal[axis][i], normal[2][i])));
    }
    for name in OTHERS {
        planes.extend(take(name)?);
    }
    let mut lobes = StoredLobes::default();
    if has_anisotropy {
        let [x, y, strength] = ANISOTROPY;
        lobes.anisotropy = Some([take(x)?, take(y)?, take(strength)?]);
    }
    if has_coat {
        lobes.coat = Some([take(COAT[0])?, take(COAT[1])?]);
    }
    if has_sheen {
        let [r, g, b, roughness] = SHEEN;
        lobes.sheen = Some([take(r)?, take(g)?, take(b)?, take(roughness)?]);
    }
    let mut maps = Svbrdf::from_planes(file.width, file.height, planes)?;
    lobes.add_to(&mut maps)?;
    Ok(maps)
}

/// Takes a channel out of a file of maps.
fn take(file: &mut Channels, path: &Path, name: &str) -> Result<Vec<f32>> {
    let plane = file.planes.remove(name).ok_or_else(|| Error::Image {
        path: path.to_owned(),
        message: format!("no channel {name}; expected {NORMAL:?} and {OTHERS:?}"),
    })?;
    let Some(i) = plane.iter().position(|v| !v.is_finite()) else { return Ok(plane) };
    Err(Error::Field {
        path: path.to_owned(),
        field: name.to_owned(),
        message: format!("{} at column {}, row {}", plane[i], i % file.width, i / file.width),
        expected: "finite numbers".into(),
    })
}

/// Lobes of the files.
#[derive(Default)]
struct StoredLobes {
    /// Direction and strength.
    anisotropy: Option<[Vec<f32>; 3]>,
    /// Weight and roughness.
    coat: Option<[Vec<f32>; 2]>,
    /// Linear colour and roughness.
    sheen: Option<[Vec<f32>; 4]>,
}

impl StoredLobes {
    /// Adds the lobes to maps. With anisotropy, the maps still hold the roughness across the direction.
    fn add_to(self, maps: &mut Svbrdf) -> Result<()> {
        let (anisotropy, coat) = (self.anisotropy.map(texels), self.coat.map(texels));
        gltf::add_lobes(maps, anisotropy, coat, self.sheen.map(texels))
    }
}

/// Texel by texel from planes.
fn texels<const C: usize>(planes: [Vec<f32>; C]) -> impl Iterator<Item = [f32; C]> {
    (0..planes[0].len()).map(move |i| std::array::from_fn(|c| planes[c][i]))
}

/// `n.x / n.z`, limited for normals at or below the horizon.
fn slope(along: f32, up: f32) -> f32 {
    along / up.max(1e-3)
}

fn read_pictures(dir: &Path) -> Result<Svbrdf> {
    let mut size = None;
    let mut read = |path: PathBuf| -> Result<Vec<f32>> {
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
    let normal = read(find_picture(dir, "normal")?)?;
    let diffuse = read(find_picture(dir, "diffuse")?)?;
    let specular = read(find_picture(dir, "specular")?)?;
    let roughness = read(find_picture(dir, "roughness")?)?;
    let mut lobe = |stem| picture_path(dir, stem).map(&mut read).transpose();
    let (anisotropy, coat, sheen) = (lobe("anisotropy")?, lobe("coat")?, lobe("sheen")?);
    let sheen = match sheen {
        Some(colour) => Some((colour, read(find_picture(dir, "sheen_roughness")?)?)),
        None => None,
    };
    let (width, height) = size.expect("set by the first picture");
    let mut planes = Vec::with_capacity(CHANNELS * width * height);
    for axis in 0..2 {
        let texels = normal.as_chunks::<3>().0.iter();
        planes.extend(texels.map(|p| slope(2.0 * p[axis] - 1.0, 2.0 * p[2] - 1.0)));
    }
    let plane = |rgb: &[f32], c: usize| -> Vec<f32> {
        rgb.as_chunks::<3>().0.iter().map(|p| p[c]).collect()
    };
    let colour = |rgb: &[f32], c: usize| -> Vec<f32> {
        let mut plane = plane(rgb, c);
        plane.iter_mut().for_each(|v| *v = Encoding::Srgb.decode(f64::from(*v)) as f32);
        plane
    };
    for picture in [&diffuse, &specular] {
        (0..3).for_each(|c| planes.extend(colour(picture, c)));
    }
    planes.extend(plane(&roughness, 0));
    let mut maps = Svbrdf::from_planes(width, height, planes)?;
    let anisotropy = anisotropy.map(|rgb| {
        let [x, y] = [0, 1].map(|c| plane(&rgb, c).into_iter().map(|v| 2.0 * v - 1.0).collect());
        [x, y, plane(&rgb, 2)]
    });
    let coat = coat.map(|rgb| [0, 1].map(|c| plane(&rgb, c)));
    let sheen = sheen.map(|(rgb, gray)| {
        let [r, g, b] = [0, 1, 2].map(|c| colour(&rgb, c));
        [r, g, b, plane(&gray, 0)]
    });
    StoredLobes { anisotropy, coat, sheen }.add_to(&mut maps)?;
    Ok(maps)
}

/// Path of the picture with this stem, if it exists.
fn picture_path(dir: &Path, stem: &str) -> Option<PathBuf> {
    let candidates =
        ["png", "jpg", "jpeg", "tif", "tiff"].map(|e| dir.join(stem).with_extension(e));
    candidates.into_iter().find(|path| path.is_file())
}

fn find_picture(dir: &Path, stem: &str) -> Result<PathBuf> {
    picture_path(dir, stem).ok_or_else(|| {
        let what = "neither maps.exr nor this map as a PNG, JPEG or TIFF file was found";
        Error::io(dir.join(stem), std::io::Error::new(std::io::ErrorKind::NotFound, what))
    })
}
