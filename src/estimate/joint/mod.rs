//! The joint solve: gloss of material classes, what all texels share, and a grid of texels, found together.
//!
//! A texel sees its gloss in the tails of highlights, where no lobe fits a real material: tails are 10 to 15 %
//! off, alike over the sample. Where every texel may follow, each photograph makes the prediction of the next
//! one worse. So gloss is that of soft classes of similar colour; slopes are a share of the learned ones; and
//! texels deviate from both as far as it helps to predict photographs ([`choice`]). What all texels share
//! (gain of each photograph, exposure over distance, offset of the flash, room light) is found in the same
//! equations, each texel eliminated (Schur complement, [`super::bundle`]).
//!
//! The mean slope of a sample, and the lowest cosines of its slopes, are the shape of the sheet or errors of
//! the light, not relief: the prior's mean has none.

mod choice;
mod classes;
mod flat;
mod prediction;
mod setup;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use super::bundle::{Descent, Sample, SharedLobes};
use super::clusters::{Clusters, Feature};
use super::coordinates::{Coordinates, from_coordinate, to_coordinate};
use super::correction::{Correction, LightCorrection};
use super::finer::full_colours;
use super::map_state::MapState;
use super::options::{EstimateOptions, JointPrior, SharedOptions};
use super::photographs::Photographs;
use super::prior::Prior;
use crate::Svbrdf;
use crate::parallel;
use crate::svbrdf::LOBES;
pub(super) use choice::PriorChoice;
pub(super) use classes::classes;
pub(super) use flat::flattened;
use setup::{DIFFUSE, DIFFUSE_FRACTION, GLOSS, Setup, TEXELS, descent};

/// Steps, at most.
pub(super) const STEPS: usize = 12;

/// The joint solve in progress.
pub(super) struct JointFit {
    descent: Descent,
    prior: JointPrior,
    classes: Clusters,
    /// Share of the texels' own deviations of gloss in the prior's mean, of too few photographs to leave one
    /// out.
    own: Option<f64>,
}

impl JointFit {
    /// Before the first step, round maps whose slopes are learned ones.
    pub fn new(
        photographs: &Photographs,
        maps: &Svbrdf,
        prior: JointPrior,
        board: bool,
        options: &EstimateOptions,
    ) -> Self {
        let sample = Arc::new(Sample::new(photographs, TEXELS, TEXELS));
        let which: Vec<usize> = (0..photographs.len()).collect();
        let estimate = sample.coordinates(maps);
        let mut setup = Setup::new(&sample, &which, &prior, &estimate, &options.joint);
        let own = (which.len() < options.schedule.determined_from)
            .then(|| (which.len().max(1) as f64).recip());
        if let Some(own) = own {
            setup = setup.around(&estimate, own);
        }
        let classes = setup.classes.clone();
        let problem = setup.problem(&sample, which, &prior, board, options);
        Self { descent: descent(problem, STEPS), prior, classes, own }
    }

    /// One step.
    pub fn step(&mut self) {
        self.descent.step();
    }

    /// Whether nothing is left to do.
    pub fn is_done(&self) -> bool {
        self.descent.progress.done
    }

    /// Steps taken.
    pub fn steps(&self) -> usize {
        self.descent.progress.steps
    }

    /// Negative logarithm of the posterior.
    pub fn cost(&self) -> f64 {
        self.descent.progress.cost
    }

    /// What the photographs share, in words; gains beyond twice their sigma are named: the lobe does not fit.
    pub fn shared(&self, sigmas: &SharedOptions) -> String {
        let Correction { ambient, exposure, .. } = &self.descent.progress.state.correction;
        let LightCorrection { gains, exponent, offset_mm: [x, y, z], .. } = exposure;
        let mut text = format!(
            "flash moved by ({x:.1}, {y:.1}, {z:.1}) mm, exposure over distance^{exponent:.2}, ambient {ambient:.3}"
        );
        let far = gains.iter().filter(|gain| gain.abs() > 2.0 * sigmas.gain).count();
        if far > 0 {
            text += &format!("; {far} gains beyond two sigmas: the lobe does not fit");
        }
        text
    }

    /// Corrects the photographs by what all texels share; the prior of the last steps is the one found: the
    /// gloss of the classes, learned slopes, the sigmas chosen.
    pub fn finish(self, photographs: &mut Photographs, map_state: &mut MapState) {
        let Self { descent, prior, classes, own } = self;
        let (problem, state) = (descent.problem, descent.progress.state);
        let mut values = state.groups;
        for (class, mean) in values.iter_mut().zip(&problem.groups.mean) {
            class.iter_mut().zip(mean).for_each(|(v, m)| *v -= own.unwrap_or(0.0) * m);
        }
        let of_all = values.remove(0);
        for class in &mut values {
            class.iter_mut().zip(of_all).for_each(|(v, all)| *v += all);
        }
        // Classes know every texel's colour.
        map_state.refine(photographs);
        let slopes = flattened(&map_state.maps, prior.relief as f32);
        map_state.mean =
            Gloss { classes, values, lobes: state.lobes }.maps(&slopes, own, photographs);
        map_state.maps.clone_from(&map_state.mean);
        map_state.prior = Prior { sigma: prior.sigmas().map(|s| s as f32) };
        map_state.fixed_noise = Some(prior.noise as f32);
        photographs.correct(state.correction);
    }
}

/// Classes and the gloss of each.
struct Gloss {
    classes: Clusters,
    values: Vec<Coordinates>,
    lobes: Option<SharedLobes>,
}

impl Gloss {
    /// Maps with the slopes of an estimate, the gloss of their classes and the colours that photographs show;
    /// or with an `own` share of the estimate's gloss added, and its diffuse albedo.
    fn maps(&self, estimate: &Svbrdf, own: Option<f64>, photographs: &Photographs) -> Svbrdf {
        let colours = full_colours(photographs);
        let mut maps = estimate.clone();
        let width = maps.width();
        if own.is_none() {
            for (i, c) in DIFFUSE.enumerate() {
                let pairs = maps.plane_mut(c).iter_mut().zip(&colours);
                pairs.for_each(|(v, f)| *v = DIFFUSE_FRACTION * f[i] * f[i]);
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
                    *v = from_coordinate(c, value as f32 + own * to_coordinate(c, *v));
                }
            });
        }
        maps.set_lobes(self.lobes(&colours)).expect("four planes");
        maps.clamp();
        maps
    }

    /// Planes of the optional lobes.
    fn lobes(&self, colours: &[Feature]) -> Vec<f32> {
        let Some(lobes) = &self.lobes else { return Vec::new() };
        let n = colours.len();
        let mut planes = vec![0.0; LOBES * n];
        let mut shares = vec![0.0; self.classes.len()];
        for (t, colour) in colours.iter().enumerate() {
            self.classes.shares(colour, &mut shares);
            let of_groups = std::iter::once(1.0).chain(shares.iter().copied());
            for (c, value) in lobes.of_texel(of_groups).into_iter().enumerate() {
                planes[c * n + t] = value as f32;
            }
        }
        planes
    }
}
