//! Intrinsics and lens distortion from the corners of a planar board.
//!
//! # Method
//! A joint Levenberg-Marquardt refinement of intrinsics and all poses starts from the focal length of the
//! homographies (Zhang 2000, with square pixels and a central principal point) and from a few plausible ones.
//! The best minimum is kept. Outlying corners are excluded, then outlying photographs. The refined camera
//! tries both poses that a plane's picture allows for each photograph.
//!
//! # Observability
//! * One photograph from above separates neither focal length from distance nor principal point
//!   from tilt: they keep the values of [`CameraPrior`].
//! * One tilted photograph determines the focal length, and the distortion where it has corners.
//! * Three or more photographs from different sides determine everything that the maps need.
//!
//! # Paper
//! Two or more photographs also determine deviations of the print from its plan ([`Paper`]): one
//! stretch and two bows. They stay 0 unless a flat sheet explains the corners clearly worse.

mod bending;
mod joint;
mod prior;
mod robust;
mod start;

use super::detector::Corner;
use super::paper::{Paper, PaperEstimate, Sheet};
use super::target::Target;
use crate::Rejection;
use crate::geometry::{Camera, Pose};
use crate::statistics::median;
pub use bending::estimate_paper;
use joint::{Problem, State, View};
pub use prior::CameraPrior;
use robust::{
    CORNERS_MIN, ROUNDS, TRIM_MIN_PX, TRIM_SIGMA, best_pose, freedom, noise, totals, trim,
    turn_poses, view,
};
use serde::{Deserialize, Serialize};

/// Corner noise assumed before residuals are known, px.
const NOISE_PX: f64 = 0.15;
/// Largest RMS of an accepted camera: px, or a part of the long side.
const RMS_MAX_PX: f64 = 2.0;
const RMS_MAX_SIDE: f64 = 1e-3;

/// An estimated camera and its uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraEstimate {
    /// The camera.
    pub camera: Camera,
    /// Covariance of fx, fy, cx, cy (px), k1, k2, p1, p2, k3 from the residual variance and the
    /// prior; zero for fixed values.
    pub covariance: [[f64; 9]; 9],
    /// The printed sheet; as planned if not estimated.
    pub paper: PaperEstimate,
    /// RMS reprojection error of the inliers, px.
    pub rms_px: f64,
    /// One entry per photograph, in the order given; empty in a saved session.
    #[serde(skip)]
    pub views: Vec<ViewEstimate>,
}

/// Result for one photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewEstimate {
    /// Board to camera; `None` if no pose was found.
    pub pose: Option<Pose>,
    /// Whether the photograph was used.
    pub used: bool,
    /// RMS reprojection error of its inliers, px; not finite without a pose.
    pub rms_px: f64,
    /// For each corner, whether it is an inlier.
    pub inliers: Vec<bool>,
}

impl CameraEstimate {
    /// Whether the values are possible (for saved data).
    pub(crate) fn is_plausible(&self) -> bool {
        let mut numbers = self.covariance.as_flattened().iter().chain([&self.rms_px]);
        let finite = numbers.all(|v| v.is_finite());
        finite && self.camera.fault().is_none() && self.paper.is_plausible()
    }

    /// Standard deviations of fx, fy, cx, cy, k1, k2, p1, p2, k3.
    pub fn sigma(&self) -> [f64; 9] {
        std::array::from_fn(|i| self.covariance[i][i].max(0.0).sqrt())
    }
}

/// Estimates the camera from photographs of the target, all of the prior's size. `start` is an
/// earlier estimate.
///
/// # Errors
/// [`Rejection::TooFewCorners`] if no photograph has 12 corners that span a plane,
/// [`Rejection::PoseUncertain`] if no camera explains the corners.
pub fn estimate_camera(
    target: &Target,
    views: &[&[Corner]],
    prior: &CameraPrior,
    start: Option<&Camera>,
) -> Result<CameraEstimate, Rejection> {
    estimate(target, views, prior, start, false)
}

/// As [`estimate_camera`], and estimates the printed sheet from two or more photographs.
///
/// # Errors
/// As [`estimate_camera`].
pub fn estimate_camera_and_paper(
    target: &Target,
    views: &[&[Corner]],
    prior: &CameraPrior,
    start: Option<&Camera>,
) -> Result<CameraEstimate, Rejection> {
    estimate(target, views, prior, start, true)
}

