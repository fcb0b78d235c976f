//! A photograph on its way from calibration to the fit.

use super::board::Update;
use super::feedback::Hint;
use crate::geometry::Pose;
use crate::observation::Observation;

/// A photograph ready for the fit.
pub(super) struct Taken {
    pub(super) observation: Observation,
    pub(super) pose: Option<Pose>,
    pub(super) rms_px: Option<f64>,
    /// What is known better of earlier photographs.
    pub(super) updates: Vec<Update>,
    /// Whether they move the sample by more than a texel.
    pub(super) restart: bool,
    pub(super) hints: Vec<Hint>,
}
