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
use super::model::Shot;
use super::radiometry::Photometry;
use super::squares::{Spread, Square, Squares};
use crate::calibration::Target;
use crate::geometry::Pose;
use crate::statistics::{MAD_TO_SIGMA, median};

/// Stripes: most and fewest per side of a photograph, least amplitude, and least share of the
/// squares' variance that they explain.
const MOST_STRIPES: usize = 12;
const LEAST_STRIPES: f64 = 1.2;
const STRIPE_AMPLITUDE: f64 = 0.04;
const STRIPE_SHARE: f64 = 0.7;
/// Fewest squares that reveal stripes or a fault of the whole light.
const SQUARES_MIN: usize = 24;
/// Light on places of the board: log of its brightness, standard deviations of its mean over the
/// photographs, least share of the board, fewest photographs.
const PLACE_LOG: f64 = 0.07;
const PLACE_SIGMAS: f64 = 4.0;
const PLACE_SHARE: f64 = 0.03;
const PLACE_PHOTOS: usize = 3;
/// A fixed light must lower the robust deviation to this ratio, while the flash must have moved this far, mm.
const STANDS_STILL: f64 = 0.6;
const MOVED_MM: f64 = 40.0;
/// A phone's flash is nearer to the camera than this, mm.
const NEAR_FLASH_MM: f64 = 100.0;
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

/// Squares of the board with additional light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LitPlaces {
    /// Share of the visible white squares.
    pub share: f64,
    /// Measured over expected brightness.
    pub ratio: f64,
    /// Centre of the squares, mm.
    pub board_mm: DVec2,
}

/// Deviation of a square from the light model.
struct Residual {
    white: bool,
    board_mm: DVec2,
    px: DVec2,
    /// Log of measured over expected value, mean over the channels.
    log: f64,
    /// Log of the linearised value over the albedo, mean over the channels.
    log_value: f64,
    /// `-ln cos` of the angle to the optical axis.
    u: f64,
    /// Angle between the half vector and the board's normal, degrees.
    half_deg: f64,
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
        lit_places: lit_places(target, &all, photos, known),
        stands_still: stands_still(&all, photos, known),
        glare: glare(&all, photos, known),
    }
}

/// A photograph with known light.
struct Lit<'a> {
    target: &'a Target,
    known: &'a Photometry,
    index: usize,
    pose: &'a Pose,
    exposure: f32,
    /// The flash in the camera's frame.
    offset: DVec3,
}

impl<'a> Lit<'a> {
    fn new(
        target: &'a Target,
        known: &'a Photometry,
        index: usize,
        (pose, squares): &'a (Pose, &Squares),
    ) -> Self {
        let shot = Shot { pose: *pose, turned: known.turned[index] };
        let offset = shot.offset(known.flash_offset_mm);
        Self { target, known, index, pose, exposure: squares.exposure, offset }
    }

    fn albedo(&self, white: bool) -> f64 {
        if white { self.target.white_albedo } else { self.target.black_albedo }
    }

    /// Squared tangent of the angle between the optical axis and a point of the board.
    fn tan2(&self, board_mm: DVec2) -> f64 {
        let point = self.pose.transform(board_mm.extend(0.0));
        (point.truncate() / point.z).length_squared()
    }

    /// Values of a square lit by flash and room, through a clean lens.
    fn clear(&self, white: bool, board_mm: DVec2) -> [f64; 3] {
        let known = self.known;
        let board = board_mm.extend(0.0);
        let to_light = self.pose.to_board(self.offset) - board;
        let lobe = known.lobe.at(self.pose.transform(board) - self.offset);
        let flash = known.reference_mm.powi(2) * to_light.z / to_light.length().powi(3) * lobe;
        let lens = known.vignetting.at(self.tan2(board_mm));
        std::array::from_fn(|c| {
            let ink = if white { 1.0 } else { known.black_ratio[c] };
            let scale = known.log_scale[self.index][c].exp() * self.albedo(white) * ink;
            scale * (flash + known.ambient[c]) * lens
        })
    }

    /// Stored values without the tone curve.
    fn undone(&self, value: [f32; 3]) -> [f64; 3] {
        let stored = value.map(|v| v * self.exposure);
        self.known.tone.undone(stored).map(|v| f64::from(v) / f64::from(self.exposure))
    }

    /// Logs of the low and high values of a square over the expected one.
    fn log_range(&self, spread: &Spread) -> [f64; 2] {
        let sum = |values: [f64; 3]| values.iter().sum::<f64>().max(1e-9).ln();
        let expected = sum(self.clear(spread.white, spread.board_mm));
        spread.range.map(|value| sum(self.undone(value)) - expected)
    }
}

