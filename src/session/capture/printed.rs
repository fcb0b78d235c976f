//! Which board is printed, where it is not quite the one described.
//!
//! The first photograph decides: where it does not show the board described, it is looked for with the other colour at
//! its top left, and with markers that name nothing. Squares alone then place it.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::calibration::{
    self, Corner, Detection, LumaImage, MarkersRead, Target, TargetKind, TopLeft,
};
use crate::{BoardDifference, Rejection};

/// Side of markers that are not described, relative to their squares: what generators print is smaller.
const MARKER_SHARE: f64 = 0.8;
/// Markers that name the board's.
const READ_MIN: usize = 6;

/// How the print differs from its description.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Printed {
    /// Not at all, as far as is known.
    #[default]
    AsDescribed,
    /// White and black are exchanged, as older generators of boards with markers print them.
    Exchanged,
    /// White squares hold other markers than described.
    OtherMarkers(Markers),
}

/// Markers as they are read, as far as they can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Markers {
    /// The square that has the first one described would have this one.
    first: Option<i32>,
    /// Modules along a side of those read, without the border; 0: none was.
    inner: u32,
    /// How many were read.
    count: u32,
}

impl Printed {
    /// The board that is printed.
    pub fn target(&self, described: &Target) -> Target {
        let kind = match (self, &described.kind) {
            (Self::OtherMarkers(_), _) => {
                let marker_mm = match described.kind {
                    TargetKind::CharucoRing { marker_mm, .. } => marker_mm,
                    TargetKind::CheckerboardRing => MARKER_SHARE * described.square_mm,
                };
                // Not in any dictionary: only squares are looked for.
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

    /// What there is to tell about it.
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

/// The board in a photograph that does not show it as described: how it is printed, and where it is.
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
    // Something else is the matter.
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

/// Whether markers name the squares of a board as they are found.
fn is_confirmed(luma: &LumaImage, target: &Target, corners: &[Corner]) -> bool {
    let read = markers(luma, target, corners);
    read.count >= READ_MIN && read.first == Some(0)
}

/// Whether another print may be the reason of a rejection.
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
