//! Pose of the board in the frame of a known camera.
//!
//! A plane seen in perspective has two poses that nearly explain it, mirror images about the line
//! of sight (Collins and Bartoli 2014). Both are refined; when the picture cannot tell them apart
//! the photograph is refused rather than guessed.

use super::detector::Corner;
use super::paper::{Paper, Sheet};
use super::projection::{Projection, moved};
use super::target::{Target, TargetKind};
use crate::Rejection;
use crate::geometry::{Camera, Homography, Pose};
use crate::least_squares::{LeastSquares, Options, damped_step, minimise};
use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

/// Largest angle between the board's normal and the direction to the camera, degrees. At 70
/// degrees a texel is foreshortened to a third and Fresnel reflection starts to hide the material.
pub const VIEW_ANGLE_MAX_DEG: f64 = 70.0;
/// Corners that must fit.
const INLIERS_MIN: usize = 20;
/// The same where markers have named the corners.
const INLIERS_MIN_MARKED: usize = 6;
/// Share of the corners given, and of those that the pose puts inside the picture, that must fit.
const LABELLED_SHARE_MIN: f64 = 0.7;
const VISIBLE_SHARE_MIN: f64 = 0.5;
const VISIBLE_SHARE_MIN_MARKED: f64 = 0.35;
/// RMS of the corners that fit: px, or this part of a square for prints that are not quite flat.
const RMS_MAX_PX: f64 = 0.5;
const RMS_MAX_CELLS: f64 = 0.03;
/// Corners within this many standard deviations of noise fit, but never fewer than those within
/// this distance.
const TRIM_SIGMA: f64 = 3.5;
const TRIM_MIN_PX: f64 = 0.15;
/// The second pose must be this much worse: difference of squared residuals over noise variance.
const SECOND_POSE_CHI2_MIN: f64 = 16.0;

/// How a pose is refined.
const REFINEMENT: Options = Options {
    max_steps: 50,
    max_trials: 10,
    damping: 1e-4,
    min_damping: 1e-12,
    min_gain: 1e-12,
    descent: true,
};

/// A pose and how well it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// Board to camera.
    pub pose: Pose,
    /// Root mean square distance of inlying corners from their projections, px.
    pub rms_px: f64,
    /// For each corner given, whether it took part.
    pub inliers: Vec<bool>,
    /// Covariance of a small turn in camera axes (rotation vector, radians) and of the translation
    /// (mm), from the residuals' variance.
    pub covariance: [[f64; 6]; 6],
}

/// Estimates the pose from labelled corners.
///
/// # Errors
/// [`Rejection::TooFewCorners`] for fewer than 20 corners (6 of a board with markers), or when less
/// than half of those that should be in view fit; [`Rejection::PoseUncertain`] when the corners do not fit one flat board,
/// or two poses fit alike; [`Rejection::TooGrazing`] beyond [`VIEW_ANGLE_MAX_DEG`].
pub fn estimate_pose(
    camera: &Camera,
    target: &Target,
    corners: &[Corner],
) -> Result<PoseEstimate, Rejection> {
    estimate_pose_on_paper(camera, target, &Paper::default(), corners)
}

