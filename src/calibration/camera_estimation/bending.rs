//! Estimates stretch and bend of the printed sheet.

use super::super::detector::Corner;
use super::super::paper::{Paper, PaperEstimate, Sheet};
use super::super::target::Target;
use super::joint::{Problem, State, View};
use super::prior::{CameraPrior, INTRINSICS};
use super::robust::{ROUNDS, freedom, noise, totals, trim, turn_poses, view};
use crate::geometry::{Camera, Pose};

/// The sheet counts as planned unless a free sheet lowers the squared residuals by this much (in
/// units of the noise variance) and by this share.
const GAIN_MIN: f64 = 25.0;
const GAIN_SHARE_MIN: f64 = 0.02;

/// A fit with the sheet free.
pub(super) struct Bent {
    pub state: State,
    pub views: Vec<View>,
    /// The planned sheet, unless the corners contradict it.
    pub estimate: PaperEstimate,
    /// Whether the corners contradict the planned sheet.
    pub is_clear: bool,
}

/// Refines sheet, poses and the free camera parameters from a fit with a flat sheet. `None` for
/// fewer than two photographs: one cannot separate a bend from lens and pose.
pub(super) fn bend(
    views: &[View],
    flat: &State,
    prior: &CameraPrior,
    camera: [bool; INTRINSICS],
) -> Option<Bent> {
    if views.iter().filter(|v| v.used).count() < 2 {
        return None;
    }
    let (free, stiff) = (freedom(camera, true), freedom(camera, false));
    let mut views = views.to_vec();
    let mut state = flat.clone();
    let mut noise_px = noise(&views, &state);
    for round in 0..ROUNDS {
        state = Problem { prior, views: &views, noise_px, free }.minimise(state);
        let mut changed = trim(&mut views, &state);
        let before = std::mem::replace(&mut noise_px, noise(&views, &state));
        changed |= turn_poses(&views, &mut state) || noise_px < 0.9 * before;
        if !changed && round > 0 {
            break;
        }
    }
    let problem = Problem { prior, views: &views, noise_px, free };
    let state = problem.minimise(state);
    // Compare with a flat sheet on the same corners.
    let planned = Sheet { paper: Paper::default(), ..state.sheet };
    let flat = State { sheet: planned, ..state.clone() };
    let flat = Problem { prior, views: &views, noise_px, free: stiff }.minimise(flat);
    let gain = problem.cost(&flat) - problem.cost(&state);
    let (_, squares) = totals(&views, &flat);
    let is_clear = gain > (GAIN_MIN * noise_px * noise_px).max(GAIN_SHARE_MIN * squares);
    let covariance = problem.covariance(&state)?;
    let sigma = std::array::from_fn(|i| covariance[(INTRINSICS + i, INTRINSICS + i)].sqrt());
    if !sigma.iter().all(|s| s.is_finite()) {
        return None;
    }
    let paper = if is_clear { state.sheet.paper } else { Paper::default() };
    Some(Bent { state, views, estimate: PaperEstimate { paper, sigma }, is_clear })
}

/// Estimates the printed sheet from photographs with a known camera, given the corners and an
/// approximate pose of each.
///
/// Returns the planned sheet for fewer than two photographs, or if the corners do not contradict it.
pub fn estimate_paper(
    camera: &Camera,
    target: &Target,
    views: &[(&[Corner], Pose)],
) -> PaperEstimate {
    let given: Vec<View> = views.iter().map(|(corners, _)| view(target, corners)).collect();
    let poses = views.iter().map(|(_, pose)| *pose).collect();
    let state = State { camera: *camera, sheet: Sheet::new(target, Paper::default()), poses };
    let bent = bend(&given, &state, &CameraPrior::around(*camera), [false; INTRINSICS]);
    bent.map_or_else(PaperEstimate::default, |bent| bent.estimate)
}
