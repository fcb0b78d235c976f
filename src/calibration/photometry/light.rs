//! Which of the light's properties the squares can tell, and whether values are linear.

use glam::DVec3;
use nalgebra::DVector;

use super::model::{Ink, Problem, Sample, Shot};
use super::{exposure, fit, turned};

/// Formal standard deviations at which the ambient counts as seen. Errors of paper come in large
/// patches (a bow, a gradient of the print), so that two or three of them mean little.
const AMBIENT_SIGNIFICANCE: f64 = 4.0;
/// A flash whose place is known worse than this (formal standard deviation, mm; at arm's length a
/// degree), and no further off the expected than this many of them, is taken to be there.
const OFFSET_SIGMA_MAX_MM: f64 = 5.0;
const OFFSET_SIGNIFICANCE: f64 = 2.0;
/// A tone curve or a veil counts as seen where it lowers the misfit by this (three standard deviations: a print
/// may be off by two), and by this share of what it leaves: what is wrong with paper and light can
/// look a little like a curve.
const TONE_EVIDENCE: f64 = 9.0;
const TONE_EVIDENCE_SHARE: f64 = 0.5;
/// Photographs from which on what surrounds squares is told from what is wrong with paper and lens.
const SURROUNDINGS_FROM: usize = 3;
/// Rounds in which turned photographs are looked for.
const TURNS_MAX: usize = 4;
/// A veil counts as seen too where it is as large as this and as so many formal standard deviations, and hardly
/// anything is left of the squares (deviation): a little of it hides behind unknown blacks.
const VEIL_LEAST: f64 = 0.02;
const VEIL_SIGNIFICANCE: f64 = 5.0;
const VEIL_SIGMA_MAX: f64 = 0.008;
/// Local tone mapping counts as seen too where its exponent is as large as this and as so many formal standard
/// deviations, and it lowers the misfit by such a share of what it leaves. A curve must be better by more than
/// [`TONE_EVIDENCE`]: it has two parameters more.
const LOCAL_LEAST: f64 = 0.04;
const LOCAL_SIGNIFICANCE: f64 = 6.0;
const LOCAL_EVIDENCE_SHARE: f64 = 0.15;
/// Exponent from which on other scales than the middle one are looked at.
const LOCAL_HINTED: f64 = 0.02;
/// Logarithmic slopes of a curve that is none.
const STRAIGHT: f64 = 0.03;

/// What the squares tell.
pub(super) struct Light {
    pub solution: fit::Solution,
    /// Ambient light before it was decided whether it is seen, and its standard deviation.
    pub ambient_raw: [(f64, f64); 3],
    /// The photographs, with those found turned.
    pub shots: Vec<Shot>,
}

