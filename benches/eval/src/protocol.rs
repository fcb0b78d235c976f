//! Materials and their synthetic photographs.

use std::f32::consts::PI;
use std::path::PathBuf;

use svbrdf::export::read_maps;
use svbrdf::observation::{Falloff, Observation, View};
use svbrdf::photo::Encoding;
use svbrdf::random::Random;
use svbrdf::render;
use svbrdf::{Error, Result, Svbrdf};

/// Selection of materials, and conditions of their photographs.
#[derive(Clone, clap::Args)]
pub struct Arguments {
    /// Folder with a folder per material: normal, diffuse, specular, roughness
    #[arg(default_value = "materials")]
    pub materials: PathBuf,
    /// Crops of 256x256 texels of each material
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=4))]
    pub crops: u8,
    /// Use the materials whose names contain this only
    #[arg(long)]
    pub only: Option<String>,
    /// Use every nth material only
    #[arg(long, default_value_t = 1)]
    pub every: usize,
    /// Standard deviation of multiplicative noise
    #[arg(long, default_value_t = 0.0)]
    pub noise: f32,
    /// A line per crop
    #[arg(long)]
    pub verbose: bool,
}

/// One crop of each material of a folder, without noise.
impl From<PathBuf> for Arguments {
    fn from(materials: PathBuf) -> Self {
        Self { materials, crops: 1, only: None, every: 1, noise: 0.0, verbose: false }
    }
}

/// Texels per side of a crop.
pub const SIDE: usize = 256;
/// Half the width of the sample, mm.
pub const HALF_WIDTH: f32 = 50.0;
/// The paper's camera, see [`Conditions`].
pub const DISTANCE: f32 = 2.146;
const REACH: f64 = 1.2;

/// A piece of a known material.
pub struct Crop {
    pub name: String,
    pub truth: Svbrdf,
}

/// Conditions of the photographs.
#[derive(Clone, Copy)]
pub struct Conditions {
    /// Standard deviation of noise proportional to the value.
    pub noise: f32,
    /// Angle between the true light and the light given to the fit, degrees.
    pub light_degrees: f32,
    /// Irradiance of uniform surroundings as a share of the flash's, not given to the fit.
    pub ambient: f32,
    /// Gain of the sensor, given to the fit; the sensor saturates at 1.
    pub gain: f32,
    /// Levels of the file; `None`: continuous without saturation (HDR).
    pub levels: Option<f32>,
    /// Encoding in which the levels are evenly spaced.
    pub encoding: Encoding,
    /// Takes the first photograph from 45 degrees.
    pub oblique: bool,
    /// Distance of the camera from the sample's plane, and range of its lateral positions, in half widths.
    pub distance: f32,
    pub reach: f64,
    /// Position of the light relative to the camera, half widths.
    pub light_beside: [f32; 2],
}

impl Conditions {
    pub fn new(noise: f32) -> Self {
        Self {
            noise,
            light_degrees: 0.0,
            ambient: 0.0,
            gain: 1.0,
            levels: Some(65535.0),
            encoding: Encoding::Linear,
            oblique: false,
            distance: DISTANCE,
            reach: REACH,
            light_beside: [0.0; 2],
        }
    }

    /// Random realistic conditions: camera (the sample, or a board around it, fills the picture),
    /// flash, ambient light, noise and levels.
    pub fn random(random: &mut Random) -> Self {
        let mut uniform = || random.uniform() as f32;
        let distance = 1.7 * 4.7f32.powf(uniform());
        let beside = 0.15 * distance * uniform() * uniform();
        let (sin, cos) = (std::f32::consts::TAU * uniform()).sin_cos();
        let (levels, encoding) = match uniform() {
            0.0..0.4 => (255.0, Encoding::Srgb),
            0.4..0.6 => (1023.0, Encoding::Linear),
            _ => (65535.0, Encoding::Linear),
        };
        Self {
            levels: Some(levels),
            encoding,
            ambient: if uniform() < 0.25 { 0.03 * uniform() } else { 0.0 },
            distance,
            reach: f64::from(distance * (0.3 + 0.5 * uniform())),
            light_beside: [beside * cos, beside * sin],
            ..Self::new([0.0, 0.01, 0.02, 0.04][(4.0 * uniform()) as usize])
        }
    }
}

/// Maps of the selected materials.
fn materials(arguments: &Arguments) -> Result<Vec<(String, Svbrdf)>> {
    let folder = &arguments.materials;
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let mut folders: Vec<_> =
        entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.is_dir()).collect();
    folders.sort();
    let mut materials = Vec::new();
    for folder in folders.iter().step_by(arguments.every.max(1)) {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if arguments.only.as_ref().is_some_and(|part| !name.contains(part)) {
            continue;
        }
        materials.push((name, read_maps(folder)?));
    }
    if materials.is_empty() {
        return Err(Error::argument("materials", format!("{}: none found", folder.display())));
    }
    Ok(materials)
}

/// Crops of the selected materials.
pub fn crops(arguments: &Arguments) -> Result<Vec<Crop>> {
    let mut crops = Vec::new();
    for (name, maps) in materials(arguments)? {
        let (w, h) = (maps.width(), maps.height());
        if w < SIDE || h < SIDE {
            return Err(Error::argument("materials", format!("{name}: smaller than {SIDE}")));
        }
        let (left, top) = ((w - SIDE) / 2, (h - SIDE) / 2);
        let corners: Vec<[usize; 2]> = if arguments.crops == 1 || left < SIDE / 2 || top < SIDE / 2
        {
            vec![[left, top]]
        } else {
            let (x, y) = (w / 2 - SIDE, h / 2 - SIDE);
            let four = [[x, y], [w / 2, y], [x, h / 2], [w / 2, h / 2]];
            four[..usize::from(arguments.crops)].to_vec()
        };
        for (i, corner) in corners.into_iter().enumerate() {
            crops.push(Crop { name: format!("{name} {i}"), truth: crop(&maps, corner, SIDE)? });
        }
    }
    Ok(crops)
}

