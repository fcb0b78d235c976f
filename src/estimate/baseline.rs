//! Classic inverse rendering, the paper's baseline: Adam directly on the maps, with no prior but
//! the start.
//!
//! Parameters are those that networks see ([`encoding`]), which are well scaled. The step size
//! decays along a half cosine, so that the L1 loss settles instead of jumping about its corners.

use super::options::BaselineOptions;
use crate::observation::Observation;
use crate::parallel;
use crate::render::{self, check_observations};
use crate::svbrdf::{CHANNELS, Svbrdf, encoding};
use crate::{Error, Result};

/// Encoded values stay this far from -1, where the derivative of an albedo vanishes for good.
const MARGIN: f32 = 0.01;

/// Values that one task updates.
const CHUNK: usize = 1 << 14;

/// Iterations in progress on maps that the caller keeps.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Baseline {
    options: BaselineOptions,
    /// Iterations done.
    pub steps: usize,
    /// One for each value of the maps.
    pub moments: Vec<Moments>,
    gradient: Vec<f32>,
}

impl Baseline {
    /// Before the first iteration; maps are brought into their range.
    ///
    /// # Errors
    /// When sizes differ or an option is out of range.
    pub fn new(
        maps: &mut Svbrdf,
        observations: &[Observation],
        options: &BaselineOptions,
    ) -> Result<Self> {
        maps.clamp();
        let n = maps.texels();
        let moments = |(i, &v): (usize, &f32)| Moments {
            encoded: encoding::encode(i / n, v),
            mean: 0.0,
            square: 0.0,
        };
        let moments = maps.planes().iter().enumerate().map(moments).collect();
        Self::resume(maps, observations, options, 0, moments)
    }

    /// Goes on where another stopped.
    ///
    /// # Errors
    /// When sizes differ or an option is out of range.
    pub fn resume(
        maps: &Svbrdf,
        observations: &[Observation],
        options: &BaselineOptions,
        steps: usize,
        moments: Vec<Moments>,
    ) -> Result<Self> {
        check_observations(maps, observations)?;
        let in_range = options.learning_rate > 0.0
            && (0.0..=1.0).contains(&options.final_fraction)
            && (0.0..1.0).contains(&options.beta1)
            && (0.0..1.0).contains(&options.beta2);
        if !in_range {
            return Err(Error::argument("baseline", "rates and decays must lie between 0 and 1"));
        }
        if moments.len() != maps.planes().len() {
            return Err(Error::argument("moments", "one for each value of the maps is expected"));
        }
        Ok(Self { options: *options, steps, moments, gradient: Vec::new() })
    }

    /// One iteration; returns the mean log-L1 before it.
    pub fn step(&mut self, maps: &mut Svbrdf, observations: &[Observation]) -> f64 {
        let n = maps.texels();
        self.gradient.resize(CHANNELS * n, 0.0);
        let loss = render::loss_and_gradient(maps, observations, &mut self.gradient);
        self.steps += 1;
        let rate = Rate::new(&self.options, self.steps, n as f32);
        let parts = maps.planes_mut().chunks_mut(CHUNK).zip(self.moments.chunks_mut(CHUNK));
        let parts = parts.zip(self.gradient.chunks(CHUNK));
        parallel::parts(parts, |chunk, ((values, moments), gradient)| {
            for (i, ((value, m), g)) in values.iter_mut().zip(moments).zip(gradient).enumerate() {
                *value = m.update((chunk * CHUNK + i) / n, *g, &rate);
            }
        });
        loss
    }

    /// Whether all iterations are done.
    pub fn is_done(&self) -> bool {
        self.steps >= self.options.steps
    }
}

/// What one iteration multiplies with.
struct Rate {
    beta1: f32,
    beta2: f32,
    step: f32,
    /// 1 / sqrt(1 - beta2^t).
    square_correction: f32,
    /// The mean over texels makes gradients tiny; this takes it out, so that Adam's epsilon has
    /// the same meaning at every resolution.
    texels: f32,
}

impl Rate {
    fn new(options: &BaselineOptions, step: usize, texels: f32) -> Self {
        let done = step as f32 / options.steps as f32;
        let cosine = 0.5 + 0.5 * (std::f32::consts::PI * done).cos();
        let fraction = options.final_fraction + (1.0 - options.final_fraction) * cosine;
        let (beta1, beta2) = (options.beta1, options.beta2);
        Self {
            beta1,
            beta2,
            step: options.learning_rate * fraction / (1.0 - beta1.powf(step as f32)),
            square_correction: (1.0 - beta2.powf(step as f32)).sqrt().recip(),
            texels,
        }
    }
}

/// An encoded value with the moments of its gradient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moments {
    pub encoded: f32,
    pub mean: f32,
    pub square: f32,
}

impl Moments {
    /// One step of Adam; returns the new natural value.
    fn update(&mut self, c: usize, natural_gradient: f32, rate: &Rate) -> f32 {
        let slope = encoding::decode_derivative(c, self.encoded) * rate.texels;
        let g = natural_gradient * slope;
        self.mean += (1.0 - rate.beta1) * (g - self.mean);
        self.square += (1.0 - rate.beta2) * (g * g - self.square);
        let scale = self.square.sqrt() * rate.square_correction + 1e-8;
        let moved = self.encoded - rate.step * self.mean / scale;
        self.encoded = moved.clamp(MARGIN - 1.0, 1.0);
        encoding::decode(c, self.encoded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::solver::tests::{errors, perturbed, photographs, truth};

    /// Clean photographs: the baseline is a fair one only if its loss goes to nearly nothing. It
    /// ends at 1/250 of the start's.
    #[test]
    fn adam_converges_on_clean_photographs() {
        let truth = truth(16, 1);
        let start = perturbed(&truth, 0.1, 2);
        let photos = photographs(&truth, 5, 0.0, 3);
        let mut maps = start.clone();
        let mut baseline = Baseline::new(&mut maps, &photos, &BaselineOptions::default()).unwrap();
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
    fn results_repeat_for_any_number_of_threads_and_after_a_resumption() {
        let truth = truth(9, 4);
        let start = perturbed(&truth, 0.1, 5);
        let photos = photographs(&truth, 2, 0.01, 6);
        let options = BaselineOptions::default();
        let run = |threads, resumed| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut maps = start.clone();
                let mut baseline = Baseline::new(&mut maps, &photos, &options).unwrap();
                for _ in 0..7 {
                    baseline.step(&mut maps, &photos);
                    if resumed {
                        let Baseline { steps, moments, .. } = baseline;
                        baseline =
                            Baseline::resume(&maps, &photos, &options, steps, moments).unwrap();
                    }
                }
                (maps, baseline)
            })
        };
        let (maps, baseline) = run(1, false);
        assert_eq!((maps.clone(), baseline), run(3, false));
        assert_eq!(maps, run(1, true).0);
    }

    #[test]
    fn bad_arguments_are_refused() {
        let mut maps = Svbrdf::new(4, 4);
        let photos = photographs(&Svbrdf::new(5, 4), 1, 0.0, 1);
        assert!(Baseline::new(&mut maps, &photos, &BaselineOptions::default()).is_err());
        let options = BaselineOptions { learning_rate: -1.0, ..Default::default() };
        assert!(Baseline::new(&mut maps, &[], &options).is_err());
    }
}
