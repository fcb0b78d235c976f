//! What a session tells its caller.

use super::feedback::Hint;
use crate::Rejection;
use crate::geometry::Pose;
use crate::observation::Observation;

/// What became of a photograph.
#[derive(Debug, Clone, PartialEq)]
pub enum Pushed {
    /// It takes part in the fit from now on.
    Accepted(Accepted),
    /// It was not used; nothing changed.
    Rejected(Rejection),
}

/// An accepted photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Accepted {
    /// Number of accepted photographs before this one.
    pub index: usize,
    /// Pose of the board; `None` for rectified photographs.
    pub pose: Option<Pose>,
    /// Reprojection error, px; `None` for rectified photographs.
    pub reprojection_rms_px: Option<f64>,
    /// Seconds from the call of push to maps being available.
    pub maps_seconds: f64,
    /// What the user may want to know about it.
    pub hints: Vec<Hint>,
}

/// Where the board lies in a photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardPose {
    /// Board to camera.
    pub pose: Pose,
    /// Reprojection error, px.
    pub reprojection_rms_px: f64,
}

/// What a session sees in a photograph that it does not keep.
#[derive(Debug, Clone, PartialEq)]
pub struct Observed {
    /// The rectified photograph with its camera and light, at the session's resolution.
    pub observation: Observation,
    /// Where the board lies; `None` for rectified photographs.
    pub pose: Option<BoardPose>,
    /// What the user may want to know about it.
    pub hints: Vec<Hint>,
}

/// State of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Accepted photographs.
    pub frames: usize,
    /// Share of the work on the photographs so far that is done, 0 to 1.
    pub fraction: f32,
    /// Mean log-L1 before the fit of the latest photograph.
    pub loss_before: f32,
    /// Mean log-L1 now.
    pub loss: f32,
    /// Estimated seconds left, if known.
    pub seconds_left: Option<f32>,
    /// Whether the fit has finished on all photographs so far.
    pub settled: bool,
}

/// Counters that grow with a session's state, to tell whether anything is new.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Revision {
    /// Grows with every change of progress and with every set of maps.
    pub state: u64,
    /// Sets of maps published so far.
    pub maps: u64,
}
