//! The structured prior: few material classes with small deviations of texels, found together with
//! exposure and place of the flash; its widths chosen by leaving photographs out.
//!
//! Texels get their gloss from the tails of highlights, and there the model of the lobe is 10 to 15 %
//! off, alike all over the sample: a prior that lets each texel follow makes the prediction of further
//! photographs worse with every photograph. Gloss is therefore that of soft classes of like colour,
//! with deviations of texels only as far as they help to predict; slopes are flat in the same sense.
//! What all texels share (gain of each photograph, exposure over distance, one offset of the flash) is
//! found in the same equations, each texel eliminated (Schur complement).
//!
//! How far texels may deviate differs from material to material. Candidates are compared by how well
//! they predict each of the latest photographs from all others (leave-one-out cross-validation), at a
//! few texels as they are: averages would hide relief. Where the widest wins, or the maps of the other
//! phases have predicted the latest photograph better (prequential error), those go on, and nothing is
//! changed. A choice once made needs less evidence to stay.
//!
//! Two photographs cannot be left out. They tell whether exposure and flash are as given: where the
//! classes explain them clearly better with both free (a likelihood ratio), the light is known badly,
//! texels would follow it, and the classes are taken, round the latent estimate.

mod groups;
mod prediction;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::sync::Arc;

use super::belief::Belief;
use super::bundle::{Descent, Groups, Limits, Parameter, Problem, Sample, Shared, State};
use super::correction::{Correction, Exposure};
use super::finer::full_colours;
use super::noise::Noise;
use super::options::{EstimateOptions, StructuredOptions, Widths};
use super::photographs::Photographs;
use super::prior::{Coordinates, Prior, from_coordinate, to_coordinate};
use crate::Svbrdf;
use crate::parallel;
use crate::svbrdf::{CHANNELS, channel};
use groups::Classes;
pub(crate) use prediction::Predicted;

/// Coordinates that classes share.
const GLOSS: Range<usize> = channel::SPECULAR..CHANNELS;

/// Coordinates of the diffuse albedo.
const DIFFUSE: Range<usize> = channel::DIFFUSE..channel::DIFFUSE + 3;

/// Trials of the widths in progress.
pub(crate) struct WidthTrials {
    options: EstimateOptions,
    /// Whether exposure and flash are free.
    free: bool,
    sample: Arc<Sample>,
    /// Photographs that the trials see.
    which: Vec<usize>,
    /// Classes round the estimate, where photographs are too few to leave one out.
    few: Option<Setup>,
    /// Photographs left out, each in turn.
    folds: Vec<usize>,
    /// How the maps before the latest photograph predicted it.
    predicted: Option<Predicted>,
    /// Of the trials done: squared errors of each candidate for each photograph left out; then what
    /// the widest leaves of all photographs. Of few photographs: costs with exposure and flash as
    /// given, and free.
    pub errors: Vec<f64>,
}

impl WidthTrials {
    /// Before the first trial, with the latent estimate. Where a board tells exposure and flash, they
    /// are not `free`.
    pub fn new(
        photographs: &Photographs,
        estimate: &Svbrdf,
        free: bool,
        predicted: Option<Predicted>,
        options: &EstimateOptions,
    ) -> Self {
        let (count, o) = (photographs.len(), &options.structured);
        let averaged = if count < o.leave_out_from { o.trial_texels } else { o.trial_averaged };
        let sample = Sample::new(photographs, averaged, o.trial_texels);
        let few = (count < o.leave_out_from).then(|| {
            let which: Vec<usize> = (0..count).collect();
            let setup = Setup::new(&sample, &which, o.few.classes, options);
            setup.around(&sample.coordinates(estimate), o.own_share)
        });
        Self {
            options: options.clone(),
            free,
            sample: Arc::new(sample),
            which: photographs.drawn(0),
            few,
            folds: (count.saturating_sub(o.folds)..count).collect(),
            predicted,
            errors: Vec::new(),
        }
    }

    /// Trials in all.
    pub fn count(&self) -> usize {
        if self.few.is_some() { 2 } else { self.predictions() + 1 }
    }

    /// Trials that predict photographs.
    fn predictions(&self) -> usize {
        self.options.structured.candidates.len() * self.folds.len()
    }

    /// Whether all trials are done.
    pub fn is_done(&self) -> bool {
        self.errors.len() >= self.count()
    }

    /// The next trial.
    pub fn step(&mut self) {
        let error = match &self.few {
            Some(setup) => self.cost_of_all(setup),
            None => self.error_of_next(),
        };
        self.errors.push(error);
    }

    /// The cost of all photographs, first with exposure and flash as given, then with both free.
    fn cost_of_all(&self, setup: &Setup) -> f64 {
        let (options, few) = (&self.options, self.options.structured.few);
        let which: Vec<usize> = (0..self.sample.photographs.len()).collect();
        let free = self.free && !self.errors.is_empty();
        let problem = setup.clone().problem(&self.sample, which, few, free, options);
        let (problem, state) = descended(problem, options.structured.trial_steps, options);
        problem.cost(&state)
    }

