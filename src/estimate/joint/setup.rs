//! The prior of texels in the joint solve, and the problem that it minimises.
//!
//! A texel's coordinates have a normal prior. [`choice`](super::choice) chooses its [`JointPrior`] by
//! leave-one-out predictions:
//!
//! | coordinate | prior mean | sigma |
//! |---|---|---|
//! | slopes | `relief` times the learned slopes | `slope` |
//! | roots of diffuse albedo | those of the photographs' colour times [`DIFFUSE_FRACTION`] | `diffuse` |
//! | roots of specular albedo | common gloss plus offset of the texel's classes | `specular` |
//! | roughness | common gloss plus offset of the texel's classes | `roughness` |
//!
//! The solve estimates the common gloss and the offsets. The common gloss has mean [`JointOptions::gloss`]
//! (roughness .5) and sigma [`JointOptions::gloss_sigma`]; offsets have mean 0 and sigma `between_classes`. With two
//! photographs, [`Setup::around`] takes the means from the maps so far.

use std::ops::Range;
use std::sync::Arc;

use super::directions::Directions;
use crate::estimate::bundle::{
    Descent, Groups, Limits, MIRRORED, Parameter, Problem, Sample, Shared, State,
};
use crate::estimate::clusters::{Clusters, Feature};
use crate::estimate::coordinates::Coordinates;
use crate::estimate::correction::{Correction, LightCorrection};
use crate::estimate::noise::Noise;
use crate::estimate::options::{EstimateOptions, JointOptions, JointPrior, SharedOptions};
use crate::svbrdf::{CHANNELS, channel};

/// Largest number of texels along the longer side.
pub(super) const TEXELS: usize = 64;
/// Diffuse share of the photographs' colour in the prior's mean.
pub(super) const DIFFUSE_FRACTION: f32 = 0.8;
/// A step with a smaller relative gain is the last.
const CONVERGED: f64 = 1e-4;
/// Longest steps: logarithm of a gain, exponent, offset of the flash (mm), light rotation (radians).
const MAX_STEPS: [f64; 4] = [1.0, 0.2, 15.0, 0.06];
/// Largest angle of a light rotation, radians: the model is one of small angles.
const MAX_ROTATION: f64 = 0.3;
/// Largest ambient fraction: with more, a photograph is not a flash photograph.
const MAX_AMBIENT: f64 = 0.4;
/// Radiance of ambient light (white paper under the flash is 1) above which a smooth sample shows a room's
/// unevenness.
const MIN_SURROUND: f32 = 0.01;

/// Largest number of anisotropy: the alphas differ by a factor of 12.
const MAX_ANISOTROPY: f64 = 2.5;
/// Range of a coat's roughness: a narrower highlight falls between the fitted texels; a wider one is that of
/// a rough base.
const COAT_ROUGHNESS: [f64; 2] = [0.15, 0.35];

/// Least roughness of a sheen: a smoother one shows only at angles that photographs of a board avoid.
const SHEEN_ROUGHNESS: f64 = 0.2;

/// Coordinates of gloss, which classes share.
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

/// A descent from the prior's mean and from uncorrected views.
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

/// The minimum nearest to the prior's mean, after at most `steps` steps.
pub(super) fn descended(problem: Problem, steps: usize) -> (Problem, State) {
    descent(problem, steps).run()
}

/// Classes of colour.
pub(super) fn clusters(colours: &[Feature], options: &JointOptions) -> Clusters {
    Clusters::find(colours, options.classes)
}

/// Means of the prior, and classes of colour.
#[derive(Debug, Clone)]
pub(super) struct Setup {
    pub classes: Clusters,
    /// Shares of each texel: 1 in the common gloss, then in each class.
    shares: Vec<f32>,
    /// Prior means of texels without the gloss of all and of classes.
    mean: Vec<Coordinates>,
    /// Prior means of the common gloss, then of each class's offset.
    means: Vec<Coordinates>,
    /// Anisotropy from which each of two directions starts.
    directions: Option<[[f64; 2]; 2]>,
}

