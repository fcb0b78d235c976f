//! Detector and pose on rendered ring boards: tilt, blur, motion, noise, glare, crops, distortion,
//! every kind of ring, every turn; and pictures in which there is nothing to find.

mod common;

use common::{Random, Sample, Scene, charuco, looking_at, ring};
use glam::{DVec2, DVec3};
use svbrdf::calibration::{Hole, LumaImage, Target, TopLeft, detect, estimate_pose};
use svbrdf::geometry::Camera;
use svbrdf::{BoardDifference, Rejection};

fn camera(distortion: [f64; 5]) -> Camera {
    Camera { width: 1440, height: 1080, fx: 1050.0, fy: 1052.0, cx: 722.0, cy: 541.0, distortion }
}

const MILD: [f64; 5] = [0.08, -0.12, 5e-4, -4e-4, 0.0];
const STRONG: [f64; 5] = [-0.25, 0.08, 1e-3, -1e-3, 0.0];

fn scene(target: Target, tilt: f64, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let camera = camera(MILD);
    // The board's longer side takes about 85 % of the picture's height when seen from the top.
    let side = f64::from(target.rows.max(target.cols)) * target.square_mm;
    let distance = camera.fy * side / (0.85 * f64::from(camera.height));
    let pose = looking_at(tilt, 360.0 * random.uniform(), 360.0 * random.uniform(), distance);
    Scene::new(target, camera, pose, seed)
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

/// Conditions of a photograph, and the RMS error of its corners that is allowed, px. Noise, blur
/// and foreshortening cost precision; glare and dark pictures pull on some edges.
const CONDITIONS: [(&str, f64); 9] = [
    ("plain", 0.06),
    ("noisy", 0.2),
    ("dark", 0.35),
    ("blurred", 0.3),
    ("moved", 0.6),
    ("glare", 0.4),
    ("distorted", 0.08),
    ("cropped", 0.08),
    ("far", 0.08),
];

fn scene_under(target: &Target, tilt: f64, condition: &str, seed: u64) -> Scene {
    let mut scene = scene(target.clone(), tilt, seed);
    let mut random = Random::new(seed + 1);
    match condition {
        "noisy" => scene.noise = 0.04,
        "dark" => (scene.exposure, scene.noise) = (0.05, 0.01),
        "blurred" => scene.blur_px = 2.2,
        "moved" => scene.motion_px = 8.0 * DVec2::from_angle(seed as f64),
        "glare" => {
            for _ in 0..2 {
                let at = random.uniform() * target.corners().len() as f64;
                let (row, col) = target.corners()[at as usize];
                scene.glare.push((scene.corner_px(row, col), 20.0 + 25.0 * random.uniform()));
            }
        }
        "distorted" => scene.camera.distortion = STRONG,
        "cropped" => {
            let shift = DVec2::from_angle(seed as f64) * 0.22 * scene.pose.translation.z;
            scene.pose.translation += DVec3::new(shift.x, shift.y, 0.0);
        }
        "far" => scene.pose.translation.z *= 1.5,
        _ => {}
    }
    scene
}

/// Checks every `stride`-th combination of tilt and condition, from `first` on.
fn sweep(name: &str, target: &Target, first: usize, stride: usize) {
    let tilts = [0.0, 25.0, 45.0, 60.0];
    let all =
        tilts.into_iter().flat_map(|t| CONDITIONS.into_iter().enumerate().map(move |c| (t, c)));
    for (tilt, (k, (condition, allowed))) in all.skip(first).step_by(stride) {
        let seed = 1000 * k as u64 + tilt as u64 + 17 * u64::from(target.rows);
        let what = format!("{name}, {tilt} degrees, {condition}");
        match check(&scene_under(target, tilt, condition, seed), &what) {
            Ok((found, in_view, rms)) => {
                println!("{what:34} {found:3}/{in_view:<3} {rms:.3} px");
                // Two blobs of glare may cover a fifth of a small board.
                let share = if condition == "glare" { 0.75 } else { 0.85 };
                assert!(found as f64 >= share * in_view as f64, "{what}: {found} of {in_view}");
                assert!(rms <= allowed, "{what}: {rms} px");
            }
            Err(reason) => panic!("{what}: {reason}"),
        }
    }
}

#[test]
fn rings_three_wide_are_found_and_labelled() {
    sweep("three wide", &ring(17, 16, 3), 0, 5);
}

#[test]
fn rings_two_wide_are_found_and_labelled() {
    sweep("two wide", &ring(14, 13, 2), 1, 5);
}

#[test]
fn rings_with_markers_are_found_and_labelled() {
    sweep("markers", &charuco(13, 12, 2), 2, 5);
}

#[test]
fn small_rings_are_found_and_labelled() {
    sweep("small", &ring(8, 9, 3), 3, 5);
}

#[test]
#[ignore = "all 144 pictures: a minute and a half"]
fn all_rings_under_all_conditions() {
    sweep("three wide", &ring(17, 16, 3), 0, 1);
    sweep("two wide", &ring(14, 13, 2), 0, 1);
    sweep("markers", &charuco(13, 12, 2), 0, 1);
    sweep("small", &ring(8, 9, 3), 0, 1);
}

#[test]
fn every_turn_of_the_board_is_told_apart() {
    for (k, target) in [ring(11, 10, 2), ring(10, 13, 3), ring(9, 10, 2)].iter().enumerate() {
        for roll in [2.0, 91.0, 135.0, 182.0, 271.0] {
            let mut scene = scene(target.clone(), 12.0, k as u64);
            scene.pose = looking_at(12.0, 40.0, roll, scene.pose.translation.z);
            let (found, in_view, _) = check(&scene, &format!("{k}, {roll}")).unwrap();
            // Corners close to the picture's border may be left out.
            assert!(found + 3 >= in_view, "{k}, {roll}: {found} of {in_view}");
        }
    }
}

#[test]
fn the_pose_of_a_rendered_board_is_right() {
    for (target, tilt) in
        [(ring(17, 16, 3), 10.0), (ring(17, 16, 2), 35.0), (charuco(13, 12, 2), 55.0)]
    {
        let scene = scene(target, tilt, 5);
        let corners = detect(&scene.luma(), &scene.target).unwrap().corners;
        let found = estimate_pose(&scene.camera, &scene.target, &corners).unwrap();
        let truth = &scene.pose;
        let error = found.pose.camera_centre() - truth.camera_centre();
        let normals = found.pose.rotation.z_axis.angle_between(truth.rotation.z_axis).to_degrees();
        println!("{tilt}: {:.4} mm, {normals:.4} degrees, {:.3} px", error.length(), found.rms_px);
        // Corners to about 0.03 px of 30 px squares: a thousandth of a square over sixty corners.
        assert!(error.length() < 0.15 && normals < 0.03 && found.rms_px < 0.1);
    }
}

#[test]
fn blur_is_measured_and_hopeless_blur_is_refused() {
    for blur in [0.8, 1.5, 2.5] {
        let mut scene = scene(ring(17, 16, 3), 5.0, 9);
        scene.blur_px = blur;
        let found = detect(&scene.luma(), &scene.target).unwrap().blur_px;
        // Pixels themselves add 0.3 px, interpolation up to 0.5, in squares.
        assert!((found - blur.hypot(0.4)).abs() < 0.2 * blur, "{blur}: {found}");
    }
    let mut scene = scene(ring(10, 9, 3), 5.0, 9);
    scene.blur_px = 9.0;
    let refused = detect(&scene.luma(), &scene.target);
    assert!(
        matches!(refused, Err(Rejection::Blurred { blur_px, .. }) if blur_px > 6.0),
        "{refused:?}"
    );
}

/// The difference of a board from its description, as the detector reports it.
fn difference(shown: &Scene, stated: &Target, mirrored: bool) -> Option<BoardDifference> {
    let mut luma = shown.luma();
    if mirrored {
        luma.data.chunks_mut(luma.width).for_each(<[f32]>::reverse);
    }
    match detect(&luma, stated) {
        Err(Rejection::BoardDiffers(difference)) => Some(difference),
        Err(other) => panic!("{other}"),
        Ok(_) => None,
    }
}

#[test]
fn what_tells_a_board_from_its_description_is_said() {
    let hole =
        |row, col| Hole { row_start: row, col_start: col, row_end: row + 13, col_end: col + 10 };
    let printed =
        Target { rows: 19, cols: 14, hole: hole(3, 2), patches: false, ..ring(19, 14, 3) };
    for tilt in [5.0, 35.0] {
        let shown = scene(printed.clone(), tilt, 70);
        assert_eq!(difference(&shown, &printed, false), None);
        let larger = Target { rows: 20, cols: 15, hole: hole(4, 3), ..printed.clone() };
        let missing = difference(&shown, &larger, false);
        assert!(
            matches!(missing, Some(BoardDifference::SquaresMissing { rows: 20, cols: 15, .. })),
            "{missing:?}"
        );
        let marked = scene(charuco(13, 12, 2), tilt, 71);
        assert_eq!(difference(&marked, &marked.target, false), None);
        let turned = Target { top_left: TopLeft::White, ..marked.target.clone() };
        let elsewhere = difference(&marked, &turned, false);
        assert!(
            matches!(elsewhere, Some(BoardDifference::MarkersElsewhere { count }) if count > 20),
            "{elsewhere:?}"
        );
        let flipped = difference(&marked, &marked.target, true);
        assert!(
            matches!(flipped, Some(BoardDifference::MarkersMirrored { count }) if count > 20),
            "{flipped:?}"
        );
    }
}

#[test]
fn other_boards_are_refused() {
    let full = |target: &Target, k: u64| Scene {
        sample: Sample::Checkerboard,
        ..scene(target.clone(), 8.0 + 10.0 * k as f64, 40 + k)
    };
    let cases: [(&str, Target, Target); 9] = [
        ("fewer squares", ring(14, 13, 2), ring(17, 16, 2)),
        ("more squares", ring(17, 16, 2), ring(14, 13, 2)),
        ("two columns fewer", ring(17, 14, 3), ring(17, 16, 3)),
        ("two columns more", ring(17, 16, 3), ring(17, 14, 3)),
        ("two columns more, single row", ring(17, 16, 2), ring(17, 14, 2)),
        ("another shape", ring(17, 16, 2), ring(19, 14, 2)),
        ("a wider ring", ring(17, 16, 3), ring(17, 16, 2)),
        ("a narrower ring", ring(17, 16, 2), ring(17, 16, 3)),
        ("with markers, other counts", charuco(13, 12, 2), ring(15, 12, 2)),
    ];
    for (k, (what, shown, expected)) in cases.iter().enumerate() {
        for tilt in [5.0, 35.0] {
            let scene = scene(shown.clone(), tilt, 60 + k as u64);
            let result = detect(&scene.luma(), expected);
            println!(
                "{what}, {tilt}: {}",
                result.as_ref().err().map_or("FOUND".into(), Rejection::to_string)
            );
            assert!(
                matches!(result, Err(Rejection::BoardNotFound | Rejection::TooFewCorners { .. })),
                "{what}, {tilt}: {} corners",
                result.map_or(0, |d| d.corners.len())
            );
        }
    }
    for (k, target) in [ring(17, 16, 3), ring(14, 13, 2), ring(9, 8, 2)].iter().enumerate() {
        let result = detect(&full(target, k as u64).luma(), target);
        assert_eq!(result.map(|d| d.corners.len()), Err(Rejection::BoardNotFound), "full board");
    }
}

#[test]
fn a_part_that_fits_in_several_places_is_refused() {
    // One corner of the ring, the arms cut off by the picture.
    for (k, target) in [ring(17, 16, 3), ring(17, 16, 2)].iter().enumerate() {
        let mut scene = scene(target.clone(), 5.0, 3 + k as u64);
        let roll = 20.0 + 90.0 * k as f64;
        scene.pose = looking_at(5.0, 0.0, roll, 0.5 * scene.pose.translation.z);
        let corner = scene.target.grid_mm(1.0, 1.0).extend(0.0);
        scene.pose.translation -= (scene.pose.rotation * corner).with_z(0.0) * 0.75;
        let result = detect(&scene.luma(), target);
        println!("{} in view: {:?}", scene.corners_in_view(6.0), result.as_ref().err());
        // Of so few corners as the second picture shows, their number is said.
        let refused = match result {
            Err(Rejection::PlacementAmbiguous { .. }) => true,
            Err(Rejection::TooFewCorners { found, needed, .. }) => k == 1 && found < needed,
            _ => false,
        };
        assert!(refused, "{result:?}");
    }
}

#[test]
fn pictures_without_a_board_are_refused() {
    let picture = |width: usize, height: usize, value: &mut dyn FnMut(usize) -> f32| LumaImage {
        width,
        height,
        data: (0..width * height).map(value).collect(),
    };
    let mut random = Random::new(1);
    let targets = [ring(17, 16, 3), ring(14, 13, 2), charuco(13, 12, 2)];
    let pictures = [
        picture(900, 700, &mut |_| 0.0),
        picture(900, 700, &mut |_| 0.4),
        picture(900, 700, &mut |_| 1.0),
        picture(900, 700, &mut |_| random.uniform() as f32),
        // A fine full checkerboard.
        picture(900, 700, &mut |i| f32::from(((i % 900 / 20 + i / 900 / 20) % 2) as u8)),
        picture(900, 700, &mut |i| ((i % 900) as f32 / 30.0).sin() + 1.0),
        picture(1, 1, &mut |_| 0.5),
        picture(3, 900, &mut |i| (i % 7) as f32),
        picture(2000, 12, &mut |i| (i % 5) as f32),
    ];
    for target in &targets {
        for (k, luma) in pictures.iter().enumerate() {
            let result = detect(luma, target);
            assert_eq!(result.map(|d| d.corners.len()), Err(Rejection::BoardNotFound), "{k}");
        }
    }
}

#[test]
fn pictures_that_are_none_are_refused() {
    let target = ring(17, 16, 3);
    let short = LumaImage { width: 300, height: 300, data: vec![0.5; 17] };
    assert_eq!(detect(&short, &target), Err(Rejection::NotFinite));
    let mut data = vec![0.5; 90_000];
    data[777] = f32::INFINITY;
    let infinite = LumaImage { width: 300, height: 300, data };
    assert_eq!(detect(&infinite, &target), Err(Rejection::NotFinite));
}

#[test]
#[ignore = "prints how long detection takes at 3 and 12 megapixels"]
fn time_of_detection() {
    let mut random = Random::new(3);
    let data = (0..2016 * 1512).map(|_| 0.3 + 0.4 * random.uniform() as f32).collect();
    let noise = LumaImage { width: 2016, height: 1512, data };
    let start = std::time::Instant::now();
    assert!(detect(&noise, &ring(17, 16, 3)).is_err());
    println!("noise, 2016x1512: {:.1} ms", 1e3 * start.elapsed().as_secs_f64());
    for scale in [1.4, 2.8] {
        let mut scene = scene(ring(17, 16, 3), 30.0, 2);
        let camera = &mut scene.camera;
        (camera.width, camera.height) = ((1440.0 * scale) as u32, (1080.0 * scale) as u32);
        for v in [&mut camera.fx, &mut camera.fy, &mut camera.cx, &mut camera.cy] {
            *v *= scale;
        }
        let luma = scene.luma();
        let mut times = Vec::new();
        for _ in 0..7 {
            let start = std::time::Instant::now();
            let found = detect(&luma, &scene.target).unwrap();
            times.push(1e3 * start.elapsed().as_secs_f64());
            assert!(found.corners.len() > 100);
        }
        times.sort_by(f64::total_cmp);
        println!("{}x{}: {:.1} ms", luma.width, luma.height, times[0]);
    }
}
