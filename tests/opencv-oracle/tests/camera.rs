//! Joint calibration of camera and poses against OpenCV's `calibrateCamera`.

#[path = "../../common/captures.rs"]
mod captures;

use std::path::{Path, PathBuf};

use captures::{angle_deg, picture};
use glam::{DMat3, DVec2, DVec3};
use opencv::core::{Mat, Point2f, Point3f, Size, TermCriteria, TermCriteria_Type, Vector};
use opencv::prelude::*;
use opencv::{calib3d, imgproc};
use svbrdf::calibration::{
    CameraPrior, Corner, Hole, LumaImage, Target, TopLeft, detect, estimate_camera,
};
use svbrdf::geometry::{Camera, Pose};

fn criteria(count: i32, epsilon: f64) -> TermCriteria {
    let both = TermCriteria_Type::COUNT as i32 | TermCriteria_Type::EPS as i32;
    TermCriteria::new(both, count, epsilon).unwrap()
}

/// Camera, poses and RMS by OpenCV.
fn calibrated_by_opencv(
    size: (u32, u32),
    target: &Target,
    views: &[Vec<Corner>],
) -> (Camera, Vec<Pose>, f64) {
    let mut object = Vector::<Vector<Point3f>>::new();
    let mut image = Vector::<Vector<Point2f>>::new();
    for corners in views {
        object.push(
            corners
                .iter()
                .map(|c| target.grid_mm(c.row.into(), c.col.into()))
                .map(|p| Point3f::new(p.x as f32, p.y as f32, 0.0))
                .collect(),
        );
        image.push(corners.iter().map(|c| Point2f::new(c.px.x as f32, c.px.y as f32)).collect());
    }
    let (mut k, mut d) = (Mat::default(), Mat::default());
    let (mut rotations, mut translations) = (Vector::<Mat>::new(), Vector::<Mat>::new());
    let rms = calib3d::calibrate_camera(
        &object,
        &image,
        Size::new(size.0 as i32, size.1 as i32),
        &mut k,
        &mut d,
        &mut rotations,
        &mut translations,
        0,
        criteria(300, 1e-14),
    )
    .unwrap();
    let three =
        |m: &Mat| DVec3::from_array(std::array::from_fn(|i| *m.at::<f64>(i as i32).unwrap()));
    let poses = rotations
        .iter()
        .zip(translations.iter())
        .map(|(r, t)| {
            let (r, t) = (three(&r), three(&t));
            Pose { rotation: DMat3::from_axis_angle(r.normalize(), r.length()), translation: t }
        })
        .collect();
    let at = |i: i32, j: i32| *k.at_2d::<f64>(i, j).unwrap();
    let camera = Camera {
        width: size.0,
        height: size.1,
        fx: at(0, 0),
        fy: at(1, 1),
        cx: at(0, 2),
        cy: at(1, 2),
        distortion: std::array::from_fn(|i| *d.at::<f64>(i as i32).unwrap()),
    };
    (camera, poses, rms)
}

#[test]
fn joint_calibrations_agree() {
    let Some(all) = captures::all() else { return };
    println!(
        "{:24} {:>9} {:>9} {:>9} {:>9} {:>10}",
        "capture", "rms", "rms cv", "focal %", "px", "pose deg"
    );
    for capture in all {
        let target = &capture.target;
        let size = (capture.camera.width, capture.camera.height);
        let single = |c: &Corner| {
            // OpenCV takes single precision.
            let px = DVec2::new(f64::from(c.px.x as f32), f64::from(c.px.y as f32));
            Corner { px, ..*c }
        };
        let found: Vec<Vec<Corner>> = capture
            .photos
            .iter()
            .map(|f| {
                let luma = LumaImage::from_photo(&f.photo());
                detect(&luma, target).unwrap().corners.iter().map(single).collect()
            })
            .collect();
        let prior = CameraPrior::none(size.0, size.1);
        let slices: Vec<&[Corner]> = found.iter().map(Vec::as_slice).collect();
        let ours = estimate_camera(target, &slices, &prior, None).unwrap();
        let inliers: Vec<Vec<Corner>> = found
            .iter()
            .zip(&ours.views)
            .map(|(corners, view)| {
                let kept = corners.iter().zip(&view.inliers).filter(|(_, i)| **i);
                kept.map(|(c, _)| *c).collect()
            })
            .collect();
        let (camera, poses, rms) = calibrated_by_opencv(size, target, &inliers);
        let focal = 100.0 * (ours.camera.fx / camera.fx - 1.0).abs();
        let centre = (ours.camera.cx - camera.cx).hypot(ours.camera.cy - camera.cy);
        let turn = ours
            .views
            .iter()
            .zip(&poses)
            .map(|(v, p)| angle_deg(&v.pose.unwrap(), p))
            .fold(0.0, f64::max);
        println!(
            "{:24} {:9.5} {rms:9.5} {focal:9.5} {centre:9.5} {turn:10.2e}",
            capture.name, ours.rms_px
        );
        assert!(ours.rms_px <= rms * (1.0 + 1e-6));
        // The same minimum; OpenCV stops a little before it.
        assert!(focal < 0.02 && turn < 0.02);
        for (view, shot) in ours.views.iter().zip(&capture.photos) {
            assert!(angle_deg(&view.pose.unwrap(), &shot.pose) < 0.15);
        }
    }
}

