//! Pose of the board in the frame of a known camera.
//!
//! A plane in perspective has two poses that nearly explain it, mirror images about the line of sight
//! (Collins and Bartoli 2014). Both are refined, and a photograph that does not separate them is rejected.

mod minima;

use super::detector::Corner;
use super::paper::{Paper, Sheet};
use super::target::{Target, TargetKind};
use crate::Rejection;
use crate::geometry::{Camera, Pose};
use glam::{DVec2, DVec3};
use minima::Problem;
pub(super) use minima::{Fit, pose_minima};

/// Largest angle between the board's normal and the direction to the camera, degrees. At 70 degrees
/// texels are foreshortened to a third, and Fresnel reflection starts to hide the material.
pub const VIEW_ANGLE_MAX_DEG: f64 = 70.0;
/// Fewest inliers.
const INLIERS_MIN: usize = 20;
/// The same if markers identified the corners.
const INLIERS_MIN_MARKED: usize = 6;
/// Least share of inliers among the given corners, and among the corners inside the picture.
const LABELLED_SHARE_MIN: f64 = 0.7;
const VISIBLE_SHARE_MIN: f64 = 0.5;
const VISIBLE_SHARE_MIN_MARKED: f64 = 0.35;
/// Largest RMS of the inliers: px, or a part of a square for prints that are not quite flat.
const RMS_MAX_PX: f64 = 0.5;
const RMS_MAX_CELLS: f64 = 0.03;
/// Least excess of the second pose: difference of squared residuals over noise variance.
const SECOND_POSE_CHI2_MIN: f64 = 16.0;

/// A pose and its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// Board to camera.
    pub pose: Pose,
    /// RMS reprojection error of the inliers, px.
    pub rms_px: f64,
    /// For each given corner, whether it is an inlier.
    pub inliers: Vec<bool>,
    /// Covariance of a small rotation in camera axes (rotation vector, radians) and of the
    /// translation (mm), from the residual variance.
    pub covariance: [[f64; 6]; 6],
}

/// Estimates the pose from labelled corners.
///
/// # Errors
/// [`Rejection::TooFewCorners`] for fewer than 20 corners (6 with markers), or if less than half of
/// the corners in view fit; [`Rejection::PoseUncertain`] if the corners do not fit one flat board
/// or fit two poses equally; [`Rejection::TooGrazing`] beyond [`VIEW_ANGLE_MAX_DEG`].
pub fn estimate_pose(
    camera: &Camera,
    target: &Target,
    corners: &[Corner],
) -> Result<PoseEstimate, Rejection> {
    estimate_pose_on_paper(camera, target, &Paper::default(), corners)
}

/// As [`estimate_pose`], on an estimated sheet.
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
        // Within about a hundredth of a radian they are one minimum.
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

/// The best pose and its RMS, px, reliable or not; `None` if no pose faces the camera.
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

/// Number of the target's corners inside the picture.
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

#[cfg(test)]
mod tests;
