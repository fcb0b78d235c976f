//! Whether numbers that were read can be what a session wrote.

use super::format::damaged;
use crate::Result;
use crate::calibration::photometry::{Radiometry, Square, Squares};
use crate::calibration::{CameraEstimate, CameraPrior, PaperEstimate};
use crate::geometry::{Camera, Pose};
use crate::observation::{Falloff, Observation};
use crate::rectification::elevation::{self, ElevationEstimate};
use crate::session::capture::{Conditions, Measured, Part, Photograph};
use crate::session::settings::{RectifiedFalloff, Scene};

fn finite<'a>(what: &str, values: impl IntoIterator<Item = &'a f64>) -> Result<()> {
    let all = values.into_iter().all(|v| v.is_finite());
    if all { Ok(()) } else { Err(damaged(format!("{what}: a value is not a number"))) }
}

fn require(holds: bool, what: &str) -> Result<()> {
    if holds { Ok(()) } else { Err(damaged(what)) }
}

fn is_positive(v: f32) -> bool {
    v.is_finite() && v > 0.0
}

/// What [`Session::with_networks`](crate::session::Session::with_networks) takes as it is.
pub(super) fn scene(scene: &Scene) -> Result<()> {
    if let Scene::Rectified { falloff: RectifiedFalloff::Given(falloff) } = scene {
        let (Falloff::None { power } | Falloff::InverseSquare { power_mm2: power }) = falloff;
        require(power.iter().all(|v| v.is_finite()), "the power of the light is not a number")?;
    }
    Ok(())
}

pub(super) fn paper(estimate: &PaperEstimate) -> Result<()> {
    let sigma = estimate.sigma.iter().all(|s| (0.0..=f64::MAX).contains(s));
    require(estimate.paper.is_plausible() && sigma, "the shape of the paper is out of range")
}

pub(super) fn height(estimate: &ElevationEstimate) -> Result<()> {
    let sigma = (0.0..=f64::MAX).contains(&estimate.sigma_mm);
    require(
        elevation::is_possible(estimate.mm) && sigma,
        "the height of the sample is out of range",
    )
}

fn camera(camera: &Camera) -> Result<()> {
    match camera.fault() {
        Some((field, _)) => Err(damaged(format!("camera: {field} is out of range"))),
        None => Ok(()),
    }
}

pub(super) fn camera_estimate(estimate: &CameraEstimate) -> Result<()> {
    camera(&estimate.camera)?;
    paper(&estimate.paper)?;
    finite("camera", estimate.covariance.as_flattened().iter().chain([&estimate.rms_px]))
}

fn pose(pose: &Pose) -> Result<()> {
    let identity = pose.rotation * pose.rotation.transpose();
    let off = (identity - glam::DMat3::IDENTITY).to_cols_array();
    // not a number is not small either
    require(off.iter().all(|v| v.abs() <= 1e-6), "a rotation is not orthonormal")?;
    require(pose.translation.is_finite(), "a translation is not a number")
}

/// Rectified photographs of the session's resolution.
pub(super) fn observation(observation: &Observation, resolution: usize) -> Result<()> {
    let size = [observation.width(), observation.height()];
    require(size == [resolution; 2], "a photograph is not of the session's resolution")
}

/// A photograph of a board that a camera of this size took.
pub(super) fn photograph(
    photograph: &Photograph,
    size: (u32, u32),
    resolution: usize,
) -> Result<()> {
    let Measured { corners, prior, squares } = &photograph.measured;
    require(corners.iter().all(|c| c.px.is_finite()), "a corner is not a number")?;
    camera_prior(prior)?;
    measured_squares(squares)?;
    pose(&photograph.pose)?;
    finite("photograph", [&photograph.rms_px])?;
    conditions(&photograph.wanted)?;
    let rectified = photograph.rectified.as_ref().filter(|r| *r.conditions() == photograph.wanted);
    let rectified = rectified.ok_or_else(|| damaged("a photograph is not rectified"))?;
    observation(rectified.observation(), resolution)?;
    let whole = photograph.wanted.camera;
    require((whole.width, whole.height) == size, "a photograph does not match the camera")?;
    photograph.part.as_ref().map_or(Ok(()), |part| inside(part, &whole))
}

fn camera_prior(prior: &CameraPrior) -> Result<()> {
    camera(&prior.camera)?;
    let CameraPrior { focal_sigma, aspect_sigma, centre_sigma_px, distortion_sigma, .. } = prior;
    finite(
        "prior",
        [focal_sigma, aspect_sigma, centre_sigma_px].into_iter().chain(distortion_sigma),
    )?;
    let sigma = [focal_sigma, aspect_sigma, centre_sigma_px].into_iter().chain(distortion_sigma);
    require(sigma.into_iter().all(|v| *v >= 0.0), "a standard deviation is negative")
}

fn measured_squares(squares: &Squares) -> Result<()> {
    require(is_positive(squares.exposure), "an exposure is not positive")?;
    require(squares.clipped_share.is_finite(), "a share is not a number")?;
    let fine = |square: &Square| {
        square.board_mm.is_finite() && square.value.iter().flatten().all(|v| is_positive(*v))
    };
    require(squares.squares.iter().chain(&squares.gray).all(fine), "a square is out of range")
}

fn conditions(conditions: &Conditions) -> Result<()> {
    let Conditions { camera: taken_by, pose: at, radiometry, elevation_mm, edge_px } = conditions;
    camera(taken_by)?;
    pose(at)?;
    light(radiometry)?;
    require(elevation::is_possible(*elevation_mm), "the height of the sample is out of range")?;
    require((0.0..=f32::MAX).contains(edge_px), "a standard deviation is negative")
}

fn light(radiometry: &Radiometry) -> Result<()> {
    let Radiometry { gain, tone, vignetting, lobe, flash_offset_mm, power_mm2, ambient, log_sigma } =
        radiometry;
    let shape = [&vignetting.exponent, &vignetting.curvature, &lobe.exponent];
    finite("light", shape.into_iter().chain(&lobe.pattern).chain(gain))?;
    require(flash_offset_mm.is_finite(), "the place of the flash is not a number")?;
    require(ambient.iter().all(|v| v.is_finite()), "ambient light is not a number")?;
    require(gain.iter().all(|v| *v > 0.0), "a gain is not positive")?;
    require(power_mm2.iter().all(|v| is_positive(*v)), "the power of a light is not positive")?;
    require((0.0..=f32::MAX).contains(log_sigma), "a standard deviation is negative")?;
    require(tone.is_plausible(), "a tone curve is out of range")
}

fn inside(part: &Part, whole: &Camera) -> Result<()> {
    let fits =
        |from: u32, count: u32, size: u32| from.checked_add(count).is_some_and(|end| end <= size);
    let [x, y] = part.corner;
    let (photo, Camera { width, height, .. }) = (&part.photo, *whole);
    let fits = fits(x, photo.width(), width) && fits(y, photo.height(), height);
    require(fits, "a region lies outside its photograph")
}
