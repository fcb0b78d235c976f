//! Boards that are not quite the ones described: recognised, used, and told about.

mod common;

use common::{Scene, charuco, looking_at};
use glam::DVec2;
use svbrdf::BoardDifference;
use svbrdf::calibration::{Target, TargetKind, TopLeft};
use svbrdf::geometry::Camera;
use svbrdf::photo::Photo;
use svbrdf::session::{Hint, Outcome, Scene as Described, Session, Settings};

/// A photograph of a printed board by its flash, from above.
fn photo(printed: &Target) -> Photo {
    let camera = Camera {
        width: 1440,
        height: 1080,
        fx: 1050.0,
        fy: 1052.0,
        cx: 722.0,
        cy: 541.0,
        distortion: [0.0; 5],
    };
    let side = f64::from(printed.rows.max(printed.cols)) * printed.square_mm;
    let distance = camera.fy * side / (0.85 * f64::from(camera.height));
    let pose = looking_at(14.0, 70.0, 20.0, distance);
    let scene = Scene::new(printed.clone(), camera, pose, 5);
    let mut rgb: Vec<f32> = scene.linear().into_iter().flat_map(|v| [v; 3]).collect();
    let eye = pose.camera_centre();
    for (i, pixel) in rgb.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let px = DVec2::new((i % 1440) as f64, (i / 1440) as f64);
        let ray = pose.rotation.transpose() * camera.undistort(px).extend(1.0);
        let way = ray * (eye.z / -ray.z);
        let flash = eye.length_squared() * eye.z / way.length().powi(3);
        pixel.iter_mut().for_each(|v| *v *= 0.7 * flash as f32);
    }
    Photo::from_linear(1440, 1080, rgb, 1.0, 9.0).unwrap()
}

/// The reported difference if a photograph of one board is taken for one of another.
fn said(printed: &Target, described: &Target) -> Option<BoardDifference> {
    let scene = Described::Board {
        target: described.clone(),
        camera: None,
        flash_offset_mm: None,
        elevation_mm: None,
    };
    let hole = described.hole_mm().map(|mm| mm as f32 - 10.0);
    let settings = Settings { sample_mm: hole, threads: 1, ..Settings::default() };
    let session = Session::new(scene, settings).unwrap();
    session.pause();
    let outcome = session.add_photo(&photo(printed)).unwrap();
    let Outcome::Accepted(accepted) = outcome else { panic!("{outcome:?}") };
    accepted.hints.iter().find_map(|hint| match hint {
        Hint::BoardDiffers(difference) => Some(*difference),
        _ => None,
    })
}

#[test]
fn other_prints_are_used_and_named() {
    let described = charuco(15, 14, 3);
    assert_eq!(said(&described, &described), None);
    // As OpenCV before 4.6 prints boards of an even number of rows.
    let legacy = Target { top_left: TopLeft::White, ..described.clone() };
    assert_eq!(said(&legacy, &described), Some(BoardDifference::ColoursExchanged));
    // A board without markers is described.
    let plain = Target { kind: TargetKind::CheckerboardRing, ..described.clone() };
    assert_eq!(said(&described, &plain), Some(BoardDifference::MarkersNotDescribed));
    // Another dictionary.
    let TargetKind::CharucoRing { marker_mm, .. } = described.kind else { unreachable!() };
    let kind = TargetKind::CharucoRing { dictionary: "DICT_5X5_250".into(), marker_mm };
    let other = Target { kind, ..described.clone() };
    let difference = said(&other, &described);
    assert_eq!(difference, Some(BoardDifference::MarkersShifted { first: 0, inner: 5 }));
}
