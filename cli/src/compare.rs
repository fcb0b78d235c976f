//! `svbrdf compare`

use std::f32::consts::PI;
use std::path::PathBuf;

use serde_json::json;
use svbrdf::Svbrdf;
use svbrdf::export::{read_maps, resized};
use svbrdf::observation::{Falloff, View};
use svbrdf::render::render;
use svbrdf::svbrdf::channel;

use crate::failure::{Failure, Result};
use crate::random::Random;
use crate::render::sample_size;

/// Renderings compared.
const RENDERINGS: usize = 100;
/// Largest angle of view and light.
const LIMIT_DEGREES: f64 = 70.0;
/// Distance of camera and light, mm, for a sample of 100 mm: far, so that directions are one each.
const DISTANCE_MM: f64 = 1e5;

/// Root-mean-square differences of two sets of maps and of 100 renderings of them
#[derive(clap::Args)]
#[command(after_help = "Example:\n  svbrdf compare maps truth --json")]
pub struct Arguments {
    /// Folder of maps
    a: PathBuf,
    /// Folder of maps; those of A are resampled when sizes differ
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn rms(sum: f64, count: usize) -> f64 {
    (sum / count as f64).sqrt()
}

fn squares(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

fn planes(a: &Svbrdf, b: &Svbrdf, first: usize, count: usize) -> f64 {
    let sum = (first..first + count).map(|c| squares(a.plane(c), b.plane(c))).sum();
    rms(sum, count * a.texels())
}

fn normals(a: &Svbrdf, b: &Svbrdf) -> f64 {
    let mut sum = 0.0;
    for y in 0..a.height() {
        for x in 0..a.width() {
            sum += squares(&a.normal(x, y), &b.normal(x, y));
        }
    }
    rms(sum, 3 * a.texels())
}

fn renderings(a: &Svbrdf, b: &Svbrdf) -> f64 {
    let mut random = Random::new(1);
    let mut images = [vec![0.0; 3 * a.texels()], vec![0.0; 3 * a.texels()]];
    let mut sum = 0.0;
    for _ in 0..RENDERINGS {
        let mut position =
            || random.direction(LIMIT_DEGREES.to_radians()).map(|v| (DISTANCE_MM * v) as f32);
        let view = View {
            sample_mm: sample_size(a, 100.0),
            camera_mm: position(),
            light_mm: position(),
            falloff: Falloff::None { power: [PI; 3] },
            ambient: [0.0; 3],
        };
        for (maps, image) in [a, b].into_iter().zip(&mut images) {
            render(maps, &view, image);
            image.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
        }
        sum += squares(&images[0], &images[1]);
    }
    rms(sum, RENDERINGS * images[0].len())
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let a = read_maps(&arguments.a).map_err(Failure::input)?;
    let b = read_maps(&arguments.b).map_err(Failure::input)?;
    let a = resized(&a, b.width(), b.height());
    let results = [
        ("normal", normals(&a, &b)),
        ("diffuse", planes(&a, &b, channel::DIFFUSE, 3)),
        ("specular", planes(&a, &b, channel::SPECULAR, 3)),
        ("roughness", planes(&a, &b, channel::ROUGHNESS, 1)),
        ("render", renderings(&a, &b)),
    ];
    if arguments.json {
        let object: serde_json::Map<_, _> =
            results.iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
        println!("{}", serde_json::Value::Object(object));
    } else {
        for (name, value) in results {
            println!("{name:<10} {value:.6}");
        }
    }
    Ok(())
}
