//! Errors of the start and of the latent fit on synthetic photographs of known materials.
//!
//! `cargo run --release --example evaluate_fit -- MATERIALS_DIR [key=value ...]`
//!
//! `MATERIALS_DIR` holds a folder per material with `normal`, `diffuse`, `specular` (sRGB) and
//! `roughness` pictures; the central 256x256 texels are used. Photographs follow the protocol of the
//! paper: the first from above, the others at random, light at the camera, no fall-off, clamped at 1.
//! Keys: `photos` (1,2,5), `materials` (all), `steps`, `rate`, `prior`, `global` (true), `detail` (true), `b1`, `b2`,
//! `models` (folder), `noise` (0), `threads`, `views` (100), `propagate` (true), `sigma` (1: scale of
//! the refinement's prior); `carry=1` goes on from refined maps, `classic=1` adds the baselines,
//! `verbose=1` a line per material.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use svbrdf::Svbrdf;
use svbrdf::classic;
use svbrdf::initial_estimate::{Networks, PooledPhotos};
use svbrdf::latent_fit::{FitOptions, LatentFit};
use svbrdf::observation::{Falloff, Observation, View};
use svbrdf::propagation::propagate;
use svbrdf::refinement::{self, Prior, refine};
use svbrdf::render;
use svbrdf::svbrdf::{CHANNELS, channel};

type Failure = Box<dyn std::error::Error>;

const SIDE: usize = 256;
const HALF_WIDTH: f32 = 50.0;

/// A small linear congruential generator: the same cases everywhere.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    fn symmetric(&mut self, limit: f32) -> f32 {
        limit * (2.0 * self.uniform() - 1.0)
    }

    /// Direction at most 70 degrees off +Z, uniform over that cap.
    fn direction(&mut self) -> [f32; 3] {
        let lowest = 70f32.to_radians().cos();
        let z = lowest + (1.0 - lowest) * self.uniform();
        let phi = std::f32::consts::TAU * self.uniform();
        let s = (1.0 - z * z).sqrt();
        [s * phi.cos(), s * phi.sin(), z]
    }
}

fn view(camera: [f32; 3], light: [f32; 3]) -> View {
    View {
        sample_mm: [2.0 * HALF_WIDTH; 2],
        camera_mm: camera.map(|v| v * HALF_WIDTH),
        light_mm: light.map(|v| v * HALF_WIDTH),
        falloff: Falloff::None { power: [std::f32::consts::PI; 3] },
        ambient: [0.0; 3],
    }
}

fn load(folder: &Path) -> Result<Svbrdf, Failure> {
    let mut maps = Svbrdf::new(SIDE, SIDE);
    let linear = |v: f32| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    for name in ["normal", "diffuse", "specular", "roughness"] {
        let Some(path) =
            ["jpg", "png"].iter().map(|e| folder.join(name).with_extension(e)).find(|p| p.exists())
        else {
            return Err(format!("{}: no {name}", folder.display()).into());
        };
        let image = image::open(path)?.to_rgb32f();
        let (w, h) = image.dimensions();
        let (left, top) =
            ((w.max(SIDE as u32) - SIDE as u32) / 2, (h.max(SIDE as u32) - SIDE as u32) / 2);
        for i in 0..SIDE * SIDE {
            let (x, y) = ((i % SIDE) as u32 + left, (i / SIDE) as u32 + top);
            let p = image.get_pixel(x % w, y % h).0;
            match name {
                "normal" => {
                    let n = p.map(|v| 2.0 * v - 1.0);
                    let z = n[2].max(0.1);
                    maps.plane_mut(channel::SLOPE_X)[i] = n[0] / z;
                    maps.plane_mut(channel::SLOPE_Y)[i] = n[1] / z;
                }
                "roughness" => maps.plane_mut(channel::ROUGHNESS)[i] = p[0],
                _ => {
                    let first =
                        if name == "diffuse" { channel::DIFFUSE } else { channel::SPECULAR };
                    for c in 0..3 {
                        maps.plane_mut(first + c)[i] = linear(p[c]);
                    }
                }
            }
        }
    }
    maps.clamp();
    Ok(maps)
}

fn photograph(truth: &Svbrdf, index: usize, random: &mut Random, noise: f32) -> Observation {
    let at = match index {
        0 => [0.0, 0.0, 2.146],
        _ => [random.symmetric(1.2), random.symmetric(1.2), 2.146],
    };
    let view = view(at, at);
    let n = truth.texels();
    let mut radiance = vec![0.0; 3 * n];
    render::render(truth, &view, &mut radiance);
    for v in &mut radiance {
        *v = (*v * (1.0 + noise * random.symmetric(1.7))).max(0.0);
        if *v >= 1.0 {
            *v = -1.0;
        }
    }
    Observation { width: SIDE, height: SIDE, view, radiance, weight: vec![1.0; n] }
}

