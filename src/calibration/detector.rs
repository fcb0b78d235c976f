//! Finds the board's corners in a photograph, without knowing the camera.
//!
//! Coarse to fine: X-corners are found and joined on a small version of the picture, placed on the
//! known layout, followed down to full size, and completed there. When the small version does not
//! show the whole board, the next larger one is tried.

use super::blur;
use super::corners;
use super::lattice;
use super::layout::{CORNERS_MIN, Labelling, Layout};
use super::luma::LumaImage;
use super::subpixel::Refiner;
use super::target::Target;
use crate::Rejection;
use glam::DVec2;

/// Long side of the smallest version searched, px.
const COARSE_PX: usize = 640;
/// With this share of the corners in view, larger versions are not searched.
const ENOUGH: f64 = 0.85;
/// Share of the corners in view that must be found.
const SHARE_MIN: f64 = 0.6;
/// Edges softer than this part of a square, or of the picture's diagonal, are of no use.
const BLUR_CELLS_MAX: f64 = 0.22;
const BLUR_DIAGONAL_MAX: f64 = 0.005;

/// A corner of the board in a photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Row of the grid point, as in [`Target::corners`].
    pub row: u32,
    /// Column of the grid point.
    pub col: u32,
    /// Position, px; (0, 0) is the centre of the top-left pixel.
    pub px: DVec2,
}

/// The board as found in a photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// Corners, in the order of [`Target::corners`]; those not found are left out.
    pub corners: Vec<Corner>,
    /// Edge spread (one sigma) in the board's softer direction, px. A sharp photo has about 0.7.
    pub blur_px: f64,
}

/// Finds the corners of a valid `target`. Works for a part of the board too, as long as what is
/// seen fits in one place only.
///
/// # Errors
/// [`Rejection::BoardNotFound`], [`Rejection::TooFewCorners`] or [`Rejection::Blurred`].
pub fn detect(luma: &LumaImage, target: &Target) -> Result<Detection, Rejection> {
    let layout = Layout::new(target);
    let mut smaller: Vec<LumaImage> = Vec::new();
    loop {
        let last = smaller.last().unwrap_or(luma);
        if last.width.max(last.height) <= COARSE_PX || last.width.min(last.height) < 200 {
            break;
        }
        smaller.push(last.halved());
    }
    let level = |k: usize| if k == 0 { luma } else { &smaller[k - 1] };

    let mut refiner = Refiner::default();
    let mut best: Option<(f64, Labelling)> = None;
    let mut rejection = Rejection::BoardNotFound;
    for k in (0..=smaller.len()).rev() {
        match search(&layout, level(k)) {
            Ok(mut labelling) => {
                for finer in (0..=k).rev() {
                    if finer < k {
                        follow(&mut labelling, level(finer));
                    }
                    layout.refine(&mut refiner, level(finer), &mut labelling);
                    layout.extend(&mut refiner, level(finer), &mut labelling);
                }
                layout.refine(&mut refiner, luma, &mut labelling);
                let visible = layout.visible(luma, &labelling.model);
                let seen = visible.iter().filter(|v| **v).count();
                let share = labelling.count() as f64 / seen.max(1) as f64;
                if best.as_ref().is_none_or(|b| labelling.count() > b.1.count()) {
                    best = Some((share, labelling));
                }
                if best.as_ref().is_some_and(|b| b.0 >= ENOUGH && b.1.count() >= CORNERS_MIN) {
                    break;
                }
            }
            Err(reason) => rejection = more_telling(rejection, reason),
        }
    }
    let Some((share, labelling)) = best else { return Err(rejection) };
    let found = labelling.count();
    if found < CORNERS_MIN || share < SHARE_MIN {
        let needed = (found as f64 / share.max(1e-3) * SHARE_MIN).ceil() as usize;
        return Err(Rejection::TooFewCorners {
            found: found as u32,
            expected: layout.corners.len() as u32,
            needed: needed.clamp(CORNERS_MIN, layout.corners.len()) as u32,
        });
    }
    let blur_px = blur::edge_spread(luma, &layout, &labelling).unwrap_or(0.0);
    let diagonal = (luma.width as f64).hypot(luma.height as f64);
    let limit = (BLUR_CELLS_MAX * layout.usual_cell(&labelling)).min(BLUR_DIAGONAL_MAX * diagonal);
    if blur_px > limit {
        return Err(Rejection::Blurred { blur_px: blur_px as f32 });
    }
    let corners = layout
        .corners
        .iter()
        .zip(&labelling.px)
        .filter_map(|(&(row, col), px)| Some(Corner { row, col, px: (*px)? }))
        .collect();
    Ok(Detection { corners, blur_px })
}

/// One level: corners, lattice, placement.
fn search(layout: &Layout, level: &LumaImage) -> Result<Labelling, Rejection> {
    let saddles = corners::find(level);
    let pieces = lattice::grow(level, &saddles);
    layout.place(level, &pieces)
}

/// Carries a labelling to the version of twice the size.
fn follow(labelling: &mut Labelling, finer: &LumaImage) {
    labelling.model = labelling.model.doubled((finer.width, finer.height));
    for px in labelling.px.iter_mut().flatten() {
        *px = 2.0 * *px + 0.5;
    }
}

/// The reason that says more.
fn more_telling(a: Rejection, b: Rejection) -> Rejection {
    let corners = |r: &Rejection| match r {
        Rejection::TooFewCorners { found, .. } => *found,
        _ => 0,
    };
    if corners(&b) > corners(&a) { b } else { a }
}
