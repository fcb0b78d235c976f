//! Robust parts of the joint refinement: rejection of corners and photographs, the choice between
//! mirrored poses, and the noise estimate.

use super::super::detector::Corner;
use super::super::paper::Sheet;
use super::super::pose::{Fit, pose_minima};
use super::super::target::Target;
use super::joint::{SHARED, State, View};
use super::prior::INTRINSICS;
use crate::geometry::{Camera, Homography, Pose};
use crate::statistics::median;
use glam::{DVec2, DVec3};

/// Fewest corners of a usable photograph.
pub(super) const CORNERS_MIN: usize = 12;
/// Lower limit of the noise; the best corners reach a few hundredths.
const NOISE_MIN_PX: f64 = 0.03;
/// Corners within this many standard deviations, or within this distance, are inliers.
pub(super) const TRIM_SIGMA: f64 = 4.0;
pub(super) const TRIM_MIN_PX: f64 = 0.2;
/// A photograph is rejected if its corners fit this many times worse than those of the median
/// photograph, and worse than this.
const VIEW_TIMES: f64 = 4.0;
const VIEW_MIN_PX: f64 = 1.0;
/// Least share of inliers of a photograph.
const VIEW_SHARE_MIN: f64 = 0.6;
/// Most rounds of refinement and rejection.
pub(super) const ROUNDS: usize = 8;

pub(super) fn freedom(camera: [bool; INTRINSICS], paper: bool) -> [bool; SHARED] {
    let mut free = [paper; SHARED];
    free[..INTRINSICS].copy_from_slice(&camera);
    free
}

/// Corners of a photograph with their planned positions.
pub(super) fn view(target: &Target, corners: &[Corner]) -> View {
    let board: Vec<DVec2> =
        corners.iter().map(|c| target.grid_mm(c.row.into(), c.col.into())).collect();
    let px: Vec<DVec2> = corners.iter().map(|c| c.px).collect();
    let used = px.len() >= CORNERS_MIN
        && px.iter().all(|p| p.is_finite())
        && Homography::fit(&board, &px).is_some();
    let inliers = vec![true; px.len()];
    View { board, px, inliers, used }
}

/// Both poses that nearly explain a photograph, the better one first.
fn minima(view: &View, camera: &Camera, sheet: &Sheet) -> Vec<Fit> {
    let placed: Vec<DVec3> = view.board.iter().map(|b| sheet.at(*b)).collect();
    pose_minima(camera, &placed, &view.px)
}

/// The better pose.
pub(super) fn best_pose(view: &View, camera: &Camera, sheet: &Sheet) -> Option<Pose> {
    minima(view, camera, sheet).first().map(|fit| fit.pose)
}

/// Rejects outlying corners and photographs; returns whether anything changed.
pub(super) fn trim(views: &mut [View], state: &State) -> bool {
    let mut changed = false;
    let mut medians = Vec::new();
    let residuals: Vec<Vec<f64>> = views
        .iter()
        .zip(&state.poses)
        .map(|(view, pose)| view.residuals(&state.camera, &state.sheet, pose))
        .collect();
    let mut spread = Vec::with_capacity(views.len());
    for (view, residuals) in views.iter().zip(&residuals) {
        let middle = median(residuals.iter().copied()).unwrap_or(f64::INFINITY);
        spread.push(middle);
        if view.used {
            medians.push(middle);
        }
    }
    let enough = medians.len() >= 3;
    let typical = median(medians).unwrap_or(f64::INFINITY);
    for ((view, residuals), middle) in views.iter_mut().zip(&residuals).zip(spread) {
        // The median length of a two-dimensional normal vector is 1.177 sigma.
        let limit = (TRIM_SIGMA * middle / 1.177).max(TRIM_MIN_PX);
        let inliers: Vec<bool> = residuals.iter().map(|r| *r <= limit).collect();
        changed |= inliers != view.inliers;
        view.inliers = inliers;
        let fits = view.inlier_count() as f64 >= VIEW_SHARE_MIN * view.px.len() as f64;
        let alike = middle <= (VIEW_TIMES * typical).max(VIEW_MIN_PX);
        if view.used && enough && !(fits && alike) {
            view.used = false;
            changed = true;
        }
    }
    changed
}

/// Tries each photograph's mirrored pose with the refined camera; returns whether one was better.
pub(super) fn turn_poses(views: &[View], state: &mut State) -> bool {
    let mut changed = false;
    for (view, pose) in views.iter().zip(&mut state.poses) {
        let (camera, sheet) = (&state.camera, &state.sheet);
        let now = view.cost(camera, sheet, pose);
        for fit in minima(view, camera, sheet) {
            let turn = (fit.pose.rotation.z_axis - pose.rotation.z_axis).length();
            if turn > 0.02 && view.cost(camera, sheet, &fit.pose) < 0.98 * now {
                *pose = fit.pose;
                changed = true;
                break;
            }
        }
    }
    changed
}

/// Number of inliers and the sum of their squared residuals.
pub(super) fn totals(views: &[View], state: &State) -> (usize, f64) {
    let used = views.iter().zip(&state.poses).filter(|(view, _)| view.used);
    used.fold((0, 0.0), |(count, sum), (view, pose)| {
        (count + view.inlier_count(), sum + view.cost(&state.camera, &state.sheet, pose))
    })
}

/// Standard deviation of a corner's coordinate.
pub(super) fn noise(views: &[View], state: &State) -> f64 {
    let (count, sum) = totals(views, state);
    let used = views.iter().filter(|view| view.used).count();
    let freedom = 2 * count as isize - 6 * used as isize - INTRINSICS as isize;
    (sum / freedom.max(1) as f64).sqrt().max(NOISE_MIN_PX)
}
