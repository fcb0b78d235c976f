//! Whether numbers that were read can be what a session wrote.

use super::format::damaged;
use crate::Result;
use crate::calibration::photometry::{Radiometry, Square};
use crate::calibration::{CameraEstimate, PaperEstimate};
use crate::geometry::{Camera, Pose};
use crate::observation::{Falloff, Observation};
use crate::rectification::{Part, elevation};
use crate::session::capture::{Board, Conditions, Measured, Photograph};
use crate::session::settings::{RectifiedFalloff, Scene};

fn require(holds: bool, what: &str) -> Result<()> {
    if holds { Ok(()) } else { Err(damaged(what)) }
}

/// What [`Session::with_networks`](crate::session::Session::with_networks) takes as it is.
pub(super) fn scene(scene: &Scene) -> Result<()> {
    if let Scene::Rectified { falloff: RectifiedFalloff::Given(falloff) } = scene {
        let (Falloff::None { power } | Falloff::InverseSquare { power_mm2: power }) = falloff;
        require(power.iter().all(|v| v.is_finite()), "the power of the light is not a number")?;
    }
    Ok(())
}

/// Rectified photographs of the session's resolution.
pub(super) fn observation(observation: &Observation, resolution: usize) -> Result<()> {
    let size = [observation.width(), observation.height()];
    require(size == [resolution; 2], "a photograph is not of the session's resolution")
}

/// What was saved of a board, which is `fresh` but for that.
pub(super) fn board(fresh: &Board, saved: &Board, resolution: usize) -> Result<()> {
    let (estimate, photographs) = (saved.estimate.as_deref(), &saved.photographs);
    require(estimate.is_none_or(is_estimate), "the camera is out of range")?;
    require(is_paper(&saved.paper), "the shape of the paper is out of range")?;
    let height = &saved.elevation;
    let height = elevation::is_possible(height.mm) && is_deviation(&height.sigma_mm);
    require(height, "the height of the sample is out of range")?;
    let known = fresh.camera().or(estimate.map(|e| e.camera));
    let size = known.map_or((0, 0), |c| (c.width, c.height));
    photographs.iter().try_for_each(|p| photograph(p, size, resolution))?;
    let estimated = fresh.camera().is_none();
    let whole = !estimated || photographs.iter().all(|p| p.part.is_some());
    let told = estimate.is_some() == (estimated && !photographs.is_empty());
    require(whole && told, "the photographs do not match the camera")
}

/// A photograph of a board that a camera of this size took.
fn photograph(photograph: &Photograph, size: (u32, u32), resolution: usize) -> Result<()> {
    let Photograph { measured, pose, rms_px, part, wanted, rectified, .. } = photograph;
    require(is_measured(measured), "what was measured in a photograph is out of range")?;
    let known = is_pose(pose) && rms_px.is_finite() && is_conditions(wanted);
    require(known, "camera, pose or light of a photograph are out of range")?;
    let whole = &wanted.camera;
    require((whole.width, whole.height) == size, "a photograph does not match the camera")?;
    let inside = part.as_ref().is_none_or(|part| is_inside(part, whole));
    require(inside, "a region lies outside its photograph")?;
    match rectified.as_ref().filter(|rectified| rectified.conditions() == wanted) {
        Some(rectified) => observation(rectified.observation(), resolution),
        None => Err(damaged("a photograph is not rectified")),
    }
}

/// A standard deviation.
fn is_deviation(v: &f64) -> bool {
    (0.0..=f64::MAX).contains(v)
}

fn is_positive(v: &f32) -> bool {
    v.is_finite() && *v > 0.0
}

fn is_estimate(estimate: &CameraEstimate) -> bool {
    let mut numbers = estimate.covariance.as_flattened().iter().chain([&estimate.rms_px]);
    estimate.camera.fault().is_none() && is_paper(&estimate.paper) && numbers.all(|v| v.is_finite())
}

fn is_paper(estimate: &PaperEstimate) -> bool {
    estimate.paper.is_plausible() && estimate.sigma.iter().all(is_deviation)
}

fn is_pose(pose: &Pose) -> bool {
    let identity = pose.rotation * pose.rotation.transpose();
    let off = (identity - glam::DMat3::IDENTITY).to_cols_array();
    // not a number is not small either
    off.iter().all(|v| v.abs() <= 1e-6) && pose.translation.is_finite()
}

fn is_measured(Measured { corners, prior, squares }: &Measured) -> bool {
    let sigmas = [&prior.focal_sigma, &prior.aspect_sigma, &prior.centre_sigma_px];
    let is_square = |square: &Square| {
        square.board_mm.is_finite() && square.value.iter().flatten().all(is_positive)
    };
    corners.iter().all(|c| c.px.is_finite())
        && prior.camera.fault().is_none()
        && sigmas.into_iter().chain(&prior.distortion_sigma).all(is_deviation)
        && is_positive(&squares.exposure)
        && squares.clipped_share.is_finite()
        && squares.squares.iter().chain(&squares.gray).all(is_square)
}

fn is_conditions(conditions: &Conditions) -> bool {
    conditions.camera.fault().is_none()
        && is_pose(&conditions.pose)
        && is_light(&conditions.radiometry)
        && elevation::is_possible(conditions.elevation_mm)
        && (0.0..=f32::MAX).contains(&conditions.edge_px)
}

fn is_light(light: &Radiometry) -> bool {
    let shape = [light.vignetting.exponent, light.vignetting.curvature, light.lobe.exponent];
    shape.iter().chain(&light.lobe.pattern).all(|v| v.is_finite())
        && light.gain.iter().all(|v| v.is_finite() && *v > 0.0)
        && light.flash_offset_mm.is_finite()
        && light.power_mm2.iter().all(is_positive)
        && light.ambient.iter().all(|v| v.is_finite())
        && (0.0..=f32::MAX).contains(&light.log_sigma)
        && light.tone.is_plausible()
}

fn is_inside(part: &Part, whole: &Camera) -> bool {
    let fits =
        |from: u32, count: u32, size: u32| from.checked_add(count).is_some_and(|end| end <= size);
    let ([x, y], photo) = (part.corner, &part.photo);
    fits(x, photo.width(), whole.width) && fits(y, photo.height(), whole.height)
}