/// As [`estimate_pose`], where the printed sheet differs from its plan.
///
/// # Errors
/// As [`estimate_pose`].
pub fn estimate_pose_on_paper(
    camera: &Camera,
    target: &Target,
    paper: &Paper,
    corners: &[Corner],
) -> Result<PoseEstimate, Rejection> {
    let expected = target.corners().len() as u32;
    let too_few = |found: usize, needed: usize| Rejection::TooFewCorners {
        found: found as u32,
        expected,
        needed: needed as u32,
    };
    let (inliers_min, share_min) = match target.kind {
        TargetKind::CheckerboardRing => (INLIERS_MIN, VISIBLE_SHARE_MIN),
        TargetKind::CharucoRing { .. } => (INLIERS_MIN_MARKED, VISIBLE_SHARE_MIN_MARKED),
    };
    if corners.len() < inliers_min {
        return Err(too_few(corners.len(), inliers_min));
    }
    let (board, px) = positions(target, paper, corners);
    let finite = |p: &DVec2| p.is_finite() && camera.undistort(*p).is_finite();
    let unknown = Rejection::PoseUncertain { rms_px: f32::INFINITY };
    if camera.fault().is_some() || !paper.is_plausible() || !px.iter().all(finite) {
        return Err(unknown);
    }
    let problem = Problem { camera, board: &board, px: &px };
    let minima = pose_minima(camera, &board, &px);
    let best = minima.first().ok_or(unknown)?;
    let count = best.inliers.iter().filter(|i| **i).count();
    let rms = best.rms();
    let uncertain = Rejection::PoseUncertain { rms_px: rms as f32 };
    let cell = typical_cell(camera, target, &best.pose);
    if !rms.is_finite()
        || rms > RMS_MAX_PX.max(RMS_MAX_CELLS * cell)
        || (count as f64) < LABELLED_SHARE_MIN * corners.len() as f64
        || best.pose.camera_centre().z <= 0.0
    {
        return Err(uncertain);
    }
    if count < inliers_min {
        return Err(too_few(count, inliers_min));
    }
    let visible = visible_corners(camera, target, &best.pose);
    let needed = (share_min * visible as f64).ceil() as usize;
    if count < needed {
        return Err(too_few(count, needed));
    }
    let degrees = best.pose.view_angle().to_degrees();
    if degrees > VIEW_ANGLE_MAX_DEG {
        return Err(Rejection::TooGrazing {
            degrees: degrees as f32,
            limit: VIEW_ANGLE_MAX_DEG as f32,
        });
    }
    let variance = (best.cost / (2 * count - 6) as f64).max(1e-12);
    for other in &minima[1..] {
        let turn = (other.pose.rotation * best.pose.rotation.transpose()).col(0).distance(DVec3::X)
            + (other.pose.rotation.z_axis - best.pose.rotation.z_axis).length();
        let other_cost = problem.cost(&other.pose, &best.inliers);
        // A hundredth of a radian or so apart they are the same minimum.
        if turn > 0.02 && other_cost - best.cost < SECOND_POSE_CHI2_MIN * variance.max(0.05 * 0.05)
        {
            return Err(uncertain);
        }
    }
    let (normal, _) = problem.normal_equations(&best.pose, &best.inliers);
    let inverse = normal.try_inverse().ok_or(uncertain)?;
    let covariance = std::array::from_fn(|i| std::array::from_fn(|j| variance * inverse[(i, j)]));
    Ok(PoseEstimate { pose: best.pose, rms_px: rms, inliers: best.inliers.clone(), covariance })
}

/// The pose that explains corners best and what it leaves, px, whether it can be relied on or not;
/// `None` where none faces the camera.
pub(crate) fn likeliest_pose(
    camera: &Camera,
    target: &Target,
    paper: &Paper,
    corners: &[Corner],
) -> Option<(Pose, f64)> {
    let (board, px) = positions(target, paper, corners);
    let finite = |p: &DVec2| p.is_finite() && camera.undistort(*p).is_finite();
    if corners.len() < 4 || camera.fault().is_some() || !px.iter().all(finite) {
        return None;
    }
    let minima = pose_minima(camera, &board, &px);
    let best = minima.first()?;
    let rms = best.rms();
    (rms.is_finite() && best.pose.camera_centre().z > 0.0).then_some((best.pose, rms))
}

/// Positions of corners on the board, mm, and in the picture, px.
fn positions(target: &Target, paper: &Paper, corners: &[Corner]) -> (Vec<DVec3>, Vec<DVec2>) {
    let sheet = Sheet::new(target, *paper);
    let at = |c: &Corner| (sheet.at(target.grid_mm(c.row.into(), c.col.into())), c.px);
    corners.iter().map(at).unzip()
}

/// Corners of the target that the pose puts inside the picture.
fn visible_corners(camera: &Camera, target: &Target, pose: &Pose) -> usize {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height)) - 1.0;
    let visible = target.corners().into_iter().filter(|&(row, col)| {
        let p = target.grid_mm(row.into(), col.into()).extend(0.0);
        camera
            .project(pose.transform(p))
            .is_some_and(|q| q.cmpge(DVec2::ZERO).all() && q.cmple(size).all())
    });
    visible.count()
}

