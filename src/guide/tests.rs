use glam::{DMat3, DVec3};

use super::*;
use crate::geometry::Pose;
use crate::session::{BoardPose, SurveyedView};

/// A view `tilt_deg` from the normal with the given azimuth, degrees.
fn view(tilt_deg: f32, azimuth_deg: f32) -> NextView {
    let ((s, c), (y, x)) = (tilt_deg.to_radians().sin_cos(), azimuth_deg.to_radians().sin_cos());
    NextView { direction: [s * x, s * y, c], tilt_deg, azimuth_deg }
}

/// A survey whose gain falls with the angle to one view, from `best` on.
fn survey(best: f32, at: NextView, settled: bool) -> Option<Arc<Survey>> {
    let gain = |v: &NextView| best * (-degrees(v.direction, at.direction) / 30.0).exp();
    let views =
        [10.0, 30.0, 50.0].into_iter().flat_map(|t| (0..8).map(move |k| view(t, 45.0 * k as f32)));
    let views = views.map(|v| SurveyedView { view: v, gain: gain(&v) }).collect();
    Some(Arc::new(Survey { photos: 1, settled, views, distance_mm: 300.0 }))
}

/// Probe of such a view, with the sample moved by `moved_px`.
fn probe(at: NextView, moved_px: f32) -> Probe {
    let direction = DVec3::from_array(at.direction.map(f64::from));
    let z = -direction;
    let x = DVec3::Y.cross(z).try_normalize().unwrap_or(DVec3::X);
    let rotation = DMat3::from_cols(x, z.cross(x), z).transpose();
    let pose = Pose { rotation, translation: DVec3::new(0.0, 0.0, 300.0) };
    let corners = [[100.0, 100.0], [300.0, 100.0], [300.0, 300.0], [100.0, 300.0]];
    Probe {
        rejection: None,
        hints: Vec::new(),
        corners: Vec::new(),
        corners_expected: 100,
        corners_in_view: 100,
        blur_px: Some(0.8),
        blur_direction_deg: None,
        pose: Some(BoardPose { pose, reprojection_rms_px: 0.1 }),
        view: Some(ProbedView {
            direction: at.direction,
            distance_mm: 300.0,
            tilt_deg: at.tilt_deg,
            azimuth_deg: at.azimuth_deg,
            off_next_deg: None,
            sample_seen: 1.0,
            sample_clipped: 0.0,
            sample_px: Some(corners.map(|[x, y]: [f32; 2]| [x + moved_px, y])),
            px_per_mm: 2.0,
        }),
        light: None,
    }
}

/// Shows a still picture for some frames of 1/30 s and returns the last answer.
fn still(
    guide: &mut Guide,
    survey: &Option<Arc<Survey>>,
    photos: usize,
    probe: &Probe,
    from: f64,
) -> Guidance {
    let answers =
        (0..8).map(|i| guide.decide(survey.clone(), photos, probe, from + f64::from(i) / 30.0));
    let answers: Vec<Guidance> = answers.collect();
    let shot = answers.iter().find(|a| a.action == Action::Shoot);
    shot.or(answers.last()).unwrap().clone()
}

#[test]
fn the_first_photograph_is_taken_from_above_once_the_camera_is_steady() {
    let mut guide = Guide::default();
    let aside = still(&mut guide, &None, 0, &probe(view(40.0, 0.0), 0.0), 0.0);
    assert_eq!((aside.action, aside.target.unwrap().degrees.round()), (Action::Move, 40.0));
    // 4 px in 1/30 s is 0.6 of the sample's 200 px per second.
    let mut actions = (0..10).map(|i| {
        let t = f64::from(i) / 30.0;
        guide.decide(None, 0, &probe(view(5.0, 0.0), 4.0 * i as f32), 1.0 + t).action
    });
    assert!(actions.all(|action| action == Action::Hold));
    let first = guide.decide(None, 0, &probe(view(5.0, 0.0), 0.0), 3.0);
    assert_eq!(first.action, Action::Hold, "one picture does not tell");
    let shot = still(&mut guide, &None, 0, &probe(view(5.0, 0.0), 0.0), 4.0);
    assert_eq!((shot.action, shot.photos), (Action::Shoot, 0));
}

