//! Checks the ranges of restored values: postcard reads many that no session writes.

use super::format::damaged;
use crate::Result;
use crate::calibration::CameraEstimate;
use crate::geometry::Camera;
use crate::observation::Falloff;
use crate::rectification::{Part, elevation};
use crate::scene::{RectifiedFalloff, Scene};
use crate::session::capture::{
    Board, Conditions, Given, Measured, Photograph, Placed, Rectified, Wanted,
};

fn require(holds: bool, what: &str) -> Result<()> {
    if holds { Ok(()) } else { Err(damaged(what)) }
}

/// Checks values that [`Session::with_networks`](crate::session::Session::with_networks) does not check.
pub(super) fn scene(scene: &Scene) -> Result<()> {
    if let Scene::Rectified { falloff: RectifiedFalloff::Given(falloff) } = scene {
        let (Falloff::None { power } | Falloff::InverseSquare { power_mm2: power }) = falloff;
        require(power.iter().all(|v| v.is_finite()), "the power of the light is not a number")?;
    }
    Ok(())
}

/// Checks kind and size of a rectified photograph.
pub(super) fn rectified(rectified: &Rectified, wanted: &Wanted, size: [usize; 2]) -> Result<()> {
    let Rectified { conditions, observation } = rectified;
    let found = [observation.width(), observation.height()];
    require(found == size, "a photograph is not of the session's resolution")?;
    let known = match wanted {
        Wanted::Board { .. } => conditions.as_ref().is_some_and(is_conditions),
        Wanted::Given(_) => conditions.is_none(),
    };
    require(known, "camera, pose or light of a rectified photograph are out of range")
}

/// Checks the positions of photographs that were added rectified.
pub(super) fn given(saved: &Given) -> Result<()> {
    let possible = |placed: &Placed| placed.fault().is_none();
    require(saved.photographs.iter().all(possible), "a camera or light is out of range")
}

/// Checks a saved board against a `fresh` one of the same scene.
pub(super) fn board(fresh: &Board, saved: &Board) -> Result<()> {
    let (estimate, photographs) = (saved.estimate.as_deref(), &saved.photographs);
    require(estimate.is_none_or(CameraEstimate::is_plausible), "the camera is out of range")?;
    require(saved.paper.is_plausible(), "the shape of the paper is out of range")?;
    require(saved.elevation.is_plausible(), "the height of the sample is out of range")?;
    let known = fresh.camera().or(estimate.map(|e| e.camera));
    let size = known.map_or((0, 0), |c| (c.width, c.height));
    photographs.iter().try_for_each(|p| photograph(p, size))?;
    let estimated = fresh.camera().is_none();
    let whole = !estimated || photographs.iter().all(|p| p.part.is_some());
    let estimated_or_given = estimate.is_some() == (estimated && !photographs.is_empty());
    require(whole && estimated_or_given, "the photographs do not match the camera")
}

/// Checks a photograph of a board, taken by a camera of this size.
fn photograph(photograph: &Photograph, size: (u32, u32)) -> Result<()> {
    let Photograph { measured, pose, rms_px, part, conditions, .. } = photograph;
    require(is_measured(measured), "what was measured in a photograph is out of range")?;
    let known = pose.is_plausible() && rms_px.is_finite() && is_conditions(conditions);
    require(known, "camera, pose or light of a photograph are out of range")?;
    let whole = &conditions.camera;
    require((whole.width, whole.height) == size, "a photograph does not match the camera")?;
    let inside = part.as_ref().is_none_or(|part| is_inside(part, whole));
    require(inside, "a region lies outside its photograph")
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
