//! Optimisation of the latent code against all photographs, and the multi-resolution schedule.
//!
//! The objective of the paper (Section 5), `argmin_z sum_i L(I_i, R(D(z), C_i))`, with two
//! additions. What the decoder cannot express of the start is kept as a fixed offset,
//! `maps = D(z) + (start - D(E(start)))` in encoded space, so that the fit begins exactly at the
//! start and moves it within what materials do. Each photograph begins with a correction of the maps
//! as a whole; and a prior, weaker with every photograph, holds the slopes to the start's.
//!
//! The fit is a stepper that a session's thread drives: photographs may be added, and maps taken,
//! between any two steps. It begins at 256 texels or fewer a side; finished levels are doubled as in
//! the paper's Section 7. After a new photograph it begins again at the coarsest level, with code
//! and moments as they were, and carries the *change* of each level up to the next, so that detail
//! found before stays.

mod adam;
mod global;
mod level;
mod saved;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::initial_estimate::Networks;
use crate::observation::{Observation, View};
use crate::parallel;
use crate::{Error, Result, Svbrdf};
use level::Level;
pub use saved::{SavedFit, SavedLevel, SavedStage};

/// Texels a side up to which the first level goes.
const COARSEST_TEXELS: usize = 256;

/// Photographs that add their steps, at most.
const MOST_FRESH: usize = 8;

/// Options of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Steps of the coarsest level after the first photograph: with more, one photograph's highlights
    /// and shading are explained by gloss and bumps that are not there.
    pub first_steps: usize,
    /// Steps of the coarsest level after each further photograph. Of photographs that come before
    /// the fit has settled, up to eight add their steps.
    pub steps: usize,
    /// Steps of each finer level after each photograph.
    pub fine_steps: usize,
    /// Length of the first steps, in units of the code (whose variance is 1); falls to zero over
    /// the steps of a level as half a cosine.
    pub learning_rate: f32,
    /// The same for the finer levels.
    pub fine_learning_rate: f32,
    /// Decay of Adam's moments.
    pub betas: [f32; 2],
    /// Weight of the prior on the slopes beside the mean log-L1, divided by the squared
    /// number of photographs: mean over the texels of `sum ((slope - start) / deviation)² / 2`, the deviation
    /// being the root mean square of the start's slopes.
    pub prior_weight: f32,
    /// Whether each photograph begins with a correction of the maps as a whole: gains of albedos
    /// and slopes, shift of roughness.
    pub global_correction: bool,
    /// Whether what the decoder cannot express of the start is kept.
    pub keep_detail: bool,
    /// Longest side that is fitted, texels; finer maps are interpolated from there.
    pub finest_texels: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            first_steps: 8,
            steps: 30,
            fine_steps: 15,
            learning_rate: 0.03,
            fine_learning_rate: 0.01,
            betas: [0.9, 0.99],
            prior_weight: 0.05,
            global_correction: true,
            keep_detail: true,
            finest_texels: 512,
        }
    }
}

/// What a step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Mean log-L1 at the current level before the step.
    pub loss: f64,
    /// Resolution level of the next step, 0 the coarsest.
    pub level: usize,
    /// Share of the steps for the photographs so far that is done, 0 to 1.
    pub fraction: f32,
    /// Nothing is left to do until a photograph is added.
    pub settled: bool,
}

/// A fit in progress.
pub struct LatentFit {
    networks: Arc<Networks>,
    options: FitOptions,
    stages: Vec<Stage>,
    current: usize,
    /// Steps done at the current level since the latest photograph.
    done: usize,
    /// Photographs since the fit had settled.
    fresh: usize,
    loss: f64,
    /// Halvings from the observations' size to the coarsest level.
    halvings: usize,
}

/// One resolution.
struct Stage {
    observations: Vec<Observation>,
    level: Option<Level>,
    /// The level's maps when the next finer level was last started from them.
    carried: Option<Svbrdf>,
}

impl LatentFit {
    /// Starts from maps and the first photograph, which sets the resolution. `start` has that
    /// resolution or a half, a quarter, ... of it, as [`Networks::photo_maps`] gives it.
    ///
    /// # Errors
    /// When sizes do not fit each other or the networks, or a network is broken.
    pub fn new(
        networks: Arc<Networks>,
        start: &Svbrdf,
        observation: &Observation,
        options: FitOptions,
    ) -> Result<Self> {
        let (width, height) = (observation.width(), observation.height());
        let longest = width.max(height);
        let mut halvings = 0;
        while longest >> halvings > COARSEST_TEXELS {
            halvings += 1;
        }
        let multiple = networks.decoder().stride() << halvings;
        let fits = |n: usize| n > 0 && n.is_multiple_of(multiple);
        if !fits(width) || !fits(height) {
            return Err(Error::argument(
                "observation",
                format!("{width}x{height} texels, multiples of {multiple} expected"),
            ));
        }
        let coarse = [width >> halvings, height >> halvings];
        let mut fitted = 1;
        while fitted <= halvings && longest >> (halvings - fitted) <= options.finest_texels {
            fitted += 1;
        }
        let start = to_size(start, coarse)?;
        let level = Level::new(&networks, &start, &options)?;
        let mut stages: Vec<Stage> = (0..fitted)
            .map(|_| Stage { observations: Vec::new(), level: None, carried: None })
            .collect();
        stages[0].level = Some(level);
        let mut fit = Self {
            networks,
            options,
            stages,
            current: 0,
            done: 0,
            fresh: 0,
            loss: f64::NAN,
            halvings,
        };
        fit.add_observation(observation)?;
        Ok(fit)
    }