/// RMSE over novel renderings clamped to [0, 1], then of normal, diffuse, specular, roughness.
fn errors(maps: &Svbrdf, truth: &Svbrdf, views: usize) -> [f64; 5] {
    let n = truth.texels();
    let mut random = Random(99);
    let (mut a, mut b) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
    let mut sum = 0.0;
    for _ in 0..views {
        let (v, l) = (random.direction(), random.direction());
        let view = view(v.map(|c| 4.0 * c), l.map(|c| 4.0 * c));
        render::render(maps, &view, &mut a);
        render::render(truth, &view, &mut b);
        sum += a
            .iter()
            .zip(&b)
            .map(|(x, y)| f64::from(x.clamp(0.0, 1.0) - y.clamp(0.0, 1.0)).powi(2))
            .sum::<f64>();
    }
    let rms = |from: usize, to: usize| {
        let (x, y) = (&maps.planes()[from * n..to * n], &truth.planes()[from * n..to * n]);
        let sum: f64 = x.iter().zip(y).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        (sum / ((to - from) * n) as f64).sqrt()
    };
    let normal: f64 = (0..n)
        .map(|i| {
            let (p, q) = (maps.normal(i % SIDE, i / SIDE), truth.normal(i % SIDE, i / SIDE));
            p.iter().zip(&q).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
        })
        .sum();
    [
        (sum / (views * 3 * n) as f64).sqrt(),
        (normal / (3 * n) as f64).sqrt(),
        rms(channel::DIFFUSE, channel::SPECULAR),
        rms(channel::SPECULAR, channel::ROUGHNESS),
        rms(channel::ROUGHNESS, CHANNELS),
    ]
}

/// Sums of errors by method and number of photographs.
#[derive(Default)]
struct Table(Vec<(String, [f64; 5], f64, usize)>);

impl Table {
    fn add(&mut self, name: String, errors: [f64; 5], seconds: f64) {
        if !self.0.iter().any(|row| row.0 == name) {
            self.0.push((name.clone(), [0.0; 5], 0.0, 0));
        }
        if let Some(row) = self.0.iter_mut().find(|row| row.0 == name) {
            row.1.iter_mut().zip(errors).for_each(|(s, e)| *s += e);
            row.2 += seconds;
            row.3 += 1;
        }
    }

