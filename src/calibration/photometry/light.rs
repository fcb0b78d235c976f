//! Decides which properties of the light are observable, and whether values are linear.

use glam::DVec3;
use nalgebra::DVector;

use super::model::{Ink, Problem, Sample, Shot};
use super::{exposure, fit, turned};

/// Formal standard deviations at which ambient light is significant. Errors of paper come in large
/// patches (a bow, a gradient of the print), so two or three are not significant.
const AMBIENT_SIGNIFICANCE: f64 = 4.0;
/// A flash position with a larger formal standard deviation than this (mm; a degree at arm's
/// length) keeps the prior, unless it deviates from the prior by this many standard deviations.
const OFFSET_SIGMA_MAX_MM: f64 = 5.0;
const OFFSET_SIGNIFICANCE: f64 = 2.0;
/// A tone curve or a veil is significant if it lowers the misfit by this (three standard
/// deviations, as a print may be off by two) and by this share of the remaining misfit: errors of
/// paper and light resemble a curve.
const TONE_EVIDENCE: f64 = 9.0;
const TONE_EVIDENCE_SHARE: f64 = 0.5;
/// Fewest photographs that separate surroundings of squares from errors of paper and lens.
const SURROUNDINGS_FROM: usize = 3;
/// Rounds of the search for turned photographs.
const TURNS_MAX: usize = 4;
/// A veil is also significant at this share and this many formal standard deviations, if the
/// squares fit to this deviation: unknown blacks can hide a small veil.
const VEIL_LEAST: f64 = 0.02;
const VEIL_SIGNIFICANCE: f64 = 5.0;
const VEIL_SIGMA_MAX: f64 = 0.008;
/// Local tone mapping is also significant at this exponent and this many formal standard
/// deviations, if it lowers the misfit by this share of the remainder. A curve must gain more than
/// [`TONE_EVIDENCE`] against it, because it has two more parameters.
const LOCAL_LEAST: f64 = 0.04;
const LOCAL_SIGNIFICANCE: f64 = 6.0;
const LOCAL_EVIDENCE_SHARE: f64 = 0.15;
/// Exponent above which scales other than the middle one are tried.
const LOCAL_HINTED: f64 = 0.02;
/// Log slopes below which a curve is straight.
const STRAIGHT: f64 = 0.03;

/// The light determined by the squares.
pub(super) struct Light {
    pub solution: fit::Solution,
    /// Ambient light before the test of significance, and its standard deviation.
    pub ambient_raw: [(f64, f64); 3],
    /// The photographs, with turned ones marked.
    pub shots: Vec<Shot>,
}

impl Light {
    /// Light of a capture that may contain turned photographs, a tone curve or a dirty lens. Each
    /// is accepted only if linear values explain the squares clearly worse.
    pub fn of_capture(samples: &[Sample], shots: Vec<Shot>, problem: &Problem) -> Self {
        // Without a curve the gray patch carries no information about the light.
        let plain: Vec<_> = samples.iter().copied().filter(|s| s.ink != Ink::Gray).collect();
        let mut linear = Self::of_squares(&plain, shots, problem, None);
        // The light estimated without one turned photograph reveals the next.
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
        // A straight curve with a better misfit has only found a better light.
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
        // Start from the known light; a rough fit suffices for the comparison.
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

    /// Light with unobservable properties set to their priors.
    fn of_squares(
        samples: &[Sample],
        shots: Vec<Shot>,
        problem: &Problem,
        start: Option<&DVector<f64>>,
    ) -> Self {
        let mut solution = exposure::solve(samples, &shots, problem, start);
        let share = solution.ambient_share;
        let ambient_raw = std::array::from_fn(|c| {
            // From a share of all light to a ratio to the flash: q / (1 - q).
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

/// Whether local tone mapping is significant.
pub(super) fn is_local(solution: &fit::Solution) -> bool {
    let [exponent, deviation] = solution.local_tone;
    exponent > LOCAL_LEAST.max(LOCAL_SIGNIFICANCE * deviation)
}

/// Whether the veil is significant.
fn is_veiled(solution: &fit::Solution) -> bool {
    let [share, deviation] = solution.veil;
    share > VEIL_LEAST.max(VEIL_SIGNIFICANCE * deviation) && solution.sigma < VEIL_SIGMA_MAX
}