    /// Adds a photograph; the fit begins again at the coarsest level from where it is.
    ///
    /// # Errors
    /// When its size is not that of the first.
    pub fn add_observation(&mut self, observation: &Observation) -> Result<()> {
        let [width, height] = self.size();
        let found = [observation.width(), observation.height()];
        if found != [width, height] {
            return Err(Error::argument(
                "observation",
                format!("{}x{} texels, {width}x{height} expected", found[0], found[1]),
            ));
        }
        self.settle_current()?;
        self.fresh = if self.is_settled() { 1 } else { self.fresh + 1 };
        let mut small = None;
        for stage in (0..=self.halvings).rev() {
            if stage < self.halvings {
                small = Some(small.as_ref().unwrap_or(observation).downsampled());
            }
            if let Some(stage) = self.stages.get_mut(stage) {
                stage.observations.push(small.as_ref().unwrap_or(observation).clone());
            }
        }
        self.current = 0;
        self.done = 0;
        Ok(())
    }

    /// Replaces the photographs by others of the same size (after light or ambient were estimated
    /// anew); the fit begins again at the coarsest level from where it is.
    ///
    /// # Errors
    /// When a size is not that of the first.
    pub fn set_observations(&mut self, observations: &[Observation]) -> Result<()> {
        let count = |stages: &[Stage]| stages[0].observations.len();
        let new = observations.len().saturating_sub(count(&self.stages));
        let fresh = new + if self.is_settled() { 0 } else { self.fresh };
        let old: Vec<_> =
            self.stages.iter_mut().map(|s| std::mem::take(&mut s.observations)).collect();
        for observation in observations {
            if let Err(error) = self.add_observation(observation) {
                for (stage, old) in self.stages.iter_mut().zip(old) {
                    stage.observations = old;
                }
                return Err(error);
            }
        }
        self.fresh = fresh;
        Ok(())
    }

    /// Replaces camera and light of the photographs, in their order; the fit is settled or not as
    /// before.
    pub fn set_views(&mut self, views: impl Iterator<Item = View> + Clone) {
        for stage in &mut self.stages {
            for (observation, view) in stage.observations.iter_mut().zip(views.clone()) {
                observation.view = view;
            }
        }
    }

    /// Goes on from other maps of the fit's size, such as refined ones: what the decoder cannot
    /// express of them is kept as detail. Code, moments and prior stay; the fit is settled or not as
    /// before.
    ///
    /// # Errors
    /// When the size is not the fit's, or a network is broken.
    pub fn set_maps(&mut self, maps: &Svbrdf) -> Result<()> {
        if [maps.width(), maps.height()] != self.size() {
            let [width, height] = self.size();
            return Err(Error::argument(
                "maps",
                format!("{}x{} texels, {width}x{height} expected", maps.width(), maps.height()),
            ));
        }
        let mut maps = maps.clone();
        for index in (0..=self.halvings).rev() {
            if let Some(stage) = self.stages.get_mut(index) {
                if let Some(level) = &mut stage.level {
                    level.restart(&self.networks, &maps, &self.options)?;
                }
                if stage.carried.is_some() {
                    stage.carried = Some(maps.clone());
                }
            }
            if index > 0 {
                maps = maps.downsampled();
            }
        }
        Ok(())
    }

    /// Width and height of the maps, texels.
    pub fn size(&self) -> [usize; 2] {
        let maps = self.level(0).maps();
        [maps.width() << self.halvings, maps.height() << self.halvings]
    }

    /// One step; does nothing once settled.
    ///
    /// # Errors
    /// When a network is broken or the loss is not finite.
    pub fn step(&mut self) -> Result<StepReport> {
        if self.is_settled() {
            return Ok(self.report());
        }
        if self.current == 0 && self.done == 0 && self.options.global_correction {
            let stage = &mut self.stages[0];
            if let Some(level) = &mut stage.level {
                level.correct(&self.networks, &stage.observations, &self.options)?;
            }
        }
        if self.stages[self.current].level.is_none() || (self.current > 0 && self.done == 0) {
            self.climb()?;
        }
        let steps = self.steps(self.current);
        if steps > 0 {
            let options = &self.options;
            let rate =
                if self.current == 0 { options.learning_rate } else { options.fine_learning_rate };
            // A restored fit may have done more than what one photograph asks for.
            let progress = (self.done as f32 / steps as f32).min(1.0);
            let rate = rate * 0.5 * (1.0 + (std::f32::consts::PI * progress).cos());
            let stage = &mut self.stages[self.current];
            if let Some(level) = &mut stage.level {
                self.loss = level.step(&self.networks, &stage.observations, rate, options)?;
            }
            self.done += 1;
        }
        if self.done >= steps {
            self.settle_current()?;
            if self.stages.len() > 1
                && let Some(level) = &mut self.stages[self.current].level
            {
                level.release();
            }
            if self.current + 1 < self.stages.len() {
                self.current += 1;
                self.done = 0;
            }
        }
        Ok(self.report())
    }

