//! Faults of the light: deviations of the squares that the light model cannot explain.
//!
//! Each fault has its own model and is reported if that model explains the squares much better:
//! stripes along rows or columns of a photograph, light fixed to places of the board, or a light
//! that does not move with the camera. Places that such light covers in part or saturates also
//! count, because a stripe of sun is often narrower than a square.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use nalgebra::{DMatrix, DVector};

use super::fit;
use super::lamp::{self, LitPlaces};
use super::model::Shot;
use super::radiometry::Photometry;
use super::residuals::{Lit, Residual, SQUARES_MIN, half_deg, residuals, robust};
use super::squares::Squares;
use crate::calibration::Target;
use crate::geometry::Pose;
use crate::statistics::{MAD_TO_SIGMA, median};

/// Stripes: most and fewest per side of a photograph, least amplitude, and least share of the
/// squares' variance that they explain.
const MOST_STRIPES: usize = 12;
const LEAST_STRIPES: f64 = 1.2;
const STRIPE_AMPLITUDE: f64 = 0.04;
const STRIPE_SHARE: f64 = 0.7;
/// Light on places of the board: log of its brightness, standard deviations of its mean over the
/// photographs, least share of the board, fewest photographs.
const PLACE_LOG: f64 = 0.07;
const PLACE_SIGMAS: f64 = 4.0;
const PLACE_SHARE: f64 = 0.03;
/// The same log of black squares, whose ink varies, and the least share of all squares, white and black.
const INK_LOG: f64 = 0.25;
const STRIPE_PLACES: f64 = 0.02;
const PLACE_PHOTOS: usize = 3;
/// A fixed light must lower the robust deviation to this ratio, while the flash must have moved this far, mm.
const STANDS_STILL: f64 = 0.6;
const MOVED_MM: f64 = 40.0;
/// Squares within this angle of the mirror direction may glare, degrees.
const GLARE_DEG: f64 = 10.0;
/// Black squares this much too bright (log) glare. Glare is the print's fault from this number and
/// this share of the squares near the mirror direction on, unless squares elsewhere deviate too.
const GLARE_LOG: f64 = 0.3;
const GLARE_MIN: f64 = 4.0;
const GLARE_SHARE: f64 = 0.3;
const GLARE_ELSEWHERE: f64 = 0.3;

/// Faults of a capture's light.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Examination {
    /// One entry per photograph.
    pub photos: Vec<PhotoLight>,
    /// Squares brighter than the flash explains in all photographs.
    pub lit_places: Option<LitPlaces>,
    /// Deviation with the flash over that with a fixed light, if the latter explains the squares clearly better.
    pub stands_still: Option<f64>,
    /// Share of the squares near the mirrored flash that glare, if significant.
    pub glare: Option<f64>,
}

/// Faults of one photograph's light.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct PhotoLight {
    /// Relative amplitude of bright and dark stripes, if any.
    pub stripes: Option<f64>,
}

/// Examines photographs with known light.
pub(crate) fn examine(
    target: &Target,
    photos: &[(Pose, &Squares)],
    known: &Photometry,
) -> Examination {
    let all: Vec<Vec<Residual>> =
        photos.iter().enumerate().map(|(i, photo)| residuals(target, i, photo, known)).collect();
    let photo = |residuals: &Vec<Residual>| PhotoLight { stripes: stripes(residuals) };
    Examination {
        photos: all.iter().map(photo).collect(),
        lit_places: lit_places(target, &all, photos, known)
            .or_else(|| lamp::find(target, &all, known)),
        stands_still: stands_still(&all, photos, known),
        glare: glare(&all, photos, known),
    }
}

