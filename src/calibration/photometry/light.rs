//! Which of the light's properties the squares can tell, and whether values are linear.

use glam::DVec3;

use super::fit;
use super::model::{Ink, Problem, Sample};
use crate::geometry::Pose;

/// Formal standard deviations at which the ambient counts as seen. Errors of paper come in large
/// patches (a bow, a gradient of the print), so that two or three of them mean little.
const AMBIENT_SIGNIFICANCE: f64 = 4.0;
/// A flash whose place is known worse than this (formal standard deviation, mm; at arm's length a
/// degree), and no further off the expected than this many of them, is taken to be there.
const OFFSET_SIGMA_MAX_MM: f64 = 5.0;
const OFFSET_SIGNIFICANCE: f64 = 2.0;
/// A tone curve counts as seen where it lowers the misfit by this (three standard deviations: a print
/// may be off by two), and by this share of what it leaves: what is wrong with paper and light can
/// look a little like a curve.
const TONE_EVIDENCE: f64 = 9.0;
const TONE_EVIDENCE_SHARE: f64 = 0.5;

/// What the squares tell.
pub(super) struct Light {
    pub solution: fit::Solution,
    /// Ambient light before it was decided whether it is seen, and its standard deviation.
    pub ambient_raw: [(f64, f64); 3],
}

impl Light {
    /// Of photographs that may have a tone curve, which is taken where linear values clearly explain
    /// the squares worse.
    pub fn of_capture(samples: &[Sample], poses: &[Pose], problem: &Problem) -> Self {
        // Left to a curve: without one the gray patch says nothing about the light.
        let plain: Vec<_> = samples.iter().copied().filter(|s| s.ink != Ink::Gray).collect();
        let linear = Self::of_squares(&plain, poses, problem);
        let misfit = |light: &Self, problem: &Problem, sigma: f64| {
            fit::misfit(samples, poses, problem, &light.solution, sigma)
        };
        if misfit(&linear, problem, fit::TONE_MIN_SIGMA) < TONE_EVIDENCE {
            return linear;
        }
        let problem_curved = problem.with_tone_curve();
        let curved = Self::of_squares(samples, poses, &problem_curved);
        let sigma = curved.solution.sigma;
        let explained = misfit(&curved, &problem_curved, sigma);
        let gain = misfit(&linear, problem, sigma) - explained;
        if gain > TONE_EVIDENCE + TONE_EVIDENCE_SHARE * explained { curved } else { linear }
    }

    /// After what they cannot tell was taken as expected.
    fn of_squares(samples: &[Sample], poses: &[Pose], problem: &Problem) -> Self {
        let mut solution = fit::solve(samples, poses, problem);
        let share = solution.ambient_share;
        let ambient_raw = std::array::from_fn(|c| {
            // q / (1 - q): from a share of all light to a ratio to the flash's.
            let scale = 1.0 / (1.0 - share[c]);
            (share[c] * scale, solution.ambient_share_sigma[c] * scale * scale)
        });
        let seen = |&(value, sigma): &(f64, f64)| value > AMBIENT_SIGNIFICANCE * sigma;
        let ambient_sigma = if ambient_raw.iter().any(seen) { problem.ambient_sigma } else { 0.0 };
        let mut problem = Problem { ambient_sigma, ..*problem };
        if ambient_sigma == 0.0 {
            solution = fit::solve(samples, poses, &problem);
        }
        let off = (solution.offset_mm - problem.offset_mm).abs();
        let spread = solution.offset_sigma_mm;
        if spread.max_element() > OFFSET_SIGMA_MAX_MM
            && off.cmple(OFFSET_SIGNIFICANCE * spread).all()
        {
            problem = Problem { offset_sigma_mm: DVec3::ZERO, ..problem };
            solution = fit::solve(samples, poses, &problem);
            solution.offset_sigma_mm = spread;
        }
        Self { solution, ambient_raw }
    }
}
