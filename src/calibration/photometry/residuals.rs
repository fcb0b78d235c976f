//! Deviations of squares from the model of light, and robust fits to them.

use glam::{DVec2, DVec3};
use nalgebra::{DMatrix, DVector};

use super::model::Shot;
use super::radiometry::Photometry;
use super::squares::{Spread, Square, Squares};
use crate::calibration::Target;
use crate::geometry::Pose;
use crate::statistics::{MAD_TO_SIGMA, median};

/// Fewest squares that reveal stripes or a fault of the whole light.
pub(super) const SQUARES_MIN: usize = 24;
/// A phone's flash is nearer to the camera than this, mm.
const NEAR_FLASH_MM: f64 = 100.0;

/// Deviation of a square from the light model.
pub(super) struct Residual {
    pub white: bool,
    pub board_mm: DVec2,
    pub px: DVec2,
    /// Log of measured over expected value, mean over the channels.
    pub log: f64,
    /// Log of the linearised value over the albedo, mean over the channels.
    pub log_value: f64,
    /// Darkening by local tone mapping that was undone in both.
    pub darkened: f64,
    /// Irradiance by the flash relative to that at the reference, with its lobe, and its derivatives by the flash's
    /// position along the axes of the camera, 1/mm.
    pub flash: f64,
    pub flash_slopes: [f64; 2],
    /// `-ln cos` of the angle to the optical axis.
    pub u: f64,
    /// Angle between the half vector and the board's normal, degrees.
    pub half_deg: f64,
}

/// A photograph with known light.
pub(super) struct Lit<'a> {
    target: &'a Target,
    known: &'a Photometry,
    index: usize,
    pose: &'a Pose,
    exposure: f32,
    /// The flash in the camera's frame.
    offset: DVec3,
}

impl<'a> Lit<'a> {
    pub fn new(
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

    /// Irradiance by a flash at a place in the camera's frame, relative to that at the reference.
    fn flash(&self, offset: DVec3, board_mm: DVec2) -> f64 {
        let board = board_mm.extend(0.0);
        let to_light = self.pose.to_board(offset) - board;
        let lobe = self.known.lobe.at(self.pose.transform(board) - offset);
        self.known.reference_mm.powi(2) * to_light.z / to_light.length().powi(3) * lobe
    }

    /// Values of a square lit by flash and room, through a clean lens.
    fn clear(&self, white: bool, board_mm: DVec2) -> [f64; 3] {
        let known = self.known;
        let flash = self.flash(self.offset, board_mm);
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
    pub fn log_range(&self, spread: &Spread) -> [f64; 2] {
        let sum = |values: [f64; 3]| values.iter().sum::<f64>().max(1e-9).ln();
        let expected = sum(self.clear(spread.white, spread.board_mm));
        spread.range.map(|value| sum(self.undone(value)) - expected)
    }
}

/// Deviations of the squares of a photograph.
pub(super) fn residuals(
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
        let flash = photo.flash(photo.offset, square.board_mm);
        let moved = |by: DVec3| photo.flash(photo.offset + by, square.board_mm) - flash;
        (count > 0.0 && albedo > 0.0).then_some(Residual {
            white: square.white,
            board_mm: square.board_mm,
            px: square.px,
            log: log / count + darkened,
            log_value: log_value / count + darkened,
            darkened,
            flash,
            flash_slopes: [moved(DVec3::X), moved(DVec3::Y)],
            u: 0.5 * (1.0 + tan2).ln(),
            half_deg: half_deg(light, eye, square.board_mm),
        })
    };
    squares.squares.iter().filter_map(of).filter(|r| r.log.is_finite()).collect()
}

/// Angle between half vector and normal at a point of the board, degrees.
pub(super) fn half_deg(light: DVec3, eye: DVec3, board_mm: DVec2) -> f64 {
    let board = board_mm.extend(0.0);
    let half = (light - board).normalize() + (eye - board).normalize();
    half.normalize().z.clamp(-1.0, 1.0).acos().to_degrees()
}

/// Robust least squares of rows and their values, with a ridge: the unknowns, and the robust deviation.
pub(super) fn robust(
    rows: &[(Vec<f64>, f64)],
    columns: usize,
    ridge: f64,
) -> Option<(DVector<f64>, f64)> {
    let mut found = DVector::zeros(columns);
    let mut sigma = f64::INFINITY;
    let off = |(row, value): &(Vec<f64>, f64), found: &DVector<f64>| {
        value - row.iter().zip(found.iter()).map(|(a, b)| a * b).sum::<f64>()
    };
    for _ in 0..6 {
        let (mut normal, mut right) =
            (DMatrix::identity(columns, columns) * ridge, DVector::zeros(columns));
        for row in rows {
            let off = off(row, &found).abs();
            let weight = if sigma.is_finite() { (1.5 * sigma / off).min(1.0) } else { 1.0 };
            for (j, a) in row.0.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                right[j] += weight * a * row.1;
                for (k, b) in row.0.iter().enumerate() {
                    normal[(j, k)] += weight * a * b;
                }
            }
        }
        found = normal.cholesky()?.solve(&right);
        sigma = MAD_TO_SIGMA * median(rows.iter().map(|row| off(row, &found).abs()))?;
    }
    Some((found, sigma))
}
