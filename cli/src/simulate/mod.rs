//! `svbrdf simulate`: photographs of a board and known maps.

use std::f64::consts::PI;
use std::path::PathBuf;

use glam::{DMat3, DVec2, DVec3, Vec3};
use rayon::prelude::*;
use serde_json::json;
use svbrdf::Svbrdf;
use svbrdf::calibration::Target;
use svbrdf::capture::{FILE_NAME, FORMAT};
use svbrdf::export::{check_writable, read_maps, write_atomic, write_maps};
use svbrdf::frame::Encoding;
use svbrdf::geometry::{Camera, Pose};
use svbrdf::observation::{Falloff, View};
use svbrdf::rectification::elevation::RANGE_MM;
use svbrdf::render::render;
use svbrdf::svbrdf::channel;

use crate::failure::{Failure, Result};
use crate::render::sample_size;
use svbrdf::random::Random;

/// Longer side of the sample, mm.
const SAMPLE_MM: f32 = 100.0;
/// Distance of the first camera, mm.
const DISTANCE_MM: f64 = 260.0;
/// Flash in the camera frame, mm.
const FLASH_MM: DVec3 = DVec3::new(8.0, -12.0, 0.0);
/// Albedo of the paper between board and sample and round the board.
const BACKGROUND: f64 = 0.3;
/// Sides of a raised sample, and heights at which they are looked for.
const SIDE_RADIANCE: f64 = 0.05;
const SIDE_STEPS: u32 = 8;
/// Where the room is brightest, azimuth, and by how much more than its mean at the horizon.
const ROOM_AZIMUTH: f64 = 0.6;
const ROOM_CONTRAST: f64 = 0.9;
/// Samples along each side of a pixel.
const SUPERSAMPLING: u32 = 3;

/// Make a capture of known maps: photographs of the default board round them
#[derive(clap::Args)]
#[command(after_help = "Example:\n  svbrdf simulate maps --out capture --frames 5 --seed 1")]
pub struct Arguments {
    /// Folder with maps
    maps: PathBuf,
    /// Folder to write capture.json, frames and truth into
    #[arg(long)]
    out: PathBuf,
    /// Number of photos
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    /// Seed of poses and noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Height of the sample's surface above the board, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true)]
    elevation: f64,
    /// Light of a room that is brighter to one side, as a share of the flash's on the sample
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    ambient: f64,
}

fn camera() -> Camera {
    Camera {
        width: 2016,
        height: 1512,
        fx: 1480.0,
        fy: 1480.0,
        cx: 1005.0,
        cy: 760.0,
        distortion: [0.04, -0.06, 0.0, 0.0, 0.0],
    }
}

/// The first camera looks from above, the others from up to 45 degrees all round.
fn pose(index: u32, random: &mut Random) -> Pose {
    let golden = PI * (3.0 - 5.0f64.sqrt());
    let polar = if index == 0 { 0.05 } else { (10.0 + 35.0 * random.uniform()).to_radians() };
    let azimuth = golden * f64::from(index) + 0.4 * random.uniform();
    let distance = DISTANCE_MM * (1.0 + 0.12 * (index.min(1) as f64) * random.uniform());
    let outwards =
        DVec3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let aim = DVec3::new(random.uniform() - 0.5, random.uniform() - 0.5, 0.0) * 10.0;
    // The long side of the board runs along the long side of the picture.
    let roll = PI / 2.0 + 0.2 * (random.uniform() - 0.5);
    let forward = -outwards;
    let right = DVec3::new(roll.cos(), roll.sin(), 0.0).reject_from(forward).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let centre = aim + outwards * distance;
    Pose { rotation, translation: -(rotation * centre) }
}

struct Setup<'a> {
    maps: &'a Svbrdf,
    target: Target,
    camera: Camera,
    pose: Pose,
    elevation_mm: f64,
    light: DVec3,
    power_mm2: f64,
    sample_mm: [f32; 2],
    ambient: f64,
    radiance: Vec<f32>,
}

impl<'a> Setup<'a> {
    fn new(maps: &'a Svbrdf, pose: Pose, elevation_mm: f64, ambient: f64) -> Self {
        let power_mm2 = PI * DISTANCE_MM * DISTANCE_MM;
        let light = pose.to_board(FLASH_MM);
        let sample_mm = sample_size(maps, SAMPLE_MM);
        let up = DVec3::Z * elevation_mm;
        let view = View {
            sample_mm,
            camera_mm: (pose.camera_centre() - up).as_vec3().to_array(),
            light_mm: (light - up).as_vec3().to_array(),
            falloff: Falloff::InverseSquare { power_mm2: [power_mm2 as f32; 3] },
            ambient: [0.0; 3],
            mirrored: 1.0,
        };
        let mut radiance = vec![0.0; 3 * maps.texels()];
        render(maps, &view, &mut radiance);
        if ambient > 0.0 {
            add_room(maps, &view, ambient, &mut radiance);
        }
        let (target, camera) = (Target::default(), camera());
        Self {
            maps,
            target,
            camera,
            pose,
            elevation_mm,
            light,
            power_mm2,
            sample_mm,
            ambient,
            radiance,
        }
    }

