//! Finds the board's corners in a photograph, without knowing the camera.
//!
//! Coarse to fine: X-corners are found and joined on a small version of the picture, placed on the
//! known layout, tracked up to full size and completed there. If the small version does not show
//! the whole board, the next larger one is tried.

use super::blur::{self, EdgeSpread};
use super::corners;
use super::lattice;
use super::layout::{Labelling, Layout};
use super::luma::LumaImage;
use super::marker_reading;
use super::outline;
use super::placement::CORNERS_MIN;
use super::subpixel::Refiner;
use super::target::Target;
use crate::{BoardDifference, Rejection};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Long side of the smallest version, px.
const COARSE_PX: usize = 640;
/// Larger versions are not searched if this share of the visible corners is found.
const ENOUGH: f64 = 0.85;
/// Least share of the visible corners found.
const SHARE_MIN: f64 = 0.6;
/// The same if most of the board is out of view, where fewer corners support the placement.
const SHARE_MIN_PART: f64 = 0.85;
/// Largest share of grid points off the printed squares that may look like corners.
const PHANTOM_SHARE_MAX: f64 = 0.25;
/// Limits with agreeing markers: enough corners to determine a plane, with a margin.
const CORNERS_MIN_MARKED: usize = 6;
const SHARE_MIN_MARKED: f64 = 0.6;
/// Agreeing markers required per contradicting one.
const AGREE_MIN: usize = 4;
/// Edges softer than this part of a square, or of the picture's diagonal, are unusable.
const BLUR_CELLS_MAX: f64 = 0.22;
const BLUR_DIAGONAL_MAX: f64 = 0.005;

/// A corner of the board in a photograph.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Corner {
    /// Row of the grid point, as in [`Target::corners`].
    pub row: u32,
    /// Column of the grid point.
    pub col: u32,
    /// Position, px; (0, 0) is the centre of the top-left pixel.
    pub px: DVec2,
}

/// The detected board.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// Detected corners, in the order of [`Target::corners`].
    pub corners: Vec<Corner>,
    /// Edge spread (one sigma) in the board's softer direction, px. A sharp photo has about 0.7.
    pub blur_px: f64,
}

/// Finds the corners of `target`. A part of the board suffices if it fits one place only; with
/// legible markers, six corners on two sides suffice.
///
/// A full checkerboard (an empty hole, `row_start == row_end`) also works, for camera calibration.
/// If it is symmetric under a half-turn (rows + columns even), either labelling may result.
///
/// # Errors
/// [`Rejection::BoardNotFound`], [`Rejection::TooFewCorners`], [`Rejection::PlacementAmbiguous`],
/// [`Rejection::BoardDiffers`] or [`Rejection::Blurred`]; [`Rejection::NotFinite`] if a value is
/// not finite or the data do not fit the size.
pub fn detect(luma: &LumaImage, target: &Target) -> Result<Detection, Rejection> {
    let Sighting { corners, blur, rejection, .. } = sight(luma, target)?;
    match rejection {
        Some(rejection) => Err(rejection),
        None => Ok(Detection { corners, blur_px: blur.map_or(0.0, |s| s.px) }),
    }
}

/// A detected board, usable or not.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sighting {
    /// As in [`Detection`].
    pub corners: Vec<Corner>,
    /// Corners inside the picture according to the model.
    pub in_view: usize,
    /// Edge spread; `None` if no edge has both ends.
    pub blur: Option<EdgeSpread>,
    /// The reason if it is unusable.
    pub rejection: Option<Rejection>,
}

/// As [`detect`], but also returns the corners of an unusable board.
///
/// # Errors
/// As [`detect`] if nothing fits the board.
pub(crate) fn sight(luma: &LumaImage, target: &Target) -> Result<Sighting, Rejection> {
    // Folding whole blocks vectorises.
    let finite = |block: &[f32]| block.iter().fold(true, |all, v| all & v.is_finite());
    if luma.data.len() != luma.width * luma.height || !luma.data.chunks(4096).all(finite) {
        return Err(Rejection::NotFinite);
    }
    let layout = Layout::new(target);
    let best = search(&layout, luma)?;
    let in_view = best.corners as f64 / best.share.max(1e-3);
    let blur = blur::edge_spread(luma, &layout, &best.labelling);
    let (needed, share) = best.needed();
    let rejection = if best.corners < needed || best.share < share {
        let all = layout.corners.len();
        let of_share = (in_view * share).ceil() as usize;
        Some(Rejection::TooFewCorners {
            found: best.corners as u32,
            expected: all as u32,
            needed: of_share.clamp(needed, all) as u32,
        })
    } else if let Some(difference) = difference(&layout, luma, &best.labelling) {
        Some(Rejection::BoardDiffers(difference))
    } else {
        blur.and_then(|spread| too_soft(spread, luma, &layout, &best.labelling))
    };
    let labelling = best.labelling;
    let corners = layout
        .corners
        .iter()
        .zip(&labelling.px)
        .filter_map(|(&(row, col), px)| Some(Corner { row, col, px: (*px)? }))
        .collect();
    Ok(Sighting { corners, in_view: in_view.round() as usize, blur, rejection })
}

