//! Classic inverse rendering, the paper's baseline: Adam directly on the maps, with no prior but
//! the start.
//!
//! Parameters are those that networks see ([`encoding`]), which are well scaled. The step size
//! decays along a half cosine, so that the L1 loss settles instead of jumping about its corners.

use crate::observation::Observation;
use crate::parallel;
use crate::render::{self, check_observations};
use crate::svbrdf::{CHANNELS, Svbrdf, encoding};
use crate::{Error, Result};
use std::ops::ControlFlow;

/// Options of [`fit`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Iterations.
    pub steps: usize,
    /// First step size, in encoded units.
    pub learning_rate: f32,
    /// Step size of the last iteration, as a share of the first.
    pub final_share: f32,
    /// Decay of the mean gradient (the paper's is 0.5).
    pub beta1: f32,
    /// Decay of the mean squared gradient.
    pub beta2: f32,
}

impl Default for Options {
    /// The best of a search over rates, decays and lengths on synthetic texels: longer or faster
    /// runs fit the noise, not the material.
    fn default() -> Self {
        Self { steps: 800, learning_rate: 0.01, final_share: 0.01, beta1: 0.5, beta2: 0.999 }
    }
}

/// What [`fit`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Iterations done.
    pub steps: usize,
    /// [`render::loss`] of the start.
    pub loss_before: f64,
    /// [`render::loss`] of the result.
    pub loss_after: f64,
    /// Whether the caller ended the fit early.
    pub stopped: bool,
}

/// Encoded values stay this far from -1, where the derivative of an albedo vanishes for good.
const MARGIN: f32 = 0.01;

/// Values that one task updates.
const CHUNK: usize = 1 << 14;

/// Fits maps in place. After each iteration `after` gets its number (from 1) and the loss before
/// it, and may end the work.
///
/// # Errors
/// When sizes differ or an option is out of range.
pub fn fit(
    maps: &mut Svbrdf,
    observations: &[Observation],
    options: &Options,
    after: &mut dyn FnMut(usize, f64) -> ControlFlow<()>,
) -> Result<Report> {
    check_observations(maps, observations)?;
    let in_range = options.learning_rate > 0.0
        && (0.0..=1.0).contains(&options.final_share)
        && (0.0..1.0).contains(&options.beta1)
        && (0.0..1.0).contains(&options.beta2);
    if !in_range {
        return Err(Error::argument("options", "rates and decays must lie between 0 and 1"));
    }
    maps.clamp();
    let n = maps.texels();
    let loss_before = render::loss(maps, observations);
    let mut report = Report { steps: 0, loss_before, loss_after: loss_before, stopped: false };
    let mut gradient = vec![0.0; CHANNELS * n];
    let mut state: Vec<Moments> = maps
        .planes()
        .iter()
        .enumerate()
        .map(|(i, &v)| Moments { encoded: encoding::encode(i / n, v), mean: 0.0, square: 0.0 })
        .collect();
    for step in 1..=options.steps {
        let loss = render::loss_and_gradient(maps, observations, &mut gradient);
        let rate = Rate::new(options, step, n as f32);
        let parts = maps.planes_mut().chunks_mut(CHUNK).zip(state.chunks_mut(CHUNK));
        parallel::parts(parts.zip(gradient.chunks(CHUNK)), |chunk, ((values, state), gradient)| {
            for (i, ((value, state), g)) in values.iter_mut().zip(state).zip(gradient).enumerate() {
                *value = state.update((chunk * CHUNK + i) / n, *g, &rate);
            }
        });
        report.steps = step;
        if after(step, loss).is_break() {
            report.stopped = true;
            break;
        }
    }
    report.loss_after = render::loss(maps, observations);
    Ok(report)
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
    fn new(options: &Options, step: usize, texels: f32) -> Self {
        let done = step as f32 / options.steps as f32;
        let cosine = 0.5 + 0.5 * (std::f32::consts::PI * done).cos();
        let share = options.final_share + (1.0 - options.final_share) * cosine;
        let (beta1, beta2) = (options.beta1, options.beta2);
        Self {
            beta1,
            beta2,
            step: options.learning_rate * share / (1.0 - beta1.powf(step as f32)),
            square_correction: (1.0 - beta2.powf(step as f32)).sqrt().recip(),
            texels,
        }
    }
}

#[derive(Clone, Copy)]
struct Moments {
    encoded: f32,
    mean: f32,
    square: f32,
}

impl Moments {
    /// One step of Adam; answers the new natural value.
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
    use crate::refinement::tests::{errors, perturbed, photographs, truth};

    fn go_on(_: usize, _: f64) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    /// Clean photographs: the baseline is a fair one only if its loss goes to nearly nothing. It
    /// ends at 1/250 of the start's.
    #[test]
    fn adam_converges_on_clean_photographs() {
        let truth = truth(16, 1);
        let start = perturbed(&truth, 0.1, 2);
        let photos = photographs(&truth, 5, 0.0, 3);
        let mut maps = start.clone();
        let report = fit(&mut maps, &photos, &Options::default(), &mut go_on).unwrap();
        assert!(report.loss_after < 0.01 * report.loss_before, "{report:?}");
        let (before, after) = (errors(&start, &truth), errors(&maps, &truth));
        for i in 0..4 {
            assert!(after[i] < before[i], "{before:?} {after:?}");
        }
    }

    #[test]
    fn the_caller_may_stop_and_results_repeat() {
        let truth = truth(9, 4);
        let start = perturbed(&truth, 0.1, 5);
        let photos = photographs(&truth, 2, 0.01, 6);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut maps = start.clone();
            let mut after = |step, _| {
                if step == 7 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let report =
                pool.install(|| fit(&mut maps, &photos, &Options::default(), &mut after)).unwrap();
            (maps, report)
        };
        let (maps, report) = run(1);
        assert!(report.stopped && report.steps == 7);
        assert!((report.loss_after - render::loss(&maps, &photos)).abs() < 1e-9);
        assert_eq!((maps, report), run(3));
    }

    #[test]
    fn bad_arguments_are_refused() {
        let mut maps = Svbrdf::new(4, 4);
        let photos = photographs(&Svbrdf::new(5, 4), 1, 0.0, 1);
        assert!(fit(&mut maps, &photos, &Options::default(), &mut go_on).is_err());
        let options = Options { learning_rate: -1.0, ..Default::default() };
        assert!(fit(&mut maps, &[], &options, &mut go_on).is_err());
    }
}
