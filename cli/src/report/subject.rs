//! The content of a page.

use serde_json::Value;
use svbrdf::Svbrdf;
use svbrdf::capture::{Capture, PhotoFile};
use svbrdf::comparison::Prediction;
use svbrdf::geometry::Camera;

/// The subject of the page.
pub struct Subject<'a> {
    /// The contents of `report.json`.
    pub report: &'a Value,
    pub capture: &'a Capture,
    /// The photographs used, in the order of the capture.
    pub photos: &'a [PhotoFile],
    /// As used.
    pub camera: Option<Camera>,
    /// The latest maps.
    pub maps: &'a Svbrdf,
    /// Photographs that were held out: number in the capture and prediction.
    pub predictions: Vec<(usize, &'a Prediction)>,
    /// Name of the capture.
    pub name: String,
}