/// Difference between the pictured and the described board.
fn difference(layout: &Layout, luma: &LumaImage, labelling: &Labelling) -> Option<BoardDifference> {
    let Target { rows, cols, .. } = *layout.target;
    let missing = |side| BoardDifference::SquaresMissing { side, rows, cols };
    outline::missing(layout, luma, &labelling.model)
        .map(missing)
        .or_else(|| marker_reading::contradiction(layout, luma, labelling))
}

fn too_soft(
    spread: EdgeSpread,
    luma: &LumaImage,
    layout: &Layout,
    labelling: &Labelling,
) -> Option<Rejection> {
    let diagonal = (luma.width as f64).hypot(luma.height as f64);
    let limit = (BLUR_CELLS_MAX * layout.usual_cell(labelling)).min(BLUR_DIAGONAL_MAX * diagonal);
    let direction_deg = spread.direction_deg.map(|d| d as f32);
    (spread.px > limit).then_some(Rejection::Blurred { blur_px: spread.px as f32, direction_deg })
}

/// The best labelling of the board, from the smallest version that shows enough of it.
fn search(layout: &Layout, luma: &LumaImage) -> Result<Found, Rejection> {
    let mut smaller: Vec<LumaImage> = Vec::new();
    loop {
        let last = smaller.last().unwrap_or(luma);
        if last.width.max(last.height) <= COARSE_PX || last.width.min(last.height) < 200 {
            break;
        }
        smaller.push(last.halved());
    }
    let levels: Vec<&LumaImage> = std::iter::once(luma).chain(&smaller).collect();
    let mut refiner = Refiner::default();
    let mut best: Option<Found> = None;
    let mut rejection = Rejection::BoardNotFound;
    'levels: for k in (0..levels.len()).rev() {
        let saddles = corners::find(levels[k]);
        let pieces = lattice::grow(levels[k], &saddles);
        for by_markers in [true, false] {
            let placed = if by_markers {
                marker_reading::place(layout, &levels, k, &pieces).ok_or(rejection)
            } else {
                layout.place(levels[k], &pieces)
            };
            let mut labelling = match placed {
                Ok(labelling) => labelling,
                Err(reason) => {
                    rejection = more_informative(rejection, reason);
                    continue;
                }
            };
            if by_markers {
                layout.extend(&mut refiner, levels[k], &mut labelling);
            }
            for finer in (0..=k).rev() {
                if finer < k {
                    follow(&mut labelling, levels[finer]);
                }
                layout.refine(&mut refiner, levels[finer], &mut labelling);
                layout.extend(&mut refiner, levels[finer], &mut labelling);
            }
            layout.refine(&mut refiner, luma, &mut labelling);
            let found = Found::new(layout, luma, labelling);
            // Markers contradict, or the checkerboard continues outside its printed area.
            if found.agree < AGREE_MIN * found.differ
                || layout.phantom_share(&mut refiner, luma, &found.labelling) > PHANTOM_SHARE_MAX
            {
                continue;
            }
            if best.as_ref().is_none_or(|b| found.corners > b.corners) {
                best = Some(found);
            }
            if best.as_ref().is_some_and(|b| b.share >= ENOUGH && b.corners >= b.needed().0) {
                break 'levels;
            }
        }
    }
    best.ok_or(rejection)
}

/// A labelling at full size and its evidence.
struct Found {
    labelling: Labelling,
    corners: usize,
    /// Share of the corners in view.
    share: f64,
    /// Markers that agree with the labelling, and markers that contradict it.
    agree: usize,
    differ: usize,
}

impl Found {
    fn new(layout: &Layout, luma: &LumaImage, labelling: Labelling) -> Self {
        let visible = layout.visible(luma, &labelling.model);
        let seen = visible.iter().filter(|v| **v).count();
        let corners = labelling.count();
        let (agree, differ) = marker_reading::agreement(layout, luma, &labelling);
        Self { corners, share: corners as f64 / seen.max(1) as f64, agree, differ, labelling }
    }

    /// Least number of corners, and least share of the visible ones.
    fn needed(&self) -> (usize, f64) {
        if self.agree >= marker_reading::VOTES_MIN {
            return (CORNERS_MIN_MARKED, SHARE_MIN_MARKED);
        }
        // Interpolates between a third and two thirds of the board.
        let all = self.labelling.px.len() as f64;
        let part = (3.0 * self.corners as f64 / all - 1.0).clamp(0.0, 1.0);
        (CORNERS_MIN, SHARE_MIN_PART + part * (SHARE_MIN - SHARE_MIN_PART))
    }
}

/// Transfers a labelling to the version of twice the size.
fn follow(labelling: &mut Labelling, finer: &LumaImage) {
    labelling.model = labelling.model.doubled((finer.width, finer.height));
    for px in labelling.px.iter_mut().flatten() {
        *px = 2.0 * *px + 0.5;
    }
}

/// The more informative reason.
fn more_informative(a: Rejection, b: Rejection) -> Rejection {
    let corners = |r: &Rejection| match r {
        Rejection::TooFewCorners { found, .. } | Rejection::PlacementAmbiguous { found } => *found,
        _ => 0,
    };
    if corners(&b) > corners(&a) { b } else { a }
}
