//! An accepted photograph of a board.

use std::sync::Arc;

use super::update::{Kept, Update, Used, moves};
use crate::calibration::{CameraPrior, Corner};
use crate::geometry::{Camera, Pose};
use crate::rectification::elevation::Detail;

/// Details of a photograph and what they were made with.
pub(in crate::session) struct Seen {
    pub(super) camera: Camera,
    pub(super) pose: Pose,
    /// `None` where the photograph shows too little of the sample.
    pub(super) detail: Option<Detail>,
}

/// An accepted photograph.
#[derive(Clone)]
pub(in crate::session) struct Frame {
    pub(in crate::session) corners: Vec<Corner>,
    /// What was expected of the camera; not known of a saved session's photographs.
    pub(in crate::session) prior: Option<CameraPrior>,
    /// For another rectification, while camera, paper or sample are not settled.
    pub(in crate::session) kept: Option<Arc<Kept>>,
    /// Made from that when needed.
    pub(in crate::session) seen: Option<Arc<Seen>>,
    /// Latest estimate.
    pub(in crate::session) pose: Pose,
    pub(in crate::session) rms_px: f64,
    pub(in crate::session) used: Used,
}

impl Frame {
    /// Width and height of the whole photograph, px.
    pub(in crate::session) fn picture_size(&self) -> (u32, u32) {
        (self.used.camera.width, self.used.camera.height)
    }

    /// What the fit must do to use the latest estimates; remembers that it will.
    pub(super) fn update(
        &mut self,
        index: usize,
        latest: Used,
        sample_mm: [f32; 2],
    ) -> Option<Update> {
        let old = self.used;
        if let Some(kept) = &self.kept
            && (moves(&old, &latest, sample_mm) || old.radiometry.tone != latest.radiometry.tone)
        {
            self.used = latest;
            return Some(Update::Geometry { index, kept: kept.clone(), used: latest });
        }
        self.used.radiometry = latest.radiometry;
        (latest.radiometry != old.radiometry).then_some(Update::Radiometry {
            index,
            used: old,
            new: latest.radiometry,
        })
    }
}