    /// Predicts the next photograph that is left out from all others, or fits all.
    fn error_of_next(&self) -> f64 {
        let (done, last) = (self.errors.len(), self.options.structured.candidates.len() - 1);
        let folds = self.folds.len();
        let (candidate, left_out) = match done.checked_sub(self.predictions()) {
            None => (done / folds, Some(self.folds[done % folds])),
            Some(_) => (last, None),
        };
        let widths = self.options.structured.candidates[candidate];
        let which: Vec<usize> =
            self.which.iter().copied().filter(|&i| Some(i) != left_out).collect();
        let setup = Setup::new(&self.sample, &which, widths.classes, &self.options);
        let problem = setup.problem(&self.sample, which, widths, self.free, &self.options);
        let (problem, state) =
            descended(problem, self.options.structured.trial_steps, &self.options);
        match left_out {
            Some(left_out) => {
                let at = |t| problem.coordinates(t, &state);
                prediction::error(&problem.sample, left_out, &state.correction, at)
            }
            None => problem.mean_residual(&state),
        }
    }

    /// Sum of the squared errors of each candidate.
    fn sums(&self) -> Vec<f64> {
        let predictions = &self.errors[..self.predictions().min(self.errors.len())];
        predictions.chunks(self.folds.len().max(1)).map(|e| e.iter().sum()).collect()
    }

    /// Takes over errors of trials that were done before; whether they fit.
    pub fn resume(&mut self, errors: Vec<f64>) -> bool {
        self.errors = errors;
        self.errors.len() <= self.count()
    }

    /// The prior that was chosen, if any.
    pub fn chosen(&self) -> Option<Widths> {
        match self.errors.as_slice() {
            &[given, free] if self.few.is_some() => {
                let StructuredOptions { contradiction, few, .. } = self.options.structured;
                (given > contradiction * free).then_some(few)
            }
            _ => self.chosen_by_prediction(),
        }
    }

    /// Of the narrow candidates that predict better than the widest and than the maps of the other
    /// phases that were before the latest photograph, the one that predicts best. Where there are no
    /// such maps, it must be the better for it; a choice made before stays until the widest predicts
    /// better. None begins where free texels explain the photographs to within noise and rounding.
    fn chosen_by_prediction(&self) -> Option<Widths> {
        let (sums, options) = (self.sums(), &self.options.structured);
        let widest = sums.last()?.max(f64::MIN_POSITIVE);
        let begins = *self.errors.last()? > options.min_residual;
        let is_better = |&candidate: &usize| {
            let of_widest = sums[candidate] / widest;
            let latest = self.errors[(candidate + 1) * self.folds.len() - 1];
            match self.predicted {
                Some(Predicted { structured: true, photographs, .. })
                    if photographs >= options.leave_out_from =>
                {
                    of_widest < 1.0
                }
                Some(Predicted { structured: false, error, .. }) => {
                    begins && of_widest < options.evidence && latest < options.evidence * error
                }
                _ => begins && of_widest < options.evidence_alone,
            }
        };
        let better = (0..sums.len() - 1).filter(is_better);
        let best = better.min_by(|&a, &b| sums[a].total_cmp(&sums[b]))?;
        Some(options.candidates[best])
    }
}

/// Fits classes, texels, exposure and flash with the chosen widths; the belief's mean are flat maps
/// with the gloss of their classes, of few photographs with a part of the estimate's own deviation,
/// its widths those chosen.
pub(super) fn fit(
    photographs: &mut Photographs,
    belief: &mut Belief,
    widths: Widths,
    free: bool,
    options: &EstimateOptions,
) {
    let o = &options.structured;
    let sample = Arc::new(Sample::new(photographs.working(), o.texels, o.texels));
    let which: Vec<usize> = (0..photographs.len()).collect();
    let mut setup = Setup::new(&sample, &which, widths.classes, options);
    let own = (which.len() < o.leave_out_from).then_some(o.own_share);
    if let Some(own) = own {
        let maps = belief.maps.thinned(photographs.thinning());
        setup = setup.around(&sample.coordinates(&maps), own);
    }
    let classes = setup.classes.clone();
    let problem = setup.problem(&sample, which, widths, free, options);
    let (problem, state) = descended(problem, o.steps, options);
    let mut gloss = state.groups;
    for (class, mean) in gloss.iter_mut().zip(&problem.groups.mean) {
        class.iter_mut().zip(mean).for_each(|(v, m)| *v -= own.unwrap_or(0.0) * m);
    }
    let classes = Gloss { classes, values: gloss };
    belief.mean = classes.flat_maps(&belief.maps, own, photographs, o);
    belief.maps.clone_from(&belief.mean);
    belief.prior = Prior { sigma: sigmas(&widths).map(|s| s as f32) };
    belief.fixed_noise = Some(o.noise as f32);
    let mirrored = photographs.correction().mirrored.clone();
    photographs.correct(Correction { mirrored, ..state.correction });
}

