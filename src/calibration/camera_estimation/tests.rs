use super::*;
use crate::test_support::pose;
use glam::{DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

fn truth() -> Camera {
    Camera {
        width: 2016,
        height: 1512,
        fx: 1452.0,
        fy: 1454.0,
        cx: 1016.0,
        cy: 749.0,
        distortion: [0.06, -0.09, 0.0005, -0.0004, 0.01],
    }
}

/// Deterministic Gaussian noise.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn corners(camera: &Camera, pose: &Pose, noise_px: f64, noise: &mut Noise) -> Vec<Corner> {
    corners_on(&Paper::default(), camera, pose, noise_px, noise)
}

fn corners_on(
    paper: &Paper,
    camera: &Camera,
    pose: &Pose,
    noise_px: f64,
    noise: &mut Noise,
) -> Vec<Corner> {
    let target = Target::default();
    let sheet = Sheet::new(&target, *paper);
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height)) - 1.0;
    let seen = target.corners().into_iter().filter_map(|(row, col)| {
        let p = sheet.at(target.grid_mm(row.into(), col.into()));
        let px = camera.project(pose.transform(p))?;
        let px = px + DVec2::new(noise.normal(), noise.normal()) * noise_px;
        let inside = px.cmpge(DVec2::ZERO).all() && px.cmple(size).all();
        inside.then_some(Corner { row, col, px })
    });
    seen.collect()
}