/// Side of a square facing the camera at the board's distance, px.
fn typical_cell(camera: &Camera, target: &Target, pose: &Pose) -> f64 {
    0.5 * (camera.fx + camera.fy) * target.square_mm / pose.translation.length().max(1e-9)
}

struct Problem<'a> {
    camera: &'a Camera,
    board: &'a [DVec3],
    px: &'a [DVec2],
}

/// A minimum of the reprojection error.
pub(super) struct Fit {
    pub(super) pose: Pose,
    inliers: Vec<bool>,
    /// Sum of squared residuals of the inliers, px².
    cost: f64,
    /// Median residual of all corners, px.
    median: f64,
}

/// The (at most two) poses that nearly explain corners at board positions (mm), refined, the
/// better first.
pub(super) fn pose_minima(camera: &Camera, board: &[DVec3], px: &[DVec2]) -> Vec<Fit> {
    let problem = Problem { camera, board, px };
    let mut minima: Vec<Fit> = problem.start_poses().into_iter().map(|p| problem.fit(p)).collect();
    minima.retain(|fit| fit.median.is_finite());
    minima.sort_by(|a, b| a.median.total_cmp(&b.median));
    minima
}

impl Fit {
    fn rms(&self) -> f64 {
        let count = self.inliers.iter().filter(|i| **i).count();
        (self.cost / count as f64).sqrt()
    }
}

impl Problem<'_> {
    /// A pose from the homography, and its mirror image about the line of sight.
    fn start_poses(&self) -> Vec<Pose> {
        let rays: Vec<DVec2> = self.px.iter().map(|p| self.camera.undistort(*p)).collect();
        // A bent sheet is nearly a plane.
        let plane: Vec<DVec2> = self.board.iter().map(|b| b.truncate()).collect();
        let Some(homography) = robust_homography(&plane, &rays) else { return Vec::new() };
        let h = homography.0;
        let scale = 2.0 / (h.x_axis.length() + h.y_axis.length());
        let scale = if h.z_axis.z < 0.0 { -scale } else { scale };
        let (a, b, translation) = (h.x_axis * scale, h.y_axis * scale, h.z_axis * scale);
        // The nearest rotation turns the two axes apart symmetrically until they are square.
        let (sum, difference) = ((a + b).normalize(), (a - b).normalize());
        let difference = (difference - sum * sum.dot(difference)).normalize();
        let (x, y) = (
            (sum + difference) * std::f64::consts::FRAC_1_SQRT_2,
            (sum - difference) * std::f64::consts::FRAC_1_SQRT_2,
        );
        let first = Pose { rotation: DMat3::from_cols(x, y, x.cross(y)), translation };
        let middle = plane.iter().sum::<DVec2>() / plane.len() as f64;
        let centre = first.transform(middle.extend(0.0));
        let sight = centre.normalize();
        let normal = first.rotation.z_axis;
        let mirrored = 2.0 * sight * sight.dot(normal) - normal;
        // Both normals face the camera.
        let turn = DMat3::from_quat(DQuat::from_rotation_arc(normal, mirrored));
        let rotation = turn * first.rotation;
        let second = Pose { rotation, translation: centre - rotation * middle.extend(0.0) };
        [first, second]
            .into_iter()
            .filter(|p| p.rotation.is_finite() && p.translation.is_finite())
            .collect()
    }

    /// Levenberg-Marquardt, with corners that do not fit left out once the rest does.
    fn fit(&self, start: Pose) -> Fit {
        let mut inliers = vec![true; self.px.len()];
        let mut pose = start;
        let mut median = f64::INFINITY;
        for _ in 0..6 {
            pose = self.refine(pose, &inliers).0;
            let residuals = self.residuals(&pose);
            let mut sorted = residuals.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            median = sorted[sorted.len() / 2];
            // The median length of a two-dimensional normal vector is 1.177 sigma.
            let limit = (TRIM_SIGMA * median / 1.177).max(TRIM_MIN_PX);
            let next: Vec<bool> = residuals.iter().map(|r| *r <= limit).collect();
            if next == inliers {
                break;
            }
            inliers = next;
        }
        let (pose, cost) = self.refine(pose, &inliers);
        Fit { pose, inliers, cost, median }
    }

    /// The minimum next to a pose, and its cost.
    fn refine(&self, pose: Pose, inliers: &[bool]) -> (Pose, f64) {
        let (pose, summary) = minimise(&Trimmed { problem: self, inliers }, pose, &REFINEMENT);
        (pose, summary.cost)
    }

    fn residuals(&self, pose: &Pose) -> Vec<f64> {
        let residual = |(b, p): (&DVec3, &DVec2)| {
            let projected = self.camera.project(pose.transform(*b));
            projected.map_or(f64::INFINITY, |q| q.distance(*p))
        };
        self.board.iter().zip(self.px).map(residual).collect()
    }

    fn cost(&self, pose: &Pose, inliers: &[bool]) -> f64 {
        let used = self.residuals(pose).into_iter().zip(inliers).filter(|(_, i)| **i);
        used.map(|(r, _)| r * r).sum()
    }

    fn normal_equations(
        &self,
        pose: &Pose,
        inliers: &[bool],
    ) -> (SMatrix<f64, 6, 6>, SVector<f64, 6>) {
        let mut normal = SMatrix::zeros();
        let mut gradient = SVector::zeros();
        for ((b, p), _) in self.board.iter().zip(self.px).zip(inliers).filter(|(_, i)| **i) {
            let Some(projection) = Projection::of(self.camera, pose, *b) else { continue };
            let error = projection.px - *p;
            for (row, e) in projection.by_pose.iter().zip([error.x, error.y]) {
                let row = SVector::<f64, 6>::from(*row);
                normal += row * row.transpose();
                gradient += row * e;
            }
        }
        (normal, gradient)
    }
}