    fn print(&self) {
        println!(
            "{:<16} render  normal  diffuse specular roughness  seconds  (mean of {})",
            "method",
            self.0.first().map_or(0, |r| r.3)
        );
        for (name, sums, seconds, count) in &self.0 {
            let mean = sums.map(|s| s / *count as f64);
            println!(
                "{name:<16} {:.4}  {:.4}  {:.4}  {:.4}   {:.4}    {:.2}",
                mean[0],
                mean[1],
                mean[2],
                mean[3],
                mean[4],
                seconds / *count as f64
            );
        }
    }
}

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("usage: evaluate_fit MATERIALS_DIR [key=value ...]")?;
    let keys: HashMap<String, String> = arguments
        .filter_map(|a| a.split_once('=').map(|(k, v)| (k.to_owned(), v.to_owned())))
        .collect();
    let number = |key: &str, default: f32| {
        keys.get(key).map_or(Ok(default), |v| v.parse::<f32>().map_err(|e| format!("{key}: {e}")))
    };
    let base = FitOptions::default();
    let options = FitOptions {
        steps: number("steps", base.steps as f32)? as usize,
        learning_rate: number("rate", base.learning_rate)?,
        betas: [number("b1", base.betas[0])?, number("b2", base.betas[1])?],
        prior_weight: number("prior", base.prior_weight)?,
        global_correction: keys.get("global").map_or(base.global_correction, |v| v == "true"),
        keep_detail: keys.get("detail").map_or(base.keep_detail, |v| v == "true"),
        ..base
    };
    println!("{options:?}");
    let photos: Vec<usize> = keys
        .get("photos")
        .map_or("1,2,5", String::as_str)
        .split(',')
        .map(str::parse)
        .collect::<Result<_, _>>()?;
    let noise = number("noise", 0.0)?;
    let sigma = number("sigma", 1.0)?;
    let views = number("views", 100.0)? as usize;
    let networks = Arc::new(match keys.get("models") {
        Some(folder) => Networks::from_folder(Path::new(folder))?,
        None => Networks::embedded()?,
    });
    rayon::ThreadPoolBuilder::new().num_threads(number("threads", 0.0)? as usize).build_global()?;
    let mut folders: Vec<_> = std::fs::read_dir(&folder)?
        .filter_map(|e| e.ok().map(|e| e.path()))
        .filter(|p| p.is_dir())
        .collect();
    folders.sort();
    if let Some(wanted) = keys.get("materials") {
        match wanted.parse::<usize>() {
            // so many, spread evenly
            Ok(count) => {
                let all = folders.len();
                folders = (0..count.min(all)).map(|i| folders[i * all / count].clone()).collect();
            }
            Err(_) => folders.retain(|f| f.to_string_lossy().contains(wanted.as_str())),
        }
    }
    let start = Instant::now();
    networks.prepare(SIDE, SIDE)?;
    println!("plans: {:.2} s", start.elapsed().as_secs_f64());
    let mut table = Table::default();
    for (index, folder) in folders.iter().enumerate() {
        let truth = load(folder)?;
        let mut random = Random(1000 + index as u64);
        let most = photos.iter().copied().max().unwrap_or(1);
        let observations: Vec<Observation> =
            (0..most).map(|i| photograph(&truth, i, &mut random, noise)).collect();
        let clock = Instant::now();
        let first = networks.photo_maps(&observations[0])?;
        let seconds = clock.elapsed().as_secs_f64();
        let mut print = |name: String, maps: &Svbrdf, seconds: f64| {
            let e = errors(maps, &truth, views);
            if keys.contains_key("verbose") {
                println!(
                    "{:<40} {name:<16} {e:.4?}",
                    folder.file_name().unwrap().to_string_lossy()
                );
            }
            table.add(name, e, seconds);
        };
        print("start".to_owned(), &first, seconds);
        let mut pooled = PooledPhotos::default();
        let clock = Instant::now();
        let mut fit =
            LatentFit::new(networks.clone(), &first, observations[0].clone(), options.clone())?;
        let mut seconds = 0.0;
        for (i, observation) in observations.iter().enumerate() {
            let clock = if i == 0 { clock } else { Instant::now() };
            let start = networks.pool_photo(&mut pooled, observation)?;
            if i > 0 {
                if photos.contains(&(i + 1)) {
                    print(format!("start {}", i + 1), &start, 0.0);
                }
                if keys.contains_key("pooled") {
                    fit = LatentFit::new(
                        networks.clone(),
                        &start,
                        observations[0].clone(),
                        options.clone(),
                    )?;
                    for earlier in &observations[1..i] {
                        fit.add_observation(earlier.clone())?;
                    }
                }
                fit.add_observation(observation.clone())?;
            }
            while !fit.step()?.settled {}
            seconds += clock.elapsed().as_secs_f64();
            if photos.contains(&(i + 1)) {
                let n = i + 1;
                let mut deep = fit.maps();
                print(format!("deep {n}"), &deep, seconds);
                if keys.get("propagate").is_none_or(|v| v == "true") {
                    propagate(&mut deep, &observations[..n])?;
                    print(format!("propagated {n}"), &deep, seconds);
                }
                let go_on = &mut |_: usize, _: f64| ControlFlow::Continue(());
                let clock = Instant::now();
                let mut refined = deep.clone();
                let refinement = refinement::Options::default();
                let mut prior = Prior::default();
                prior.sigma.iter_mut().for_each(|s| *s *= sigma);
                refine(&mut refined, &deep, &prior, &observations[..n], &refinement, go_on)?;
                let after = seconds + clock.elapsed().as_secs_f64();
                print(format!("deep+refine {n}"), &refined, after);
                if keys.contains_key("carry") {
                    fit.set_maps(&refined)?;
                }
                if keys.contains_key("classic") {
                    let clock = Instant::now();
                    let mut maps = first.clone();
                    let options = classic::Options::default();
                    classic::fit(&mut maps, &observations[..n], &options, go_on)?;
                    print(format!("classic {n}"), &maps, clock.elapsed().as_secs_f64());
                    let mut maps = first.clone();
                    refine(&mut maps, &first, &prior, &observations[..n], &refinement, go_on)?;
                    print(format!("start+refine {n}"), &maps, clock.elapsed().as_secs_f64());
                }
            }
        }
    }
    table.print();
    Ok(())
}
