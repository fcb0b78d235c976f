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
//! few texels. Where the widest wins, as on bumpy materials that photographs explain well, the other
//! phases of the schedule do better, and nothing is changed.
//!
//! Two photographs cannot be left out. They tell whether exposure and flash are as given: where the
//! classes explain them clearly better with both free (a likelihood ratio), the light is known badly,
//! texels would follow it, and the classes are taken, round the latent estimate.

mod descent;
mod groups;
mod problem;
mod sample;
#[cfg(test)]
mod tests;

use super::belief::Belief;
use super::correction::Correction;
use super::options::{StructuredOptions, Widths};
use super::photographs::Photographs;
use super::prior::{Prior, from_coordinate, to_coordinate};
use crate::Svbrdf;
use crate::parallel;
use crate::svbrdf::{CHANNELS, channel};
use groups::{Classes, Feature};
use problem::{CLASS, Free, GLOSS, Problem, State, precision};
use sample::{Coordinates, Lit, Sample, colours, natural};
use std::ops::Range;

/// Fraction of the colour seen that is diffuse, in the prior's mean.
const DIFFUSE_FRACTION: f32 = 0.8;

/// Coordinates of the diffuse albedo.
const DIFFUSE: Range<usize> = channel::DIFFUSE..channel::DIFFUSE + 3;

/// Trials of the widths in progress.
pub(crate) struct WidthTrials {
    options: StructuredOptions,
    free: Free,
    sample: Sample,
    /// Classes round the estimate, where photographs are too few to leave one out.
    few: Option<Setup>,
    /// Photographs left out, each in turn.
    folds: Vec<usize>,
    /// Of the trials done: squared errors of each candidate for each photograph left out; then what
    /// the best narrow one and the widest leave of all photographs. Of few photographs: costs with
    /// exposure and flash as given, and free.
    pub errors: Vec<f64>,
}

impl WidthTrials {
    /// Before the first trial, with the latent estimate. Where a board tells exposure and flash, they
    /// are not `free`.
    pub fn new(
        photographs: &Photographs,
        estimate: &Svbrdf,
        free: bool,
        options: &StructuredOptions,
    ) -> Self {
        let count = photographs.len();
        let averaged =
            if count < options.leave_out_from { options.trial_texels } else { options.trial_averaged };
        let sample = Sample::new(photographs, averaged, options.trial_texels);
        let few = (count < options.leave_out_from).then(|| {
            let which: Vec<usize> = (0..count).collect();
            let setup = Setup::new(&sample, &which, options.few.classes, options);
            setup.around(&sample.coordinates(estimate), options.own_share)
        });
        Self {
            options: options.clone(),
            free: Free { exposure: free, offset: free },
            sample,
            few,
            folds: (count.saturating_sub(options.folds)..count).collect(),
            errors: Vec::new(),
        }
    }

    /// Trials in all.
    pub fn count(&self) -> usize {
        if self.few.is_some() { 2 } else { self.predictions() + 2 }
    }

    /// Trials that predict photographs.
    fn predictions(&self) -> usize {
        self.options.candidates.len() * self.folds.len()
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
        let (options, is_free) = (&self.options, !self.errors.is_empty());
        let which: Vec<usize> = (0..self.sample.photographs.len()).collect();
        let free = if is_free { self.free } else { Free { exposure: false, offset: false } };
        let problem = setup.problem(&self.sample, &which, options.few, free, options);
        problem.cost(&problem.descend(problem.start(), options.trial_steps))
    }

    /// Predicts the next photograph that is left out from all others, or fits all.
    fn error_of_next(&self) -> f64 {
        let (done, last) = (self.errors.len(), self.options.candidates.len() - 1);
        let folds = self.folds.len();
        let (candidate, left_out) = match done.checked_sub(self.predictions()) {
            None => (done / folds, Some(self.folds[done % folds])),
            Some(0) => (self.best_narrow(), None),
            Some(_) => (last, None),
        };
        let widths = self.options.candidates[candidate];
        let which: Vec<usize> =
            (0..self.sample.photographs.len()).filter(|&i| Some(i) != left_out).collect();
        let setup = Setup::new(&self.sample, &which, widths.classes, &self.options);
        let problem = setup.problem(&self.sample, &which, widths, self.free, &self.options);
        let state = problem.descend(problem.start(), self.options.trial_steps);
        match left_out {
            Some(left_out) => prediction_error(&problem, &state, left_out),
            None => problem.mean_residual(&state),
        }
    }

