//! Whether numbers that were read can be what a session wrote.

use super::format::damaged;
use crate::Result;
use crate::calibration::CameraEstimate;
use crate::geometry::Camera;
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
    require(estimate.is_none_or(CameraEstimate::is_plausible), "the camera is out of range")?;
    require(saved.paper.is_plausible(), "the shape of the paper is out of range")?;
    require(saved.elevation.is_plausible(), "the height of the sample is out of range")?;
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
    let known = pose.is_plausible() && rms_px.is_finite() && is_conditions(wanted);
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

fn is_measured(Measured { corners, prior, squares }: &Measured) -> bool {
    corners.iter().all(|c| c.px.is_finite()) && prior.is_plausible() && squares.is_plausible()
}

fn is_conditions(conditions: &Conditions) -> bool {
    conditions.camera.fault().is_none()
        && conditions.pose.is_plausible()
        && conditions.radiometry.is_plausible()
        && elevation::is_possible(conditions.elevation_mm)
        && (0.0..=f32::MAX).contains(&conditions.edge_px)
}

fn is_inside(part: &Part, whole: &Camera) -> bool {
    let fits =
        |from: u32, count: u32, size: u32| from.checked_add(count).is_some_and(|end| end <= size);
    let ([x, y], photo) = (part.corner, &part.photo);
    let plausible = part.surround.is_plausible();
    plausible && fits(x, photo.width(), whole.width) && fits(y, photo.height(), whole.height)
}
