//! Differences of the printed board from its description.
//!
//! The first photograph decides. If it does not show the described board, the detector tries exchanged colours, then
//! unknown markers, with which the squares alone determine the placement.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::calibration::{
    self, Corner, Detection, LumaImage, MarkersRead, Target, TargetKind, TopLeft,
};
use crate::{BoardDifference, Rejection};

/// Assumed side of markers that are not described, relative to their squares. Generators print smaller ones.
const MARKER_SHARE: f64 = 0.8;
/// Fewest markers that confirm a board.
const READ_MIN: usize = 6;

/// Difference of a print from its description.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Printed {
    /// No known difference.
    #[default]
    AsDescribed,
    /// White and black are exchanged, as in prints of older generators.
    Exchanged,
    /// White squares hold other markers than described.
    OtherMarkers(Markers),
}

/// Markers as they are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Markers {
    /// The marker in the square that is described to have the first one, if the markers agree.
    first: Option<i32>,
    /// Modules along a side without the border; 0 if none was read.
    inner: u32,
    /// Number of markers that were read.
    count: u32,
}

impl Printed {
    /// The printed board.
    pub fn target(&self, described: &Target) -> Target {
        let kind = match (self, &described.kind) {
            (Self::OtherMarkers(_), _) => {
                let marker_mm = match described.kind {
                    TargetKind::CharucoRing { marker_mm, .. } => marker_mm,
                    TargetKind::CheckerboardRing => MARKER_SHARE * described.square_mm,
                };
                // No dictionary: only squares are detected.
                TargetKind::CharucoRing { dictionary: String::new(), marker_mm }
            }
            (_, kind) => kind.clone(),
        };
        let top_left = match (self, described.top_left) {
            (Self::Exchanged, TopLeft::Black) => TopLeft::White,
            (Self::Exchanged, TopLeft::White) => TopLeft::Black,
            (_, stated) => stated,
        };
        Target { kind, top_left, ..described.clone() }
    }

    /// The difference as reported to callers.
    pub fn difference(&self, described: &Target) -> Option<BoardDifference> {
        match *self {
            Self::AsDescribed => None,
            Self::Exchanged => Some(BoardDifference::ColoursExchanged),
            Self::OtherMarkers(Markers { first, inner, count }) => Some(match described.kind {
                TargetKind::CheckerboardRing => BoardDifference::MarkersNotDescribed,
                TargetKind::CharucoRing { .. } => match first {
                    Some(first) => BoardDifference::MarkersShifted { first, inner },
                    None => BoardDifference::MarkersUnknown { count },
                },
            }),
        }
    }
}

/// Detects a board that is not printed as described: the difference, and the corners.
pub fn look(luma: &LumaImage, described: &Target) -> Option<(Printed, Detection)> {
    let with_markers = matches!(described.kind, TargetKind::CharucoRing { .. });
    let exchanged = Printed::Exchanged;
    if with_markers
        && let Ok(found) = calibration::detect(luma, &exchanged.target(described))
        && is_confirmed(luma, &exchanged.target(described), &found.corners)
    {
        return Some((exchanged, found));
    }
    let silent = Printed::OtherMarkers(Markers { first: None, inner: 0, count: 0 });
    let target = silent.target(described);
    let found = calibration::detect(luma, &target).ok()?;
    let read = markers(luma, &target, &found.corners);
    if !with_markers && read.count < READ_MIN {
        return None;
    }
    let MarkersRead { first, inner, count } = read;
    let as_described = match &described.kind {
        TargetKind::CharucoRing { dictionary, .. } => {
            first == Some(0) && dictionary.starts_with(&format!("DICT_{inner}X{inner}_"))
        }
        TargetKind::CheckerboardRing => false,
    };
    // The markers are right: the board was missed for another reason.
    if as_described {
        return None;
    }
    Some((Printed::OtherMarkers(Markers { first, inner, count: count as u32 }), found))
}

fn markers(luma: &LumaImage, target: &Target, corners: &[Corner]) -> MarkersRead {
    let at = |c: &Corner| (DVec2::new(c.col.into(), c.row.into()), c.px);
    let (grid, px): (Vec<_>, Vec<_>) = corners.iter().map(at).unzip();
    calibration::read_markers(luma, target, &grid, &px)
}

/// Whether the markers agree with the placement of the corners.
fn is_confirmed(luma: &LumaImage, target: &Target, corners: &[Corner]) -> bool {
    let read = markers(luma, target, corners);
    read.count >= READ_MIN && read.first == Some(0)
}

/// Whether a different print may have caused a rejection.
pub fn may_explain(rejection: &Rejection) -> bool {
    matches!(
        rejection,
        Rejection::BoardNotFound
            | Rejection::TooFewCorners { .. }
            | Rejection::PlacementAmbiguous { .. }
            | Rejection::BoardDiffers(
                BoardDifference::MarkersElsewhere { .. } | BoardDifference::MarkersUnknown { .. }
            )
    )
}
