//! A lamp or a window beside the flash: smooth light on the board that does not move with the camera.
//!
//! Relative to the flash at the reference, a square of photograph `i` has the value
//! `(flash(x) + lamp(x)) * lens / scale_i`. With the lamp as a polynomial of the place on the board, and small
//! corrections of flash and lens, the model is linear.

use glam::DVec2;

use super::radiometry::Photometry;
use super::residuals::{Residual, SQUARES_MIN, robust};
use crate::calibration::Target;
use crate::statistics::{MAD_TO_SIGMA, median};

/// The deviation with a lamp must be this share of that without one at most, which must be at least this.
const BETTER: f64 = 0.5;
const LEAST_SIGMA: f64 = 0.006;
/// Smallest deviation counted: paper is not perfect.
const FLOOR: f64 = 0.003;
/// Least light of a lamp relative to the flash where it is brightest, and least variation over the board: even
/// light is room light, which is estimated.
const BRIGHTEST: f64 = 0.06;
const VARIATION: f64 = 0.04;
/// Least light relative to the flash of a lit square.
const LIT: f64 = 0.03;
const PHOTOGRAPHS: usize = 3;
/// Keeps lens and lamp from cancelling each other.
const RIDGE: f64 = 3e-4;
/// Unknowns besides the scales: lamp (6), lens (2), flash (2).
const SHARED: usize = 10;

/// Squares of the board with additional light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LitPlaces {
    /// Whether a smooth light explains them all, as that of a lamp or a window.
    pub smooth: bool,
    /// Share of the visible white squares.
    pub share: f64,
    /// Measured over expected brightness.
    pub ratio: f64,
    /// Centre of the squares, mm.
    pub board_mm: DVec2,
}

/// The squares that a lamp lights, if one explains the white squares much better.
pub(super) fn find(
    target: &Target,
    photos: &[Vec<Residual>],
    known: &Photometry,
) -> Option<LitPlaces> {
    let white: Vec<(usize, &Residual)> = photos
        .iter()
        .enumerate()
        .flat_map(|(i, photo)| photo.iter().filter(|r| r.white).map(move |r| (i, r)))
        .collect();
    if photos.len() < PHOTOGRAPHS || white.len() < SQUARES_MIN * photos.len() {
        return None;
    }
    let before = MAD_TO_SIGMA * median(white.iter().map(|(_, r)| r.log.abs()))?;
    if before < LEAST_SIGMA {
        return None;
    }
    let side = target.square_mm * f64::from(target.rows.max(target.cols));
    let columns = photos.len() + SHARED;
    // Each row is divided by the flash, so that its deviation is relative.
    let row = |&(photo, r): &(usize, &Residual)| {
        let lens = known.vignetting.at((2.0 * r.u).exp() - 1.0);
        let scale = known.log_scale[photo].iter().sum::<f64>() / 3.0;
        let value = (r.log_value - r.darkened - scale).exp() / lens;
        let own = (0..photos.len()).map(move |i| if i == photo { value / r.flash } else { 0.0 });
        let lamp = lamp(r.board_mm / side).map(|term| -term / r.flash);
        let [x, y] = r.flash_slopes.map(|slope| -slope / r.flash);
        own.chain(lamp).chain([-r.u, -r.u * r.u, x, y]).collect::<Vec<f64>>()
    };
    let rows: Vec<(Vec<f64>, f64)> = white.iter().map(|w| (row(w), 1.0)).collect();
    let (found, sigma) = robust(&rows, columns, RIDGE)?;
    if sigma.max(FLOOR) > BETTER * before {
        return None;
    }
    let terms = found.rows(photos.len(), 6);
    let light = |board_mm: DVec2| {
        lamp(board_mm / side).iter().zip(terms.iter()).map(|(a, b)| a * b).sum::<f64>()
    };
    let shares: Vec<(DVec2, f64)> =
        white.iter().map(|(_, r)| (r.board_mm, light(r.board_mm) / r.flash)).collect();
    let range = shares.iter().map(|(at, _)| light(*at));
    let (low, high) = range.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    let is_lamp = high > BRIGHTEST && high - low > VARIATION && low > -0.5 * high;
    let lit = || shares.iter().filter(|(_, share)| *share > LIT);
    let weight = |at: DVec2| (light(at) - low).powi(2);
    let total = lit().map(|(at, _)| weight(*at)).sum::<f64>();
    let middle = lit().map(|(at, _)| *at * weight(*at)).sum::<DVec2>() / total.max(1e-12);
    is_lamp.then_some(LitPlaces {
        smooth: true,
        share: lit().count() as f64 / shares.len() as f64,
        ratio: 1.0 + median(lit().map(|(_, share)| *share))?,
        board_mm: middle,
    })
}

/// Terms of the lamp's light at a place, in sides of the board.
fn lamp(p: DVec2) -> [f64; 6] {
    [1.0, p.x, p.y, p.x * p.x, p.x * p.y, p.y * p.y]
}
