//! Time of detection and pose for a 12-megapixel photo on one core, with and without a board:
//!
//! ```sh
//! cargo bench --bench calibration
//! ```
//! Milliseconds of processor time where available, the least of several runs.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Random, Scene, charuco, looking_at, ring};
use std::time::Instant;
use svbrdf::calibration::{LumaImage, Target, detect, estimate_pose};
use svbrdf::geometry::Camera;
use svbrdf::photo::{Encoding, Photo};

const WIDTH: u32 = 4032;
const HEIGHT: u32 = 3024;
const RUNS: usize = 3;

/// Milliseconds of this thread's run time.
fn clock(start: Instant) -> f64 {
    let spent = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = spent.and_then(|s| s.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| 1e3 * start.elapsed().as_secs_f64(), |ns| 1e-6 * ns)
}

fn camera() -> Camera {
    let f = 0.73 * f64::from(WIDTH);
    Camera {
        width: WIDTH,
        height: HEIGHT,
        fx: f,
        fy: f,
        cx: 2020.0,
        cy: 1508.0,
        distortion: [0.08, -0.12, 5e-4, -4e-4, 0.0],
    }
}

fn scene(target: &Target, tilt: f64, distance: f64, noise: f64, blur_px: f64) -> Scene {
    let pose = looking_at(tilt, 40.0, 100.0, distance);
    Scene { blur_px, noise, ..Scene::new(target.clone(), camera(), pose, 5) }
}

fn main() {
    let default = Target::default();
    let (two_wide, markers) = (ring(17, 16, 2), charuco(17, 16, 2));
    let boards = [
        ("three wide, 10 degrees", scene(&default, 10.0, 230.0, 0.01, 1.5)),
        ("three wide, 45 degrees", scene(&default, 45.0, 230.0, 0.01, 1.5)),
        ("two wide, 30 degrees", scene(&two_wide, 30.0, 200.0, 0.01, 1.5)),
        ("markers, 30 degrees", scene(&markers, 30.0, 200.0, 0.01, 1.5)),
        ("three wide, noisy", scene(&default, 30.0, 230.0, 0.08, 1.5)),
        ("three wide, far, noisy", scene(&default, 50.0, 700.0, 0.08, 1.5)),
    ];
    println!("{:24} {:>8} {:>8} {:>8} {:>8}", "photo", "luma", "detect", "pose", "sum, ms");
    for (name, scene) in &boards {
        measure(name, &eight_bits(&scene.linear()), &scene.target);
    }
    let mut random = Random::new(3);
    let mut fill = |value: &mut dyn FnMut(u32, u32, f64) -> f64| -> Vec<f32> {
        let at = |i: u32| (i % WIDTH, i / WIDTH);
        (0..WIDTH * HEIGHT).map(|i| value(at(i).0, at(i).1, random.uniform()) as f32).collect()
    };
    let checks = |cell: u32| {
        move |x: u32, y: u32, noise: f64| {
            0.1 + 0.6 * f64::from((x / cell + y / cell) % 2) + 0.02 * noise
        }
    };
    let nothing: [(&str, Vec<f32>); 5] = [
        ("noise", fill(&mut |_, _, noise| noise)),
        ("fine checks", fill(&mut checks(14))),
        ("checks", fill(&mut checks(60))),
        ("coarse checks", fill(&mut checks(200))),
        (
            "blocks at random",
            fill(&mut |x, y, _| {
                let cell = u64::from(x / 40) * 7919 + u64::from(y / 40);
                0.1 + 0.6 * Random::new(cell + 1).uniform().round()
            }),
        ),
    ];
    for (name, linear) in &nothing {
        measure(name, &eight_bits(linear), &default);
    }
}

fn eight_bits(linear: &[f32]) -> Photo {
    let encode = |v: &f32| (255.0 * v.clamp(0.0, 1.0).powf(1.0 / 2.2)).round() as u8;
    let rgb: Vec<u8> = linear.iter().flat_map(|v| [encode(v); 3]).collect();
    let stride = 3 * WIDTH as usize;
    Photo::from_rgb8(WIDTH, HEIGHT, &rgb, stride, Encoding::Gamma22, 1.0).expect("sizes fit")
}

fn measure(name: &str, photo: &Photo, target: &Target) {
    let mut least = [f64::INFINITY; 4];
    let mut outcome = String::new();
    for _ in 0..RUNS {
        let start = Instant::now();
        let begun = clock(start);
        let luma = LumaImage::from_photo(photo);
        let seen = clock(start);
        let found = detect(&luma, target);
        let detected = clock(start);
        outcome = match found.and_then(|d| estimate_pose(&camera(), target, &d.corners)) {
            Ok(pose) => format!("RMS {:.2} px", pose.rms_px),
            Err(reason) => reason.code().to_owned(),
        };
        let posed = clock(start);
        let times = [seen - begun, detected - seen, posed - detected, posed - begun];
        least.iter_mut().zip(times).for_each(|(l, t)| *l = l.min(t));
    }
    let [luma, detect, pose, sum] = least;
    println!("{name:24} {luma:8.1} {detect:8.1} {pose:8.1} {sum:8.1}  {outcome}");
}