fn view_angle_deg(a: &Pose, b: &Pose) -> f64 {
    let (a, b) = (a.camera_centre().normalize(), b.camera_centre().normalize());
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

fn orbit(n: usize) -> Vec<Pose> {
    (0..n)
        .map(|k| {
            let k = k as f64;
            pose(0.15 + 0.5 * (0.5 + 0.5 * (1.3 * k).sin()), 2.4 * k, 0.3 * k, 290.0 + 12.0 * k)
        })
        .collect()
}

fn estimate(views: &[Vec<Corner>], prior: &CameraPrior) -> CameraEstimate {
    let views: Vec<&[Corner]> = views.iter().map(Vec::as_slice).collect();
    estimate_camera(&Target::default(), &views, prior, None).unwrap()
}

#[test]
fn exact_corners_give_the_exact_camera() {
    let poses = orbit(6);
    let mut noise = Noise(1);
    let views: Vec<_> = poses.iter().map(|p| corners(&truth(), p, 0.0, &mut noise)).collect();
    let found = estimate(&views, &CameraPrior::none(2016, 1512));
    assert!((found.camera.fx - truth().fx).abs() < 1e-4, "{found:?}");
    assert!((found.camera.fy - truth().fy).abs() < 1e-4);
    assert!((found.camera.cx - truth().cx).abs() < 1e-4);
    assert!((found.camera.cy - truth().cy).abs() < 1e-4);
    for (a, b) in found.camera.distortion.iter().zip(truth().distortion) {
        assert!((a - b).abs() < 1e-5);
    }
    for (view, pose) in found.views.iter().zip(&poses) {
        assert!(view_angle_deg(&view.pose.unwrap(), pose) < 1e-5);
    }
}

#[test]
fn the_covariance_predicts_the_error() {
    // The expected squared normalised error of nine numbers is 9; the mean over 30 draws has a
    // standard deviation of sqrt(18 / 30) = 0.8.
    let mut noise = Noise(5);
    let mut sum = 0.0;
    for _ in 0..30 {
        let views: Vec<_> =
            orbit(5).iter().map(|p| corners(&truth(), p, 0.1, &mut noise)).collect();
        let found = estimate(&views, &CameraPrior::none(2016, 1512));
        let (c, t) = (found.camera, truth());
        let (d, e) = (c.distortion, t.distortion);
        let error = SVector::<f64, 9>::from([
            c.fx - t.fx,
            c.fy - t.fy,
            c.cx - t.cx,
            c.cy - t.cy,
            d[0] - e[0],
            d[1] - e[1],
            d[2] - e[2],
            d[3] - e[3],
            d[4] - e[4],
        ]);
        let covariance = SMatrix::<f64, 9, 9>::from_fn(|i, j| found.covariance[i][j]);
        // Radial terms are nearly dependent, so scale before the inversion.
        let scale = found.sigma();
        let scaled =
            SMatrix::<f64, 9, 9>::from_fn(|i, j| covariance[(i, j)] / (scale[i] * scale[j]));
        let error = SVector::<f64, 9>::from_fn(|i, _| error[i] / scale[i]);
        sum += (error.transpose() * scaled.try_inverse().unwrap() * error)[(0, 0)];
    }
    let mean = sum / 30.0;
    assert!((6.6..11.4).contains(&mean), "{mean}");
}

#[test]
fn few_photographs_give_useful_views() {
    // Median and 95th percentile of the error of the view direction over many captures with random
    // phone cameras.
    let mut noise = Noise(11);
    println!("frames  median deg  95 % deg  focal median %  95 %");
    // Bounds: twice the measured values, to reveal a loss of accuracy.
    for (frames, median_max, high_max) in
        [(1, 0.3, 0.9), (3, 0.02, 0.05), (5, 0.02, 0.05), (9, 0.015, 0.04)]
    {
        let (mut errors, mut focals) = (Vec::new(), Vec::new());
        for draw in 0..40 {
            let mut camera = truth();
            camera.fx = 1500.0 * (0.06 * noise.normal()).exp();
            camera.fy = camera.fx * (1.0 + 0.001 * noise.normal());
            camera.cx = 1007.5 + 9.0 * noise.normal();
            camera.cy = 755.5 + 9.0 * noise.normal();
            camera.distortion = [0.06 * noise.normal(), 0.06 * noise.normal(), 0.0, 0.0, 0.0];
            let poses: Vec<Pose> = (0..frames)
                .map(|k| {
                    let k = f64::from(k);
                    pose(
                        0.7 * noise.uniform(),
                        2.4 * k + f64::from(draw),
                        0.3 * k,
                        280.0 + 60.0 * noise.uniform(),
                    )
                })
                .collect();
            let views: Vec<_> =
                poses.iter().map(|p| corners(&camera, p, 0.1, &mut noise)).collect();
            let found = estimate(&views, &CameraPrior::ordinary(2016, 1512));
            for (view, pose) in found.views.iter().zip(&poses) {
                errors.push(view_angle_deg(&view.pose.unwrap(), pose));
            }
            focals.push(100.0 * (found.camera.fx / camera.fx - 1.0).abs());
        }
        let quantile = |list: &mut Vec<f64>, q: f64| {
            list.sort_by(f64::total_cmp);
            list[(q * (list.len() - 1) as f64) as usize]
        };
        let (median, high) = (quantile(&mut errors, 0.5), quantile(&mut errors, 0.95));
        println!(
            "{frames:6}  {median:10.4}  {high:8.4}  {:14.3}  {:.3}",
            quantile(&mut focals, 0.5),
            quantile(&mut focals, 0.95)
        );
        assert!(median < median_max && high < high_max, "{frames}: {median} {high}");
    }
}

#[test]
fn a_view_from_above_keeps_the_prior() {
    let mut noise = Noise(3);
    let views = [corners(&truth(), &pose(0.0, 0.0, 0.0, 300.0), 0.1, &mut noise)];
    let found = estimate(&views, &CameraPrior::ordinary(2016, 1512));
    // The focal length is unobservable: it stays near 0.75 of the long side with a large sigma.
    assert!(found.sigma()[0] > 0.03 * found.camera.fx, "{:?}", found.sigma());
    assert!((found.camera.cx - 1007.5).abs() < 60.0);
    assert!((found.camera.fx / found.camera.fy - 1.0).abs() < 0.01);
    assert!(view_angle_deg(&found.views[0].pose.unwrap(), &pose(0.0, 0.0, 0.0, 300.0)) < 3.0);
    let stated = CameraPrior::ordinary(2016, 1512).with_focal(1460.0, 0.01);
    let found = estimate(&views, &stated);
    assert!((found.camera.fx / 1452.0 - 1.0).abs() < 0.02);
}

#[test]
fn false_corners_and_false_photographs_are_left_out() {
    let mut noise = Noise(9);
    let poses = orbit(6);
    let mut views: Vec<_> = poses.iter().map(|p| corners(&truth(), p, 0.1, &mut noise)).collect();
    for (k, corner) in views[2].iter_mut().enumerate().filter(|(k, _)| k % 10 == 4) {
        corner.px += DVec2::new(3.0 + k as f64 / 20.0, -5.0);
    }
    // Bend the board of one photograph.
    for corner in &mut views[4] {
        let x = corner.px.x / 200.0;
        corner.px += DVec2::new((3.0 * x).sin(), (2.0 * x).cos()) * 12.0;
    }
    let found = estimate(&views, &CameraPrior::ordinary(2016, 1512));
    for (k, inlier) in found.views[2].inliers.iter().enumerate() {
        assert!(k % 10 != 4 || !*inlier, "{k}");
    }
    assert!(found.views[2].inliers.iter().filter(|i| !**i).count() >= views[2].len() / 10);
    let used: Vec<bool> = found.views.iter().map(|v| v.used).collect();
    assert_eq!(used, [true, true, true, true, false, true]);
    assert!((found.camera.fx / truth().fx - 1.0).abs() < 0.002, "{:?}", found.camera);
}

#[test]
fn a_wide_lens_is_found_and_kept_values_stay() {
    let camera = Camera {
        width: 1280,
        height: 960,
        fx: 600.0,
        fy: 600.5,
        cx: 650.0,
        cy: 470.0,
        distortion: [-0.25, 0.07, 0.0003, 0.0002, -0.008],
    };
    let mut noise = Noise(4);
    let poses: Vec<Pose> = orbit(10)
        .iter()
        .enumerate()
        .map(|(k, p)| Pose {
            translation: DVec3::new(40.0 * (k as f64).sin(), 30.0 * (k as f64).cos(), 170.0),
            ..*p
        })
        .collect();
    let views: Vec<_> = poses.iter().map(|p| corners(&camera, p, 0.1, &mut noise)).collect();
    let found = estimate(&views, &CameraPrior::ordinary(1280, 960));
    assert!((found.camera.fx / camera.fx - 1.0).abs() < 0.003, "{:?}", found.camera);
    assert!(found.rms_px < 0.16, "{}", found.rms_px);
    let mut keep = CameraPrior::around(camera);
    (keep.centre_sigma_px, keep.distortion_sigma) = (0.0, [0.0; 5]);
    let kept = estimate(&views, &keep);
    assert_eq!((kept.camera.cx, kept.camera.distortion), (camera.cx, camera.distortion));
    assert_eq!(kept.sigma()[2..], [0.0; 7]);
}

#[test]
fn unusable_corners_are_refused() {
    let mut noise = Noise(2);
    let prior = CameraPrior::ordinary(2016, 1512);
    let target = Target::default();
    let good = corners(&truth(), &pose(0.4, 1.0, 0.0, 300.0), 0.1, &mut noise);
    let few = estimate_camera(&target, &[&good[..8]], &prior, None);
    assert!(matches!(few, Err(Rejection::TooFewCorners { found: 8, .. })));
    assert!(estimate_camera(&target, &[], &prior, None).is_err());
    let mut mixed = good.clone();
    for i in 0..mixed.len() {
        mixed[i].px = good[(i * 37) % good.len()].px;
    }
    let mixed = estimate_camera(&target, &[&mixed], &prior, None);
    assert!(matches!(mixed, Err(Rejection::PoseUncertain { .. })), "{mixed:?}");
    let mut nonsense = good.clone();
    nonsense[3].px.y = f64::NAN;
    assert!(estimate_camera(&target, &[&nonsense], &prior, None).is_err());
    // One bad photograph among good ones is rejected.
    let found = estimate_camera(&target, &[&good, &nonsense, &good[..5]], &prior, None).unwrap();
    assert!(found.views[0].used && !found.views[1].used && !found.views[2].used);
}

/// Views of a sheet: one from above and others up to 45 degrees off, in a walk round it.
fn walk(frames: u32, noise: &mut Noise) -> Vec<Pose> {
    let pose = |k: u32| {
        let (k, tilt) = (f64::from(k), if k == 0 { 0.05 } else { 0.25 + 0.5 * noise.uniform() });
        pose(tilt, 2.4 * k + noise.uniform(), 0.4 * k, 280.0 + 60.0 * noise.uniform())
    };
    (0..frames).map(pose).collect()
}

/// Median and largest error of the view, degrees, for flat and for estimated paper, and the error
/// of the paper in its standard deviations.
fn paper_errors(paper: &Paper, frames: u32, known: bool, draws: u32) -> ([[f64; 2]; 2], f64) {
    let target = Target::default();
    let mut noise = Noise(17 + u64::from(frames));
    let (mut errors, mut worst) = ([Vec::new(), Vec::new()], 0.0f64);
    for _ in 0..draws {
        let poses = walk(frames, &mut noise);
        let seen: Vec<_> =
            poses.iter().map(|p| corners_on(paper, &truth(), p, 0.1, &mut noise)).collect();
        let on = |paper: &Paper, camera: &Camera| -> Vec<Pose> {
            let pose = |c: &Vec<Corner>| {
                super::super::pose::estimate_pose_on_paper(camera, &target, paper, c).unwrap().pose
            };
            seen.iter().map(pose).collect()
        };
        let slices: Vec<&[Corner]> = seen.iter().map(Vec::as_slice).collect();
        let prior = CameraPrior::ordinary(2016, 1512);
        let (plain, camera, found) = if known {
            let views: Vec<_> =
                slices.iter().copied().zip(on(&Paper::default(), &truth())).collect();
            (truth(), truth(), estimate_paper(&truth(), &target, &views))
        } else {
            let plain = estimate_camera(&target, &slices, &prior, None).unwrap();
            let both = estimate_camera_and_paper(&target, &slices, &prior, None).unwrap();
            (plain.camera, both.camera, both.paper)
        };
        for (list, found) in
            errors.iter_mut().zip([on(&Paper::default(), &plain), on(&found.paper, &camera)])
        {
            list.extend(found.iter().zip(&poses).map(|(f, p)| view_angle_deg(f, p)));
        }
        let [x, y] = [0, 1].map(|i| found.paper.bow_mm[i] - paper.bow_mm[i]);
        for (error, sigma) in [found.paper.aspect - paper.aspect, x, y].into_iter().zip(found.sigma)
        {
            worst = worst.max(error.abs() / sigma);
        }
    }
    let summary = errors.map(|mut list| {
        list.sort_by(f64::total_cmp);
        [list[list.len() / 2], list[list.len() - 1]]
    });
    (summary, worst)
}

#[test]
fn a_stretched_and_bent_sheet_is_found() {
    let sheets = [
        ("aspect 0.5 %", Paper { aspect: 1.005, ..Paper::default() }),
        ("bow 1 mm", Paper { bow_mm: [1.0, 0.0], ..Paper::default() }),
        ("both", Paper { aspect: 0.995, bow_mm: [0.0, -1.0] }),
    ];
    println!("paper         camera   photos  flat median max  estimated median max  worst sigmas");
    for (name, paper) in sheets {
        for (known, frames) in [(true, 2), (true, 4), (false, 3), (false, 6)] {
            let ([flat, bent], worst) = paper_errors(&paper, frames, known, 8);
            println!(
                "{name:12}  {}  {frames:6}  {:.4} {:.4}  {:.4} {:.4}  {worst:.1}",
                if known { "given  " } else { "unknown" },
                flat[0],
                flat[1],
                bent[0],
                bent[1]
            );
            // With an unknown camera, three photographs do not always separate paper from lens.
            let most = if known { 0.3 } else { 0.8 };
            assert!(bent[0] < 0.3 * flat[0] && bent[1] < most * flat[1], "{name} {known} {frames}");
            // The true deviations are smaller than the priors; twelve numbers of a normal distribution.
            assert!(worst < 4.5, "{name} {known} {frames}: {worst}");
        }
    }
}

#[test]
fn a_flat_sheet_stays_flat() {
    for known in [true, false] {
        for frames in [2, 5] {
            let ([flat, bent], _) = paper_errors(&Paper::default(), frames, known, 10);
            // Same sheet, so the results differ only by the last refinement.
            assert!((flat[1] - bent[1]).abs() < 1e-6, "{known} {frames}: {flat:?} {bent:?}");
        }
    }
    // One photograph does not determine the paper.
    let bent = Paper { aspect: 1.005, bow_mm: [2.0, 0.0] };
    let pose = pose(0.5, 1.0, 0.0, 300.0);
    let seen = corners_on(&bent, &truth(), &pose, 0.1, &mut Noise(1));
    let found = estimate_paper(&truth(), &Target::default(), &[(&seen, pose)]);
    assert_eq!(found, PaperEstimate::default());
}
