//! The problem that a fit with the structured prior solves.

use std::ops::Range;
use std::sync::Arc;

use crate::estimate::bundle::{Descent, Groups, Limits, Parameter, Problem, Sample, Shared, State};
use crate::estimate::clusters::Clusters;
use crate::estimate::correction::{Correction, Exposure};
use crate::estimate::lights::{Free, parameters};
use crate::estimate::noise::Noise;
use crate::estimate::options::{EstimateOptions, StructuredOptions, Widths};
use crate::estimate::prior::Coordinates;
use crate::svbrdf::{CHANNELS, channel};

/// Part of the colour seen that is diffuse, in the prior's mean.
pub(super) const DIFFUSE_FRACTION: f32 = 0.8;
/// Steps of a fit, at most.
pub(super) const STEPS: usize = 12;
/// Relative gain of a step that is not worth another.
const CONVERGED: f64 = 1e-4;
/// Longest steps: of a logarithm of gain, of the exponent, of the flash in mm.
const MAX_STEPS: [f64; 3] = [1.0, 0.2, 15.0];

/// Coordinates that classes share.
pub(super) const GLOSS: Range<usize> = channel::SPECULAR..CHANNELS;

/// Coordinates of the diffuse albedo.
pub(super) const DIFFUSE: Range<usize> = channel::DIFFUSE..channel::DIFFUSE + 3;

/// Standard deviations of texels' coordinates.
pub(super) fn sigmas(widths: &Widths) -> Coordinates {
    std::array::from_fn(|c| match c {
        channel::SLOPE_X | channel::SLOPE_Y => widths.slope,
        channel::ROUGHNESS => widths.roughness,
        _ if c < channel::SPECULAR => widths.diffuse,
        _ => widths.specular,
    })
}

/// The most probable state near the prior's mean.
pub(super) fn descended(problem: Problem, steps: usize) -> (Problem, State) {
    let views = problem.which.iter().map(|&i| &problem.sample.photographs[i].view);
    let turns = vec![[0.0; 2]; problem.which.len()];
    let exposure = Exposure::as_given(views);
    let correction = Correction { exposure, turns, ..Correction::default() };
    let start = problem.start(correction);
    Descent::new(problem, start, Limits { steps, converged: CONVERGED }).run()
}

/// What of lights is free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Light {
    AsGiven,
    /// Exposure and flash.
    Exposure,
    /// What the other phases correct: ambient light, and of many photographs each light's direction.
    Ambient {
        turn: bool,
    },
    /// All of these.
    Free {
        turn: bool,
    },
}

/// What the prior of a fit refers to.
#[derive(Debug, Clone)]
pub(super) struct Setup {
    pub classes: Clusters,
    shares: Vec<f32>,
    /// Prior means of texels, but for gloss: what is added to that of the classes.
    mean: Vec<Coordinates>,
    class_means: Vec<Coordinates>,
}

impl Setup {
    pub fn new(sample: &Sample, which: &[usize], count: usize, options: &EstimateOptions) -> Self {
        let options = &options.structured;
        let colours = sample.colours(which);
        let classes = Clusters::find(&colours, count, None);
        let mut shares = vec![0.0; colours.len() * classes.len()];
        for (colour, out) in colours.iter().zip(shares.chunks_exact_mut(classes.len())) {
            classes.shares(colour, out);
        }
        let root = f64::from(DIFFUSE_FRACTION.sqrt());
        let mean = colours.iter().map(|colour| {
            let mut mean = [0.0; CHANNELS];
            for c in 0..3 {
                mean[channel::DIFFUSE + c] = root * f64::from(colour[c]);
            }
            mean
        });
        let [root, roughness] = options.class_mean;
        let mut class_mean = [0.0; CHANNELS];
        class_mean[GLOSS].copy_from_slice(&[root, root, root, roughness]);
        let class_means = vec![class_mean; classes.len()];
        Self { mean: mean.collect(), classes, shares, class_means }
    }

    /// Round an estimate: its diffuse albedo, its mean gloss of each class, and an `own` part of each
    /// texel's deviation from that.
    pub fn around(mut self, estimate: &[Coordinates], own: f64) -> Self {
        let count = self.classes.len();
        let mut totals = vec![1e-9; count];
        self.class_means.fill([0.0; CHANNELS]);
        for (x, shares) in estimate.iter().zip(self.shares.chunks_exact(count)) {
            for ((mean, total), share) in self.class_means.iter_mut().zip(&mut totals).zip(shares) {
                *total += f64::from(*share);
                GLOSS.for_each(|c| mean[c] += f64::from(*share) * x[c]);
            }
        }
        for (mean, total) in self.class_means.iter_mut().zip(totals) {
            mean.iter_mut().for_each(|m| *m /= total);
        }
        for ((mean, x), shares) in
            self.mean.iter_mut().zip(estimate).zip(self.shares.chunks_exact(count))
        {
            mean[DIFFUSE].copy_from_slice(&x[DIFFUSE]);
            for c in GLOSS {
                let of_classes = shares.iter().zip(&self.class_means);
                let of_classes: f64 = of_classes.map(|(s, m)| f64::from(*s) * m[c]).sum();
                mean[c] = own * (x[c] - of_classes);
            }
        }
        self
    }

    pub fn problem(
        self,
        sample: &Arc<Sample>,
        which: Vec<usize>,
        widths: Widths,
        free: Light,
        options: &EstimateOptions,
    ) -> Problem {
        let EstimateOptions { lights, structured: options, noise, .. } = options;
        // Errors of the model are alike all over a sample: what is shared is weighed by fewer texels.
        let scale = sample.texels() as f64 / options.independent_texels;
        let of_class = scale / self.classes.len() as f64;
        let [root, roughness] = options.class_sigma.map(|s| of_class / (s * s));
        let precision =
            std::array::from_fn(|c| if c == channel::ROUGHNESS { roughness } else { root });
        let exposure = || exposure(which.len(), scale, options);
        let ambient = |turn| {
            let free = Free { turn, ambient: true, mirror: false };
            let scale = sample.texels() as f64 / lights.independent_texels;
            parameters(which.len(), scale, free, lights)
        };
        let shared = match free {
            Light::AsGiven => Vec::new(),
            Light::Exposure => exposure(),
            Light::Ambient { turn } => ambient(turn),
            Light::Free { turn } => [exposure(), ambient(turn)].concat(),
        };
        Problem {
            sample: sample.clone(),
            which,
            mean: self.mean,
            precision: sigmas(&widths).map(|s| s.powi(-2)),
            groups: Groups {
                coordinates: GLOSS,
                range: [0.0, 1.0],
                shares: self.shares,
                mean: self.class_means,
                precision,
            },
            shared,
            noise: Noise { scale: options.noise as f32, huber: noise.huber },
        }
    }
}

/// Exposure of so many photographs and place of the flash.
fn exposure(photographs: usize, scale: f64, options: &StructuredOptions) -> Vec<Shared> {
    let StructuredOptions { gain_sigma, exponent_sigma, offset_sigma_mm, .. } = *options;
    let [of_gain, of_exponent, of_flash] = MAX_STEPS;
    let shared =
        |parameter, sigma: f64, most| Shared::new(parameter, scale / (sigma * sigma), most);
    let gains = (0..photographs).map(|i| shared(Parameter::Gain(i), gain_sigma, of_gain));
    let flash = (0..3).map(|axis| shared(Parameter::Flash(axis), offset_sigma_mm, of_flash));
    gains.chain([shared(Parameter::Exponent, exponent_sigma, of_exponent)]).chain(flash).collect()
}