fn residuals(
    target: &Target,
    index: usize,
    photo: &(Pose, &Squares),
    known: &Photometry,
) -> Vec<Residual> {
    let (pose, squares) = photo;
    let photo = Lit::new(target, known, index, photo);
    let (light, eye) = (pose.to_board(photo.offset), pose.camera_centre());
    let log_around = |square: &Square| f64::from(square.around[known.local_scale]).max(1e-9).ln();
    let count = squares.squares.len().max(1) as f64;
    let usual = squares.squares.iter().map(log_around).sum::<f64>() / count;
    // With a flash far from the camera, it may stand in for a light that does not move.
    let is_near = known.flash_offset_mm.length() < NEAR_FLASH_MM;
    let local_tone = if is_near { known.local_tone } else { 0.0 };
    let of = |square: &Square| {
        // Local tone mapping darkened the square by this.
        let darkened = local_tone * (log_around(square) - usual);
        let (tan2, albedo) = (photo.tan2(square.board_mm), photo.albedo(square.white));
        let undone = photo.undone(square.value.map(|v| v.unwrap_or(0.5)));
        let clear = photo.clear(square.white, square.board_mm);
        let (mut log, mut log_value, mut count) = (0.0, 0.0, 0.0);
        for c in (0..3).filter(|c| square.value[*c].is_some()) {
            let veiled = known.veil * f64::from(square.surround[c]);
            let expected = (1.0 - known.veil) * clear[c] + veiled;
            let value = undone[c];
            log += (value / expected).ln();
            log_value += (value / albedo).ln();
            count += 1.0;
        }
        (count > 0.0 && albedo > 0.0).then_some(Residual {
            white: square.white,
            board_mm: square.board_mm,
            px: square.px,
            log: log / count + darkened,
            log_value: log_value / count + darkened,
            u: 0.5 * (1.0 + tan2).ln(),
            half_deg: half_deg(light, eye, square.board_mm),
        })
    };
    squares.squares.iter().filter_map(of).filter(|r| r.log.is_finite()).collect()
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
    let mut places: Vec<(DVec2, Vec<[f64; 2]>)> = Vec::new();
    let mut add = |board_mm: DVec2, logs: [f64; 2]| match places
        .iter_mut()
        .find(|(at, _)| at.distance_squared(board_mm) < 1e-6)
    {
        Some((_, all)) => all.push(logs),
        None => places.push((board_mm, vec![logs])),
    };
    for (i, (photo, view)) in photos.iter().zip(views).enumerate() {
        photo.iter().filter(|r| r.white).for_each(|r| add(r.board_mm, [r.log; 2]));
        let lit = Lit::new(target, known, i, view);
        for spread in view.1.uneven.iter().filter(|s| s.white) {
            add(spread.board_mm, lit.log_range(spread));
        }
        // A clipped value is a lower bound. It is uninformative where the expected value is as high.
        for spread in view.1.clipped.iter().filter(|s| s.white) {
            let range = lit.log_range(spread);
            if range[0] > PLACE_LOG {
                add(spread.board_mm, range);
            }
        }
    }
    let seen: Vec<_> = places.iter().filter(|(_, logs)| logs.len() >= PLACE_PHOTOS).collect();
    let lit: Vec<(DVec2, f64)> = seen
        .iter()
        .filter_map(|(at, logs)| {
            let count = logs.len() as f64;
            let [low, high] = [0, 1].map(|k| logs.iter().map(|log| log[k]).sum::<f64>() / count);
            let variance =
                logs.iter().map(|log| (log[1] - high).powi(2)).sum::<f64>() / (count - 1.0);
            let least = logs.iter().map(|log| log[1]).fold(f64::INFINITY, f64::min);
            let clear = high > PLACE_LOG.max(PLACE_SIGMAS * (variance / count).sqrt());
            // A place with darker parts is dirt, or a part of the sample.
            (clear && least > 0.0 && low > -PLACE_LOG).then_some((*at, high))
        })
        .collect();
    let share = lit.len() as f64 / seen.len().max(1) as f64;
    let middle = lit.iter().map(|(at, _)| *at).sum::<DVec2>() / lit.len().max(1) as f64;
    let ratio = median(lit.iter().map(|(_, high)| *high))?.exp();
    (share > PLACE_SHARE && lit.len() > 1).then_some(LitPlaces { share, ratio, board_mm: middle })
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
    let rows: Vec<Vec<f64>> = white.iter().map(row).collect();
    let mut found = DVector::zeros(columns);
    let mut sigma = f64::INFINITY;
    for _ in 0..6 {
        let (mut normal, mut right) =
            (DMatrix::identity(columns, columns) * 1e-6, DVector::zeros(columns));
        for (row, (_, r)) in rows.iter().zip(&white) {
            let off = r.log_value - row.iter().zip(found.iter()).map(|(a, b)| a * b).sum::<f64>();
            let weight = if sigma.is_finite() { (1.5 * sigma / off.abs()).min(1.0) } else { 1.0 };
            for (j, a) in row.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                right[j] += weight * a * r.log_value;
                for (k, b) in row.iter().enumerate() {
                    normal[(j, k)] += weight * a * b;
                }
            }
        }
        found = normal.cholesky()?.solve(&right);
        let off = rows.iter().zip(&white).map(|(row, (_, r))| {
            (r.log_value - row.iter().zip(found.iter()).map(|(a, b)| a * b).sum::<f64>()).abs()
        });
        sigma = MAD_TO_SIGMA * median(off)?;
    }
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

/// Angle between half vector and normal at a point of the board, degrees.
fn half_deg(light: DVec3, eye: DVec3, board_mm: DVec2) -> f64 {
    let board = board_mm.extend(0.0);
    let half = (light - board).normalize() + (eye - board).normalize();
    half.normalize().z.clamp(-1.0, 1.0).acos().to_degrees()
}
