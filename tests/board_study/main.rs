//! How often rendered ring boards are found, and pictures without one refused. All of it, with
//! shares by condition:
//!
//! ```sh
//! cargo test --release --test board_study -- --ignored --nocapture
//! ```

#[path = "../common/mod.rs"]
mod common;
mod negatives;
#[path = "../common/picture.rs"]
mod picture;
#[path = "../common/test_data.rs"]
mod test_data;

use common::{Random, Scene, charuco, looking_at, ring};
use glam::{DVec2, DVec3};
use picture::picture;
use rayon::prelude::*;
use svbrdf::calibration::{LumaImage, Target, detect, estimate_pose};
use svbrdf::geometry::Camera;

const CONDITIONS: [&str; 13] = [
    "plain",
    "noisy",
    "dark",
    "defocus",
    "glare",
    "occluded",
    "shadow",
    "distorted",
    "cropped",
    "far",
    "mixed",
    "moved",
    "moved far",
];
/// The last of them are blurred by motion.
const STILL: usize = 11;
const TILTS: [f64; 5] = [0.0, 20.0, 40.0, 50.0, 60.0];

fn boards() -> [(&'static str, Target); 3] {
    [
        ("three wide", Target::default()),
        ("two wide", ring(17, 16, 2)),
        ("markers", charuco(17, 16, 2)),
    ]
}

/// The board from `tilt` off its normal, 85 % of the picture's height when seen from the top.
fn scene(target: &Target, tilt: f64, size: [u32; 2], seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let [width, height] = size;
    let f = 0.73 * f64::from(width);
    let middle = |n: u32| 0.5 * f64::from(n) + 3.0;
    let camera = Camera {
        width,
        height,
        fx: f,
        fy: 1.002 * f,
        cx: middle(width),
        cy: middle(height),
        distortion: [0.08, -0.12, 5e-4, -4e-4, 0.0],
    };
    let side = f64::from(target.rows.max(target.cols)) * target.square_mm;
    let distance = camera.fy * side / (0.85 * f64::from(height));
    let pose = looking_at(tilt, 360.0 * random.uniform(), 360.0 * random.uniform(), distance);
    Scene::new(target.clone(), camera, pose, seed)
}

fn scene_under(target: &Target, tilt: f64, condition: &str, seed: u64) -> Scene {
    let mut scene = scene(target, tilt, [1440, 1080], seed);
    let mut random = Random::new(seed ^ 0x5EED);
    let corners = target.corners();
    let mut uniform = |low: f64, high: f64| low + (high - low) * random.uniform();
    let conditions: &[&str] =
        if condition == "mixed" { &["noisy", "defocus", "glare", "shadow"] } else { &[condition] };
    for condition in conditions {
        let mut spot = |scene: &Scene| {
            let (row, col) = corners[uniform(0.0, corners.len() as f64) as usize];
            scene.corner_px(row, col)
        };
        match *condition {
            "noisy" => scene.noise = uniform(0.015, 0.05),
            "dark" => (scene.exposure, scene.noise) = (uniform(0.04, 0.1), 0.01),
            "defocus" => scene.blur_px = uniform(1.0, 2.5),
            "glare" => {
                for at in [spot(&scene), spot(&scene)] {
                    scene.glare.push((at, uniform(20.0, 45.0)));
                }
            }
            "occluded" => {
                for at in [spot(&scene), spot(&scene)] {
                    let half = DVec2::new(uniform(25.0, 80.0), uniform(25.0, 80.0));
                    scene.occluders.push((at, half));
                }
            }
            "shadow" => {
                let edge = DVec2::new(uniform(500.0, 940.0), uniform(350.0, 730.0));
                let into = DVec2::from_angle(uniform(0.0, 6.3));
                scene.shadow = Some((edge, into, uniform(0.15, 0.4)));
            }
            "distorted" => {
                scene.camera.distortion = [uniform(-0.3, -0.1), 0.08, 1e-3, -1e-3, 0.0];
            }
            "cropped" => {
                let shift = DVec2::from_angle(uniform(0.0, 6.3)) * uniform(0.1, 0.22);
                let shift = shift * scene.pose.translation.z;
                scene.pose.translation += DVec3::new(shift.x, shift.y, 0.0);
            }
            "far" => scene.pose.translation.z *= uniform(1.2, 1.8),
            "moved" => {
                scene.motion_px = uniform(4.0, 9.0) * DVec2::from_angle(uniform(0.0, 6.3));
            }
            "moved far" => {
                scene.motion_px = uniform(9.0, 16.0) * DVec2::from_angle(uniform(0.0, 6.3));
            }
            _ => {}
        }
    }
    scene
}

/// Results of the pictures.
#[derive(Default, Clone, Copy)]
struct Tally {
    pictures: usize,
    found: usize,
    /// A corner's label or the pose is wrong.
    wrong: usize,
}

impl Tally {
    fn and(self, other: Self) -> Self {
        Self {
            pictures: self.pictures + other.pictures,
            found: self.found + other.found,
            wrong: self.wrong + other.wrong,
        }
    }
}

fn look(scene: &Scene, what: &str) -> Tally {
    let result = detect(&scene.luma(), &scene.target).and_then(|detection| {
        let estimate = estimate_pose(&scene.camera, &scene.target, &detection.corners)?;
        Ok((detection, estimate))
    });
    let mut tally = Tally { pictures: 1, ..Tally::default() };
    match result {
        Ok((detection, estimate)) => {
            // Half of the narrowest cells is 4 px: further off is another corner.
            let off = |c: &&svbrdf::calibration::Corner| {
                c.px.distance(scene.corner_px(c.row, c.col)) > 4.0
            };
            let wrong = detection.corners.iter().filter(off).count();
            let normals = estimate.pose.rotation.z_axis;
            let degrees = normals.angle_between(scene.pose.rotation.z_axis).to_degrees();
            tally.found = 1;
            // Motion moves all corners alike; a wrong placement is off by many degrees.
            tally.wrong = usize::from(wrong > 0 || degrees > 1.0);
            if tally.wrong > 0 {
                println!("WRONG {what}: {wrong} corners, {degrees:.2} degrees");
            }
        }
        Err(reason) => println!("{what}: {reason}"),
    }
    tally
}

/// Looks at every `stride`-th picture and prints shares by condition.
fn study(stride: usize, seeds: u64) -> [Tally; 2] {
    let mut cases = Vec::new();
    for (name, board) in boards() {
        for seed in 0..seeds {
            for tilt in TILTS {
                for condition in 0..CONDITIONS.len() {
                    cases.push((name, board.clone(), tilt, condition, seed));
                }
            }
        }
    }
    let tallies: Vec<(usize, Tally)> = cases
        .into_par_iter()
        .step_by(stride)
        .map(|(name, board, tilt, condition, seed)| {
            let seed = seed * 977 + 31 * condition as u64 + tilt as u64;
            let scene = scene_under(&board, tilt, CONDITIONS[condition], seed);
            let what = format!("{name}, {tilt} degrees, {} ({seed})", CONDITIONS[condition]);
            (condition, look(&scene, &what))
        })
        .collect();
    println!("{:12} {:>8} {:>6} {:>6}", "condition", "pictures", "found", "wrong");
    let sum = |wanted: &dyn Fn(usize) -> bool| {
        let chosen = tallies.iter().filter(|(c, _)| wanted(*c)).map(|(_, t)| *t);
        chosen.fold(Tally::default(), Tally::and)
    };
    let print = |name: &str, t: Tally| {
        let share = |n: usize| 100.0 * n as f64 / t.pictures.max(1) as f64;
        println!("{name:12} {:8} {:5.1}% {:5.1}%", t.pictures, share(t.found), share(t.wrong));
    };
    for (k, name) in CONDITIONS.iter().enumerate() {
        print(name, sum(&|c| c == k));
    }
    let (still, all) = (sum(&|c| c < STILL), sum(&|_| true));
    print("still", still);
    print("all", all);
    [still, all]
}

/// `least`: share of the pictures without motion that must be found.
fn check([still, all]: [Tally; 2], least: f64) {
    assert_eq!(all.wrong, 0);
    assert!(still.found as f64 >= least * still.pictures as f64);
    assert!(all.found as f64 >= 0.95 * all.pictures as f64);
}

#[test]
fn boards_are_found_and_none_wrongly() {
    check(study(9, 1), 1.0);
}

#[test]
#[ignore = "585 pictures: six minutes of processor time"]
fn boards_are_found_and_none_wrongly_in_full() {
    // One in some hundred at 60 degrees with four faults at once is refused.
    check(study(1, 3), 0.995);
}

/// Accepts nothing: the photograph is of something else.
fn accepted(picture: &LumaImage, name: &str, targets: &[(&str, Target)]) -> usize {
    let mut count = 0;
    for (board, target) in targets {
        if let Ok(detection) = detect(picture, target) {
            println!("ACCEPTED {name} as {board}: {} corners", detection.corners.len());
            count += 1;
        }
    }
    count
}

fn negatives_accepted(stride: usize) -> usize {
    let targets = boards();
    let kinds = negatives::all();
    let count = kinds.len().div_ceil(stride);
    let wrong: usize = kinds
        .into_par_iter()
        .step_by(stride)
        .map(|negative| {
            let usable: Vec<_> =
                targets.iter().filter(|t| !negative.shows(&t.1)).cloned().collect();
            accepted(&negative.picture(), &negative.name, &usable)
        })
        .sum();
    println!("{count} pictures without the board: {wrong} accepted");
    wrong
}

#[test]
fn other_things_are_refused() {
    assert_eq!(negatives_accepted(5), 0);
}

#[test]
#[ignore = "all pictures: a minute"]
fn other_things_are_refused_in_full() {
    assert!(negatives::all().len() >= 100);
    assert_eq!(negatives_accepted(1), 0);
}

#[test]
fn photographs_of_other_things_are_refused() {
    let Some(files) = negatives::photographs() else { return };
    let targets = boards();
    let count = files.len();
    assert!(count >= 100, "{count} photographs");
    let wrong: usize = files
        .into_par_iter()
        .map(|file| {
            let gray = picture(&file).into_luma8();
            let (width, height) = (gray.width() as usize, gray.height() as usize);
            let data = gray.into_raw().into_iter().map(|v| f32::from(v) / 255.0).collect();
            let picture = LumaImage { width, height, data };
            accepted(&picture, &file.display().to_string(), &targets)
        })
        .sum();
    println!("{count} photographs of other things: {wrong} accepted");
    assert_eq!(wrong, 0);
}