/// Standard deviations of texels' coordinates.
fn sigmas(widths: &Widths) -> Coordinates {
    std::array::from_fn(|c| match c {
        channel::SLOPE_X | channel::SLOPE_Y => widths.slope,
        channel::ROUGHNESS => widths.roughness,
        _ if c < channel::SPECULAR => widths.diffuse,
        _ => widths.specular,
    })
}

/// The most probable state near the prior's mean.
fn descended(problem: Problem, steps: usize, options: &EstimateOptions) -> (Problem, State) {
    let views = problem.which.iter().map(|&i| &problem.sample.photographs[i].view);
    let correction = Correction { exposure: Exposure::as_given(views), ..Correction::default() };
    let start = problem.start(correction);
    Descent::new(problem, start, Limits { steps, converged: options.structured.converged }).run()
}

/// What the prior of a fit refers to.
#[derive(Debug, Clone)]
struct Setup {
    classes: Classes,
    shares: Vec<f32>,
    /// Prior means of texels, but for gloss: what is added to that of the classes.
    mean: Vec<Coordinates>,
    class_means: Vec<Coordinates>,
}

impl Setup {
    fn new(sample: &Sample, which: &[usize], count: usize, options: &EstimateOptions) -> Self {
        let options = &options.structured;
        let colours = sample.colours(which);
        let classes = Classes::find(&colours, count, options);
        let mut shares = vec![0.0; colours.len() * classes.len()];
        for (colour, out) in colours.iter().zip(shares.chunks_exact_mut(classes.len())) {
            classes.shares(colour, out);
        }
        let root = f64::from(options.diffuse_fraction.sqrt());
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
    fn around(mut self, estimate: &[Coordinates], own: f64) -> Self {
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

    fn problem(
        self,
        sample: &Arc<Sample>,
        which: Vec<usize>,
        widths: Widths,
        free: bool,
        options: &EstimateOptions,
    ) -> Problem {
        let (descent, options) = (options.bundle, &options.structured);
        // Errors of the model are alike all over a sample: what is shared is weighed by fewer texels.
        let scale = sample.texels() as f64 / options.independent_texels;
        let of_class = scale / self.classes.len() as f64;
        let [root, roughness] = options.class_sigma.map(|s| of_class / (s * s));
        let precision =
            std::array::from_fn(|c| if c == channel::ROUGHNESS { roughness } else { root });
        let shared = if free { exposure(which.len(), scale, options) } else { Vec::new() };
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
            noise: Noise { scale: options.noise as f32, huber: options.huber as f32 },
            options: descent,
        }
    }
}

/// Exposure of so many photographs and place of the flash.
fn exposure(photographs: usize, scale: f64, options: &StructuredOptions) -> Vec<Shared> {
    let StructuredOptions { gain_sigma, exponent_sigma, offset_sigma_mm, .. } = *options;
    let [of_gain, of_exponent, of_flash] = options.max_steps;
    let shared =
        |parameter, sigma: f64, most| Shared::new(parameter, scale / (sigma * sigma), most);
    let gains = (0..photographs).map(|i| shared(Parameter::Gain(i), gain_sigma, of_gain));
    let flash = (0..3).map(|axis| shared(Parameter::Flash(axis), offset_sigma_mm, of_flash));
    gains.chain([shared(Parameter::Exponent, exponent_sigma, of_exponent)]).chain(flash).collect()
}

/// Classes and the gloss of each.
struct Gloss {
    classes: Classes,
    values: Vec<Coordinates>,
}

impl Gloss {
    /// Flat maps with the gloss of their classes, of the colours that photographs show; or with an
    /// `own` part of the estimate's gloss added, and its diffuse albedo.
    fn flat_maps(
        &self,
        estimate: &Svbrdf,
        own: Option<f64>,
        photographs: &Photographs,
        options: &StructuredOptions,
    ) -> Svbrdf {
        let colours = full_colours(photographs);
        let mut maps = Svbrdf::new(estimate.width(), estimate.height());
        let width = maps.width();
        for (i, c) in DIFFUSE.enumerate() {
            let plane = maps.plane_mut(c);
            match own {
                Some(_) => plane.copy_from_slice(estimate.plane(c)),
                None => {
                    let pairs = plane.iter_mut().zip(&colours);
                    pairs.for_each(|(v, f)| *v = options.diffuse_fraction * f[i] * f[i]);
                }
            }
        }
        let own = own.unwrap_or(0.0) as f32;
        let scratch = || vec![0.0; self.classes.len()];
        for c in GLOSS {
            let rows = maps.plane_mut(c).chunks_mut(width);
            parallel::parts_with(rows, scratch, |shares, y, row| {
                for (x, v) in row.iter_mut().enumerate() {
                    self.classes.shares(&colours[y * width + x], shares);
                    let of_classes = shares.iter().zip(&self.values);
                    let value: f64 = of_classes.map(|(s, g)| f64::from(*s) * g[c]).sum();
                    let estimate = to_coordinate(c, estimate.plane(c)[y * width + x]);
                    *v = from_coordinate(c, value as f32 + own * estimate);
                }
            });
        }
        maps.clamp();
        maps
    }
}