impl Light {
    /// Of photographs that may be turned, and may have a tone curve or be taken through a dirty lens: that
    /// is believed where linear values clearly explain the squares worse.
    pub fn of_capture(samples: &[Sample], shots: Vec<Shot>, problem: &Problem) -> Self {
        // Left to a curve: without one the gray patch says nothing about the light.
        let plain: Vec<_> = samples.iter().copied().filter(|s| s.ink != Ink::Gray).collect();
        let mut linear = Self::of_squares(&plain, shots, problem, None);
        // A light that is found without one turned photograph shows the next.
        for _ in 0..TURNS_MAX {
            let found = turned::find(&plain, &linear.shots, problem, &linear.solution);
            let Some(shots) = found else { break };
            linear = Self::of_squares(&plain, shots, problem, None);
        }
        let misfit = |light: &Self, problem: &Problem, sigma: f64| {
            fit::misfit(samples, &light.shots, problem, &light.solution, sigma)
        };
        if misfit(&linear, problem, fit::TONE_MIN_SIGMA) < TONE_EVIDENCE {
            return linear;
        }
        let curved_problem = problem.with_tone_curve();
        let curved = Self::of_squares(samples, linear.shots.clone(), &curved_problem, None);
        let straight = curved.solution.tone.iter().all(|slope| slope.abs() < STRAIGHT);
        let sigma = curved.solution.sigma;
        let gain = misfit(&linear, problem, sigma) - misfit(&curved, &curved_problem, sigma);
        // A curve that is none and explains more has only found a better light.
        if straight && gain > TONE_EVIDENCE {
            let start = Some(&curved.solution.theta);
            linear = Self::of_squares(&plain, linear.shots, problem, start);
        }
        if linear.shots.len() < SURROUNDINGS_FROM {
            let left = misfit(&curved, &curved_problem, sigma);
            let gain = misfit(&linear, problem, sigma) - left;
            let clear = gain > TONE_EVIDENCE + TONE_EVIDENCE_SHARE * left;
            return if clear && !straight { curved } else { linear };
        }
        // From the light that is known: a rough look is enough to see what does not explain the squares.
        let solve = |other: Problem| {
            let start = Some(&linear.solution.theta);
            (fit::solve(&plain, &linear.shots, &other, start), other)
        };
        let mut others = vec![solve(problem.with_veil()), solve(problem.with_local_tone(1))];
        if others[1].0.local_tone[0] > LOCAL_HINTED {
            others.extend([0, 2].map(|scale| solve(problem.with_local_tone(scale))));
        }
        let sigma = others.iter().map(|other| &other.0).chain([&curved.solution]);
        let sigma = sigma.map(|solution| solution.sigma);
        let sigma = sigma.fold(f64::MAX, f64::min).max(fit::TONE_MIN_SIGMA);
        let left = |solution: &fit::Solution, problem: &Problem| {
            fit::misfit(samples, &linear.shots, problem, solution, sigma)
        };
        let before = left(&linear.solution, problem);
        let clear = |left: f64| before - left > TONE_EVIDENCE + TONE_EVIDENCE_SHARE * left;
        let by_curve = left(&curved.solution, &curved_problem);
        let best =
            others.into_iter().map(|(solution, other)| (left(&solution, &other), solution, other));
        let best = best.min_by(|a, b| a.0.total_cmp(&b.0));
        let is_seen = |(left, solution, _): &(f64, fit::Solution, Problem)| {
            let gain = before - left;
            let local = is_local(solution) && gain > TONE_EVIDENCE + LOCAL_EVIDENCE_SHARE * left;
            let margin = if local { TONE_EVIDENCE } else { 0.0 };
            *left < by_curve + margin && (clear(*left) || is_veiled(solution) || local)
        };
        match best.filter(is_seen) {
            Some((_, solution, other)) => {
                Self::of_squares(&plain, linear.shots, &other, Some(&solution.theta))
            }
            None if clear(by_curve) && !straight => curved,
            None => linear,
        }
    }

    /// After what they cannot tell was taken as expected.
    fn of_squares(
        samples: &[Sample],
        shots: Vec<Shot>,
        problem: &Problem,
        start: Option<&DVector<f64>>,
    ) -> Self {
        let mut solution = exposure::solve(samples, &shots, problem, start);
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
            solution = exposure::solve(samples, &shots, &problem, start);
        }
        let off = (solution.offset_mm - problem.offset_mm).abs();
        let spread = solution.offset_sigma_mm;
        if spread.max_element() > OFFSET_SIGMA_MAX_MM
            && off.cmple(OFFSET_SIGNIFICANCE * spread).all()
        {
            problem = Problem { offset_sigma_mm: DVec3::ZERO, ..problem };
            solution = exposure::solve(samples, &shots, &problem, start);
            solution.offset_sigma_mm = spread;
        }
        Self { solution, ambient_raw, shots }
    }
}

/// Whether tones are clearly mapped place by place.
fn is_local(solution: &fit::Solution) -> bool {
    let [exponent, deviation] = solution.local_tone;
    exponent > LOCAL_LEAST.max(LOCAL_SIGNIFICANCE * deviation)
}

/// Whether a lens is clearly dirty.
fn is_veiled(solution: &fit::Solution) -> bool {
    let [share, deviation] = solution.veil;
    share > VEIL_LEAST.max(VEIL_SIGNIFICANCE * deviation) && solution.sigma < VEIL_SIGMA_MAX
}
