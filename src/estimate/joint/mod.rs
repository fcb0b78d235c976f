//! The joint solve of material classes, shared unknowns and a grid of texels.
//!
//! Photographs show a texel's gloss mainly in the tails of highlights. No lobe fits the tails of real
//! materials: they are 10 to 15 % off, alike over the sample. Free texels would fit this error and predict
//! each further photograph worse. Therefore soft classes of colour share their gloss, and texels stay near
//! their class and near the learned slopes. [`setup`] defines this prior; [`choice`] chooses its sigmas by
//! the prediction of photographs. Gains, exponent, flash and room light are unknowns of the same equations
//! ([`super::bundle`]).
//!
//! The lowest cosines of the slopes, the mean included, are the sheet's shape or errors of the light. The
//! prior's mean does not have them ([`flat`]).

mod choice;
mod classes;
mod directions;
mod flat;
mod prediction;
mod setup;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use super::bundle::{Descent, EstimatedLobes, Sample, SharedLobes};
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
use crate::svbrdf::{LOBES, lobe};
pub(super) use choice::PriorChoice;
pub(super) use classes::classes;
use directions::Directions;
pub(super) use flat::flattened;
use setup::{DIFFUSE, DIFFUSE_FRACTION, GLOSS, Setup, TEXELS, descent};

/// Largest number of steps.
pub(super) const STEPS: usize = 12;

/// The joint solve in progress.
pub(super) struct JointFit {
    descent: Descent,
    prior: JointPrior,
    classes: Clusters,
    /// Share of the texels' own deviations of gloss in the prior's mean, with too few photographs to leave
    /// one out.
    own: Option<f64>,
    independent_texels: f64,
}

impl JointFit {
    /// Before the first step. `maps` have the learned slopes.
    pub fn new(
        photographs: &Photographs,
        maps: &Svbrdf,
        prior: JointPrior,
        board: bool,
        options: &EstimateOptions,
    ) -> Self {
        // Averages would mix the yarns of a weave.
        let averaged = if prior.directions == 2 { usize::MAX } else { TEXELS };
        let sample = Arc::new(Sample::new(photographs, averaged, TEXELS));
        let which: Vec<usize> = (0..photographs.len()).collect();
        let estimate = sample.coordinates(maps);
        let mut setup = Setup::new(&sample, &which, &prior, &estimate, &options.joint);
        let own = (which.len() < options.schedule.determined_from)
            .then(|| (which.len().max(1) as f64).recip());
        if let Some(own) = own {
            setup = setup.around(&estimate, own);
        }
        let classes = setup.classes.clone();
        if prior.directions == 2 {
            let neutral = prior.with_lobes_of(&JointPrior::default());
            let problem = setup.clone().problem(&sample, which.clone(), &neutral, board, options);
            let (problem, state) = setup::descended(problem, STEPS);
            setup = setup.with_directions(&Directions::of(&problem, &state));
        }
        let problem = setup.problem(&sample, which, &prior, board, options);
        let independent_texels = options.joint.independent_texels;
        Self { descent: descent(problem, STEPS), prior, classes, own, independent_texels }
    }

    pub fn step(&mut self) {
        self.descent.step();
    }

    /// Whether the solve has ended.
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

    /// The shared unknowns in words. Gains beyond twice their sigma show that the lobe does not fit.
    pub fn shared(&self, sigmas: &SharedOptions) -> String {
        let Correction { ambient, exposure, .. } = &self.descent.progress.state.correction;
        let LightCorrection { log_gains, exponent, offset_mm: [x, y, z], .. } = exposure;
        let mut text = format!(
            "flash moved by ({x:.1}, {y:.1}, {z:.1}) mm, exposure over distance^{exponent:.2}, ambient {ambient:.3}"
        );
        let far = log_gains.iter().filter(|gain| gain.abs() > 2.0 * sigmas.gain).count();
        if far > 0 {
            text += &format!("; {far} gains beyond two sigmas: the lobe does not fit");
        }
        text
    }

    /// Corrects the photographs' views, and sets maps and prior of the last steps: gloss of classes, learned
    /// slopes, chosen sigmas. Returns the optional lobes, if any: of all texels or of each direction.
    pub fn finish(
        self,
        photographs: &mut Photographs,
        map_state: &mut MapState,
    ) -> Vec<EstimatedLobes> {
        let Self { descent, prior, classes, own, independent_texels } = self;
        let (problem, state) = (descent.problem, descent.progress.state);
        let lobes = problem.estimated_lobes(&state, prior.directions, independent_texels);
        let mut values = state.groups;
        for (class, mean) in values.iter_mut().zip(&problem.groups.mean) {
            class.iter_mut().zip(mean).for_each(|(v, m)| *v -= own.unwrap_or(0.0) * m);
        }
        values.truncate(1 + classes.len());
        let of_all = values.remove(0);
        for class in &mut values {
            class.iter_mut().zip(of_all).for_each(|(v, all)| *v += all);
        }
        // Classes apply to the colours of texels at full size.
        map_state.refine(photographs);
        let slopes = flattened(&map_state.maps, prior.relief as f32);
        photographs.correct(state.correction);
        let mut gloss = ClassGloss { classes, values, lobes: None, directions: Vec::new() };
        if let [[a, _], [b, _]] = lobes[..] {
            let without = gloss.maps(&slopes, own, photographs);
            gloss.directions =
                Directions::at_full_size(&without, photographs.full(), problem.noise, [a, b]);
        }
        gloss.lobes = state.lobes;
        map_state.mean = gloss.maps(&slopes, own, photographs);
        map_state.maps.clone_from(&map_state.mean);
        map_state.prior = Prior { sigma: prior.sigmas().map(|s| s as f32) };
        map_state.noise = problem.noise;
        lobes
    }
}

/// Classes and their gloss.
struct ClassGloss {
    classes: Clusters,
    values: Vec<Coordinates>,
    lobes: Option<SharedLobes>,
    /// Shares of texels in two directions, if any.
    directions: Vec<[f32; 2]>,
}

impl ClassGloss {
    /// Maps with the slopes of an estimate, the gloss of classes, and the photographs' colours. With `own`,
    /// they have that share of the estimate's gloss in addition, and its diffuse albedo.
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
        maps.set_lobes(self.lobes(&colours)).expect("none, four or eight planes");
        maps.clamp();
        maps
    }

    /// Planes of the optional lobes.
    fn lobes(&self, colours: &[Feature]) -> Vec<f32> {
        let Some(lobes) = &self.lobes else { return Vec::new() };
        let (n, count) = (colours.len(), if lobes.sheen.is_some() { LOBES } else { lobe::SHEEN });
        let mut planes = vec![0.0; count * n];
        let mut shares = vec![0.0; self.classes.len()];
        for (t, colour) in colours.iter().enumerate() {
            self.classes.shares(colour, &mut shares);
            let directions = self.directions.get(t).into_iter().flatten();
            let of_groups = std::iter::once(&1.0).chain(&shares).chain(directions).copied();
            for (c, value) in lobes.of_texel(of_groups).into_iter().take(count).enumerate() {
                planes[c * n + t] = value as f32;
            }
        }
        planes
    }
}
