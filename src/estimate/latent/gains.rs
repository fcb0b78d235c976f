//! Gains of the maps as a whole: of albedos and slopes, and a shift of roughness.
//!
//! All texels of all photographs constrain these eight numbers. A free fit of one photograph would instead
//! compensate a wrong roughness by albedo and normals of each texel.
//!
//! Adam searches with the gradient of the renderer's adjoint.

use crate::Svbrdf;
use crate::estimate::adam::Adam;
use crate::observation::Observation;
use crate::parallel;
use crate::render;
use crate::svbrdf::{CHANNELS, MAX_SLOPE, MIN_ROUGHNESS, RANGE, channel};

/// Logarithms of the gains of diffuse and specular albedo (three each), shift of the logit of roughness,
/// logarithm of the gain of slopes.
type Gains = [f64; 8];

/// Sigma of the gains.
const SIGMA: f64 = 0.6;
/// Weight of their prior relative to the mean loss, divided by the number of photographs.
const PRIOR_WEIGHT: f64 = 1e-2;
/// Number of steps, the first step size, and the decay of Adam's moments.
const STEPS: usize = 32;
const RATE: f32 = 0.12;
const BETAS: [f32; 2] = [0.8, 0.9];
/// Largest ratio of the losses with and without gains that accepts the gains.
const BETTER_MAPS: f64 = 0.99;
/// Largest roughness before the shift: its logit is infinite at 1.
const MAX_ROUGHNESS: f32 = 0.98;

const ROUGHNESS: usize = 6;
const SLOPES: usize = 7;

/// Applies the gains that explain the photographs best; returns whether they were accepted.
pub(super) fn apply(maps: &mut Svbrdf, observations: &[Observation]) -> bool {
    let mut problem = Problem::new(maps, observations);
    let (mut gains, mut adam) = ([0.0f32; 8], Adam::new(8));
    let (before, mut gradient) = problem.evaluate(&[0.0; 8]);
    let mut value = before;
    for step in 0..STEPS {
        let rate = RATE * (1.0 - step as f32 / STEPS as f32);
        adam.step(&mut gains, &gradient.map(|g| g as f32), rate, BETAS);
        (value, gradient) = problem.evaluate(&gains.map(f64::from));
    }
    let better = value < BETTER_MAPS * before;
    if better {
        std::mem::swap(maps, &mut problem.moved);
    }
    better
}

struct Problem<'a> {
    base: Svbrdf,
    moved: Svbrdf,
    observations: &'a [Observation],
    gradient: Vec<f32>,
    prior_weight: f64,
}

impl<'a> Problem<'a> {
    fn new(maps: &Svbrdf, observations: &'a [Observation]) -> Self {
        let gradient = vec![0.0; CHANNELS * maps.texels()];
        let prior_weight = PRIOR_WEIGHT / observations.len().max(1) as f64;
        let (base, moved) = (maps.clone(), maps.clone());
        Self { base, moved, observations, gradient, prior_weight }
    }

    /// Writes the maps with these gains to `moved`.
    fn apply(&mut self, gains: &Gains) {
        let n = self.base.texels();
        let base = &self.base;
        parallel::parts(self.moved.planes_mut().chunks_mut(n), |c, plane| {
            let source = base.plane(c);
            let amount = gains[parameter(c)].exp() as f32;
            let (low, high) = RANGE[c];
            for (to, &from) in plane.iter_mut().zip(source) {
                *to = if c == channel::ROUGHNESS {
                    let r = from.clamp(MIN_ROUGHNESS, MAX_ROUGHNESS);
                    // The logistic function of logit + shift.
                    let moved = r * amount / (1.0 - r + r * amount);
                    moved.clamp(MIN_ROUGHNESS, 1.0)
                } else {
                    (from * amount).clamp(low, high)
                };
            }
        });
    }

    /// Loss with the prior, and its gradient.
    fn evaluate(&mut self, gains: &Gains) -> (f64, Gains) {
        self.apply(gains);
        let mut value =
            render::loss_and_gradient(&self.moved, self.observations, &mut self.gradient);
        let n = self.moved.texels();
        let moved = &self.moved;
        let sums: Vec<f64> = parallel::map_parts(self.gradient.chunks(n), |c, gradient| {
            let high = if c < channel::DIFFUSE { MAX_SLOPE } else { 1.0 };
            let products = gradient.iter().zip(moved.plane(c)).map(|(&g, &v)| {
                let derivative = if c == channel::ROUGHNESS { v * (1.0 - v) } else { v };
                if v.abs() < high { f64::from(g * derivative) } else { 0.0 }
            });
            products.sum()
        });
        let mut gradient = [0.0; 8];
        for (c, sum) in sums.into_iter().enumerate() {
            gradient[parameter(c)] += sum;
        }
        for (g, x) in gradient.iter_mut().zip(gains) {
            value += self.prior_weight * (x / SIGMA).powi(2);
            *g += 2.0 * self.prior_weight * x / (SIGMA * SIGMA);
        }
        (value, gradient)
    }
}

/// Index of a channel's gain.
fn parameter(c: usize) -> usize {
    match c {
        channel::SLOPE_X | channel::SLOPE_Y => SLOPES,
        channel::ROUGHNESS => ROUGHNESS,
        _ => c - channel::DIFFUSE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::latent::tests::{SIDE, TOP, material, photograph};

    #[test]
    fn the_gradient_matches_finite_differences() {
        let truth = material(64);
        let observations = [photograph(&truth, TOP), photograph(&truth, SIDE)];
        let mut problem = Problem::new(&truth, &observations);
        let at = [0.1, -0.2, 0.05, 0.3, -0.1, 0.2, -0.4, 0.15];
        let (_, gradient) = problem.evaluate(&at);
        for i in 0..8 {
            // The loss is a sum of absolute values: wide differences average over its kinks.
            let h = 2e-3;
            let mut value = |d: f64| {
                let mut to = at;
                to[i] += d;
                problem.evaluate(&to).0
            };
            let difference = (value(h) - value(-h)) / (2.0 * h);
            let error = (difference - gradient[i]).abs();
            assert!(error < 0.02 * difference.abs() + 2e-3, "{i}: {difference} {}", gradient[i]);
        }
    }

    #[test]
    fn gains_correct_wrong_scales() {
        let truth = material(64);
        let observations = [photograph(&truth, TOP), photograph(&truth, SIDE)];
        let mut problem = Problem::new(&truth, &[]);
        problem.apply(&[-0.4, -0.3, -0.5, 0.5, 0.5, 0.5, 0.9, 0.3]);
        let mut maps = problem.moved;
        let mean = |maps: &Svbrdf, c: usize| {
            maps.plane(c).iter().zip(truth.plane(c)).map(|(a, b)| (a - b).abs()).sum::<f32>()
                / maps.texels() as f32
        };
        let before = [mean(&maps, channel::DIFFUSE), mean(&maps, channel::ROUGHNESS)];
        assert!(apply(&mut maps, &observations));
        let after = [mean(&maps, channel::DIFFUSE), mean(&maps, channel::ROUGHNESS)];
        assert!(after[0] < 0.1 * before[0] && after[1] < 0.15 * before[1], "{before:?} {after:?}");
    }

    #[test]
    fn true_maps_stay() {
        let truth = material(64);
        let mut maps = truth.clone();
        assert!(!apply(&mut maps, &[photograph(&truth, TOP)]));
        assert_eq!(maps, truth);
    }
}