/// Amplitude of the sine along rows or columns that explains most of the residuals.
fn stripes(residuals: &[Residual]) -> Option<f64> {
    let white: Vec<&Residual> = residuals.iter().filter(|r| r.white).collect();
    if white.len() < SQUARES_MIN {
        return None;
    }
    let values = DVector::from_iterator(white.len(), white.iter().map(|r| r.log));
    let explained = |along: fn(&Residual) -> f64, stripes: f64| {
        let (low, high) = white
            .iter()
            .fold((f64::MAX, f64::MIN), |(low, high), r| (low.min(along(r)), high.max(along(r))));
        let rows = DMatrix::from_fn(white.len(), 3, |i, k| {
            let phase = 2.0 * PI * stripes * (along(white[i]) - low) / (high - low).max(1.0);
            [1.0, phase.cos(), phase.sin()][k]
        });
        let found = (rows.transpose() * &rows).try_inverse()? * (rows.transpose() * &values);
        let left = (&values - rows * &found).norm_squared();
        Some((left, found[1].hypot(found[2])))
    };
    let mean = values.mean();
    let all = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    let counts = (0..)
        .map(|i| LEAST_STRIPES + 0.2 * f64::from(i))
        .take_while(|stripes| *stripes <= MOST_STRIPES as f64);
    let axes: [fn(&Residual) -> f64; 2] = [|r| r.px.x, |r| r.px.y];
    let tried = counts.flat_map(|count| axes.map(|along| explained(along, count)));
    let (left, amplitude) = tried.flatten().min_by(|a, b| a.0.total_cmp(&b.0))?;
    (amplitude > STRIPE_AMPLITUDE && left < (1.0 - STRIPE_SHARE) * all).then_some(amplitude)
}

/// Places of the board that are brighter than the flash explains, at least in part, in all photographs.
fn lit_places(
    target: &Target,
    photos: &[Vec<Residual>],
    views: &[(Pose, &Squares)],
    known: &Photometry,
) -> Option<LitPlaces> {
    let mut places: Vec<Place> = Vec::new();
    let mut add = |white: bool, board_mm: DVec2, logs: [f64; 2]| match places
        .iter_mut()
        .find(|place| place.board_mm.distance_squared(board_mm) < 1e-6)
    {
        Some(place) => place.logs.push(logs),
        None => places.push(Place { white, board_mm, logs: vec![logs] }),
    };
    for (i, (photo, view)) in photos.iter().zip(views).enumerate() {
        photo.iter().for_each(|r| add(r.white, r.board_mm, [r.log; 2]));
        let lit = Lit::new(target, known, i, view);
        for spread in &view.1.uneven {
            add(spread.white, spread.board_mm, lit.log_range(spread));
        }
        // A clipped value is a lower bound. It is uninformative where the expected value is as high.
        for spread in view.1.clipped.iter().filter(|s| s.white) {
            let range = lit.log_range(spread);
            if range[0] > PLACE_LOG {
                add(true, spread.board_mm, range);
            }
        }
    }
    places.retain(|place| place.logs.len() >= PLACE_PHOTOS);
    let white = || places.iter().filter(|place| place.white);
    let lit: Vec<(DVec2, f64)> =
        white().filter_map(|place| Some((place.board_mm, place.lit()?))).collect();
    let share = lit.len() as f64 / white().count().max(1) as f64;
    // A narrow stripe lights few white squares, and black ones between them.
    let all = places.iter().filter(|place| place.lit().is_some()).count();
    let enough = share > PLACE_SHARE || all as f64 > STRIPE_PLACES * places.len() as f64;
    let middle = lit.iter().map(|(at, _)| *at).sum::<DVec2>() / lit.len().max(1) as f64;
    let ratio = median(lit.iter().map(|(_, high)| *high))?.exp();
    (enough && lit.len() > 1).then_some(LitPlaces { smooth: false, share, ratio, board_mm: middle })
}

/// A square in all photographs.
struct Place {
    white: bool,
    board_mm: DVec2,
    /// Logs of low and high values over the expected ones.
    logs: Vec<[f64; 2]>,
}

