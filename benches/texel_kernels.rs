//! Nanoseconds per texel and photograph of the texel kernels, on one thread:
//! `cargo bench --bench texel_kernels`.

use std::sync::Arc;
use std::time::Instant;
use svbrdf::estimate::{EstimateOptions, Method};
use svbrdf::estimator::Estimator;
use svbrdf::networks::Networks;
use svbrdf::observation::{Falloff, Observation, View};
use svbrdf::{Svbrdf, render};

const SIZE: usize = 256;
const FRAMES: usize = 5;
const REPEATS: usize = 15;

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread pool");
    pool.install(run);
}

fn run() {
    let maps = Svbrdf::new(SIZE, SIZE);
    let observations: Vec<Observation> = (0..FRAMES).map(|i| observe(&maps, i)).collect();
    let mut out = vec![0.0; 3 * maps.texels()];
    report("render", 1, || render::render(&maps, &observations[0].view, &mut out));
    let mut start = maps.clone();
    for v in start.planes_mut() {
        *v = 0.9 * *v + 0.02;
    }
    report("loss", FRAMES, || {
        render::loss(&start, &observations);
    });
    let mut gradient = vec![0.0; start.planes().len()];
    report("loss and gradient", FRAMES, || {
        render::loss_and_gradient(&start, &observations, &mut gradient);
    });
    let steps = (0..REPEATS).map(|_| step_of_the_maps(&start, &observations));
    print("step of the maps", FRAMES, steps.fold(f64::INFINITY, f64::min));
}

/// Seconds of the second step of the solver.
fn step_of_the_maps(start: &Svbrdf, observations: &[Observation]) -> f64 {
    let mut options = EstimateOptions::default();
    (options.latent.first_steps, options.latent.steps) = (1, 1);
    let networks = Arc::new(Networks::embedded().expect("embedded networks"));
    let mut estimator = Estimator::with_options(networks, Method::Deep, true, options);
    estimator.correct_lights(false);
    estimator.start_from(start.clone());
    for observation in observations {
        estimator.add(observation.clone()).expect("one size");
    }
    while estimator.reports().last().is_none_or(|report| report.name != "relief") {
        estimator.step().expect("photographs");
    }
    let start = Instant::now();
    estimator.step().expect("photographs");
    start.elapsed().as_secs_f64()
}

fn observe(maps: &Svbrdf, i: usize) -> Observation {
    let angle = i as f32;
    let camera_mm = [90.0 * angle.cos(), 90.0 * angle.sin(), 240.0];
    let light_mm = [camera_mm[0] - 4.0, camera_mm[1] + 8.0, camera_mm[2]];
    let falloff = Falloff::InverseSquare { power_mm2: [std::f32::consts::PI * 240.0 * 240.0; 3] };
    let view = View {
        sample_mm: [100.0; 2],
        camera_mm,
        light_mm,
        falloff,
        ambient: [0.01; 3],
        ..View::default()
    };
    let mut radiance = vec![0.0; 3 * maps.texels()];
    render::render(maps, &view, &mut radiance);
    let weight = vec![1.0; maps.texels()];
    Observation::new(SIZE, SIZE, view, &radiance, &weight).expect("planes of this size")
}

/// Prints the shortest of several run times.
fn report(name: &str, frames: usize, mut work: impl FnMut()) {
    let mut least = f64::INFINITY;
    for _ in 0..REPEATS {
        let start = Instant::now();
        work();
        least = least.min(start.elapsed().as_secs_f64());
    }
    print(name, frames, least);
}

fn print(name: &str, frames: usize, seconds: f64) {
    let each = 1e9 * seconds / (SIZE * SIZE * frames) as f64;
    println!("{name:24} {each:7.2} ns per texel and photograph");
}