    /// Whether nothing is left to do until a photograph is added.
    pub fn is_settled(&self) -> bool {
        self.current + 1 == self.stages.len() && self.done >= self.steps(self.current)
    }

    /// The maps as they are now, at the photographs' resolution.
    pub fn maps(&self) -> Svbrdf {
        // A level whose steps have not begun does not know yet what the one below has found.
        let known = if self.done == 0 { self.current.saturating_sub(1) } else { self.current };
        let mut maps = self.level(known).maps().clone();
        for stage in known + 1..=self.halvings {
            maps = self.finer(stage, &maps);
        }
        maps
    }

    /// The maps as they are now at the resolution of the level in work.
    pub fn coarse_maps(&self) -> &Svbrdf {
        self.level(self.current).maps()
    }

    /// Steps that the finest level takes, once it is in work.
    pub(crate) fn steps_at_finest(&self) -> Option<usize> {
        (self.current + 1 == self.stages.len()).then(|| self.steps(self.current))
    }

    /// The photographs so far count as fitted, steps left or not: the next brings its own alone.
    pub(crate) fn count_as_fitted(&mut self) {
        self.fresh = 0;
    }

    fn level(&self, stage: usize) -> &Level {
        let started = self.stages[..=stage].iter().rev().find_map(|s| s.level.as_ref());
        started.expect("the coarsest level is made with the fit")
    }

    fn steps(&self, stage: usize) -> usize {
        let fresh = self.fresh.clamp(1, MOST_FRESH);
        match (stage, self.stages[0].observations.len()) {
            (0, ..=1) => self.options.first_steps,
            (0, _) => fresh * self.options.steps,
            _ => self.options.fine_steps,
        }
    }

    fn report(&self) -> StepReport {
        // a finer level's step costs four times as much
        let weight = |s: usize| self.steps(s) as f32 * 4f32.powi(s as i32);
        let total: f32 = (0..self.stages.len()).map(weight).sum();
        let before: f32 = (0..self.current).map(weight).sum();
        let here = self.done as f32 * 4f32.powi(self.current as i32);
        let fraction = if total > 0.0 { (before + here) / total } else { 1.0 };
        StepReport { loss: self.loss, level: self.current, fraction, settled: self.is_settled() }
    }

    /// Brings the current level's maps up to its code.
    fn settle_current(&mut self) -> Result<()> {
        match &mut self.stages[self.current].level {
            Some(level) => level.refresh(&self.networks),
            None => Ok(()),
        }
    }

    /// Starts the current level from the one below.
    fn climb(&mut self) -> Result<()> {
        let below = self.level(self.current - 1).maps().clone();
        let start = self.finer(self.current, &below);
        self.stages[self.current - 1].carried = Some(below);
        match &mut self.stages[self.current].level {
            Some(level) => level.restart(&self.networks, &start, &self.options),
            none => {
                *none = Some(Level::new(&self.networks, &start, &self.options)?);
                Ok(())
            }
        }
    }

    /// Maps of a stage from those of the stage below: its own, moved by what has changed below
    /// since; or the ones below, interpolated.
    fn finer(&self, stage: usize, below: &Svbrdf) -> Svbrdf {
        let own = self.stages.get(stage).and_then(|s| s.level.as_ref());
        let carried = self.stages.get(stage - 1).and_then(|s| s.carried.as_ref());
        let (Some(own), Some(carried)) = (own, carried) else {
            return below.upsampled();
        };
        let mut change = below.clone();
        let change_to = |to: &mut Svbrdf, other: &Svbrdf, sign: f32| {
            let width = to.width();
            let both = to.planes_mut().chunks_mut(width).zip(other.planes().chunks(width));
            parallel::parts(both, |_, (to, other)| {
                to.iter_mut().zip(other).for_each(|(v, other)| *v += sign * other);
            });
        };
        change_to(&mut change, carried, -1.0);
        let mut maps = change.upsampled();
        change_to(&mut maps, own.maps(), 1.0);
        maps.clamp();
        maps
    }
}

/// Maps at another power of two of their size.
fn to_size(maps: &Svbrdf, [width, height]: [usize; 2]) -> Result<Svbrdf> {
    let mut maps = maps.clone();
    while maps.width() > width && maps.width().is_multiple_of(2) && maps.height().is_multiple_of(2)
    {
        maps = maps.downsampled();
    }
    while maps.width() < width {
        maps = maps.upsampled();
    }
    if [maps.width(), maps.height()] == [width, height] {
        return Ok(maps);
    }
    Err(Error::argument(
        "start",
        format!("{}x{} texels do not scale to {width}x{height}", maps.width(), maps.height()),
    ))
}
