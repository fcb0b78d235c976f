//! Poses of exact, noisy and unusable corners.

use super::*;
use crate::test_support::pose;
use nalgebra::{SMatrix, SVector};

fn camera() -> Camera {
    Camera {
        width: 2016,
        height: 1512,
        fx: 1450.0,
        fy: 1455.0,
        cx: 1001.0,
        cy: 760.0,
        distortion: [0.06, -0.09, 0.001, -0.0005, 0.0],
    }
}

fn corners(truth: &Pose, noise_px: f64) -> Vec<Corner> {
    let target = Target::default();
    let mut state = 7u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let seen = target.corners().into_iter().filter_map(|(row, col)| {
        let p = target.grid_mm(row.into(), col.into()).extend(0.0);
        let px = camera().project(truth.transform(p))?;
        // Uniform noise of standard deviation `noise_px`.
        let px = px + DVec2::new(random(), random()) * noise_px * 12f64.sqrt();
        Some(Corner { row, col, px })
    });
    seen.collect()
}

fn angle_deg(a: &Pose, b: &Pose) -> f64 {
    let turn = a.rotation * b.rotation.transpose();
    let sine = DVec3::new(
        turn.y_axis.z - turn.z_axis.y,
        turn.z_axis.x - turn.x_axis.z,
        turn.x_axis.y - turn.y_axis.x,
    );
    (0.5 * sine.length()).asin().to_degrees()
}

#[test]
fn exact_corners_give_the_exact_pose() {
    for tilt in [0.0, 0.02, 0.3, 0.8, 1.1] {
        for azimuth in [0.0, 1.0, 4.0] {
            let truth = pose(tilt, azimuth, 0.4, 330.0);
            let found =
                estimate_pose(&camera(), &Target::default(), &corners(&truth, 0.0)).unwrap();
            assert!(angle_deg(&found.pose, &truth) < 1e-7, "{tilt} {azimuth}");
            assert!((found.pose.translation - truth.translation).length() < 1e-6);
            assert!(found.rms_px < 1e-8 && found.inliers.iter().all(|i| *i));
        }
    }
}

#[test]
fn false_corners_are_left_out() {
    let truth = pose(0.5, 2.0, 0.1, 320.0);
    let mut given = corners(&truth, 0.1);
    for (k, corner) in given.iter_mut().enumerate().filter(|(k, _)| k % 8 == 3) {
        corner.px += DVec2::new(4.0 + k as f64 / 10.0, -6.0);
    }
    let found = estimate_pose(&camera(), &Target::default(), &given).unwrap();
    assert!(found.inliers.iter().enumerate().all(|(k, i)| *i != (k % 8 == 3)));
    assert!(angle_deg(&found.pose, &truth) < 0.03);
}

#[test]
fn the_covariance_predicts_the_error() {
    // The expected squared normalised error is 6; its mean over 60 draws has a standard deviation of 0.45.
    let mut sum = 0.0;
    for k in 0..60 {
        let k = f64::from(k);
        let truth = pose(0.2 + 0.012 * k, 0.7 * k, 0.3 * k, 300.0);
        let found = estimate_pose(&camera(), &Target::default(), &corners(&truth, 0.1)).unwrap();
        let turn = found.pose.rotation * truth.rotation.transpose();
        let shift = found.pose.translation - truth.translation;
        let e = SVector::<f64, 6>::from([
            0.5 * (turn.y_axis.z - turn.z_axis.y),
            0.5 * (turn.z_axis.x - turn.x_axis.z),
            0.5 * (turn.x_axis.y - turn.y_axis.x),
            shift.x,
            shift.y,
            shift.z,
        ]);
        let c = SMatrix::<f64, 6, 6>::from_fn(|i, j| found.covariance[i][j]);
        sum += (e.transpose() * c.try_inverse().unwrap() * e)[(0, 0)];
    }
    let mean = sum / 60.0;
    assert!((4.3..7.7).contains(&mean), "{mean}");
}

#[test]
fn unusable_corners_are_refused_with_the_reason() {
    let target = Target::default();
    let truth = pose(0.4, 1.0, 0.0, 320.0);
    let all = corners(&truth, 0.1);
    let few = estimate_pose(&camera(), &target, &all[..12]);
    assert!(matches!(few, Err(Rejection::TooFewCorners { found: 12, needed: 20, .. })));
    let part = estimate_pose(&camera(), &target, &all[..40]);
    assert!(matches!(part, Err(Rejection::TooFewCorners { found: 40, needed: 54, .. })));
    let mut mixed = all.clone();
    for i in 0..mixed.len() {
        mixed[i].px = all[(i * 37) % all.len()].px;
    }
    let mixed = estimate_pose(&camera(), &target, &mixed);
    assert!(matches!(mixed, Err(Rejection::PoseUncertain { .. })));
    let flat = pose(1.29, 1.0, 0.0, 420.0);
    let flat = estimate_pose(&camera(), &target, &corners(&flat, 0.05));
    assert!(matches!(flat, Err(Rejection::TooGrazing { .. })), "{flat:?}");
    let mut nonsense = all.clone();
    nonsense[5].px.x = f64::NAN;
    let nonsense = estimate_pose(&camera(), &target, &nonsense);
    assert!(matches!(nonsense, Err(Rejection::PoseUncertain { .. })));
    // Collinear corners define no plane.
    let line: Vec<Corner> =
        (0..25).map(|k| Corner { row: 1, col: 1 + k % 14, px: all[k as usize].px }).collect();
    assert!(estimate_pose(&camera(), &target, &line).is_err());
    // Seen from behind: mirrored.
    let mut behind = all.clone();
    for corner in &mut behind {
        corner.px.x = 2002.0 - corner.px.x;
    }
    let behind = estimate_pose(&camera(), &target, &behind);
    assert!(matches!(behind, Err(Rejection::PoseUncertain { .. })), "{behind:?}");
}

#[test]
fn a_distant_board_whose_tilt_could_be_mirrored_is_refused() {
    let mut far = camera();
    (far.fx, far.fy, far.distortion) = (6e6, 6e6, [0.0; 5]);
    let truth = pose(0.5, 1.0, 0.0, 1.4e6);
    let target = Target::default();
    let given: Vec<Corner> = corners(&truth, 0.0)
        .into_iter()
        .enumerate()
        .map(|(k, c)| {
            let p = target.grid_mm(c.row.into(), c.col.into()).extend(0.0);
            let noise = DVec2::from_angle(k as f64) * 0.15;
            Corner { px: far.project(truth.transform(p)).unwrap() + noise, ..c }
        })
        .collect();
    let result = estimate_pose(&far, &target, &given);
    assert!(matches!(result, Err(Rejection::PoseUncertain { .. })), "{result:?}");
}