    /// Radiance from where a ray from the camera ends: sample, its sides, or the board.
    fn radiance(&self, eye: DVec3, ray: DVec3) -> [f64; 3] {
        let at = |z: f64| (eye + ray * ((z - eye.z) / ray.z)).truncate();
        let [w, h] = self.sample_mm.map(f64::from);
        let on_sample = |p: DVec2| p.x.abs() < 0.5 * w && p.y.abs() < 0.5 * h;
        let top = at(self.elevation_mm);
        if on_sample(top) {
            return self.sample(top.x / w + 0.5, 0.5 - top.y / h);
        }
        if (0..SIDE_STEPS)
            .any(|i| on_sample(at(self.elevation_mm * f64::from(i) / f64::from(SIDE_STEPS))))
        {
            return [SIDE_RADIANCE; 3];
        }
        let p = at(0.0);
        let target = &self.target;
        let row = (0.5 * f64::from(target.rows) - p.y / target.square_mm).floor() as i64;
        let col = (0.5 * f64::from(target.cols) + p.x / target.square_mm).floor() as i64;
        let albedo = match (target.has_square(row, col), target.is_white(row, col)) {
            (false, _) => BACKGROUND,
            (true, true) => target.white_albedo,
            (true, false) => target.black_albedo,
        };
        let to_light = self.light - p.extend(0.0);
        let squared = to_light.length_squared();
        let cosine = (to_light.z / squared.sqrt()).max(0.0);
        [albedo * (cosine * self.power_mm2 / (PI * squared) + self.ambient); 3]
    }

