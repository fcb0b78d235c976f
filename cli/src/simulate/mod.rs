//! `svbrdf simulate`: photographs of a board and known maps.

mod faults;
mod held_out;
mod light;
mod path;
mod reflectance;
mod scene;
mod sensor;
mod surface;
mod tone;

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use glam::{DVec2, DVec3};
use serde_json::{Value, json};
use svbrdf::calibration::Target;
use svbrdf::capture::{FILE_NAME, FORMAT};
use svbrdf::export::{MapsOptions, check_writable, read_maps, write_atomic, write_maps};
use svbrdf::random::Random;
use svbrdf::rectification::elevation::RANGE_MM;

use self::faults::{Faults, FrameFaults, JPEG_QUALITY};
use self::path::{Path as HandPath, Walk};
use self::reflectance::{Lobe, Reflectance};
use self::scene::{
    BLURRED_SUPERSAMPLING, GRAY_PRINTED, SUPERSAMPLING, Scene, camera, pose, power_mm2,
};
use self::sensor::{Picture, file};
use self::surface::Surface;
use self::tone::Tone;
use crate::failure::{Failure, Result};
use crate::place;
use crate::render::sample_size;

/// Longer side of the sample, mm.
const SAMPLE_MM: f32 = 100.0;
/// Flash in the camera frame, mm.
const FLASH_MM: DVec3 = DVec3::new(8.0, -12.0, 0.0);

/// Folder of the ideal photographs to be predicted, in the capture.
const HELD_OUT: &str = "truth/heldout";

/// Make a capture of known maps: render photographs of them inside the default board
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  svbrdf simulate maps --out capture --frames 5 --seed 1\n  svbrdf simulate maps --out capture --real --rectified\n  svbrdf simulate maps --out capture --real --lobe coat --frames 9 --held-out 2\n  svbrdf simulate maps --out capture --tone filmic --patches"
)]
pub struct Arguments {
    /// Folder with maps
    maps: PathBuf,
    /// Folder for capture.json, frames and truth
    #[arg(long)]
    out: PathBuf,
    /// Number of photographs
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    /// Seed of poses, noise and faults
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Height of the sample's surface above the board, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true)]
    elevation: f64,
    /// Room light, brighter on one side, as a share of the flash on the sample
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    ambient: f64,
    /// Write JPEG files of this quality [default: 80 with --real, 92 with --tone, otherwise PNG]
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,
    /// Apply a camera's tone curve, without stating it in the capture
    #[arg(long, value_enum, conflicts_with = "rectified")]
    tone: Option<Tone>,
    /// Add the gray patches below the ring; the middle one is printed darker than planned
    #[arg(long, conflicts_with = "rectified")]
    patches: bool,
    /// Add the faults of real photographs, without stating them in the capture: changing brightness
    /// and exposure, a flash beside the camera that is weaker to the sides, blur, JPEG, a bowed
    /// sample, a lobe that the maps cannot hold; if rectified, registration errors of half a texel.
    /// truth.json lists them
    #[arg(long)]
    real: bool,
    /// Lobe of the faults, where the maps have none of that kind [default: by the seed; nine in a row have each but sheen once]
    #[arg(long, value_enum, requires = "real")]
    lobe: Option<Lobe>,
    /// Write the last photographs without faults too, to be predicted; every other one shows the
    /// highlight
    #[arg(long, value_name = "N", default_value_t = 0)]
    held_out: u32,
    /// Take the photographs along the path of a hand [default: at random from all sides]
    #[arg(long, value_enum, conflicts_with = "rectified")]
    path: Option<HandPath>,
    /// Write rectified photographs: the sample alone from above, one pixel per texel
    #[arg(long, conflicts_with = "elevation")]
    rectified: bool,
}

/// Quality of JPEG files with a tone curve, unless stated: that of phones.
const TONED_QUALITY: u8 = 92;

impl Arguments {
    fn target(&self) -> Target {
        Target { patches: self.patches, ..Target::default() }
    }

    fn jpeg_quality(&self) -> Option<u8> {
        let usual = if self.real { Some(JPEG_QUALITY) } else { self.tone.map(|_| TONED_QUALITY) };
        self.jpeg.or(usual)
    }

