//! What a session tells its caller.

use std::sync::Arc;

use super::advice::Hint;
use crate::calibration::Corner;
use crate::confidence::Confidence;
use crate::estimate::{Part, Phase, Residual};
use crate::geometry::Pose;
use crate::observation::Observation;
use crate::{Rejection, Svbrdf};

/// Photographs from which on one may stand out.
const OUTLIER_FROM: usize = 4;
/// A residual stands out that is so many robust standard deviations above the median, and so many
/// times as large: of photographs that agree, deviations are tiny.
const OUTLIER_SIGMA: f32 = 5.0;
const OUTLIER_RATIO: f32 = 1.5;
/// Standard deviation of a normal distribution over its median absolute deviation.
const MAD_TO_SIGMA: f32 = 1.4826;

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

/// What a photograph that is only looked at would be good for, see
/// [`Session::probe`](super::Session::probe).
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// Why a photograph like it would not be used; `None`: it would.
    pub rejection: Option<Rejection>,
    /// What there is to tell about it, whether it would be used or not.
    pub hints: Vec<Hint>,
    /// Corners of the board found, px of the picture as it came.
    pub corners: Vec<Corner>,
    /// Corners the board has.
    pub corners_expected: usize,
    /// Corners that lie inside the picture; 0 where the board was not found.
    pub corners_in_view: usize,
    /// Edge spread (one sigma) in the board's softer direction, px. Large pictures are reduced first:
    /// below one pixel of the reduced one, widths cannot be told apart.
    pub blur_px: Option<f32>,
    /// Across the softer edges, where they clearly are: degrees clockwise from the picture's x
    /// axis, 0 to 180.
    pub blur_direction_deg: Option<f32>,
    /// Where the board lies, also in a picture that would not be used; `None` where it was not found.
    pub pose: Option<BoardPose>,
    /// Where the camera is; `None` without a pose.
    pub view: Option<ProbedView>,
    /// How the board is lit; `None` without a pose, or where the light says nothing.
    pub light: Option<ProbedLight>,
}

impl Probe {
    pub(super) fn rejected(corners_expected: usize, rejection: Rejection) -> Self {
        Self {
            rejection: Some(rejection),
            hints: Vec::new(),
            corners: Vec::new(),
            corners_expected,
            corners_in_view: 0,
            blur_px: None,
            blur_direction_deg: None,
            pose: None,
            view: None,
            light: None,
        }
    }
}

/// Where a camera looks at the sample from, and how much of it is seen.
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
    /// Share of the sample inside the picture, 0 to 1.
    pub sample_seen: f32,
    /// Share of what is seen of the sample that is saturated in all channels, 0 to 1.
    pub sample_clipped: f32,
    /// The sample's corners in the picture as it came, px, clockwise from the upper left of the
    /// maps; also outside of it. `None` where one is behind the camera.
    pub sample_px: Option<[[f32; 2]; 4]>,
    /// Mean scale of the sample in the picture as it came, px/mm.
    pub px_per_mm: f32,
}

/// How the board of a picture is lit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProbedLight {
    /// Median level of the white squares, share of full scale, linear.
    pub white_level: f32,
    /// Share of the white squares that are clipped, 0 to 1.
    pub clipped_share: f32,
}

/// How the maps of the moment explain an accepted photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameFit {
    /// Median over its texels of the absolute difference of the logarithms of rendered and measured
    /// radiance, mean of the channels: a relative error.
    pub residual: f32,
    /// Mean weight of its texels, 0 to 1: the cosine to the camera, 0 for texels that it does not show.
    pub weight: f32,
    /// Whether it contradicts the others: its residual stands out. Of fewer than four photographs
    /// none does.
    pub outlier: bool,
    /// A part of it that contradicts the others: sun, a shadow, a hand or glare on a part of the
    /// sample. Of fewer than four photographs none does.
    pub part: Option<Part>,
}

impl FrameFit {
    /// Of all photographs, by what the maps leave of each.
    pub(super) fn all(residuals: &[Residual]) -> Vec<Self> {
        let limit = limit(residuals.iter().map(|r| r.median).collect());
        let fit = |r: &Residual| Self {
            residual: r.median,
            weight: r.weight,
            outlier: r.median > limit,
            part: r.part,
        };
        residuals.iter().map(fit).collect()
    }
}

/// The residual above which a photograph stands out.
fn limit(mut residuals: Vec<f32>) -> f32 {
    if residuals.len() < OUTLIER_FROM {
        return f32::INFINITY;
    }
    let median = |values: &mut Vec<f32>| {
        values.sort_by(f32::total_cmp);
        values[(values.len() - 1) / 2]
    };
    let middle = median(&mut residuals);
    let mut off: Vec<f32> = residuals.iter().map(|r| (r - middle).abs()).collect();
    let sigma = MAD_TO_SIGMA * median(&mut off);
    (middle + OUTLIER_SIGMA * sigma).max(OUTLIER_RATIO * middle)
}

/// Maps and how far they may be off.
#[derive(Debug, Clone, PartialEq)]
pub struct Assessed {
    /// The maps.
    pub maps: Arc<Svbrdf>,
    /// Standard deviations of their errors.
    pub confidence: Confidence,
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
    /// What the fit is doing; `None` where it has nothing to do, or has not begun.
    pub phase: Option<Phase>,
}

/// Counters that grow with a session's state, to tell whether anything is new.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Revision {
    /// Grows with every change of progress and with every set of maps.
    pub state: u64,
    /// Sets of maps published so far.
    pub maps: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_out_is_above_the_limit() {
        assert_eq!(limit(vec![0.01, 0.01, 0.5]), f32::INFINITY);
        let limit_of = |values: &[f32]| limit(values.to_vec());
        assert!(limit_of(&[0.02, 0.021, 0.019, 0.2]) < 0.1);
        // Photographs that agree well do not differ enough to matter.
        assert!(limit_of(&[0.01, 0.01, 0.01, 0.012]) > 0.012);
        assert!(limit_of(&[0.02, 0.05, 0.03, 0.06]) > 0.06);
    }
}
