//! Brightness of photographs against their stated exposures.
//!
//! A stated exposure is a prior. Only the fall-off inside photographs determines the flash position, and a
//! wrong exposure must not move it. If the estimated light is far from the prior, or photographs are not as
//! bright as stated, a second fit leaves the gains free, and the likelier one wins.

use nalgebra::DVector;

use super::fit::{self, Solution};
use super::model::{Problem, Sample, Shot, parameter};

/// Width of the prior of free gains, log.
const FREE: f64 = 1.0;
/// Gains (in widths of their prior) and flash positions (in standard deviations) that trigger the second fit.
const DOUBTFUL_GAIN: f64 = 3.0;
const DOUBTFUL_OFFSET: f64 = 1.5;

/// Estimates the light with stated exposures unless the photographs outvote them. Starts from the
/// prior and from `start`.
pub(super) fn solve(
    samples: &[Sample],
    shots: &[Shot],
    problem: &Problem,
    start: Option<&DVector<f64>>,
) -> Solution {
    let expected = outvoted(samples, shots, problem);
    let Some(start) = start else { return expected };
    likelier(samples, shots, problem, expected, fit::solve(samples, shots, problem, Some(start)))
}

fn outvoted(samples: &[Sample], shots: &[Shot], problem: &Problem) -> Solution {
    let stated = fit::solve(samples, shots, problem, None);
    if shots.len() < 2 || !is_doubtful(&stated, problem) {
        return stated;
    }
    let free = Problem { gain_width: FREE, ..*problem };
    let free = fit::solve(samples, shots, &free, None);
    let start = with_most_as_stated(&free.theta, shots.len(), problem.gain_width);
    let outvoted = fit::solve(samples, shots, problem, Some(&start));
    likelier(samples, shots, problem, stated, outvoted)
}

/// The likelier of two solutions.
fn likelier(
    samples: &[Sample],
    shots: &[Shot],
    problem: &Problem,
    one: Solution,
    other: Solution,
) -> Solution {
    let sigma = one.sigma.min(other.sigma);
    let misfit = |solution| fit::misfit(samples, shots, problem, solution, sigma);
    if misfit(&other) < misfit(&one) { other } else { one }
}

fn is_doubtful(solution: &Solution, problem: &Problem) -> bool {
    let gain =
        solution.log_gain.iter().any(|[log, _]| log.abs() > DOUBTFUL_GAIN * problem.gain_width);
    let off = (solution.offset_mm - problem.offset_mm).abs();
    gain || off.cmpgt(DOUBTFUL_OFFSET * problem.offset_sigma_mm).any()
}

/// The same light, with the common scale chosen so that most gains nearly vanish.
fn with_most_as_stated(theta: &DVector<f64>, photos: usize, width: f64) -> DVector<f64> {
    let mut theta = theta.clone();
    for c in 0..3 {
        let own = |f: usize| parameter::FRAMES + 3 * f + c;
        let gains: Vec<f64> = (0..photos).map(|f| theta[own(f)]).collect();
        let cost = |common: f64| {
            gains.iter().map(|g| (1.0 + ((g - common) / width).powi(2)).ln()).sum::<f64>()
        };
        let common = gains.iter().copied().min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
        let common = common.unwrap_or(0.0);
        theta[parameter::LOG_SCALE + c] += common;
        (0..photos).for_each(|f| theta[own(f)] -= common);
    }
    theta
}
