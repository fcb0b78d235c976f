//! Projection, corners and pose against OpenCV.

#[path = "../../common/captures.rs"]
mod captures;

use captures::angle_deg;
use glam::{DMat3, DVec2, DVec3};
use opencv::core::{
    Mat, Point2d, Point2f, Point3d, Size, TermCriteria, TermCriteria_Type, Vec3d, Vector,
};
use opencv::{calib3d, imgproc};
use svbrdf::calibration::{Corner, LumaImage, Target, TargetKind, detect, estimate_pose};
use svbrdf::geometry::{Camera, Pose};

fn matrix(camera: &Camera) -> Mat {
    let rows = [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]];
    Mat::from_slice_2d(&rows).unwrap()
}

fn vector(v: DVec3) -> Vec3d {
    Vec3d::from([v.x, v.y, v.z])
}

/// Rotation vector of a rotation.
fn rodrigues(rotation: &DMat3) -> DVec3 {
    let (axis, angle) = glam::DQuat::from_mat3(rotation).to_axis_angle();
    axis * angle
}

fn pose(rotation: &Vec3d, translation: &Vec3d) -> Pose {
    let r = DVec3::new(rotation[0], rotation[1], rotation[2]);
    Pose {
        rotation: DMat3::from_axis_angle(r.normalize(), r.length()),
        translation: DVec3::new(translation[0], translation[1], translation[2]),
    }
}

#[test]
fn projections_agree() {
    let camera = Camera {
        width: 2016,
        height: 1512,
        fx: 1450.0,
        fy: 1460.0,
        cx: 1000.0,
        cy: 760.0,
        distortion: [0.05, -0.08, 0.002, -0.003, 0.02],
    };
    let placed = Pose {
        rotation: DMat3::from_axis_angle(DVec3::new(1.0, 0.2, -0.1).normalize(), 2.8),
        translation: DVec3::new(5.0, -8.0, 250.0),
    };
    let points: Vec<DVec3> = (0..400)
        .map(|k| DVec3::new(f64::from(k % 20) * 9.0 - 85.0, f64::from(k / 20) * 8.0 - 75.0, 2.0))
        .collect();
    let object: Vector<Point3d> = points.iter().map(|p| Point3d::new(p.x, p.y, p.z)).collect();
    let mut image = Vector::<Point2d>::new();
    calib3d::project_points(
        &object,
        &vector(rodrigues(&placed.rotation)),
        &vector(placed.translation),
        &matrix(&camera),
        &Mat::from_slice(&camera.distortion).unwrap(),
        &mut image,
        &mut opencv::core::no_array(),
        0.0,
    )
    .unwrap();
    for (point, theirs) in points.iter().zip(&image) {
        let ours = camera.project(placed.transform(*point)).unwrap();
        // Both in double precision: rounding of some thousand pixels.
        assert!(ours.distance(DVec2::new(theirs.x, theirs.y)) < 1e-9);
    }
}

/// Smallest distance between neighbouring corners, px.
fn smallest_cell(corners: &[Corner]) -> f64 {
    let distances = corners
        .iter()
        .enumerate()
        .flat_map(|(i, a)| corners[..i].iter().map(move |b| a.px.distance(b.px)));
    distances.fold(f64::INFINITY, f64::min)
}

/// Corners moved by `cornerSubPix` in windows of a quarter of the smallest cell, or the distance
/// to the markers.
fn refined_by_opencv(luma: &LumaImage, target: &Target, corners: &[Corner]) -> Vec<DVec2> {
    let image =
        Mat::new_rows_cols_with_data(luma.height as i32, luma.width as i32, &luma.data).unwrap();
    let mut points: Vector<Point2f> =
        corners.iter().map(|c| Point2f::new(c.px.x as f32, c.px.y as f32)).collect();
    let cells = match target.kind {
        TargetKind::CheckerboardRing => 0.25,
        TargetKind::CharucoRing { marker_mm, .. } => 0.5 * (1.0 - marker_mm / target.square_mm),
    };
    let half = (cells * smallest_cell(corners)).max(2.0) as i32;
    let both = TermCriteria_Type::COUNT as i32 | TermCriteria_Type::EPS as i32;
    imgproc::corner_sub_pix(
        &image,
        &mut points,
        Size::new(half, half),
        Size::new(-1, -1),
        TermCriteria::new(both, 60, 1e-4).unwrap(),
    )
    .unwrap();
    points.iter().map(|p| DVec2::new(p.x.into(), p.y.into())).collect()
}