#[test]
fn a_photograph_is_asked_for_once() {
    let mut guide = Guide::default();
    let picture = probe(view(5.0, 0.0), 0.0);
    assert_eq!(still(&mut guide, &None, 0, &picture, 0.0).action, Action::Shoot);
    assert_eq!(guide.decide(None, 0, &picture, 2.0).action, Action::Hold);
    // The survey is not yet available.
    assert_eq!(still(&mut guide, &None, 1, &picture, 2.1).action, Action::Hold);
    let mut other = Guide::default();
    assert_eq!(still(&mut other, &None, 0, &picture, 0.0).action, Action::Shoot);
    other.missed();
    assert_eq!(still(&mut other, &None, 0, &picture, 1.0).action, Action::Shoot);
    assert_eq!(still(&mut other, &None, 0, &picture, 9.0).action, Action::Shoot, "timed out");
}

#[test]
fn the_camera_is_led_to_the_most_informative_view() {
    let mut guide = Guide::default();
    let wanted = view(30.0, 90.0);
    let surveyed = survey(0.4, wanted, true);
    let away = still(&mut guide, &surveyed, 1, &probe(view(10.0, 270.0), 0.0), 0.0);
    let target = away.target.unwrap();
    assert_eq!((away.action, target.view), (Action::Move, wanted));
    assert!((target.degrees - 40.0).abs() < 1e-3, "{target:?}");
    // Camera centre plus offset gives the target, 300 mm from the sample.
    let pose = probe(view(10.0, 270.0), 0.0).pose.unwrap().pose;
    let there = pose.to_board(DVec3::from_array(target.offset_mm.map(f64::from)));
    let expected = DVec3::from_array(wanted.direction.map(f64::from)) * 300.0;
    assert!(there.distance(expected) < 1e-3, "{there} {expected}");
    assert!(away.message.contains("far side"), "{}", away.message);
    assert!(away.gain.unwrap() < 0.5 * away.best_gain.unwrap());
    // A nearby view suffices.
    let near = still(&mut guide, &surveyed, 1, &probe(view(30.0, 86.0), 0.0), 1.0);
    assert_eq!(near.action, Action::Shoot);
    let mut again = Guide::default();
    let mut same = probe(wanted, 0.0);
    same.hints.push(Hint::NothingNew { index: 0 });
    assert_eq!(still(&mut again, &surveyed, 1, &same, 0.0).action, Action::Move);
}

#[test]
fn faults_are_corrected_first() {
    let mut guide = Guide::default();
    let surveyed = survey(0.4, view(30.0, 90.0), true);
    let mut dark = probe(view(30.0, 90.0), 0.0);
    dark.rejection = Some(Rejection::TooDark { level: 0.01 });
    let answer = still(&mut guide, &surveyed, 1, &dark, 0.0);
    assert_eq!((answer.action, answer.rejection), (Action::Adjust, dark.rejection));
    assert!(answer.message.starts_with("Too dark"), "{}", answer.message);
    dark.rejection = Some(Rejection::Blurred { blur_px: 5.0, direction_deg: None });
    assert_eq!(still(&mut guide, &surveyed, 1, &dark, 1.0).action, Action::Hold);
    let mut lost = dark.clone();
    (lost.rejection, lost.pose, lost.view) = (Some(Rejection::BoardNotFound), None, None);
    let answer = still(&mut guide, &surveyed, 1, &lost, 2.0);
    assert_eq!((answer.action, answer.target), (Action::Adjust, None));
}

#[test]
fn capture_ends_when_the_settled_fit_expects_little_gain() {
    let at = view(30.0, 90.0);
    let picture = probe(at, 0.0);
    let action = |best, settled, photos| {
        let surveyed = survey(best, at, settled);
        still(&mut Guide::default(), &surveyed, photos, &picture, 0.0).action
    };
    assert_eq!(action(0.02, true, 6), Action::Enough);
    assert_eq!(action(0.02, false, 6), Action::Shoot, "not settled");
    assert_eq!(action(0.02, true, 3), Action::Shoot, "too few");
    assert_eq!(action(0.5, true, 6), Action::Shoot);
    assert_eq!(action(0.5, false, 20), Action::Enough, "the most");
}
