//! Detector and pose on rendered ring boards: tilt, blur, motion, noise, glare, crops, distortion,
//! every kind of ring, every turn; and pictures in which there is nothing to find.

mod common;

use common::{Random, Sample, Scene, looking_at};
use glam::{DVec2, DVec3};
use svbrdf::Rejection;
use svbrdf::calibration::{Hole, Target, TargetKind, detect};
use svbrdf::geometry::Camera;

fn camera(distortion: [f64; 5]) -> Camera {
    Camera { width: 1440, height: 1080, fx: 1050.0, fy: 1052.0, cx: 722.0, cy: 541.0, distortion }
}

const MILD: [f64; 5] = [0.08, -0.12, 5e-4, -4e-4, 0.0];
const STRONG: [f64; 5] = [-0.25, 0.08, 1e-3, -1e-3, 0.0];

fn ring(rows: u32, cols: u32, wide: u32) -> Target {
    Target {
        rows,
        cols,
        square_mm: 10.0,
        hole: Hole { row_start: wide, col_start: wide, row_end: rows - wide, col_end: cols - wide },
        ..Target::default()
    }
}

fn charuco(rows: u32, cols: u32, wide: u32) -> Target {
    let kind = TargetKind::CharucoRing { dictionary: "DICT_4X4_250".to_owned(), marker_mm: 7.0 };
    Target { kind, ..ring(rows, cols, wide) }
}

fn scene(target: Target, tilt: f64, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let camera = camera(MILD);
    // The board's longer side takes about 85 % of the picture's height when seen from the top.
    let side = f64::from(target.rows.max(target.cols)) * target.square_mm;
    let distance = camera.fy * side / (0.85 * f64::from(camera.height));
    let pose = looking_at(tilt, 360.0 * random.uniform(), 360.0 * random.uniform(), distance);
    Scene {
        target,
        camera,
        pose,
        sample: Sample::Textured,
        blur_px: 0.6,
        motion_px: DVec2::ZERO,
        noise: 0.008,
        glare: Vec::new(),
        exposure: 0.7,
        seed,
    }
}

/// Corners found, corners in view, RMS error in px; panics when a label is wrong.
fn check(scene: &Scene, what: &str) -> Result<(usize, usize, f64), Rejection> {
    let detection = detect(&scene.luma(), &scene.target)?;
    let mut squares = 0.0;
    for corner in &detection.corners {
        let truth = scene.corner_px(corner.row, corner.col);
        let error = corner.px.distance(truth);
        // Cells are 8 px and more: three pixels cannot be the neighbouring corner.
        assert!(error < 3.0, "{what}: ({}, {}) is {error} px off", corner.row, corner.col);
        squares += error * error;
    }
    let rms = (squares / detection.corners.len() as f64).sqrt();
    Ok((detection.corners.len(), scene.corners_in_view(6.0), rms))
}

#[test]
fn rings_of_all_kinds_are_found_and_labelled_under_all_conditions() {
    let targets: [(&str, Target); 4] = [
        ("three wide", ring(17, 16, 3)),
        ("two wide", ring(14, 13, 2)),
        ("markers", charuco(13, 12, 2)),
        ("small", ring(8, 9, 3)),
    ];
    let conditions =
        ["plain", "noisy", "dark", "blurred", "moved", "glare", "distorted", "cropped", "far"];
    let mut lost = Vec::new();
    let mut total = 0;
    for (name, target) in &targets {
        for tilt in [0.0, 25.0, 45.0, 60.0] {
            for (k, condition) in conditions.iter().enumerate() {
                let seed = 1000 * k as u64 + tilt as u64 + 17 * u64::from(target.rows);
                let mut scene = scene(target.clone(), tilt, seed);
                let mut random = Random::new(seed + 1);
                match *condition {
                    "noisy" => scene.noise = 0.04,
                    "dark" => (scene.exposure, scene.noise) = (0.05, 0.01),
                    "blurred" => scene.blur_px = 2.2,
                    "moved" => scene.motion_px = 8.0 * DVec2::from_angle(seed as f64),
                    "glare" => {
                        for _ in 0..2 {
                            let at = random.uniform() * target.corners().len() as f64;
                            let (row, col) = target.corners()[at as usize];
                            let radius = 20.0 + 25.0 * random.uniform();
                            scene.glare.push((scene.corner_px(row, col), radius));
                        }
                    }
                    "distorted" => scene.camera.distortion = STRONG,
                    "cropped" => {
                        let shift =
                            DVec2::from_angle(seed as f64) * 0.22 * scene.pose.translation.z;
                        scene.pose.translation += DVec3::new(shift.x, shift.y, 0.0);
                    }
                    "far" => scene.pose.translation.z *= 1.5,
                    _ => {}
                }
                if std::env::var("ONLY")
                    .is_ok_and(|o| !format!("{name}, {tilt} degrees, {condition}").contains(&o))
                {
                    continue;
                }
                let what = format!("{name}, {tilt} degrees, {condition}");
                total += 1;
                match check(&scene, &what) {
                    Ok((found, in_view, rms)) => {
                        println!("{what:34} {found:3}/{in_view:<3} {rms:.3} px");
                    }
                    Err(reason) => {
                        println!("{what:34} {reason} ({} in view)", scene.corners_in_view(6.0));
                        lost.push(what);
                    }
                }
            }
        }
    }
    println!("{} of {total} found; not: {lost:#?}", total - lost.len());
}
