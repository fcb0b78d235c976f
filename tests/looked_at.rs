//! Photographs that are looked at before they are added, removed afterwards, and weighed.

#[path = "common/rectified.rs"]
mod rectified;

use rectified::{POSITIONS, material, photo, scene};
use svbrdf::capture::Capture;
use svbrdf::photo::Photo;
use svbrdf::session::{
    Budget, Driver, Hint, Method, Outcome, Phase, Probe, RectifiedFalloff, Scene, Session, Settings,
};
use svbrdf::svbrdf::channel;
use svbrdf::{Error, Rejection, Svbrdf};

fn capture() -> Capture {
    Capture::load(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile")).unwrap()
}

fn photos(count: usize) -> Vec<Photo> {
    capture().photos[..count].iter().map(|f| f.read().unwrap()).collect()
}

/// A paused session of the bundled capture, with its camera or without.
fn paused(with_camera: bool) -> Session {
    let capture = capture();
    let Scene::Board { target, camera, flash_offset_mm, elevation_mm } = capture.scene else {
        panic!("no board")
    };
    let camera = camera.filter(|_| with_camera);
    let scene = Scene::Board { target, camera, flash_offset_mm, elevation_mm };
    let (sample_mm, method) = (capture.sample_mm, Method::Classic);
    let settings = Settings { sample_mm, method, threads: 2, ..Settings::default() };
    let session = Session::new(scene, settings).unwrap();
    session.pause();
    session
}

fn push(session: &Session, photo: &Photo) {
    let outcome = session.add_photo(photo).unwrap();
    assert!(matches!(outcome, Outcome::Accepted(_)), "{outcome:?}");
}

/// Another look at a photograph's values, row by row.
fn changed(photo: &Photo, change: impl Fn(&[f32], usize) -> f32) -> Photo {
    let row = 3 * photo.width() as usize;
    let linear = photo.to_linear();
    let rows =
        linear.chunks_exact(row).flat_map(|r| (0..row).map(|i| change(r, i)).collect::<Vec<_>>());
    Photo::from_linear(photo.width(), photo.height(), rows.collect(), 1.0, 1.0).unwrap()
}

/// Degrees between two lines of sight, and mm between two distances.
fn apart(probe: &Probe, accepted: &svbrdf::geometry::Pose) -> (f64, f64) {
    let (a, b) = (probe.pose.unwrap().pose.camera_centre(), accepted.camera_centre());
    (a.angle_between(b).to_degrees(), (a.length() - b.length()).abs())
}

#[test]
fn a_probe_says_what_a_push_says_and_changes_nothing() {
    let session = paused(true);
    for (i, photo) in photos(3).iter().enumerate() {
        let before = session.save().unwrap();
        let probe = session.probe(photo).unwrap();
        assert!(session.save().unwrap() == before, "the session has changed");
        assert_eq!((probe.rejection, probe.hints.len()), (None, 0), "{probe:?}");
        let Outcome::Accepted(accepted) = session.add_photo(photo).unwrap() else {
            panic!("rejected")
        };
        // Of the reduced picture corners are found to some hundredths of a pixel: 0.1 px of the whole.
        let (degrees, mm) = apart(&probe, &accepted.pose.unwrap().pose);
        assert!(degrees < 0.2 && mm < 0.5, "{degrees} {mm}");
        let view = probe.view.unwrap();
        let expected = accepted.pose.unwrap().pose.view_angle().to_degrees() as f32;
        assert!((view.tilt_deg - expected).abs() < 0.2, "{view:?}");
        assert_eq!(view.off_next_deg.is_some(), i > 0);
        assert!(view.sample_seen == 1.0 && view.sample_clipped < 0.5, "{view:?}");
        assert!(view.px_per_mm > 3.0 && view.px_per_mm < 20.0, "{view:?}");
        assert!(probe.corners.len() > 60 && probe.corners_in_view >= probe.corners.len());
        let light = probe.light.unwrap();
        assert!((0.05..=1.0).contains(&light.white_level), "{light:?}");
        assert!(probe.blur_px.unwrap() < 5.0, "{:?}", probe.blur_px);
        let again = session.probe(photo).unwrap();
        assert_eq!(again.hints, [Hint::NothingNew { index: i }]);
    }
}

#[test]
fn pictures_of_a_preview_have_other_sizes() {
    let photos = photos(2);
    let session = paused(true);
    push(&session, &photos[0]);
    let pose = session.poses()[0].pose;
    let half = photos[0].reduced(2);
    // A wide preview of the same lens.
    let wide = photos[0].cropped(0, 189, 2016, 1134);
    for (preview, limit) in [(&half, 0.2), (&wide, 0.2)] {
        let probe = session.probe(preview).unwrap();
        assert_eq!(probe.rejection, None, "{probe:?}");
        let (degrees, mm) = apart(&probe, &pose);
        assert!(degrees < limit && mm < 1.0, "{degrees} {mm}");
    }
    // Turned, and with a camera that nobody knows: estimated from the picture alone, as well as one
    // picture tells.
    let unknown = paused(false);
    for probe in [unknown.probe(&half).unwrap(), unknown.probe(&photos[0]).unwrap()] {
        assert_eq!(probe.rejection, None, "{probe:?}");
        let (degrees, _) = apart(&probe, &pose);
        assert!(degrees < 5.0, "{degrees}");
    }
    let rectified = Session::new(scene(), Settings::default()).unwrap();
    assert!(matches!(rectified.probe(&half), Err(Error::Argument { argument: "photo", .. })));
}

#[test]
fn rejected_pictures_tell_what_was_found() {
    let session = paused(true);
    let photo = &photos(1)[0];
    // Moved while it was taken; as encoded, which widens edges further.
    let moved = |px: usize| {
        changed(photo, |row, i| {
            let at = |k: usize| row[(i + 3 * k).min(row.len() - 3 + i % 3)].sqrt();
            ((0..px).map(at).sum::<f32>() / px as f32).powi(2)
        })
    };
    let blurred = |probe: &Probe| match probe.rejection {
        Some(Rejection::Blurred { blur_px, .. }) => {
            assert!(blur_px > 8.0 && probe.blur_px == Some(blur_px), "{probe:?}");
            assert!(probe.corners.len() > 20 && probe.pose.is_some(), "{probe:?}");
            true
        }
        _ => false,
    };
    let probes = [31, 37, 43].map(|px| session.probe(&moved(px)).unwrap());
    assert!(probes.iter().any(blurred), "{:?}", probes.map(|p| p.rejection));
    for (factor, expected) in [(0.002, "too_dark"), (60.0, "clipped")] {
        let photo = changed(photo, |row, i| (factor * row[i]).min(1.0));
        let probe = session.probe(&photo).unwrap();
        let Outcome::Rejected(rejection) = session.add_photo(&photo).unwrap() else {
            panic!("taken")
        };
        assert_eq!(probe.rejection.map(|r| r.code()), Some(rejection.code()), "{probe:?}");
        println!("{factor}: {rejection}, corners {}", probe.corners.len());
        assert_eq!(rejection.code(), expected);
    }
    // Dark, but the board is seen: the pose is told.
    let dim = changed(photo, |row, i| 0.006 * row[i]);
    let probe = session.probe(&dim).unwrap();
    assert!(matches!(probe.rejection, Some(Rejection::TooDark { .. })), "{probe:?}");
    assert!(probe.pose.is_some() && probe.corners.len() > 60 && probe.light.is_some());
    // Before the flash fires that says nothing.
    let probe = session.probe_without_flash(&dim).unwrap();
    assert!(probe.rejection.is_none() && probe.light.is_none() && probe.view.is_some());
    let empty = Photo::from_linear(800, 600, vec![0.3; 3 * 800 * 600], 1.0, 1.0).unwrap();
    let probe = session.probe(&empty).unwrap();
    assert_eq!(probe.rejection, Some(Rejection::BoardNotFound));
    assert!(probe.corners.is_empty() && probe.pose.is_none() && probe.corners_expected > 60);
    session.cancel();
    assert!(matches!(session.probe(photo), Err(Error::Cancelled)));
}

fn top_views(settings: Settings) -> Session {
    let falloff = RectifiedFalloff::InverseSquareAuto;
    let session = Session::new(Scene::Rectified { falloff }, settings).unwrap();
    session.pause();
    session
}

fn fitted(session: &Session, steps: u32) -> std::sync::Arc<Svbrdf> {
    session.set_budget(Budget { steps: Some(steps), ..Budget::default() }).unwrap();
    session.resume();
    session.wait().unwrap();
    session.snapshot().unwrap()
}

/// Views from the top depend on nothing but themselves: the same bits.
#[test]
fn a_rectified_photograph_taken_back_has_never_come() {
    let truth = material();
    let photos: Vec<Photo> = POSITIONS.iter().map(|p| photo(&truth, *p)).collect();
    for (method, index) in [(Method::Deep, 0), (Method::Classic, 1)] {
        let settings = Settings { threads: 2, method, ..Settings::default() };
        let (session, without) = (top_views(settings.clone()), top_views(settings));
        for (i, photo) in photos.iter().enumerate() {
            session.add_rectified_photo(photo, POSITIONS[i], POSITIONS[i]).unwrap();
            if i != index {
                without.add_rectified_photo(photo, POSITIONS[i], POSITIONS[i]).unwrap();
            }
        }
        session.remove_photo(index).unwrap();
        assert_eq!(session.progress().photos, 2);
        assert!(session.snapshot().unwrap() == without.snapshot().unwrap());
        assert!(fitted(&session, 6) == fitted(&without, 6), "{method:?} {index}");
    }
}

#[test]
fn photographs_of_a_board_are_taken_back_with_what_they_told() {
    let photos = photos(6);
    // With an unknown camera; with a given one; and that after it has settled on the paper.
    for (with_camera, count, index) in [(false, 3, 1), (true, 3, 0), (true, 6, 4)] {
        let settled = count > 4;
        let (session, without) = (paused(with_camera), paused(with_camera));
        for (i, photo) in photos[..count].iter().enumerate() {
            push(&session, photo);
            if i != index {
                push(&without, photo);
            }
        }
        let before = session.save().unwrap();
        for wrong in [count, usize::MAX] {
            let fault = session.remove_photo(wrong).unwrap_err();
            assert!(matches!(fault, Error::Argument { argument: "index", .. }), "{fault}");
        }
        assert!(session.save().unwrap() == before, "a wrong index changes nothing");
        session.remove_photo(index).unwrap();
        assert_eq!(session.progress().photos, count - 1);
        assert_eq!(session.camera(), without.camera());
        if settled {
            // Paper and height stay; the others determine the same.
            assert_eq!(session.paper().unwrap().paper, without.paper().unwrap().paper);
        } else {
            assert_eq!(session.paper(), without.paper());
            assert_eq!(session.elevation(), without.elevation());
        }
        assert_eq!(session.poses(), without.poses());
        let off = session.flash_offset_mm() - without.flash_offset_mm();
        assert!(off.length() < 1e-2, "{off}");
        // Half floats round lights and views. A fit in progress enlarges the difference, since its gradient is a sign.
        let difference = || {
            let (a, b) = (session.snapshot().unwrap(), without.snapshot().unwrap());
            let sum: f32 = a.planes().iter().zip(b.planes()).map(|(a, b)| (a - b).abs()).sum();
            sum / a.planes().len() as f32
        };
        let first = difference();
        fitted(&session, 10);
        fitted(&without, 10);
        let fitted = difference();
        println!("camera {with_camera}, {count} photographs: flash {off}, maps {first}, {fitted}");
        assert!(first < 1e-3 && fitted < 1e-2, "{first} {fitted}");
        // And it goes on, also when it is saved.
        session.pause();
        push(&session, &photos[index]);
        assert_eq!(session.poses().len(), count);
    }
}

#[test]
fn without_photographs_there_are_no_maps() {
    let session = paused(false);
    let photo = &photos(1)[0];
    push(&session, photo);
    session.remove_photo(0).unwrap();
    assert!(matches!(session.snapshot(), Err(Error::NoMaps)));
    assert!(session.progress().settled && session.progress().photos == 0);
    assert!(session.camera().is_none() && session.poses().is_empty());
    assert!(session.photo_fits().unwrap().is_empty());
    assert!(session.remove_photo(0).is_err());
    push(&session, photo);
    assert!(session.snapshot().is_ok());
}

#[test]
fn the_photograph_that_contradicts_the_others_is_named() {
    let truth = material();
    let mut other = material();
    for c in 0..3 {
        other.diffuse_mut()[c].copy_from_slice(truth.plane(channel::DIFFUSE + 2 - c));
    }
    // Driven from here: the fit begins with all of them, and no phase is missed.
    let (method, driver) = (Method::Classic, Driver::Caller);
    let settings = Settings { threads: 2, method, driver, ..Settings::default() };
    let session = Session::new(scene(), settings).unwrap();
    session.set_budget(Budget { steps: Some(150), ..Budget::default() }).unwrap();
    let [a, b, c] = POSITIONS;
    let d = [-30.0, -60.0, 120.0];
    let e = [20.0, -40.0, 100.0];
    for (i, position) in [a, b, c, d, e].into_iter().enumerate() {
        let seen = if i == 2 { &other } else { &truth };
        session.add_rectified_photo(&photo(seen, position), position, position).unwrap();
    }
    let mut phases = Vec::new();
    while session.step().unwrap() {
        phases.extend(session.progress().phase);
    }
    assert!(phases.contains(&Phase::Fit), "{phases:?}");
    assert_eq!(session.progress().phase, None);
    let fits = session.photo_fits().unwrap();
    println!("{fits:?}");
    let named: Vec<usize> = (0..5).filter(|&i| fits[i].outlier).collect();
    assert_eq!(named, [2], "{fits:?}");
    assert!(fits.iter().all(|f| f.weight > 0.3 && f.weight <= 1.0 && f.residual >= 0.0));
    session.remove_photo(2).unwrap();
    session.wait().unwrap();
    let left = session.photo_fits().unwrap();
    println!("{left:?}");
    assert!(left.len() == 4 && left.iter().all(|f| !f.outlier), "{left:?}");
    assert!(left[2].residual < fits[2].residual);
}
