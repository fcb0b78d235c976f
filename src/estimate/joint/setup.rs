//! The problem that the joint solve minimises.

use std::ops::Range;
use std::sync::Arc;

use crate::estimate::bundle::{
    Descent, Groups, Limits, MIRRORED, Parameter, Problem, Sample, Shared, State,
};
use crate::estimate::clusters::{Clusters, Feature};
use crate::estimate::coordinates::Coordinates;
use crate::estimate::correction::{Correction, LightCorrection};
use crate::estimate::noise::Noise;
use crate::estimate::options::{EstimateOptions, JointOptions, JointPrior, SharedOptions};
use crate::svbrdf::{CHANNELS, channel};

/// Texels along the longer side that are fitted, at most.
pub(super) const TEXELS: usize = 64;
/// Share of the colour seen that is diffuse, in the prior's mean.
pub(super) const DIFFUSE_FRACTION: f32 = 0.8;
/// Relative gain of a step that is not worth another.
const CONVERGED: f64 = 1e-4;
/// Longest steps: of a logarithm of gain, of the exponent, of the flash in mm, of a turn in radians.
const MAX_STEPS: [f64; 4] = [1.0, 0.2, 15.0, 0.06];
/// Longest turn of a light, radians: the model is one of small angles.
const MAX_ROTATION: f64 = 0.3;
/// Largest ambient fraction: beyond it a capture is no flash capture.
const MAX_AMBIENT: f64 = 0.4;
/// Radiance of ambient light, white paper under the flash being 1, from which on a smooth sample shows that
/// a room is not uniform.
const MIN_SURROUND: f32 = 0.01;

/// Greatest number of an anisotropy: the alphas differ by a factor of 12.
const MAX_ANISOTROPY: f64 = 2.5;
/// Roughness of a coat: a narrower highlight falls between the texels that are fitted, which then say
/// nothing of it; a wider one is that of a rough base.
const COAT_ROUGHNESS: [f64; 2] = [0.15, 0.35];

/// Coordinates that classes share.
pub(super) const GLOSS: Range<usize> = channel::SPECULAR..CHANNELS;

/// Coordinates of the diffuse albedo.
pub(super) const DIFFUSE: Range<usize> = channel::DIFFUSE..channel::DIFFUSE + 3;

impl JointPrior {
    /// Standard deviations of texels' coordinates.
    pub(super) fn sigmas(&self) -> Coordinates {
        std::array::from_fn(|c| match c {
            channel::SLOPE_X | channel::SLOPE_Y => self.slope,
            channel::ROUGHNESS => self.roughness,
            _ if c < channel::SPECULAR => self.diffuse,
            _ => self.specular,
        })
    }
}

/// A descent from the prior's mean, with nothing corrected.
pub(super) fn descent(problem: Problem, steps: usize) -> Descent {
    let count = problem.which.len();
    let views = problem.which.iter().map(|&i| &problem.sample.photographs[i].view);
    let correction = Correction {
        exposure: LightCorrection::as_given(views),
        turns: vec![[0.0; 2]; count],
        mirrored: vec![0.0; count],
        ..Correction::default()
    };
    let start = problem.start(correction);
    Descent::new(problem, start, Limits { steps, converged: CONVERGED })
}

/// The most probable state near the prior's mean.
pub(super) fn descended(problem: Problem, steps: usize) -> (Problem, State) {
    descent(problem, steps).run()
}

/// Classes of colours.
pub(super) fn clusters(colours: &[Feature], options: &JointOptions) -> Clusters {
    Clusters::find(colours, options.classes, None)
}

/// What the prior refers to: classes of colour and the texels' prior means.
#[derive(Debug, Clone)]
pub(super) struct Setup {
    pub classes: Clusters,
    /// How much texels belong to all, and to each class.
    shares: Vec<f32>,
    /// Prior means of texels, but for gloss: what is added to that of the classes.
    mean: Vec<Coordinates>,
    /// Prior means of the gloss of all and of what each class adds.
    means: Vec<Coordinates>,
}

impl Setup {
    /// Of some photographs, on a share of the slopes of an `estimate`.
    pub fn new(
        sample: &Sample,
        which: &[usize],
        prior: &JointPrior,
        estimate: &[Coordinates],
        options: &JointOptions,
    ) -> Self {
        let colours = sample.colours(which);
        let classes = clusters(&colours, options);
        let mut shares = vec![1.0; colours.len() * (1 + classes.len())];
        for (colour, out) in colours.iter().zip(shares.chunks_exact_mut(1 + classes.len())) {
            classes.shares(colour, &mut out[1..]);
        }
        let root = f64::from(DIFFUSE_FRACTION.sqrt());
        let mean = colours.iter().zip(estimate).map(|(colour, estimate)| {
            let mut mean = [0.0; CHANNELS];
            for c in [channel::SLOPE_X, channel::SLOPE_Y] {
                mean[c] = prior.relief * estimate[c];
            }
            for c in 0..3 {
                mean[channel::DIFFUSE + c] = root * f64::from(colour[c]);
            }
            mean
        });
        let [root, roughness] = options.gloss;
        let mut means = vec![[0.0; CHANNELS]; 1 + classes.len()];
        means[0][GLOSS].copy_from_slice(&[root, root, root, roughness]);
        Self { mean: mean.collect(), classes, shares, means }
    }