impl Setup {
    /// Means from the photographs `which` and from the slopes of an `estimate`.
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
        Self { mean: mean.collect(), classes, shares, means, directions: None }
    }

    /// Takes the means from an estimate: its diffuse albedo, its mean gloss of each class, and an `own` share
    /// of each texel's deviation from it.
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

    /// Adds two classes of direction.
    pub fn with_directions(mut self, directions: &Directions) -> Self {
        let groups = self.means.len();
        let texels = self.shares.chunks_exact(groups).zip(&directions.shares);
        self.shares = texels.flat_map(|(of, shares)| of.iter().chain(shares).copied()).collect();
        self.means.extend([[0.0; CHANNELS]; 2]);
        self.directions = Some(directions.start);
        self
    }

    /// The problem of the photographs `which`. `board` says that a board determines the lights.
    pub fn problem(
        self,
        sample: &Arc<Sample>,
        which: Vec<usize>,
        prior: &JointPrior,
        board: bool,
        options: &EstimateOptions,
    ) -> Problem {
        let EstimateOptions { joint: options, noise, .. } = options;
        // Errors of the model are alike all over a sample: fewer texels count against the priors of shared
        // unknowns.
        let scale = sample.texels() as f64 / options.independent_texels;
        let [root, roughness] = options.gloss_sigma.map(|s| scale / (s * s));
        let of_all =
            std::array::from_fn(|c| if c == channel::ROUGHNESS { roughness } else { root });
        let classes = self.classes.len();
        let of_class =
            scale / classes.max(1) as f64 / (prior.between_classes * prior.between_classes);
        let mut precision = vec![[of_class; CHANNELS]; 1 + classes];
        precision[0] = of_all;
        // Directions have the gloss of their colours.
        precision.resize(self.means.len(), [f64::MAX.sqrt(); CHANNELS]);
        let mut shared = shared(sample, &which, board, scale, prior, &options.shared);
        shared.extend(self.anisotropy(prior, scale, options.shared.anisotropy));
        Problem {
            shared,
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

    /// The unknowns of the anisotropy: of all texels, of each class round it, and of two directions.
    fn anisotropy(
        &self,
        prior: &JointPrior,
        scale: f64,
        [of_all, of_class]: [f64; 2],
    ) -> Vec<Shared> {
        if prior.directions == 0 {
            return Vec::new();
        }
        let classes = self.classes.len();
        // A class has a part of the texels.
        let of_class = of_class * (classes as f64).sqrt();
        let groups = std::iter::once((of_all, [0.0; 2]))
            .chain(std::iter::repeat_n((of_class, [0.0; 2]), classes))
            .chain(self.directions.iter().flatten().map(|start| (of_all, *start)));
        let numbers = |(group, (sigma, start)): (usize, (f64, [f64; 2]))| {
            [0, 1].map(|i| {
                Shared::new(Parameter::Anisotropy(group, i), scale / (sigma * sigma), 0.5)
                    .around(start[i])
                    .within(-MAX_ANISOTROPY, MAX_ANISOTROPY)
            })
        };
        groups.enumerate().flat_map(numbers).collect()
    }
}

/// Unknowns that all texels share: gains, exponent and flash; with a board the reflected ambient light;
/// without one the ambient light and, with many photographs, light rotations; accepted optional lobes.
fn shared(
    sample: &Sample,
    which: &[usize],
    board: bool,
    scale: f64,
    prior: &JointPrior,
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
    if prior.coated {
        let [weight, roughness] = sigmas.coat;
        let weight = new(Parameter::Coat(0), weight, 0.3).around(1.0);
        let roughness = new(Parameter::Coat(1), roughness, 0.1);
        let [least, most] = COAT_ROUGHNESS;
        all.push(weight.within(0.0, 1.0));
        all.push(roughness.around(sigmas.coat_roughness).within(least, most));
    }
    if prior.sheen {
        let [colour, roughness] = sigmas.sheen;
        // Colour and roughness start where both have derivatives.
        let colours = (0..3).map(|i| new(Parameter::Sheen(i), colour, 0.3).around(0.1));
        all.extend(colours.map(|colour| colour.within(0.0, 1.0)));
        let roughness = new(Parameter::Sheen(3), roughness, 0.1).around(0.5);
        all.push(roughness.within(SHEEN_ROUGHNESS, 1.0));
    }
    all
}
