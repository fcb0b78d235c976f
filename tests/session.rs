//! A session from the outside: streaming, rejections, pause, cancel, drop.

#[path = "common/rectified.rs"]
mod rectified;

use rectified::{POSITIONS, SIZE, material, photo, scene, view};
use svbrdf::observation::View;
use svbrdf::photo::Photo;
use svbrdf::session::{Method, Outcome, RectifiedFalloff, Scene, Session, Settings};
use svbrdf::{Error, Rejection, Svbrdf, render};

fn session(settings: Settings) -> Session {
    Session::new(scene(), settings).unwrap()
}

/// Mean absolute difference of renderings from directions that no photograph had.
fn novel_error(a: &Svbrdf, b: &Svbrdf) -> f32 {
    let mut sum = 0.0;
    let novel = [[80.0, -10.0, 120.0], [-20.0, -70.0, 130.0], [10.0, 90.0, 100.0]];
    for camera_mm in novel {
        let v = View { light_mm: [-camera_mm[0], 30.0, 140.0], ..view(camera_mm) };
        let (mut x, mut y) = (vec![0.0; 3 * SIZE * SIZE], vec![0.0; 3 * SIZE * SIZE]);
        render::render(a, &v, &mut x);
        render::render(b, &v, &mut y);
        sum += x.iter().zip(&y).map(|(x, y)| (x.min(1.0) - y.min(1.0)).abs()).sum::<f32>()
            / x.len() as f32;
    }
    sum / novel.len() as f32
}

#[test]
fn maps_come_at_once_and_improve_with_every_photograph() {
    let truth = material();
    let session = session(Settings { threads: 2, ..Settings::default() });
    assert!(matches!(session.snapshot(), Err(Error::NoMaps)));
    let mut errors = Vec::new();
    for (i, position) in POSITIONS.into_iter().enumerate() {
        let Outcome::Accepted(accepted) =
            session.add_rectified_photo(&photo(&truth, position), position, position).unwrap()
        else {
            panic!("photograph {i} was rejected")
        };
        assert_eq!(accepted.index, i);
        if i == 0 {
            errors.push(novel_error(&session.snapshot().unwrap(), &truth));
        }
        session.wait().unwrap();
        let progress = session.progress();
        assert!(progress.settled && progress.photos == i + 1);
        assert!(progress.loss < progress.loss_before, "{progress:?}");
        errors.push(novel_error(&session.snapshot().unwrap(), &truth));
    }
    println!("error of novel renderings: {errors:?}");
    // One photograph does not determine all parameters, and two have six values for nine: errors may grow a little. A
    // third must lower them.
    assert!(errors[2] < 1.15 * errors[1] && errors[3] < errors[2], "{errors:?}");
    assert!(errors[3] < 0.6 * errors[0], "{errors:?}");
}

#[test]
fn same_input_same_maps() {
    let truth = material();
    for method in [Method::Deep, Method::Classic] {
        let run = || {
            let session = session(Settings { threads: 2, method, ..Settings::default() });
            for position in &POSITIONS[..2] {
                session
                    .add_rectified_photo(&photo(&truth, *position), *position, *position)
                    .unwrap();
                session.wait().unwrap();
            }
            session.snapshot().unwrap()
        };
        assert_eq!(run().planes(), run().planes());
    }
}

#[test]
fn rejected_photographs_change_nothing() {
    let truth = material();
    let session = session(Settings::default());
    let mut rgb = vec![0.5; 3 * SIZE * SIZE];
    rgb[1000] = f32::NAN;
    let size = SIZE as u32;
    let bad = Photo::from_linear(size, size, rgb, 1.0, f32::INFINITY).unwrap();
    let push =
        |photo: &Photo| session.add_rectified_photo(photo, POSITIONS[0], POSITIONS[0]).unwrap();
    assert_eq!(push(&bad), Outcome::Rejected(Rejection::NotFinite));
    assert!(matches!(session.snapshot(), Err(Error::NoMaps)));
    assert!(matches!(push(&photo(&truth, POSITIONS[0])), Outcome::Accepted(_)));
    session.wait().unwrap();
    let before = session.snapshot().unwrap();
    assert_eq!(push(&bad), Outcome::Rejected(Rejection::NotFinite));
    assert_eq!(session.snapshot().unwrap().planes(), before.planes());
    assert_eq!(session.progress().photos, 1);
}

