//! Rendered captures of a board that the printer has stretched, or that does not lie flat.

mod common;

use common::{Scene, looking_at, ring};
use svbrdf::calibration::{Paper, PaperEstimate, Target, detect, estimate_pose};
use svbrdf::geometry::{Camera, Pose};
use svbrdf::networks::Networks;
use svbrdf::photo::Photo;
use svbrdf::session::{Method, Outcome, RestoreOptions, Scene as Shown, Session, Settings};

fn camera() -> Camera {
    let distortion = [0.08, -0.12, 5e-4, -4e-4, 0.0];
    Camera { width: 1440, height: 1080, fx: 1050.0, fy: 1052.0, cx: 722.0, cy: 541.0, distortion }
}

/// From the top, then round it.
fn scenes(target: &Target, paper: Paper) -> Vec<Scene> {
    let views = [(6.0, 0.0, 0.0), (30.0, 40.0, 20.0), (35.0, 160.0, 95.0), (25.0, 280.0, -30.0)];
    let scene = |(k, (tilt, azimuth, roll))| {
        let pose = looking_at(tilt, azimuth, roll, 215.0 + 5.0 * k as f64);
        Scene { paper, ..Scene::new(target.clone(), camera(), pose, 70 + k as u64) }
    };
    views.into_iter().enumerate().map(scene).collect()
}

fn photo(scene: &Scene) -> Photo {
    let rgb = scene.linear().into_iter().flat_map(|v| [v; 3]).collect();
    Photo::from_linear(scene.camera.width, scene.camera.height, rgb, 1.0, 1.0).unwrap()
}

fn view_error_deg(found: &Pose, truth: &Pose) -> f64 {
    found.camera_centre().angle_between(truth.camera_centre()).to_degrees()
}

/// A session that only calibrates.
fn session(target: &Target, camera: Option<Camera>) -> Session {
    let scene =
        Shown::Board { target: target.clone(), camera, flash_offset_mm: None, elevation_mm: None };
    let settings = Settings { method: Method::Classic, ..Settings::default() };
    let session = Session::new(scene, settings).unwrap();
    session.pause();
    session
}

/// Largest view error over all photographs, and the paper, once all are in.
fn calibrated(session: &Session, scenes: &[Scene], photos: &[Photo]) -> (f64, PaperEstimate) {
    for photo in photos {
        let outcome = session.add_photo(photo).unwrap();
        assert!(matches!(outcome, Outcome::Accepted(_)), "{outcome:?}");
    }
    let errors =
        session.poses().into_iter().zip(scenes).map(|(k, s)| view_error_deg(&k.pose, &s.pose));
    (errors.fold(0.0, f64::max), session.paper().unwrap())
}

#[test]
fn a_print_that_differs_from_its_plan_is_measured() {
    let target = ring(17, 16, 3);
    let sheets = [
        Paper::default(),
        Paper { aspect: 1.005, ..Paper::default() },
        Paper { bow_mm: [0.0, 1.0], ..Paper::default() },
    ];
    println!("truth, camera: view degrees as planned, measured; aspect, bows and sigmas");
    for paper in sheets {
        let scenes = scenes(&target, paper);
        let photos: Vec<Photo> = scenes.iter().map(photo).collect();
        let plain = scenes.iter().map(|scene| {
            let corners = detect(&scene.luma(), &target).unwrap().corners;
            view_error_deg(&estimate_pose(&camera(), &target, &corners).unwrap().pose, &scene.pose)
        });
        let plain = plain.fold(0.0, f64::max);
        for known in [Some(camera()), None] {
            let (degrees, found) = calibrated(&session(&target, known), &scenes, &photos);
            println!(
                "{paper:?}, {}: {plain:.4}, {degrees:.4}; {found:?}",
                if known.is_some() { "given" } else { "unknown" }
            );
            let flat = paper == Paper::default();
            assert_eq!(flat, found.paper == Paper::default());
            // Corners are good to 0.04 px or so: a hundredth of a degree with a given camera. Where
            // rolls differ little, pixels' and paper's aspect are hard to tell apart.
            assert!(degrees < if known.is_some() { 0.02 } else { 0.06 }, "{degrees}");
            assert!(flat || degrees < 0.35 * plain, "{degrees} {plain}");
            assert!((found.paper.aspect - paper.aspect).abs() < 1e-3);
            for (found, truth) in found.paper.bow_mm.iter().zip(paper.bow_mm) {
                assert!((found - truth).abs() < 0.1, "{found} {truth}");
            }
        }
    }
}

#[test]
fn a_saved_session_knows_its_paper() {
    let target = ring(17, 16, 3);
    let paper = Paper { aspect: 0.995, bow_mm: [1.0, 0.0] };
    let scenes = scenes(&target, paper);
    let photos: Vec<Photo> = scenes.iter().map(photo).collect();
    for known in [Some(camera()), None] {
        let (whole, halved) = (session(&target, known), session(&target, known));
        let (_, expected) = calibrated(&whole, &scenes, &photos);
        calibrated(&halved, &scenes, &photos[..3]);
        let saved = halved.save().unwrap();
        let networks = std::sync::Arc::new(Networks::embedded().unwrap());
        let restored = Session::restore(&saved, networks, RestoreOptions::default()).unwrap();
        restored.pause();
        assert_eq!(restored.paper(), halved.paper());
        let (_, found) = calibrated(&restored, &scenes, &photos[3..]);
        assert_eq!(found, expected);
        assert_eq!(restored.poses(), whole.poses());
    }
}
