//! Hints from the corners of the board in all photographs.

use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

use crate::calibration::{self, CameraPrior};
use crate::session::capture::{Board, Capture, Photograph};
use crate::session::hint::Hint;
use crate::statistics::median;

/// Least deviation of a displaced corner: mm, and standard deviations of its mean over the photographs.
const OFF_MM: f64 = 0.12;
const OFF_SIGMAS: f64 = 4.0;
/// Least share of displaced corners that is a fault of the board, and fewest photographs of a corner.
const OFF_SHARE: f64 = 0.07;
const PHOTOS: usize = 2;
/// Prior of a single photograph's focal length: relative standard deviation.
const OWN_FOCAL_SIGMA: f64 = 0.02;
/// Largest usable and least assumed standard deviation of an optical axis, relative to the long side.
const AXIS_KNOWN: f64 = 0.02;
const AXIS_FLOOR: f64 = 0.006;
/// In views nearer to the vertical than this, radians, the axis is correlated with the pose.
const AXIS_TILT: f64 = 0.17;
/// Least significant deviation of an axis in standard deviations, and fewest axes that determine the usual one.
const AXIS_SIGMAS: f64 = 6.0;
const AXES_MIN: usize = 3;

/// Adds the hints.
pub(super) fn of_capture(capture: &Capture, hints: &mut [Vec<Hint>]) {
    let Some(board) = capture.board() else { return };
    if let Some((mm, share)) = bent(board) {
        let hint = Hint::BoardBent { mm: mm as f32, share: share as f32 };
        hints.iter_mut().for_each(|hints| hints.push(hint));
        return;
    }
    for (hints, off) in hints.iter_mut().zip(cropped(board)) {
        hints.extend(off.map(|px| Hint::Cropped { px: px as f32 }));
    }
}

/// Distance of each photograph's optical axis from the median one, px, where significant. Each axis is estimated from
/// the photograph's own corners, with the focal length and distortion of all photographs as prior.
fn cropped(board: &Board) -> Vec<Option<f64>> {
    let own = |photograph: &Photograph| {
        let camera = board.camera().filter(|_| photograph.pose.view_angle() > AXIS_TILT)?;
        let around = CameraPrior::around(camera);
        let prior = CameraPrior {
            focal_sigma: OWN_FOCAL_SIGMA,
            centre_sigma_px: f64::INFINITY,
            distortion_sigma: [0.0; 5],
            ..around
        };
        let corners = photograph.measured.corners.as_slice();
        let own = calibration::estimate_camera(&board.target, &[corners], &prior, Some(&camera));
        let own = own.ok()?;
        let sigma = own.sigma();
        Some((DVec2::new(own.camera.cx, own.camera.cy), DVec2::new(sigma[2], sigma[3])))
    };
    let all: Vec<_> = board.photographs.iter().map(own).collect();
    let long = board.camera().map_or(0.0, |c| f64::from(c.width.max(c.height)));
    let known =
        || all.iter().flatten().filter(|(_, sigma)| sigma.max_element() < AXIS_KNOWN * long);
    if known().count() < AXES_MIN {
        return vec![None; all.len()];
    }
    let middle = |k: usize| median(known().map(|(axis, _)| axis[k])).unwrap_or(0.0);
    let usual = DVec2::new(middle(0), middle(1));
    let off = |&(axis, sigma): &(DVec2, DVec2)| {
        let off = axis - usual;
        let least = sigma.max(DVec2::splat(AXIS_FLOOR * long));
        ((off / least).abs().max_element() > AXIS_SIGMAS).then(|| off.length())
    };
    all.iter().map(|own| own.as_ref().and_then(off)).collect()
}

/// Corners displaced alike in all photographs: their median displacement, mm, and their share.
fn bent(board: &Board) -> Option<(f64, f64)> {
    let mut corners: BTreeMap<(u32, u32), Vec<DVec2>> = BTreeMap::new();
    for photograph in &board.photographs {
        let pose = &photograph.pose;
        let camera = board.camera()?;
        for corner in &photograph.measured.corners {
            let plan = board.target.grid_mm(corner.row.into(), corner.col.into());
            let at = board.paper.paper.place(&board.target, plan);
            // Intersection of the line of sight with the plane at the corner's height.
            let ray = pose.rotation.transpose() * camera.undistort(corner.px).extend(1.0);
            let eye: DVec3 = pose.camera_centre();
            let seen = eye + ray * ((at.z - eye.z) / ray.z);
            let off = (seen - at).truncate();
            if off.is_finite() {
                corners.entry((corner.row, corner.col)).or_default().push(off);
            }
        }
    }
    let seen: Vec<&Vec<DVec2>> = corners.values().filter(|offs| offs.len() >= PHOTOS).collect();
    let off: Vec<f64> = seen
        .iter()
        .filter_map(|offs| {
            let count = offs.len() as f64;
            let mean = offs.iter().copied().sum::<DVec2>() / count;
            let variance =
                offs.iter().map(|o| o.distance_squared(mean)).sum::<f64>() / (count - 1.0);
            let clear = mean.length() > OFF_MM.max(OFF_SIGMAS * (variance / count).sqrt());
            clear.then_some(mean.length())
        })
        .collect();
    let share = off.len() as f64 / seen.len().max(1) as f64;
    Some((median(off)?, share)).filter(|_| share > OFF_SHARE)
}
