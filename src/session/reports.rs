//! Reports of a session to its caller.

use std::sync::Arc;

use super::hint::Hint;
use crate::calibration::Corner;
use crate::estimate::Phase;
use crate::geometry::Pose;
use crate::observation::Observation;
use crate::uncertainty::Uncertainty;
use crate::{Rejection, Svbrdf};

/// The answer to a photograph: it can be used, or the reason why not. A rejection changes nothing.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome<T> {
    /// The photograph can be used.
    Accepted(T),
    /// The photograph cannot be used.
    Rejected(Rejection),
}

impl<T> Outcome<T> {
    /// Whether the photograph can be used.
    pub fn is_accepted(&self) -> bool {
        matches!(self, Self::Accepted(_))
    }

    /// The value of an accepted photograph as `Ok`, the rejection as `Err`.
    ///
    /// # Errors
    /// The rejection.
    pub fn into_result(self) -> Result<T, Rejection> {
        match self {
            Self::Accepted(value) => Ok(value),
            Self::Rejected(rejection) => Err(rejection),
        }
    }

    /// Applies a function to the value of an accepted photograph.
    pub fn map<U>(self, function: impl FnOnce(T) -> U) -> Outcome<U> {
        self.into_result().map(function).into()
    }
}

impl<T> From<Result<T, Rejection>> for Outcome<T> {
    fn from(result: Result<T, Rejection>) -> Self {
        match result {
            Ok(value) => Self::Accepted(value),
            Err(rejection) => Self::Rejected(rejection),
        }
    }
}

/// An accepted photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct AcceptedPhoto {
    /// Number of accepted photographs before this one.
    pub index: usize,
    /// Pose of the board; `None` for rectified photographs.
    pub pose: Option<BoardPose>,
    /// Seconds from the call to maps being available.
    pub maps_seconds: f64,
    /// Remarks for the user.
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

/// A photograph as the session sees it, without being added.
#[derive(Debug, Clone, PartialEq)]
pub struct Observed {
    /// The rectified photograph with its camera and light, at the session's resolution.
    pub observation: Observation,
    /// Where the board lies; `None` for rectified photographs.
    pub pose: Option<BoardPose>,
    /// Remarks for the user.
    pub hints: Vec<Hint>,
}

/// The verdict on a photograph or preview image that is not added, see
/// [`Session::probe`](super::Session::probe).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Probe {
    /// The reason for which such a photograph would be rejected; `None`: it would be accepted.
    pub rejection: Option<Rejection>,
    /// Remarks, whether it would be accepted or not.
    pub hints: Vec<Hint>,
    /// Corners of the board found, px of the image as given.
    pub corners: Vec<Corner>,
    /// Corners the board has.
    pub corners_expected: usize,
    /// Corners that lie inside the image; 0 where the board was not found.
    pub corners_in_view: usize,
    /// Edge spread (one sigma) in the board's softer direction, px. Large images are reduced first:
    /// widths below one pixel of the reduced image cannot be distinguished.
    pub blur_px: Option<f32>,
    /// Across the softer edges, where they clearly are: degrees clockwise from the image's x
    /// axis, 0 to 180.
    pub blur_direction_deg: Option<f32>,
    /// The pose of the board, also in an image that would be rejected; `None` if it was not found.
    pub pose: Option<BoardPose>,
    /// The camera's position; `None` without a pose.
    pub view: Option<ProbedView>,
    /// The light on the board; `None` without a pose, and for images without the flash.
    pub light: Option<ProbedLight>,
}

impl Probe {
    /// Sets the reason for a rejection, unless there is one.
    pub(super) fn refuse(&mut self, why: Option<Rejection>) {
        self.rejection = self.rejection.or(why);
    }
}

/// The position of a camera relative to the sample, and the part of the sample that it sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProbedView {
    /// Unit vector from the sample's centre towards the camera, board frame.
    pub direction: [f32; 3],
    /// From the sample's centre to the camera, mm.
    pub distance_mm: f32,
    /// Angle off the vertical, degrees.
    pub tilt_deg: f32,
    /// Side of the camera: degrees counter-clockwise from the sample's +X, 0 to 360.
    pub azimuth_deg: f32,
    /// Angle to the direction of [`Session::next_view`](super::Session::next_view), degrees; `None`
    /// before the first photograph.
    pub off_next_deg: Option<f32>,
    /// Share of the sample inside the image, 0 to 1.
    pub sample_seen: f32,
    /// Share of the visible sample that is saturated in all channels, 0 to 1.
    pub sample_clipped: f32,
    /// The sample's corners in the image as given, px, clockwise from the upper left of the
    /// maps; they may lie outside the image. `None` where one is behind the camera.
    pub sample_px: Option<[[f32; 2]; 4]>,
    /// Mean scale of the sample in the image as given, px/mm.
    pub px_per_mm: f32,
}

/// The light on the board of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProbedLight {
    /// Median level of the white squares, share of full scale, linear.
    pub white_level: f32,
    /// Share of the white squares that are clipped, 0 to 1.
    pub clipped_share: f32,
}

/// Maps and how far they may be off.
#[derive(Debug, Clone, PartialEq)]
pub struct MapsWithUncertainty {
    /// The maps.
    pub maps: Arc<Svbrdf>,
    /// Standard deviations of their errors.
    pub uncertainty: Uncertainty,
}

/// State of the fit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    /// Accepted photographs.
    pub photos: usize,
    /// Fraction of the work that is done, 0 to 1. On photographs announced by
    /// [`Session::announce`](super::Session::announce) it never falls. Without an announcement it is that of
    /// the latest photograph and begins at 0 with each one. It also begins again when a photograph is removed
    /// or a larger budget resumes the fit, unless announced photographs are still to come.
    pub fraction: f32,
    /// Mean log-L1 before the fit of the latest photograph.
    pub loss_before: f32,
    /// Mean log-L1 now.
    pub loss: f32,
    /// Estimated seconds left on the photographs so far, if known.
    pub seconds_left: Option<f32>,
    /// Whether the fit has finished on all photographs so far.
    pub settled: bool,
    /// The present phase of the fit; `None` when it has nothing to do or has not begun.
    pub phase: Option<Phase>,
}

/// Counters that grow when a session's state changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Revision {
    /// Grows with every change of progress and with every set of maps.
    pub state: u64,
    /// Sets of maps published so far.
    pub maps: u64,
}
