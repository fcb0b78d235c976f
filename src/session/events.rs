//! Events for subscribers of the crate `tracing`; those of the phases of a fit are in `estimate`.

use tracing::field::debug as shown;
use tracing::{debug, info, warn};

use super::capture::Board;
use super::reports::AcceptedPhoto;
use crate::Rejection;

/// A photograph was accepted.
pub(super) fn accepted(photo: &AcceptedPhoto) {
    info!(
        target: "svbrdf::photo",
        index = photo.index,
        milliseconds = (1e3 * photo.maps_seconds).round() as u64,
        hints = ?photo.hints.iter().map(|hint| hint.code()).collect::<Vec<_>>(),
        "photo accepted"
    );
}

/// A photograph was rejected.
pub(super) fn rejected(why: Rejection) {
    warn!(target: "svbrdf::photo", reason = %why.code(), "photo rejected: {why}");
}

/// A photograph was removed.
pub(super) fn removed(index: usize) {
    info!(target: "svbrdf::photo", index, "photo removed");
}

/// Camera and light were estimated from the photographs of a board.
pub(super) fn calibrated(board: &Board) {
    let (camera, light) = (board.camera(), board.photometry.as_ref());
    debug!(
        target: "svbrdf::calibration",
        photos = board.photographs.len(),
        focal_px = camera.map(|camera| shown([camera.fx, camera.fy])),
        centre_px = camera.map(|camera| shown([camera.cx, camera.cy])),
        distortion = camera.map(|camera| shown(camera.distortion)),
        flash_offset_mm = ?board.flash_offset_mm().to_array(),
        ambient = light.map(|light| shown(light.ambient)),
        "calibrated"
    );
}

/// A session continues a saved one.
pub(super) fn restored(photos: usize) {
    info!(target: "svbrdf::session", photos, "session restored");
}

/// The fit was paused.
pub(super) fn paused() {
    info!(target: "svbrdf::session", "fit paused");
}

/// The fit continues after a pause.
pub(super) fn resumed() {
    info!(target: "svbrdf::session", "fit resumed");
}

/// The session was cancelled.
pub(super) fn cancelled() {
    info!(target: "svbrdf::session", "session cancelled");
}