fn photos(folder: &Path, part: &str) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "jpg"))
        .filter(|p| p.file_name().unwrap().to_string_lossy().starts_with(part))
        .collect();
    files.sort();
    files
}

/// Corners by `findChessboardCorners` and `cornerSubPix` in the order of the target's.
fn found_by_opencv(path: &Path, target: &Target, half: i32) -> Option<Vec<Corner>> {
    let gray = picture(path).into_luma8();
    let (w, h) = gray.dimensions();
    let raw = gray.into_raw();
    let image = Mat::new_rows_cols_with_data(h as i32, w as i32, &raw).unwrap();
    let (rows, cols) = (target.rows - 1, target.cols - 1);
    let mut points = Vector::<Point2f>::new();
    let found = calib3d::find_chessboard_corners(
        &image,
        Size::new(cols as i32, rows as i32),
        &mut points,
        calib3d::CALIB_CB_ADAPTIVE_THRESH | calib3d::CALIB_CB_NORMALIZE_IMAGE,
    )
    .unwrap();
    if !found {
        return None;
    }
    imgproc::corner_sub_pix(
        &image,
        &mut points,
        Size::new(half, half),
        Size::new(-1, -1),
        criteria(60, 1e-4),
    )
    .unwrap();
    let place = |(i, p): (usize, Point2f)| Corner {
        row: i as u32 / cols + 1,
        col: i as u32 % cols + 1,
        px: DVec2::new(p.x.into(), p.y.into()),
    };
    Some(points.iter().enumerate().map(place).collect())
}

/// Two detectors and two calibrations on the same real photographs.
#[test]
fn own_calibration_of_real_photographs_fits_as_well() {
    let Some(root) = captures::test_data("calibration") else { return };
    for (folder, part, rows, cols, square_mm) in [
        ("opencv_stereo", "left", 7, 10, 25.0),
        ("opencv_stereo", "right", 7, 10, 25.0),
        ("udacity_gopro/calibration_wide", "GOPR", 7, 9, 30.0),
    ] {
        let hole = Hole { row_start: 0, col_start: 0, row_end: 0, col_end: 0 };
        let target =
            Target { rows, cols, square_mm, hole, top_left: TopLeft::Black, ..Target::default() };
        let files = photos(&root.join(folder), part);
        let (mut ours, mut theirs) = (Vec::new(), [Vec::new(), Vec::new()]);
        let mut size = (0, 0);
        let (mut found, mut both, mut corners) = (0, 0, 0);
        let mut apart = Vec::new();
        for file in &files {
            let photo =
                svbrdf::photo::Photo::read(file, svbrdf::photo::Encoding::Srgb, 1.0).unwrap();
            // One photograph of the wide set has another size.
            if size == (0, 0) {
                size = (photo.width(), photo.height());
            }
            if size != (photo.width(), photo.height()) {
                println!("{}: another size", file.display());
                continue;
            }
            let own = detect(&LumaImage::from_photo(&photo), &target);
            match &own {
                Ok(own) => {
                    found += 1;
                    corners += own.corners.len();
                }
                Err(reason) => println!("{}: {reason}", file.display()),
            }
            let classic = [5, 11].map(|half| found_by_opencv(file, &target, half));
            if let (Ok(own), [Some(a), Some(b)]) = (own, classic) {
                both += 1;
                for corner in &own.corners {
                    let nearest = a.iter().map(|c| c.px.distance_squared(corner.px));
                    apart.push(nearest.fold(f64::INFINITY, f64::min));
                }
                ours.push(own.corners);
                theirs[0].push(a);
                theirs[1].push(b);
            }
        }
        let slices: Vec<&[Corner]> = ours.iter().map(Vec::as_slice).collect();
        let prior = CameraPrior::ordinary(size.0, size.1);
        let own = estimate_camera(&target, &slices, &prior, None).unwrap();
        let references = theirs.map(|views| calibrated_by_opencv(size, &target, &views));
        let best = references[0].2.min(references[1].2);
        let all: usize = ours.iter().map(Vec::len).sum();
        let used: usize = own.views.iter().map(|v| v.inliers.iter().filter(|i| **i).count()).sum();
        // Every corner found counts, those left out of the estimate too.
        let mut squares = 0.0;
        for (corners, view) in ours.iter().zip(&own.views) {
            for c in corners {
                let p = target.grid_mm(c.row.into(), c.col.into()).extend(0.0);
                let px = own.camera.project(view.pose.unwrap().transform(p)).unwrap();
                squares += px.distance_squared(c.px);
            }
        }
        let rms_all = (squares / all as f64).sqrt();
        let apart = (apart.iter().sum::<f64>() / apart.len() as f64).sqrt();
        println!(
            "{folder}/{part}: {found} of {} boards, {corners} corners; on {both} also found by the \
             classic detector: RMS {:.4} px ({used} of {all} corners; all: {rms_all:.4}), classic \
             {:.4} (window 5), {:.4} (window 11); corners {apart:.3} px apart; fx {:.2} +- {:.2}, \
             classic {:.2} {:.2}",
            files.len(),
            own.rms_px,
            references[0].2,
            references[1].2,
            own.camera.fx,
            own.sigma()[0],
            references[0].0.fx,
            references[1].0.fx,
        );
        assert!(rms_all <= 1.05 * best, "{rms_all} {best}");
    }
}