    /// Sum of the squared errors of each candidate.
    fn sums(&self) -> Vec<f64> {
        let predictions = &self.errors[..self.predictions().min(self.errors.len())];
        predictions.chunks(self.folds.len().max(1)).map(|e| e.iter().sum()).collect()
    }

    /// The candidate but the last that predicts best.
    fn best_narrow(&self) -> usize {
        let sums = self.sums();
        let narrow = sums.iter().take(self.options.candidates.len() - 1).enumerate();
        narrow.min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i)
    }

    /// Takes over errors of trials that were done before; whether they fit.
    pub fn resume(&mut self, errors: Vec<f64>) -> bool {
        self.errors = errors;
        self.errors.len() <= self.count()
    }

    /// The prior that was chosen, if any.
    pub fn chosen(&self) -> Option<Widths> {
        if std::env::var_os("TRIALS").is_some() {
            let n = self.sample.photographs.len();
            if self.few.is_some() {
                eprintln!("TRIAL {n} ratio {:.3}", self.errors[0] / self.errors[1]);
            } else {
                let sums = self.sums();
                let &[a, b] = self.errors.last_chunk().unwrap();
                let scale = sums[2];
                let rel: Vec<String> = sums.iter().map(|s| format!("{:.3}", s / scale)).collect();
                eprintln!("TRIAL {n} rel {} rms {:.4} narrow {a:.4} widest {b:.4} misfit {:.3} free {}", rel.join(" "), (scale / self.folds.len() as f64).sqrt(), b / a, self.free.exposure);
            }
        }
        match self.errors.as_slice() {
            &[given, free] if self.few.is_some() => {
                (given > self.options.contradiction * free).then_some(self.options.few)
            }
            _ => self.chosen_by_prediction(),
        }
    }

    /// The narrow candidate that predicts best, if it predicts better than the widest, and if the
    /// photographs are not explained much better without it: what is left even when every texel is
    /// free is the model's error, which texels follow.
    fn chosen_by_prediction(&self) -> Option<Widths> {
        let (sums, best) = (self.sums(), self.best_narrow());
        let &[narrow_residual, widest_residual] = self.errors.last_chunk()?;
        let predicts = sums[best] < self.options.evidence * sums.last()?;
        let StructuredOptions { min_misfit, min_residual, .. } = self.options;
        let misfits = widest_residual > (min_misfit * narrow_residual).max(min_residual);
        (predicts && misfits).then(|| self.options.candidates[best])
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
    options: &StructuredOptions,
) {
    let free = Free { exposure: free, offset: free };
    let sample = Sample::new(photographs, options.texels, options.texels);
    let which: Vec<usize> = (0..photographs.len()).collect();
    let mut setup = Setup::new(&sample, &which, widths.classes, options);
    let own = (which.len() < options.leave_out_from).then_some(options.own_share);
    if let Some(own) = own {
        setup = setup.around(&sample.coordinates(&belief.maps), own);
    }
    let problem = setup.problem(&sample, &which, widths, free, options);
    let state = problem.descend(problem.start(), options.steps);
    let mut gloss = state.classes.clone();
    for (class, mean) in gloss.iter_mut().zip(&setup.class_means) {
        class.iter_mut().zip(mean).for_each(|(v, m)| *v -= own.unwrap_or(0.0) * m);
    }
    let colours = colours(photographs.full(), photographs.given());
    belief.base = flat_maps(&belief.maps, own, &colours, &setup.classes, &gloss);
    belief.mean.clone_from(&belief.base);
    belief.maps.clone_from(&belief.base);
    belief.prior =
        Prior { sigma: std::array::from_fn(|c| precision(&widths, c).powf(-0.5) as f32) };
    belief.fixed_noise = Some(options.noise as f32);
    let mirrored = photographs.correction().mirrored.clone();
    photographs.correct(Correction { mirrored, ..state.correction });
}

/// What a fit's problem refers to.
struct Setup {
    classes: Classes,
    shares: Vec<f32>,
    /// Prior means of texels, but for gloss: what is added to that of the classes.
    mean: Vec<Coordinates>,
    class_means: Vec<[f64; CLASS]>,
}

impl Setup {
    fn new(sample: &Sample, which: &[usize], count: usize, options: &StructuredOptions) -> Self {
        let colours = sample.colours(which);
        let classes = Classes::find(&colours, count);
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
        let class_means = vec![[root, root, root, roughness]; classes.len()];
        Self { mean: mean.collect(), classes, shares, class_means }
    }

