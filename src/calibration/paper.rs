//! Deviations of a print from its plan: stretch by the printer, bend by curl.

use super::target::Target;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Priors: the feed of printers errs by some tenths of a per cent, and paper from a roll rises by a
/// millimetre.
const ASPECT_SIGMA: f64 = 0.005;
const BOW_SIGMA_MM: f64 = 1.0;
/// At this precision (a fortieth of a degree of the pose) further photographs do not help.
const ASPECT_KNOWN: f64 = 5e-4;
const BOW_KNOWN_MM: f64 = 0.2;

/// Number of parameters of [`Paper`].
pub(super) const PARAMETERS: usize = 3;

/// The printed sheet, the same in all photographs of a capture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Paper {
    /// Scale along Y relative to the scale along X, which is as planned.
    pub aspect: f64,
    /// Rise of the board's left and right edges, and of its upper and lower edges, above its
    /// middle, mm: parabolas whose mean over the corners lies in the board's plane.
    pub bow_mm: [f64; 2],
}

impl Default for Paper {
    /// As planned: flat.
    fn default() -> Self {
        Self { aspect: 1.0, bow_mm: [0.0; 2] }
    }
}

impl Paper {
    /// Position of a planned point of the target's print, mm.
    pub fn place(&self, target: &Target, board_mm: DVec2) -> DVec3 {
        Sheet::new(target, *self).at(board_mm)
    }

    pub(super) fn moved(&self, step: &[f64; PARAMETERS]) -> Self {
        let [x, y] = self.bow_mm;
        Self { aspect: self.aspect + step[0], bow_mm: [x + step[1], y + step[2]] }
    }

    /// Deviations from the plan in prior standard deviations, and the reciprocals of the latter.
    pub(super) fn deviations(&self) -> [(f64, f64); PARAMETERS] {
        let bow = self.bow_mm.map(|b| (b / BOW_SIGMA_MM, BOW_SIGMA_MM.recip()));
        [((self.aspect - 1.0) / ASPECT_SIGMA, ASPECT_SIGMA.recip()), bow[0], bow[1]]
    }

    /// Whether a print can have these values.
    pub(crate) fn is_plausible(&self) -> bool {
        (self.aspect - 1.0).abs() < 0.1 && self.bow_mm.iter().all(|b| b.abs() < 30.0)
    }
}

/// An estimated sheet and its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PaperEstimate {
    /// The sheet; as planned unless the corners clearly contradict it.
    pub paper: Paper,
    /// Standard deviations of the aspect and of the two bows (mm).
    pub sigma: [f64; 3],
}

impl Default for PaperEstimate {
    /// As planned, with the prior's deviations.
    fn default() -> Self {
        Self { paper: Paper::default(), sigma: [ASPECT_SIGMA, BOW_SIGMA_MM, BOW_SIGMA_MM] }
    }
}

impl PaperEstimate {
    /// Whether the values are possible (for saved data).
    pub(crate) fn is_plausible(&self) -> bool {
        self.paper.is_plausible() && self.sigma.iter().all(|s| (0.0..=f64::MAX).contains(s))
    }

    /// Whether further photographs would not improve the estimate noticeably.
    pub(crate) fn is_settled(&self) -> bool {
        let [aspect, x, y] = self.sigma;
        aspect < ASPECT_KNOWN && x.max(y) < BOW_KNOWN_MM
    }
}

/// A paper with the dimensions of its target.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sheet {
    pub paper: Paper,
    /// Half the board's width and height, mm.
    pub half_mm: DVec2,
    /// Mean of x² and y² over the corners, in units of `half_mm`.
    pub mean: DVec2,
}

impl Sheet {
    pub fn new(target: &Target, paper: Paper) -> Self {
        let half_mm = 0.5 * target.square_mm * DVec2::new(target.cols.into(), target.rows.into());
        let corners = target.corners();
        let square = |&(row, col): &(u32, u32)| {
            let u = target.grid_mm(row.into(), col.into()) / half_mm;
            u * u
        };
        let mean = corners.iter().map(square).sum::<DVec2>() / corners.len().max(1) as f64;
        Self { paper, half_mm, mean }
    }

    /// Position of a planned point, mm.
    pub fn at(&self, board_mm: DVec2) -> DVec3 {
        let rise = self.rise(board_mm);
        let [x, y] = self.paper.bow_mm;
        DVec3::new(board_mm.x, board_mm.y * self.paper.aspect, x * rise.x + y * rise.y)
    }

    /// Derivatives of [`Sheet::at`] by aspect and bows.
    pub fn slopes(&self, board_mm: DVec2) -> [DVec3; PARAMETERS] {
        let rise = self.rise(board_mm);
        [DVec3::Y * board_mm.y, DVec3::Z * rise.x, DVec3::Z * rise.y]
    }

    fn rise(&self, board_mm: DVec2) -> DVec2 {
        let u = board_mm / self.half_mm;
        u * u - self.mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_sheet_keeps_its_mean_in_the_plane() {
        let target = Target::default();
        let paper = Paper { aspect: 1.01, bow_mm: [2.0, -1.0] };
        let corners = target.corners();
        let at =
            |&(row, col): &(u32, u32)| paper.place(&target, target.grid_mm(row.into(), col.into()));
        let mean = corners.iter().map(at).sum::<DVec3>() / corners.len() as f64;
        assert!(mean.length() < 1e-9, "{mean}");
        // The left edge against the middle, at the same height.
        let half = 0.5 * 16.0 * 11.5;
        let edge = paper.place(&target, DVec2::new(-half, 30.0));
        let middle = paper.place(&target, DVec2::new(0.0, 30.0));
        assert!((edge.z - middle.z - 2.0).abs() < 1e-12);
        assert!((edge.y - 30.3).abs() < 1e-12 && edge.x == -half);
        assert_eq!(
            Paper::default().place(&target, DVec2::new(3.0, 4.0)),
            DVec3::new(3.0, 4.0, 0.0)
        );
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let sheet = |paper| Sheet::new(&Target::default(), paper);
        let paper = Paper { aspect: 0.99, bow_mm: [0.5, 1.5] };
        let at = DVec2::new(-40.0, 71.0);
        for (i, slope) in sheet(paper).slopes(at).into_iter().enumerate() {
            let mut step = [0.0; PARAMETERS];
            step[i] = 1.0;
            // Linear, so exact up to rounding.
            let difference = sheet(paper.moved(&step)).at(at) - sheet(paper).at(at);
            assert!((difference - slope).length() < 1e-12, "{i}");
        }
    }
}