/// The problem on the corners that take part.
struct Trimmed<'a> {
    problem: &'a Problem<'a>,
    inliers: &'a [bool],
}

impl LeastSquares for Trimmed<'_> {
    type State = Pose;
    type Equations = (SMatrix<f64, 6, 6>, SVector<f64, 6>);

    fn cost(&self, pose: &Pose) -> f64 {
        self.problem.cost(pose, self.inliers)
    }

    fn linearise(&self, pose: &Pose) -> Self::Equations {
        self.problem.normal_equations(pose, self.inliers)
    }

    fn step(
        &self,
        pose: &Pose,
        (normal, gradient): &Self::Equations,
        damping: f64,
    ) -> Option<Pose> {
        Some(moved(pose, &damped_step(normal, gradient, damping)?.into()))
    }
}

/// Homography by repeated fits to the three quarters of the points that fit best.
fn robust_homography(board: &[DVec2], rays: &[DVec2]) -> Option<Homography> {
    let mut homography = Homography::fit(board, rays)?;
    for _ in 0..4 {
        let mut order: Vec<(f64, usize)> = (0..board.len())
            .map(|i| (homography.apply(board[i]).distance(rays[i]), i))
            .filter(|r| r.0.is_finite())
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order.truncate((3 * board.len()).div_ceil(4));
        let kept = |all: &[DVec2]| order.iter().map(|&(_, i)| all[i]).collect::<Vec<_>>();
        homography = Homography::fit(&kept(board), &kept(rays)).unwrap_or(homography);
    }
    Some(homography)
}

#[cfg(test)]
mod tests {
    use super::*;

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

    fn pose(tilt: f64, azimuth: f64, roll: f64, distance: f64) -> Pose {
        let facing = DMat3::from_rotation_x(std::f64::consts::PI);
        let axis = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
        Pose {
            rotation: DMat3::from_axis_angle(axis, tilt) * DMat3::from_rotation_z(roll) * facing,
            translation: DVec3::new(6.0, -4.0, distance),
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
        // Mean squared normalised error over poses: 6 in expectation, its mean over 60 draws has a
        // standard deviation of 0.45.
        let mut sum = 0.0;
        for k in 0..60 {
            let k = f64::from(k);
            let truth = pose(0.2 + 0.012 * k, 0.7 * k, 0.3 * k, 300.0);
            let found =
                estimate_pose(&camera(), &Target::default(), &corners(&truth, 0.1)).unwrap();
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
        // On one line there is no plane.
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
}