    fn walk(&self, sample_mm: [f32; 2]) -> Result<Option<Walk>> {
        let flash_mm = (!self.real).then_some(FLASH_MM);
        let walk =
            |path| Walk::new(path, self.frames, self.seed, sample_mm, self.target(), flash_mm);
        self.path.map(walk).transpose()
    }

    fn check(&self) -> Result<()> {
        let [low, high] = RANGE_MM;
        if !(low..=high).contains(&self.elevation) {
            let mm = self.elevation;
            return Err(Failure::Input(format!("--elevation {mm}: {low} to {high} mm expected")));
        }
        if !(0.0..=0.5).contains(&self.ambient) {
            let share = self.ambient;
            return Err(Failure::Input(format!("--ambient {share}: 0 to 0.5 expected")));
        }
        Ok(())
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.check()?;
    place::folder("--out", &arguments.out)?;
    let maps = read_maps(&arguments.maps).map_err(Failure::input)?;
    let out = &arguments.out;
    for dir in ["", "frames", "truth"] {
        check_writable(out.join(dir))?;
    }
    if arguments.held_out > 0 {
        check_writable(out.join(HELD_OUT))?;
    }
    let sample_mm = sample_size(&maps, SAMPLE_MM);
    let (faults, draws) =
        arguments.real.then(|| Faults::draw(arguments.seed, arguments.lobe)).unzip();
    let surface = Surface {
        maps: &maps,
        sample_mm,
        bow_mm: faults.as_ref().map_or(0.0, |f| f.bow_mm),
        reflectance: faults.as_ref().map(|f| Reflectance::new(f.reflectance)),
    };
    let (frames, truths) = photographs(arguments, &surface, faults.as_ref(), draws)?;
    write_maps(out.join("truth"), &maps, &MapsOptions::default())?;
    let mut truth = json!({
        "frames": truths,
        "elevation_mm": arguments.elevation,
        "ambient": arguments.ambient,
        "light_power": power_mm2(),
    });
    if let Some(tone) = arguments.tone {
        truth["tone"] = json!(tone.to_possible_value().map(|v| v.get_name().to_owned()));
    }
    if arguments.patches {
        truth["gray_over_planned"] = json!(GRAY_PRINTED);
    }
    if let Some(faults) = &faults {
        truth["faults"] = json!(faults);
    }
    write_json(out.join("truth/truth.json"), &truth)?;
    // Last, so that a folder with a description is complete.
    write_json(out.join(FILE_NAME), &description(arguments, sample_mm, frames))
}

/// Writes the photographs. Returns their entries for `capture.json` and `truth.json`.
fn photographs(
    arguments: &Arguments,
    surface: &Surface,
    faults: Option<&Faults>,
    mut draws: Option<Random>,
) -> Result<(Vec<Value>, Vec<Value>)> {
    let flash =
        faults.map_or((FLASH_MM, 0.0), |f| (DVec3::from(f.flash_offset_mm), f.flash_exponent));
    let mut random = Random::new(arguments.seed);
    let mut walk = arguments.walk(surface.sample_mm)?;
    let (mut frames, mut truths) = (Vec::new(), Vec::new());
    let mut first_distance = None;
    for index in 0..arguments.frames {
        let stop = walk.as_mut().map(|walk| walk.next(index)).transpose()?;
        let scene = {
            // of photographs to be predicted, every other one shows the highlight
            let left = arguments.frames - index;
            let near = left <= arguments.held_out && left.is_multiple_of(2);
            let pose =
                stop.as_ref().map_or_else(|| pose(index, near, &mut random), |stop| stop.pose);
            let (target, up) = (arguments.target(), arguments.elevation);
            Scene::new(surface, target, pose, up, flash, arguments.ambient)
        };
        let eye = scene.pose.camera_centre();
        let distance = eye.length() / *first_distance.get_or_insert(eye.length());
        let own = faults.zip(draws.as_mut()).map(|(f, draws)| f.photograph(draws, distance));
        let seed = arguments.seed.wrapping_mul(1_000_003).wrapping_add(index.into());
        let picture = picture(&scene, own.as_ref(), arguments.rectified);
        let picture = picture.taken(seed, arguments.tone);
        let (ending, bytes) = file(&picture, arguments.jpeg_quality())?;
        let name = format!("frames/{index:02}.{ending}");
        write_atomic(arguments.out.join(&name), &bytes)?;
        if let Some(walk) = &mut walk {
            walk.taken(&bytes)?;
        }
        let mut frame = json!({ "image": name, "encoding": "srgb" });
        if arguments.rectified {
            frame["camera_mm"] = json!(eye.to_array());
            let light = if own.is_some() { eye } else { scene.light.place };
            frame["light_mm"] = json!(light.to_array());
        }
        frames.push(frame);
        let mut truth = json!({
            "rotation": scene.pose.rotation.transpose().to_cols_array_2d(),
            "translation_mm": scene.pose.translation.to_array(),
        });
        if let Some(stop) = stop {
            truth["seconds"] = json!(stop.seconds);
            truth["gain"] = json!(stop.gains.map(|[here, _]| here));
            truth["best_gain"] = json!(stop.gains.map(|[_, best]| best));
        }
        if arguments.frames - index <= arguments.held_out {
            let name = format!("{HELD_OUT}/{index:02}.npy");
            held_out::write(&arguments.out.join(&name), &scene)?;
            truth["camera_mm"] = json!(scene.eye().to_array());
            truth["light_mm"] = json!(scene.ideal_light().place.to_array());
            truth["exposure"] = json!(own.as_ref().map_or(1.0, |own| own.exposure));
            truth["heldout"] = json!({ "file": name });
        }
        if let Some(own) = own {
            truth["light_mm"] = json!(scene.ideal_light().place.to_array());
            truth["faults"] = json!(own);
        }
        truths.push(truth);
    }
    Ok((frames, truths))
}

/// Linear values of a photograph, without noise.
fn picture(scene: &Scene, faults: Option<&FrameFaults>, rectified: bool) -> Picture {
    let picture = if rectified {
        let [dx, dy] = faults.map_or([0.0; 2], |f| f.registration_texels);
        let (maps, size) = (scene.surface.maps, scene.surface.sample_mm.map(f64::from));
        let (w, h) = (maps.width(), maps.height());
        Picture::new(w as u32, h as u32, |x, y| {
            let right = (f64::from(x) + 0.5 + dx) / w as f64 - 0.5;
            let up = 0.5 - (f64::from(y) + 0.5 + dy) / h as f64;
            scene.rectified(DVec2::new(size[0] * right, size[1] * up))
        })
    } else {
        let samples = if faults.is_some() { BLURRED_SUPERSAMPLING } else { SUPERSAMPLING };
        Picture::new(scene.camera.width, scene.camera.height, |x, y| scene.pixel(x, y, samples))
    };
    match faults {
        Some(faults) => picture.with_faults(faults),
        None => picture,
    }
}

/// Contents of `capture.json`.
fn description(arguments: &Arguments, sample: [f32; 2], frames: Vec<Value>) -> Value {
    let sample = json!({ "width_mm": sample[0], "height_mm": sample[1] });
    if arguments.rectified {
        return json!({
            "format": FORMAT, "sample": sample, "rectified": true, "falloff": "inverse-square",
            "light_power": power_mm2(), "frames": frames,
        });
    }
    let target = arguments.target();
    let hole = &target.hole;
    let mut capture = json!({
        "format": FORMAT,
        "sample": sample,
        "board": {
            "kind": "checkerboard-ring", "rows": target.rows, "cols": target.cols,
            "square_mm": target.square_mm,
            "hole_squares": [hole.row_start, hole.col_start, hole.row_end, hole.col_end],
            "white_albedo": target.white_albedo, "black_albedo": target.black_albedo,
            "top_left": "black", "patches": target.patches,
        },
        "camera": camera(),
        "frames": frames,
    });
    if !arguments.real {
        capture["flash"] = json!({ "offset_mm": FLASH_MM.to_array() });
    }
    capture
}

fn write_json(path: impl AsRef<Path>, value: &Value) -> Result<()> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Failure::Other(e.to_string()))?;
    write_atomic(path, format!("{text}\n").as_bytes())?;
    Ok(())
}