impl Place {
    /// Log of the brightness, if it is higher than expected in all photographs.
    fn lit(&self) -> Option<f64> {
        let Self { white, logs, .. } = self;
        let least_log = if *white { PLACE_LOG } else { INK_LOG };
        let count = logs.len() as f64;
        let [low, high] = [0, 1].map(|k| logs.iter().map(|log| log[k]).sum::<f64>() / count);
        let variance = logs.iter().map(|log| (log[1] - high).powi(2)).sum::<f64>() / (count - 1.0);
        let least = logs.iter().map(|log| log[1]).fold(f64::INFINITY, f64::min);
        let clear = high > least_log.max(PLACE_SIGMAS * (variance / count).sqrt());
        // A place with darker parts is dirt, or a part of the sample.
        (clear && least > 0.0 && low > -least_log).then_some(high)
    }
}

/// Whether a light fixed to the board explains the white squares better.
fn stands_still(
    photos: &[Vec<Residual>],
    views: &[(Pose, &Squares)],
    known: &Photometry,
) -> Option<f64> {
    let lights = || views.iter().map(|(pose, _)| pose.to_board(known.flash_offset_mm));
    let moved = lights().any(|a| lights().any(|b: DVec3| a.distance(b) > MOVED_MM));
    let white: Vec<(usize, &Residual)> = photos
        .iter()
        .enumerate()
        .flat_map(|(i, photo)| photo.iter().filter(|r| r.white).map(move |r| (i, r)))
        .collect();
    if !moved || white.len() < SQUARES_MIN * photos.len().min(2) {
        return None;
    }
    // Unknowns: one scale per photograph, a smooth field on the board, a lens.
    let columns = photos.len() + 7;
    let row = |&(photo, r): &(usize, &Residual)| {
        let p = r.board_mm / 100.0;
        let field = [p.x, p.y, p.x * p.x, p.x * p.y, p.y * p.y, r.u, r.u * r.u];
        let own = (0..photos.len()).map(move |i| f64::from(u8::from(i == photo)));
        own.chain(field).collect::<Vec<f64>>()
    };
    let rows: Vec<(Vec<f64>, f64)> = white.iter().map(|w| (row(w), w.1.log_value)).collect();
    let (_, sigma) = robust(&rows, columns, 1e-6)?;
    let flash = MAD_TO_SIGMA * median(white.iter().map(|(_, r)| r.log.abs()))?;
    let ratio = sigma.max(fit::TONE_MIN_SIGMA) / flash.max(fit::TONE_MIN_SIGMA);
    (ratio < STANDS_STILL).then_some(ratio.recip())
}

/// Share of the squares near the mirror direction that glare (black squares much too bright, or
/// uneven squares), unless squares elsewhere do too.
fn glare(photos: &[Vec<Residual>], views: &[(Pose, &Squares)], known: &Photometry) -> Option<f64> {
    let (mut near, mut far) = ([0.0_f64; 2], [0.0_f64; 2]);
    let mut count = |half_deg: f64, odd: bool| {
        let to = if half_deg < GLARE_DEG { &mut near } else { &mut far };
        if !(GLARE_DEG..=2.0 * GLARE_DEG).contains(&half_deg) {
            *to = [to[0] + 1.0, to[1] + f64::from(u8::from(odd))];
        }
    };
    for (i, (photo, (pose, squares))) in photos.iter().zip(views).enumerate() {
        photo.iter().for_each(|r| count(r.half_deg, !r.white && r.log > GLARE_LOG));
        let shot = Shot { pose: *pose, turned: known.turned[i] };
        let light = pose.to_board(shot.offset(known.flash_offset_mm));
        let eye = pose.camera_centre();
        squares.uneven.iter().for_each(|s| count(half_deg(light, eye, s.board_mm), true));
    }
    let [near, far] = [near, far].map(|[all, odd]| (odd, odd / f64::max(all, 1.0)));
    (near.0 >= GLARE_MIN && near.1 > GLARE_SHARE && far.1 < GLARE_ELSEWHERE * near.1)
        .then_some(near.1)
}
