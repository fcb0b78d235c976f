//! Optimisation of the latent code against all photographs, and the multi-resolution schedule.
//!
//! The objective of the paper (Section 5), `argmin_z sum_i L(I_i, R(D(z), C_i))`, with two
//! additions. What the decoder cannot express of the start is kept as a fixed detail,
//! `maps = D(z) + (start - D(E(start)))` in encoded space, so that the fit begins exactly at the
//! start and moves it within what materials do. Each photograph begins with gains of the maps
//! as a whole; and a prior, weaker with every photograph, holds the slopes to the start's.
//!
//! The fit is a stepper: photographs may be added, and maps taken, between any two steps. It begins
//! at 256 texels or fewer a side; finished levels are doubled as in the paper's Section 7. After a
//! new photograph it begins again at the coarsest level, with code and moments as they were, and
//! carries the *change* of each level up to the next, so that detail found before stays.

mod gains;
mod level;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use super::options::{GainOptions, LatentOptions};
use super::photographs::Photographs;
use crate::initial_estimate::Networks;
use crate::svbrdf::moved;
use crate::{Error, Result, Svbrdf};
use level::Level;
pub(crate) use level::SavedLevel;

/// What a step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StepReport {
    /// Mean log-L1 at the current level before the step.
    pub loss: f64,
    /// Nothing is left to do until a photograph is added.
    pub settled: bool,
}

/// A fit in progress.
pub(crate) struct LatentFit {
    networks: Arc<Networks>,
    options: LatentOptions,
    gains: GainOptions,
    stages: Vec<Stage>,
    /// Photographs so far.
    photographs: usize,
    position: LatentPosition,
    /// Halvings from the photographs' size to the coarsest level.
    halvings: usize,
}

/// How far a fit is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LatentPosition {
    /// Level of the next step.
    pub current: usize,
    /// Steps done at the current level since the latest photograph.
    pub done: usize,
    /// Photographs since the fit had settled.
    pub fresh: usize,
    /// Mean log-L1 of the latest step; not a number before the first.
    pub loss: f64,
}

/// One resolution.
struct Stage {
    level: Option<Level>,
    /// The level's maps when the next finer level was last started from them.
    carried: Option<Svbrdf>,
}

/// What a [`LatentFit`] holds apart from photographs and networks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SavedFit {
    pub position: LatentPosition,
    /// Levels from the coarsest on, each with what the next finer one was started from.
    pub stages: Vec<(Option<SavedLevel>, Option<Svbrdf>)>,
}

impl LatentFit {
    /// Starts from maps for photographs of `[width, height]` texels. `start` has that resolution or a
    /// half, a quarter, ... of it, as [`Networks::photo_maps`] gives it.
    ///
    /// # Errors
    /// When sizes do not fit each other or the networks, or a network is broken.
    pub fn new(
        networks: Arc<Networks>,
        start: &Svbrdf,
        [width, height]: [usize; 2],
        options: &LatentOptions,
        gains: &GainOptions,
    ) -> Result<Self> {
        let halvings = halvings(width, height, options);
        let multiple = networks.decoder().stride() << halvings;
        let fits = |n: usize| n > 0 && n.is_multiple_of(multiple);
        if !fits(width) || !fits(height) {
            return Err(Error::argument(
                "observation",
                format!("{width}x{height} texels, multiples of {multiple} expected"),
            ));
        }
        let mut fitted = 1;
        while fitted <= halvings
            && width.max(height) >> (halvings - fitted) <= options.finest_texels
        {
            fitted += 1;
        }
        let start = to_size(start, [width >> halvings, height >> halvings])?;
        let level = Level::new(&networks, &start, options)?;
        let mut stages: Vec<Stage> =
            (0..fitted).map(|_| Stage { level: None, carried: None }).collect();
        stages[0].level = Some(level);
        let position = LatentPosition { current: 0, done: 0, fresh: 0, loss: f64::NAN };
        let (options, gains) = (options.clone(), gains.clone());
        Ok(Self { networks, options, gains, stages, photographs: 0, position, halvings })
    }