    /// The rendered sample between texel centres; `u` and `v` from 0 to 1 from the top left.
    fn sample(&self, u: f64, v: f64) -> [f64; 3] {
        let (w, h) = (self.maps.width(), self.maps.height());
        let axis = |t: f64, n: usize| {
            let t = (t * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
            (t as usize, (t as usize + 1).min(n - 1), t.fract())
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (axis(u, w), axis(v, h));
        std::array::from_fn(|c| {
            let plane = &self.radiance[c * w * h..][..w * h];
            let at = |x: usize, y: usize| f64::from(plane[y * w + x]);
            let top = at(x0, y0) + fx * (at(x1, y0) - at(x0, y0));
            let bottom = at(x0, y1) + fx * (at(x1, y1) - at(x0, y1));
            top + fy * (bottom - top)
        })
    }

    /// Mean radiance over a pixel; the distortion is taken as constant within it.
    fn pixel(&self, x: u32, y: u32) -> [f64; 3] {
        let centre = self.camera.undistort(DVec2::new(x.into(), y.into()));
        let origin = self.pose.camera_centre();
        let back = self.pose.rotation.transpose();
        let mut sum = [0.0; 3];
        let offset = |i: u32| (f64::from(i) + 0.5) / f64::from(SUPERSAMPLING) - 0.5;
        for (i, j) in (0..SUPERSAMPLING).flat_map(|i| (0..SUPERSAMPLING).map(move |j| (i, j))) {
            let p = centre + DVec2::new(offset(i) / self.camera.fx, offset(j) / self.camera.fy);
            let ray = back * p.extend(1.0);
            if ray.z < -1e-9 {
                let value = self.radiance(origin, ray);
                (0..3).for_each(|c| sum[c] += value[c]);
            }
        }
        sum.map(|v| v / f64::from(SUPERSAMPLING * SUPERSAMPLING))
    }
}

/// Adds what maps reflect of a room: diffuse its mean, specular what lies in the mirrored direction.
fn add_room(maps: &Svbrdf, view: &View, ambient: f64, radiance: &mut [f32]) {
    let (w, n) = (maps.width(), maps.texels());
    let bright = DVec3::new(ROOM_AZIMUTH.cos(), ROOM_AZIMUTH.sin(), 0.0);
    for i in 0..n {
        let [x, y] = view.texel_mm(w, maps.height(), i % w, i / w);
        let slope = |c: usize| f64::from(maps.plane(c)[i]);
        let normal = DVec3::new(slope(channel::SLOPE_X), slope(channel::SLOPE_Y), 1.0).normalize();
        let eye = Vec3::from(view.camera_mm) - Vec3::new(x, y, 0.0);
        let mirrored = (-eye.as_dvec3().normalize()).reflect(normal);
        // its mean over all directions, weighted by their cosine, is 1
        let room = 1.0 + ROOM_CONTRAST * mirrored.dot(bright);
        for c in 0..3 {
            let diffuse = f64::from(maps.plane(channel::DIFFUSE + c)[i]);
            let specular = f64::from(maps.plane(channel::SPECULAR + c)[i]);
            radiance[c * n + i] += (ambient * (diffuse + specular * room)) as f32;
        }
    }
}

/// An 8-bit sRGB picture with shot and read noise; each row has its own random numbers.
fn photograph(setup: &Setup, seed: u64) -> image::RgbImage {
    let (w, h) = (setup.camera.width, setup.camera.height);
    let rows: Vec<Vec<u8>> = (0..h)
        .into_par_iter()
        .map(|y| {
            let mut random = Random::new(seed ^ (u64::from(y) << 32));
            let mut row = Vec::with_capacity(3 * w as usize);
            for x in 0..w {
                for v in setup.pixel(x, y) {
                    let sigma = (1e-6 + 2e-5 * v).sqrt();
                    let noisy = (v + sigma * random.bell()).clamp(0.0, 1.0);
                    row.push((255.0 * Encoding::Srgb.encode(noisy)).round() as u8);
                }
            }
            row
        })
        .collect();
    image::RgbImage::from_raw(w, h, rows.concat()).expect("three values a pixel")
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let [low, high] = RANGE_MM;
    if !(low..=high).contains(&arguments.elevation) {
        let mm = arguments.elevation;
        return Err(Failure::Input(format!("--elevation {mm}: {low} to {high} mm expected")));
    }
    if !(0.0..=0.5).contains(&arguments.ambient) {
        let share = arguments.ambient;
        return Err(Failure::Input(format!("--ambient {share}: 0 to 0.5 expected")));
    }
    let maps = read_maps(&arguments.maps).map_err(Failure::input)?;
    let out = &arguments.out;
    for dir in [out.clone(), out.join("frames"), out.join("truth")] {
        check_writable(dir)?;
    }
    let mut random = Random::new(arguments.seed);
    let (mut frames, mut poses) = (Vec::new(), Vec::new());
    for index in 0..arguments.frames {
        let setup =
            Setup::new(&maps, pose(index, &mut random), arguments.elevation, arguments.ambient);
        let seed = arguments.seed.wrapping_mul(1_000_003).wrapping_add(index.into());
        let mut bytes = std::io::Cursor::new(Vec::new());
        photograph(&setup, seed)
            .write_to(&mut bytes, image::ImageFormat::Png)
            .map_err(|e| Failure::Other(e.to_string()))?;
        let name = format!("frames/{index:02}.png");
        write_atomic(out.join(&name), bytes.get_ref())?;
        frames.push(json!({ "image": name, "encoding": "srgb" }));
        poses.push(json!({
            "rotation": setup.pose.rotation.transpose().to_cols_array_2d(),
            "translation_mm": setup.pose.translation.to_array(),
        }));
    }
    write_maps(out.join("truth"), &maps)?;
    write_json(
        out.join("truth/truth.json"),
        &json!({
            "frames": poses,
            "elevation_mm": arguments.elevation,
            "ambient": arguments.ambient,
        }),
    )?;
    let (target, sample) = (Target::default(), sample_size(&maps, SAMPLE_MM));
    let hole = &target.hole;
    let capture = json!({
        "format": FORMAT,
        "sample": { "width_mm": sample[0], "height_mm": sample[1] },
        "board": {
            "kind": "checkerboard-ring", "rows": target.rows, "cols": target.cols,
            "square_mm": target.square_mm,
            "hole_squares": [hole.row_start, hole.col_start, hole.row_end, hole.col_end],
            "white_albedo": target.white_albedo, "black_albedo": target.black_albedo,
            "top_left": "black",
        },
        "camera": camera(),
        "flash": { "offset_mm": FLASH_MM.to_array() },
        "frames": frames,
    });
    // Last, so that a folder with a description is complete.
    write_json(out.join(FILE_NAME), &capture)
}

fn write_json(path: PathBuf, value: &serde_json::Value) -> Result<()> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Failure::Other(e.to_string()))?;
    write_atomic(path, format!("{text}\n").as_bytes())?;
    Ok(())
}
