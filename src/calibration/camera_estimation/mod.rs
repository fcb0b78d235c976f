//! Intrinsics and lens distortion from the corners of a planar board.
//!
//! # Method
//! A focal length from the homographies (Zhang 2000, with square pixels and the principal point in
//! the middle) and a few plausible ones start a joint Levenberg-Marquardt refinement of intrinsics
//! and all poses; the best minimum counts. Corners that do not fit the rest are left out, then
//! photographs. For each photograph both poses that nearly explain a plane's picture are tried with
//! the refined camera.
//!
//! # What photographs can and cannot tell
//! * One photograph from above tells neither the focal length apart from the distance nor the
//!   principal point from a slight tilt: both stay at what [`CameraPrior`] expects.
//! * One tilted photograph tells the focal length; distortion as far as corners reach.
//! * Three photographs and more from different sides tell all that maps need.
//!
//! # Paper
//! Two photographs and more tell how the print differs from its plan, too ([`Paper`]): one stretch
//! and two bows join the refinement. They stay at 0 unless that explains the corners clearly worse.

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

/// Noise of corners assumed before residuals tell, px.
const NOISE_PX: f64 = 0.15;
/// RMS above which there is no camera that explains the corners: px, or part of the long side.
const RMS_MAX_PX: f64 = 2.0;
const RMS_MAX_SIDE: f64 = 1e-3;

/// An estimated camera and how well it is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraEstimate {
    /// The camera.
    pub camera: Camera,
    /// Covariance of fx, fy, cx, cy (px), k1, k2, p1, p2, k3, from the residuals' variance and the
    /// prior; zero for values that were kept.
    pub covariance: [[f64; 9]; 9],
    /// The printed sheet; as planned where it was not estimated.
    pub paper: PaperEstimate,
    /// Root mean square distance of the corners that took part from their projections, px.
    pub rms_px: f64,
    /// One for each photograph given, in their order; none in a saved session.
    #[serde(skip)]
    pub views: Vec<ViewEstimate>,
}

/// One photograph of a camera's estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewEstimate {
    /// Board to camera; `None` where no pose was found.
    pub pose: Option<Pose>,
    /// Whether the photograph took part.
    pub used: bool,
    /// Root mean square distance of its inlying corners, px; not finite without a pose.
    pub rms_px: f64,
    /// For each corner, whether it fits.
    pub inliers: Vec<bool>,
}

impl CameraEstimate {
    /// Whether photographs may have told such values.
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

/// Estimates the camera from one or several photographs of the target, all of the prior's size.
/// `start` is where an earlier estimate ended.
///
/// # Errors
/// [`Rejection::TooFewCorners`] when no photograph has 12 corners that span a plane,
/// [`Rejection::PoseUncertain`] when no camera explains the corners.
pub fn estimate_camera(
    target: &Target,
    views: &[&[Corner]],
    prior: &CameraPrior,
    start: Option<&Camera>,
) -> Result<CameraEstimate, Rejection> {
    estimate(target, views, prior, start, false)
}

/// As [`estimate_camera`], with the printed sheet where two photographs and more tell it.
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

/// The minimum next to a starting camera and its robust cost, for comparing starts.
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
        // Left out of the estimate, yet seen by the camera it gave.
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