    /// Round an estimate: its diffuse albedo, its mean gloss of each class, and an `own` share of each
    /// texel's deviation from that.
    pub fn around(mut self, estimate: &[Coordinates], own: f64) -> Self {
        let count = self.means.len();
        let mut totals = vec![1e-9; count];
        self.means.fill([0.0; CHANNELS]);
        for (x, shares) in estimate.iter().zip(self.shares.chunks_exact(count)) {
            for ((mean, total), share) in self.means.iter_mut().zip(&mut totals).zip(shares) {
                *total += f64::from(*share);
                GLOSS.for_each(|c| mean[c] += f64::from(*share) * x[c]);
            }
        }
        for (mean, total) in self.means.iter_mut().zip(totals) {
            mean.iter_mut().for_each(|m| *m /= total);
        }
        let of_all = self.means[0];
        for mean in &mut self.means[1..] {
            GLOSS.for_each(|c| mean[c] -= of_all[c]);
        }
        for ((mean, x), shares) in
            self.mean.iter_mut().zip(estimate).zip(self.shares.chunks_exact(count))
        {
            mean[DIFFUSE].copy_from_slice(&x[DIFFUSE]);
            for c in GLOSS {
                let of_classes = shares.iter().zip(&self.means);
                let of_classes: f64 = of_classes.map(|(s, m)| f64::from(*s) * m[c]).sum();
                mean[c] = own * (x[c] - of_classes);
            }
        }
        self
    }

    /// The problem of these photographs; `board`: whether a board has shown the lights.
    pub fn problem(
        self,
        sample: &Arc<Sample>,
        which: Vec<usize>,
        prior: &JointPrior,
        board: bool,
        options: &EstimateOptions,
    ) -> Problem {
        let EstimateOptions { joint: options, noise, .. } = options;
        // Errors of the model are alike all over a sample: what is shared is weighed by fewer texels.
        let scale = sample.texels() as f64 / options.independent_texels;
        let [root, roughness] = options.gloss_sigma.map(|s| scale / (s * s));
        let of_all =
            std::array::from_fn(|c| if c == channel::ROUGHNESS { roughness } else { root });
        let classes = self.classes.len();
        let of_class = scale / classes.max(1) as f64 / (prior.between * prior.between);
        let mut precision = vec![[of_class; CHANNELS]; 1 + classes];
        precision[0] = of_all;
        Problem {
            shared: shared(sample, &which, board, scale, prior, classes, &options.shared),
            sample: sample.clone(),
            which,
            mean: self.mean,
            precision: prior.sigmas().map(|s| s.powi(-2)),
            groups: Groups {
                coordinates: GLOSS,
                range: [-1.0, 1.0],
                shares: self.shares,
                mean: self.means,
                precision,
            },
            noise: Noise { scale: prior.noise as f32, huber: noise.huber },
        }
    }
}

/// What all texels share: exposure of each photograph and place of the flash; with a board what a smooth
/// sample mirrors of the room, without one ambient light and, of many photographs, the direction of each light.
fn shared(
    sample: &Sample,
    which: &[usize],
    board: bool,
    scale: f64,
    prior: &JointPrior,
    classes: usize,
    sigmas: &SharedOptions,
) -> Vec<Shared> {
    let [of_gain, of_exponent, of_flash, of_rotation] = MAX_STEPS;
    let new = |parameter, sigma: f64, most| Shared::new(parameter, scale / (sigma * sigma), most);
    let photographs = 0..which.len();
    let gains = photographs.clone().map(|i| new(Parameter::Gain(i), sigmas.gain, of_gain));
    let flash = (0..3).map(|axis| new(Parameter::Flash(axis), sigmas.offset_mm, of_flash));
    let exponent = new(Parameter::Exponent, sigmas.exponent, of_exponent);
    let mut all: Vec<Shared> = gains.chain([exponent]).chain(flash).collect();
    if !board {
        let ambient = new(Parameter::Ambient, sigmas.ambient, f64::INFINITY);
        all.push(ambient.within(0.0, MAX_AMBIENT));
        if which.len() >= sigmas.turns_from {
            all.extend(photographs.flat_map(|i| {
                [0, 1].map(|axis| {
                    new(Parameter::Rotation(i, axis), sigmas.turn, of_rotation)
                        .within(-MAX_ROTATION, MAX_ROTATION)
                })
            }));
        }
    } else if which.iter().any(|&i| sample.photographs[i].view.ambient[1] > MIN_SURROUND) {
        let [low, high] = MIRRORED;
        all.extend(
            photographs
                .map(|i| new(Parameter::Mirrored(i), sigmas.mirrored, 1.0).within(low, high)),
        );
    }
    if prior.anisotropic {
        let [low, high] = [-MAX_ANISOTROPY, MAX_ANISOTROPY];
        let [of_all, of_class] = sigmas.anisotropy;
        for group in 0..=classes {
            // A class is a part of the texels.
            let sigma = if group == 0 { of_all } else { of_class * (classes as f64).sqrt() };
            let numbers = [0, 1].map(|i| new(Parameter::Anisotropy(group, i), sigma, 0.5));
            all.extend(numbers.map(|number| number.within(low, high)));
        }
    }
    if prior.coated {
        let [weight, roughness] = sigmas.coat;
        let weight = new(Parameter::Coat(0), weight, 0.3).around(1.0);
        let roughness = new(Parameter::Coat(1), roughness, 0.1);
        let [least, most] = COAT_ROUGHNESS;
        all.push(weight.within(0.0, 1.0));
        all.push(roughness.around(sigmas.coat_roughness).within(least, most));
    }
    all
}