/// Pose by IPPE, then Levenberg-Marquardt.
fn pose_by_opencv(camera: &Camera, target: &Target, corners: &[Corner]) -> Pose {
    let object: Vector<Point3d> = corners
        .iter()
        .map(|c| target.grid_mm(c.row.into(), c.col.into()))
        .map(|p| Point3d::new(p.x, p.y, 0.0))
        .collect();
    let image: Vector<Point2d> = corners.iter().map(|c| Point2d::new(c.px.x, c.px.y)).collect();
    let (k, d) = (matrix(camera), Mat::from_slice(&camera.distortion).unwrap());
    let (mut rotation, mut translation) = (Vec3d::default(), Vec3d::default());
    let found = calib3d::solve_pnp(
        &object,
        &image,
        &k,
        &d,
        &mut rotation,
        &mut translation,
        false,
        calib3d::SOLVEPNP_IPPE,
    );
    assert!(found.unwrap());
    let both = TermCriteria_Type::COUNT as i32 | TermCriteria_Type::EPS as i32;
    calib3d::solve_pnp_refine_lm(
        &object,
        &image,
        &k,
        &d,
        &mut rotation,
        &mut translation,
        TermCriteria::new(both, 200, 1e-14).unwrap(),
    )
    .unwrap();
    pose(&rotation, &translation)
}

#[test]
fn corners_and_poses_of_photographs_agree() {
    let Some(all) = captures::all() else { return };
    println!(
        "{:28} {:>10} {:>10} {:>10} {:>12} {:>12}",
        "photo", "rms px", "true ours", "true cv", "pose deg", "pose mm"
    );
    let mut sums = [0.0; 2];
    for capture in all {
        for (index, shot) in capture.photos.iter().enumerate() {
            let (camera, target) = (&capture.camera, &capture.target);
            let luma = LumaImage::from_photo(&shot.photo());
            let corners = detect(&luma, target).unwrap().corners;
            let theirs = refined_by_opencv(&luma, target, &corners);
            let rms =
                |squares: Vec<f64>| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
            let truth = |c: &Corner| {
                let p = target.grid_mm(c.row.into(), c.col.into()).extend(0.0);
                camera.project(shot.pose.transform(p)).unwrap()
            };
            let pairs = || corners.iter().zip(&theirs);
            let apart = rms(pairs().map(|(c, q)| c.px.distance_squared(*q)).collect());
            let ours_true = rms(pairs().map(|(c, _)| c.px.distance_squared(truth(c))).collect());
            let theirs_true = rms(pairs().map(|(c, q)| q.distance_squared(truth(c))).collect());
            sums[0] += ours_true;
            sums[1] += theirs_true;

            let estimate = estimate_pose(camera, target, &corners).unwrap();
            let inliers: Vec<Corner> = corners
                .iter()
                .zip(&estimate.inliers)
                .filter_map(|(c, inlier)| inlier.then_some(*c))
                .collect();
            let reference = pose_by_opencv(camera, target, &inliers);
            let degrees = angle_deg(&estimate.pose, &reference);
            let mm = estimate.pose.translation.distance(reference.translation);
            println!(
                "{:28} {apart:10.4} {ours_true:10.4} {theirs_true:10.4} {degrees:12.2e} {mm:12.2e}",
                format!("{}/{index}", capture.name)
            );
            // Two estimators on the same noisy pixels, each about 0.05 px from the truth.
            assert!(apart < 0.12);
            // One minimum of one sum of squares.
            assert!(degrees < 1e-4 && mm < 1e-3);
        }
    }
    println!("sum of RMS errors: ours {:.3}, cornerSubPix {:.3}", sums[0], sums[1]);
    assert!(sums[0] < sums[1]);
}