fn estimate(
    target: &Target,
    views: &[&[Corner]],
    prior: &CameraPrior,
    start: Option<&Camera>,
    with_paper: bool,
) -> Result<CameraEstimate, Rejection> {
    let uncertain = |rms: f64| Rejection::PoseUncertain { rms_px: rms as f32 };
    if !prior.is_valid() {
        return Err(uncertain(f64::INFINITY));
    }
    let mut given: Vec<View> = views.iter().map(|corners| view(target, corners)).collect();
    if !given.iter().any(|v| v.used) {
        return Err(Rejection::TooFewCorners {
            found: views.iter().map(|v| v.len()).max().unwrap_or(0) as u32,
            expected: target.corners().len() as u32,
            needed: CORNERS_MIN as u32,
        });
    }
    let starts = start::cameras(&given, prior, start);
    let flat = Sheet::new(target, Paper::default());
    let free = freedom(prior.free(), false);
    let best = starts
        .iter()
        .filter_map(|camera| first_minimum(&given, prior, flat, camera))
        .min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((mut state, _)) = best else { return Err(uncertain(f64::INFINITY)) };
    let mut noise_px = NOISE_PX;
    for _ in 0..ROUNDS {
        let mut changed = trim(&mut given, &state);
        noise_px = noise(&given, &state);
        state = Problem { prior, views: &given, noise_px, free }.minimise(state);
        changed |= turn_poses(&given, &mut state);
        if !changed {
            break;
        }
    }
    let mut state = Problem { prior, views: &given, noise_px, free }.minimise(state);
    let mut paper = PaperEstimate::default();
    let mut free = free;
    if with_paper && let Some(bent) = bending::bend(&given, &state, prior, prior.free()) {
        paper = bent.estimate;
        if bent.is_clear {
            (given, state) = (bent.views, bent.state);
            free = freedom(prior.free(), true);
        }
    }
    noise_px = noise(&given, &state);
    let rms = rms(&given, &state);
    let long = f64::from(prior.camera.width.max(prior.camera.height));
    if rms.is_nan() || rms > RMS_MAX_PX.max(RMS_MAX_SIDE * long) {
        return Err(uncertain(rms));
    }
    let covariance = Problem { prior, views: &given, noise_px, free }
        .covariance(&state)
        .ok_or_else(|| uncertain(rms))?;
    let covariance = std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)]));
    let views = given.into_iter().zip(state.poses);
    let views =
        views.map(|(view, pose)| finished(view, pose, &state.camera, &state.sheet)).collect();
    Ok(CameraEstimate { camera: state.camera, covariance, paper, rms_px: rms, views })
}

/// The minimum near a starting camera, with its robust cost for the comparison of starts.
fn first_minimum(
    views: &[View],
    prior: &CameraPrior,
    sheet: Sheet,
    camera: &Camera,
) -> Option<(State, f64)> {
    let mut poses = Vec::with_capacity(views.len());
    let mut views = views.to_vec();
    for view in &mut views {
        let pose = if view.used { best_pose(view, camera, &sheet) } else { None };
        view.used = pose.is_some();
        poses.push(
            pose.unwrap_or(Pose { rotation: glam::DMat3::IDENTITY, translation: glam::DVec3::Z }),
        );
    }
    if !views.iter().any(|v| v.used) {
        return None;
    }
    let free = freedom(prior.free(), false);
    let problem = Problem { prior, views: &views, noise_px: NOISE_PX, free };
    let state = problem.minimise(State { camera: *camera, sheet, poses });
    let limit = 10.0 * NOISE_PX;
    let corners: f64 = views
        .iter()
        .zip(&state.poses)
        .filter(|(view, _)| view.used)
        .flat_map(|(view, pose)| view.residuals(&state.camera, &sheet, pose))
        .map(|r| (r.min(limit) / NOISE_PX).powi(2))
        .sum();
    let prior: f64 = prior.terms(&state.camera).map(|(d, _)| d * d).sum();
    let cost = corners + prior;
    cost.is_finite().then_some((state, cost))
}

fn rms(views: &[View], state: &State) -> f64 {
    let (count, sum) = totals(views, state);
    (sum / count as f64).sqrt()
}

fn finished(mut view: View, pose: Pose, camera: &Camera, sheet: &Sheet) -> ViewEstimate {
    let mut pose = Some(pose);
    if !view.used {
        // Excluded from the estimate; its pose follows from the estimated camera.
        pose = best_pose(&view, camera, sheet);
        let residuals = pose.map(|p| view.residuals(camera, sheet, &p)).unwrap_or_default();
        let middle = median(residuals.iter().copied()).unwrap_or(0.0);
        let limit = (TRIM_SIGMA * middle / 1.177).max(TRIM_MIN_PX);
        view.inliers = view
            .px
            .iter()
            .enumerate()
            .map(|(i, _)| residuals.get(i).is_some_and(|r| *r <= limit))
            .collect();
    }
    let rms = |p: Pose| (view.cost(camera, sheet, &p) / view.inlier_count() as f64).sqrt();
    let rms_px = pose.map_or(f64::INFINITY, rms);
    ViewEstimate { pose, used: view.used, rms_px, inliers: view.inliers }
}

#[cfg(test)]
mod tests;