    /// Round an estimate: its diffuse albedo, its mean gloss of each class, and an `own` part of each
    /// texel's deviation from that.
    fn around(mut self, estimate: &[Coordinates], own: f64) -> Self {
        let count = self.classes.len();
        let mut totals = vec![1e-9; count];
        self.class_means.fill([0.0; CLASS]);
        for (x, shares) in estimate.iter().zip(self.shares.chunks_exact(count)) {
            for ((mean, total), share) in self.class_means.iter_mut().zip(&mut totals).zip(shares) {
                *total += f64::from(*share);
                mean.iter_mut().zip(&x[GLOSS]).for_each(|(m, v)| *m += f64::from(*share) * v);
            }
        }
        for (mean, total) in self.class_means.iter_mut().zip(totals) {
            mean.iter_mut().for_each(|m| *m /= total);
        }
        for ((mean, x), shares) in
            self.mean.iter_mut().zip(estimate).zip(self.shares.chunks_exact(count))
        {
            mean[DIFFUSE].copy_from_slice(&x[DIFFUSE]);
            for (i, c) in GLOSS.enumerate() {
                let of_classes = shares.iter().zip(&self.class_means);
                let of_classes: f64 = of_classes.map(|(s, m)| f64::from(*s) * m[i]).sum();
                mean[c] = own * (x[c] - of_classes);
            }
        }
        self
    }

    fn problem<'a>(
        &'a self,
        sample: &'a Sample,
        which: &'a [usize],
        widths: Widths,
        free: Free,
        options: &'a StructuredOptions,
    ) -> Problem<'a> {
        let widths = Widths { classes: self.classes.len(), ..widths };
        let Self { shares, mean, class_means, .. } = self;
        Problem { sample, which, mean, shares, class_means, widths, free, options }
    }
}

/// Flat maps with the gloss of their classes, of given colours; or with an `own` part of the
/// estimate's gloss added, and its diffuse albedo.
fn flat_maps(
    estimate: &Svbrdf,
    own: Option<f64>,
    colours: &[Feature],
    classes: &Classes,
    gloss: &[[f64; CLASS]],
) -> Svbrdf {
    let mut maps = Svbrdf::new(estimate.width(), estimate.height());
    let width = maps.width();
    for (i, c) in DIFFUSE.enumerate() {
        let plane = maps.plane_mut(c);
        match own {
            Some(_) => plane.copy_from_slice(estimate.plane(c)),
            None => {
                let pairs = plane.iter_mut().zip(colours);
                pairs.for_each(|(v, f)| *v = DIFFUSE_FRACTION * f[i] * f[i]);
            }
        }
    }
    let own = own.unwrap_or(0.0) as f32;
    for (i, c) in GLOSS.enumerate() {
        let rows = maps.plane_mut(c).chunks_mut(width);
        parallel::parts_with(
            rows,
            || vec![0.0; classes.len()],
            |shares, y, row| {
                for (x, v) in row.iter_mut().enumerate() {
                    classes.shares(&colours[y * width + x], shares);
                    let value: f64 =
                        shares.iter().zip(gloss).map(|(s, g)| f64::from(*s) * g[i]).sum();
                    let estimate = to_coordinate(c, estimate.plane(c)[y * width + x]);
                    *v = from_coordinate(c, value as f32 + own * estimate);
                }
            },
        );
    }
    maps.clamp();
    maps
}

/// Squared error of the prediction of a photograph that was not fitted, gamma 2.2, its brightness
/// apart.
fn prediction_error(problem: &Problem, state: &State, left_out: usize) -> f64 {
    let sample = problem.sample;
    let photograph = &sample.photographs[left_out];
    let light = Lit::new(&state.correction.exposure.predict(&photograph.view));
    let n = sample.texels();
    let gamma = |v: f64| v.clamp(0.0, 1e6).powf(1.0 / 2.2);
    let mut values = Vec::with_capacity(3 * n);
    let (mut products, mut squares) = (0.0, 1e-12);
    for t in 0..n {
        let weight = f64::from(photograph.weight[t]);
        let radiance = light.radiance(&natural(&problem.coordinates(t, state)), sample.places[t]);
        for c in 0..3 {
            let seen = f64::from(photograph.radiance[c * n + t]);
            let (ours, theirs) = (gamma(radiance.value[c]), gamma(seen.abs()));
            if seen >= 0.0 {
                products += weight * ours * theirs;
                squares += weight * ours * ours;
            }
            values.push([weight, ours, theirs, if seen < 0.0 { theirs } else { f64::MAX }]);
        }
    }
    let factor = products / squares;
    let (mut sum, mut total) = (0.0, 1e-12);
    for [weight, ours, theirs, limit] in values {
        sum += weight * ((factor * ours).min(limit) - theirs).powi(2);
        total += weight;
    }
    sum / total
}