    /// A photograph was added; the fit begins again at the coarsest level from where it is.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn add_photograph(&mut self) -> Result<()> {
        let fresh = if self.is_settled() { 1 } else { self.position.fresh + 1 };
        self.begin_again()?;
        (self.position.fresh, self.photographs) = (fresh, self.photographs + 1);
        Ok(())
    }

    /// Begins again at the coarsest level from where the fit is, as light or ambient light were
    /// estimated anew.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn begin_again(&mut self) -> Result<()> {
        let fresh = if self.is_settled() { 0 } else { self.position.fresh };
        self.refresh()?;
        (self.position.current, self.position.done, self.position.fresh) = (0, 0, fresh);
        Ok(())
    }

    /// One step; does nothing once settled.
    ///
    /// # Errors
    /// When a network is broken or the loss is not finite.
    pub fn step(&mut self, photographs: &Photographs) -> Result<StepReport> {
        if self.is_settled() {
            return Ok(self.report());
        }
        let LatentPosition { current, done, .. } = self.position;
        let which = photographs.drawn(done);
        let observations = photographs.some((self.halvings - current) as u32, &which);
        if current == 0
            && done == 0
            && self.options.gains
            && let Some(level) = &mut self.stages[0].level
        {
            level.apply_gains(&self.networks, &observations, &self.options, &self.gains)?;
        }
        if self.stages[current].level.is_none() || (current > 0 && done == 0) {
            self.climb()?;
        }
        let steps = self.steps(current);
        if steps > 0 {
            let options = &self.options;
            let rate =
                if current == 0 { options.learning_rate } else { options.fine_learning_rate };
            // A restored fit may have done more than what one photograph asks for.
            let progress = (done as f32 / steps as f32).min(1.0);
            let rate = rate * 0.5 * (1.0 + (std::f32::consts::PI * progress).cos());
            if let Some(level) = &mut self.stages[current].level {
                self.position.loss = level.step(&self.networks, &observations, rate, options)?;
            }
            self.position.done += 1;
        }
        if self.position.done >= steps {
            self.refresh()?;
            if self.stages.len() > 1
                && let Some(level) = &mut self.stages[current].level
            {
                level.release();
            }
            if current + 1 < self.stages.len() {
                (self.position.current, self.position.done) = (current + 1, 0);
            }
        }
        Ok(self.report())
    }

    /// Whether nothing is left to do until a photograph is added.
    pub fn is_settled(&self) -> bool {
        let LatentPosition { current, done, .. } = self.position;
        current + 1 == self.stages.len() && done >= self.steps(current)
    }

    /// The maps as they are now, at the photographs' resolution.
    pub fn maps(&self) -> Svbrdf {
        // A level whose steps have not begun does not know yet what the one below has found.
        let LatentPosition { current, done, .. } = self.position;
        let known = if done == 0 { current.saturating_sub(1) } else { current };
        let mut maps = self.level(known).maps().clone();
        for stage in known + 1..=self.halvings {
            maps = self.finer(stage, &maps);
        }
        maps
    }

    /// The maps as they are now at the resolution of the level in work.
    pub fn coarse_maps(&self) -> &Svbrdf {
        self.level(self.position.current).maps()
    }

    /// Texels of the coarsest level.
    pub fn coarsest_texels(&self) -> usize {
        self.level(0).maps().texels()
    }

    /// Steps done at the finest level and steps that it takes, once it is in work.
    pub fn steps_at_finest(&self) -> Option<[usize; 2]> {
        let LatentPosition { current, done, .. } = self.position;
        (current + 1 == self.stages.len()).then(|| [done, self.steps(current)])
    }

    /// The photographs so far count as fitted, steps left or not: the next brings its own alone.
    pub fn count_as_fitted(&mut self) {
        self.position.fresh = 0;
    }

    /// Steps of each level, from the coarsest on: those done, and all.
    pub fn work(&self) -> impl Iterator<Item = [usize; 2]> {
        (0..self.stages.len()).map(|stage| {
            let all = self.steps(stage);
            match stage.cmp(&self.position.current) {
                std::cmp::Ordering::Less => [all, all],
                std::cmp::Ordering::Equal => [self.position.done.min(all), all],
                std::cmp::Ordering::Greater => [0, all],
            }
        })
    }

    /// The fit as plain data.
    pub fn save(&self) -> SavedFit {
        let save = |s: &Stage| (s.level.as_ref().map(Level::save), s.carried.clone());
        SavedFit { position: self.position, stages: self.stages.iter().map(save).collect() }
    }

    /// Goes on from a saved fit with its photographs. Without `same_networks` the codes are found
    /// anew from the maps.
    ///
    /// # Errors
    /// When sizes do not fit each other or the networks, or a network is broken.
    pub fn restore(
        networks: Arc<Networks>,
        saved: SavedFit,
        photographs: &Photographs,
        same_networks: bool,
        options: &LatentOptions,
        gains: &GainOptions,
    ) -> Result<Self> {
        let first = photographs.full().first().ok_or(Error::NoMaps)?;
        let size = [first.width(), first.height()];
        let halvings = halvings(size[0], size[1], options);
        let SavedFit { position, stages } = saved;
        let fault = |message: &str| Err(Error::argument("fit", message));
        if stages.is_empty() || stages.len() > halvings + 1 || position.current >= stages.len() {
            return fault("levels that the resolution has are expected");
        }
        let begun = |i: usize| stages[i].0.is_some();
        if (1..stages.len()).any(|i| begun(i) && !begun(i - 1))
            || !(0..position.current).all(begun)
            || !begun(0)
        {
            return fault("a level is missing");
        }
        let mut made = Vec::with_capacity(stages.len());
        for (i, (level, carried)) in stages.into_iter().enumerate() {
            let size = size.map(|n| n >> (halvings - i));
            let fits = |maps: &Svbrdf| [maps.width(), maps.height()] == size;
            if !level.iter().map(|l| &l.maps).chain(&carried).all(fits) {
                return fault("a level's maps are not of its size");
            }
            let level = match level {
                Some(level) => Some(Level::restore(&networks, level, same_networks, options)?),
                None => None,
            };
            made.push(Stage { level, carried });
        }
        let (options, gains) = (options.clone(), gains.clone());
        let photographs = photographs.len();
        Ok(Self { networks, options, gains, stages: made, photographs, position, halvings })
    }

    fn level(&self, stage: usize) -> &Level {
        let started = self.stages[..=stage].iter().rev().find_map(|s| s.level.as_ref());
        started.expect("the coarsest level is made with the fit")
    }

    fn steps(&self, stage: usize) -> usize {
        let fresh = self.position.fresh.clamp(1, self.options.max_pending);
        match (stage, self.photographs) {
            (0, ..=1) => self.options.first_steps,
            (0, _) => fresh * self.options.steps,
            _ => self.options.fine_steps,
        }
    }

    fn report(&self) -> StepReport {
        StepReport { loss: self.position.loss, settled: self.is_settled() }
    }

    /// Brings the current level's maps up to its code.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn refresh(&mut self) -> Result<()> {
        match &mut self.stages[self.position.current].level {
            Some(level) => level.refresh(&self.networks),
            None => Ok(()),
        }
    }

    /// Starts the current level from the one below.
    fn climb(&mut self) -> Result<()> {
        let current = self.position.current;
        let below = self.level(current - 1).maps().clone();
        let start = self.finer(current, &below);
        self.stages[current - 1].carried = Some(below);
        match &mut self.stages[current].level {
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
        moved(own.maps(), carried, below, 1)
    }
}

/// Halvings from the photographs' size to the coarsest level.
fn halvings(width: usize, height: usize, options: &LatentOptions) -> usize {
    let mut halvings = 0;
    while width.max(height) >> halvings > options.coarsest_texels {
        halvings += 1;
    }
    halvings
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
