//! Classic inverse rendering, the paper's baseline: Adam directly on the maps, with no prior but
//! the start.
//!
//! The parameters are those of the networks ([`encoding`]), which are well scaled. The step size decays along
//! a half cosine, because constant steps make the L1 loss jump about its kinks.

use super::adam::Adam;
use crate::Result;
use crate::observation::Observation;
use crate::parallel;
use crate::render::{self, check_observations};
use crate::svbrdf::{CHANNELS, Svbrdf, encoding};

/// Iterations: the best of a search over rates, decays and lengths on synthetic texels. Longer or faster runs
/// fit the noise.
pub(super) const STEPS: usize = 800;
/// First step size, in encoded units, and the last one as a fraction of it.
const LEARNING_RATE: f32 = 0.01;
const FINAL_FRACTION: f32 = 0.01;
/// Decay of the mean gradient (the paper's) and of the mean squared gradient.
const BETAS: [f32; 2] = [0.5, 0.999];
/// Distance of encoded values from -1, where the derivative of an albedo vanishes.
const MARGIN: f32 = 0.01;

/// Iterations in progress; the caller keeps the maps.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Baseline {
    /// The maps, encoded for networks.
    encoded: Vec<f32>,
    /// Moments of the encoded maps, and iterations done.
    adam: Adam,
    gradient: Vec<f32>,
}

impl Baseline {
    /// Before the first iteration; clamps the maps to their range.
    ///
    /// # Errors
    /// When sizes differ.
    pub fn new(maps: &mut Svbrdf, observations: &[Observation]) -> Result<Self> {
        maps.clamp();
        let n = maps.texels();
        let values = maps.planes().iter().enumerate();
        let encoded: Vec<f32> = values.map(|(i, &v)| encoding::encode(i / n, v)).collect();
        let adam = Adam::new(encoded.len());
        check_observations(maps, observations)?;
        Ok(Self { encoded, adam, gradient: Vec::new() })
    }

    /// Iterations done.
    pub fn steps(&self) -> usize {
        self.adam.steps.max(0) as usize
    }

    /// One iteration; returns the mean log-L1 before it.
    pub fn step(&mut self, maps: &mut Svbrdf, observations: &[Observation]) -> f64 {
        let n = maps.texels();
        self.gradient.resize(CHANNELS * n, 0.0);
        let loss = render::loss_and_gradient(maps, observations, &mut self.gradient);
        let (encoded, adam) = (&mut self.encoded, &mut self.adam);
        let planes = encoded.chunks(n).zip(self.gradient.chunks_mut(n));
        parallel::parts(planes, |c, (encoded, gradient)| {
            for (g, v) in gradient.iter_mut().zip(encoded) {
                *g *= encoding::decode_derivative(c, *v);
            }
        });
        let done = (adam.steps + 1) as f32 / STEPS as f32;
        let cosine = 0.5 + 0.5 * (std::f32::consts::PI * done).cos();
        let rate = LEARNING_RATE * (FINAL_FRACTION + (1.0 - FINAL_FRACTION) * cosine);
        adam.step(encoded, &self.gradient, rate, BETAS);
        let planes = encoded.chunks_mut(n).zip(maps.planes_mut().chunks_mut(n));
        parallel::parts(planes, |c, (encoded, values)| {
            for (v, value) in encoded.iter_mut().zip(values) {
                *v = v.clamp(MARGIN - 1.0, 1.0);
                *value = encoding::decode(c, *v);
            }
        });
        loss
    }

    /// Whether all iterations are done.
    pub fn is_done(&self) -> bool {
        self.steps() >= STEPS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::solver::tests::{errors, perturbed, photographs, truth};

    /// A fair baseline explains clean photographs: its loss ends at 1/250 of the start's.
    #[test]
    fn adam_converges_on_clean_photographs() {
        let truth = truth(16, 1);
        let start = perturbed(&truth, 0.1, 2);
        let photos = photographs(&truth, 5, 0.0, 3);
        let mut maps = start.clone();
        let mut baseline = Baseline::new(&mut maps, &photos).unwrap();
        let before = baseline.step(&mut maps, &photos);
        while !baseline.is_done() {
            baseline.step(&mut maps, &photos);
        }
        let loss = render::loss(&maps, &photos);
        assert!(loss < 0.01 * before, "{before} {loss}");
        let (before, after) = (errors(&start, &truth), errors(&maps, &truth));
        for i in 0..4 {
            assert!(after[i] < before[i], "{before:?} {after:?}");
        }
    }

    #[test]
    fn results_repeat_for_any_number_of_threads() {
        let truth = truth(9, 4);
        let start = perturbed(&truth, 0.1, 5);
        let photos = photographs(&truth, 2, 0.01, 6);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut maps = start.clone();
                let mut baseline = Baseline::new(&mut maps, &photos).unwrap();
                for _ in 0..7 {
                    baseline.step(&mut maps, &photos);
                }
                (maps, baseline)
            })
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn sizes_that_differ_are_refused() {
        let mut maps = Svbrdf::new(4, 4);
        let photos = photographs(&Svbrdf::new(5, 4), 1, 0.0, 1);
        assert!(Baseline::new(&mut maps, &photos).is_err());
    }
}