/// The central square of each selected material with at least `least` texels per side.
pub fn whole(arguments: &Arguments, least: usize) -> Result<Vec<Crop>> {
    let square = |(name, maps): (String, Svbrdf)| {
        let (w, h) = (maps.width(), maps.height());
        let side = w.min(h);
        let truth = crop(&maps, [(w - side) / 2, (h - side) / 2], side)?;
        Ok(Crop { name, truth })
    };
    let large = |(_, maps): &(String, Svbrdf)| maps.width().min(maps.height()) >= least;
    let crops: Vec<_> =
        materials(arguments)?.into_iter().filter(large).map(square).collect::<Result<_>>()?;
    if crops.is_empty() {
        return Err(Error::argument("materials", format!("none has {least} texels a side")));
    }
    Ok(crops)
}

/// A square crop of maps.
pub fn crop(maps: &Svbrdf, [left, top]: [usize; 2], side: usize) -> Result<Svbrdf> {
    let cut = |planes: &[f32]| -> Vec<f32> {
        let planes = planes.chunks_exact(maps.texels());
        let rows = planes.flat_map(|plane| plane.chunks_exact(maps.width()).skip(top).take(side));
        rows.flat_map(|row| row[left..left + side].iter().copied()).collect()
    };
    let mut square = Svbrdf::from_planes(side, side, cut(maps.planes()))?;
    square.set_lobes(cut(maps.lobes()))?;
    Ok(square)
}

fn view(camera: [f32; 3], light: [f32; 3], gain: f32, ambient: f32) -> View {
    View {
        sample_mm: [2.0 * HALF_WIDTH; 2],
        camera_mm: camera.map(|v| v * HALF_WIDTH),
        light_mm: light.map(|v| v * HALF_WIDTH),
        falloff: Falloff::None { power: [gain * PI; 3] },
        ambient: [gain * ambient; 3],
        ..View::default()
    }
}

/// The first `count` photographs of a crop; `seed` determines positions and noise.
pub fn photographs(
    truth: &Svbrdf,
    count: usize,
    seed: u64,
    conditions: &Conditions,
) -> Vec<Observation> {
    let mut places = Random::new(seed);
    let mut errors = Random::new(seed ^ 0x5EED);
    (0..count)
        .map(|i| {
            let Conditions { distance, reach, .. } = *conditions;
            let mut side = || (reach * (2.0 * places.uniform() - 1.0)) as f32;
            let random = [side(), side(), distance];
            let at = match (i, conditions.oblique) {
                (0, false) => [0.0, 0.0, distance],
                (0, true) => [distance * 0.5f32.sqrt(), 0.0, distance * 0.5f32.sqrt()],
                _ => random,
            };
            photograph(truth, at, conditions, &mut errors)
        })
        .collect()
}

/// A photograph with the camera at a position in half widths.
pub fn photograph(
    truth: &Svbrdf,
    at: [f32; 3],
    conditions: &Conditions,
    errors: &mut Random,
) -> Observation {
    let Conditions { gain, ambient, light_beside, .. } = *conditions;
    let light = [at[0] + light_beside[0], at[1] + light_beside[1], at[2]];
    let told = tilted(light, conditions.light_degrees, errors.uniform() as f32);
    let n = truth.texels();
    let mut radiance = vec![0.0; 3 * n];
    render::render(truth, &view(at, light, gain, ambient), &mut radiance);
    for v in &mut radiance {
        *v = (*v * (1.0 + conditions.noise * errors.bell() as f32)).max(0.0);
        if let Some(levels) = conditions.levels {
            let stored = conditions.encoding.encode(f64::from(*v)) as f32;
            let stored = (stored * levels).round() / levels;
            let linear = conditions.encoding.decode(f64::from(stored)) as f32;
            *v = if stored >= 1.0 { -1.0 } else { linear };
        }
    }
    let view = view(at, told, gain, 0.0);
    Observation::new(truth.width(), truth.height(), view, &radiance, &vec![1.0; n])
        .expect("planes have this size")
}

/// A position rotated about the sample's centre by an angle, in a direction given by `turn`.
fn tilted(at: [f32; 3], degrees: f32, turn: f32) -> [f32; 3] {
    let at = glam::Vec3::from(at);
    let across = at.any_orthonormal_vector();
    let axis = glam::Quat::from_axis_angle(at.normalize(), std::f32::consts::TAU * turn) * across;
    (glam::Quat::from_axis_angle(axis, degrees.to_radians()) * at).into()
}

/// The gain at which `share` of all values of the photographs saturate.
pub fn gain_of_share(truth: &Svbrdf, count: usize, seed: u64, share: f32) -> f32 {
    let conditions = Conditions { levels: None, ..Conditions::new(0.0) };
    let mut values: Vec<f32> = photographs(truth, count, seed, &conditions)
        .iter()
        .flat_map(|o| {
            (0..3 * o.texels()).step_by(7).map(|i| o.radiance(i / o.texels(), i % o.texels()))
        })
        .collect();
    values.sort_by(f32::total_cmp);
    let index = ((1.0 - share) * (values.len() - 1) as f32) as usize;
    1.0 / values[index].max(1e-4)
}