#[test]
fn misuse_is_an_error_and_loses_nothing() {
    let truth = material();
    let session = session(Settings::default());
    let good = photo(&truth, POSITIONS[0]);
    assert!(session.add_photo(&good).is_err(), "a board photograph in a rectified session");
    assert!(session.add_rectified_photo(&good, [0.0, f32::NAN, 100.0], POSITIONS[0]).is_err());
    assert!(session.add_rectified_photo(&good, POSITIONS[0], [0.0, 0.0, -5.0]).is_err());
    assert!(session.add_rectified_photo(&good, POSITIONS[0], POSITIONS[0]).is_ok());
    let scene = || Scene::Rectified { falloff: RectifiedFalloff::InverseSquareAuto };
    for settings in [
        Settings { resolution: 300, ..Settings::default() },
        Settings { sample_mm: [0.0, 100.0], ..Settings::default() },
    ] {
        assert!(Session::new(scene(), settings).is_err());
    }
}

#[test]
fn pause_holds_cancel_ends_and_drop_does_not_wait_for_the_fit() {
    let truth = material();
    let session = session(Settings { threads: 1, ..Settings::default() });
    session.pause();
    let push = |i: usize| {
        session.add_rectified_photo(&photo(&truth, POSITIONS[i]), POSITIONS[i], POSITIONS[i])
    };
    push(0).unwrap();
    // The fit answers after it has received the photograph, and does no step.
    session.photo_fits().unwrap();
    assert_eq!(session.progress().fraction, 0.0);
    assert!(session.snapshot().is_ok(), "maps need no fit");
    session.resume();
    session.wait().unwrap();
    assert!(session.progress().settled);
    // Held, so that it has not settled when it is ended.
    session.pause();
    push(1).unwrap();
    session.cancel();
    assert!(matches!(session.wait(), Err(Error::Cancelled)));
    assert!(matches!(push(2), Err(Error::Cancelled)));
    assert!(session.snapshot().is_ok());
    // A fit that is held never settles: whoever waited for it would wait for ever.
    let held = self::session(Settings { threads: 1, ..Settings::default() });
    held.pause();
    held.add_rectified_photo(&photo(&truth, POSITIONS[0]), POSITIONS[0], POSITIONS[0]).unwrap();
    drop(held);
}

/// An observed photograph equals the next added one, and the session does not change.
#[test]
fn a_photograph_that_is_observed_changes_nothing() {
    let capture = svbrdf::capture::Capture::load("examples/captures/tile").unwrap();
    let settings = Settings { sample_mm: capture.sample_mm, threads: 1, ..Settings::default() };
    let session = Session::new(capture.scene.clone(), settings).unwrap();
    session.pause();
    let photos: Vec<Photo> = capture.photos[..2].iter().map(|f| f.read().unwrap()).collect();
    let first = session.observe(&photos[0]).unwrap().into_result().unwrap();
    assert_eq!(session.progress().photos, 0);
    assert!(matches!(session.add_photo(&photos[0]).unwrap(), Outcome::Accepted(_)));
    let before = (session.save().unwrap(), session.revision());
    let second = session.observe(&photos[1]).unwrap().into_result().unwrap();
    assert_eq!((session.save().unwrap(), session.revision()), before);
    // It hints as pushing does, and has the pose that pushing finds.
    assert!(matches!(
        &session.observe(&photos[0]).unwrap().into_result().unwrap().hints[..],
        [svbrdf::session::Hint::NothingNew { index: 0 }]
    ));
    assert!(matches!(session.add_photo(&photos[1]).unwrap(), Outcome::Accepted(_)));
    let poses = session.poses();
    for (observed, pushed) in [first, second].iter().zip(&poses) {
        let pose = observed.pose.unwrap().pose;
        // The printed sheet, estimated from two photographs, moves the first one's pose a little.
        assert!(pose.translation.distance(pushed.pose.translation) < 0.5);
        let view = observed.observation.view;
        let centre = pose.camera_centre().as_vec3().to_array();
        assert!((0..2).all(|i| (view.camera_mm[i] - centre[i]).abs() < 0.01), "{view:?}");
    }
    let black = Photo::from_linear(64, 48, vec![0.0; 3 * 64 * 48], 1.0, 9.0).unwrap();
    assert!(matches!(session.observe(&black), Ok(Outcome::Rejected(Rejection::WrongSize { .. }))));
    let wrong = session.observe_rectified(&photos[0], [0.0, 0.0, 9.0], [0.0, 0.0, 9.0]);
    assert!(matches!(wrong, Err(Error::Argument { .. })));
    session.cancel();
    assert!(matches!(session.observe(&photos[0]), Err(Error::Cancelled)));
}
