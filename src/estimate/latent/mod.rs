//! Optimisation of the latent code against all photographs.
//!
//! The objective of the paper (Section 5), `argmin_z sum_i L(I_i, R(D(z), C_i))`, with two
//! additions. What the decoder cannot express of the start is kept as a fixed detail,
//! `maps = D(z) + (start - D(E(start)))` in encoded space, so that the fit begins exactly at the
//! start and moves it within what materials do. Each photograph begins with gains of the maps as a whole. A prior, weaker with every photograph, holds the slopes to the
//! start's.
//!
//! The code sees averages of at most [`CODE_TEXELS`] texels a side: finer relief is the start's, and that of the
//! phases that follow. `maps = start + upsampled(D(z) + detail - averaged start)`, in encoded space.
//!
//! The fit is a stepper: photographs may be added, and maps taken, between any two steps. With each new
//! photograph the code is found anew from the maps so far: these are all that a saved fit needs to keep. With the
//! third it is found from the mean of the maps that each photograph gives alone: one or two photographs are
//! ambiguous, and steps do not lead out of a wrong reading of them.

mod code;
mod gains;

#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use super::coordinates::{coordinates, from_coordinate};
use super::options::LatentOptions;
use super::photographs::{Photographs, chosen};
use crate::networks::{CODE_TEXELS, Networks};
use crate::observation::Observation;
use crate::svbrdf::{encoding, halved, halvings_to};
use crate::{Error, Result, Svbrdf};
use code::Code;

/// Photographs that came before the fit had settled and add their steps, at most.
const MAX_PENDING: usize = 8;

/// What a step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StepReport {
    /// Mean log-L1 before the step.
    pub loss: f64,
    /// Nothing is left to do until a photograph is added.
    pub settled: bool,
}

/// A fit in progress.
pub(crate) struct LatentFit {
    networks: Arc<Networks>,
    options: LatentOptions,
    /// The maps that the code was found from with the latest photograph, of as many texels as the phases work with.
    start: Svbrdf,
    /// Mean of the first maps of each photograph, until the code begins anew from it.
    first: Option<Svbrdf>,
    /// Of averages of the texels.
    code: Code,
    /// Photographs so far.
    photographs: usize,
    position: LatentPosition,
}

/// How far a fit is.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LatentPosition {
    /// Steps done since the latest photograph.
    done: usize,
    /// Photographs since the fit had settled.
    fresh: usize,
    /// Mean log-L1 of the latest step; not a number before the first, while the maps are the start's.
    loss: f64,
}

/// What a [`LatentFit`] goes on from later.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SavedLatent {
    /// The maps of the code.
    maps: Svbrdf,
    /// Photographs whose steps are left; 0 where none is.
    fresh: usize,
}

impl LatentFit {
    /// Starts from maps for photographs of `[width, height]` texels. `start` has that resolution or a
    /// half, a quarter, ... of it, as [`Networks::photo_maps`] gives it, or twice, ....
    ///
    /// # Errors
    /// When sizes do not fit each other or the networks, or a network is broken.
    pub fn new(
        networks: Arc<Networks>,
        start: &Svbrdf,
        [width, height]: [usize; 2],
        options: &LatentOptions,
    ) -> Result<Self> {
        let multiple = networks.decoder().stride();
        let fits = |n: usize| n > 0 && n.is_multiple_of(multiple);
        if !fits(width) || !fits(height) {
            return Err(Error::argument(
                "observation",
                format!("{width}x{height} texels, multiples of {multiple} expected"),
            ));
        }
        let start = to_size(start, [width, height])?;
        let code = Code::new(&networks, &averaged(&start))?;
        let position = LatentPosition { done: 0, fresh: 0, loss: f64::NAN };
        let first = (options.all_steps_to > 1).then(|| start.clone());
        Ok(Self { networks, options: *options, start, first, code, photographs: 0, position })
    }

    /// A photograph was added; the fit begins again from its maps, with the third from the mean of first maps.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn add_photograph(&mut self, observation: &Observation) -> Result<()> {
        let photographs = self.photographs + 1;
        let mut fresh = if self.is_settled() { 1 } else { self.position.fresh + 1 };
        if photographs > 1 {
            self.refresh()?;
            self.start = self.maps();
            if let Some(mean) = self.first.take() {
                let maps = to_size(&self.networks.photo_maps(observation)?, size(&self.start))?;
                let mean = moved(&mean, &maps, (photographs as f32).recip());
                if photographs < self.options.all_steps_to {
                    self.first = Some(mean);
                } else {
                    self.start = mean;
                    // It has settled on none.
                    fresh = photographs;
                }
            }
            self.code = Code::new(&self.networks, &averaged(&self.start))?;
        }
        self.photographs = photographs;
        self.position = LatentPosition { done: 0, fresh, loss: f64::NAN };
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
        let (done, steps, options) = (self.position.done, self.steps(), &self.options);
        let averages = photographs.averaged();
        let observations = chosen(&averages, &photographs.subset(done));
        if done == 0 {
            self.code.apply_gains(&self.networks, &observations)?;
        }
        let progress = done as f32 / steps as f32;
        // Moments begin at zero with each photograph, which makes first steps long: maps of many move less.
        let few = (options.all_steps_to as f32 / self.photographs as f32).min(1.0);
        let rate =
            few * options.learning_rate * 0.5 * (1.0 + (std::f32::consts::PI * progress).cos());
        self.position.loss = self.code.step(&self.networks, &observations, rate, options)?;
        self.position.done += 1;
        if self.is_settled() {
            self.refresh()?;
        }
        Ok(self.report())
    }

    /// Whether nothing is left to do until a photograph is added.
    pub fn is_settled(&self) -> bool {
        self.position.done >= self.steps()
    }

    /// The maps as they are now: where the code began, and what it has moved of the averages since, interpolated.
    pub fn maps(&self) -> Svbrdf {
        if self.position.loss.is_nan() {
            return self.start.clone();
        }
        let began = averaged(&self.start);
        let mut change = self.code.maps().clone();
        let n = change.texels();
        for (i, (to, from)) in change.planes_mut().iter_mut().zip(began.planes()).enumerate() {
            *to = encoding::encode(i / n, *to) - encoding::encode(i / n, *from);
        }
        while change.width() < self.start.width() {
            change = change.upsampled();
        }
        let mut maps = self.start.clone();
        let n = maps.texels();
        for (i, (to, by)) in maps.planes_mut().iter_mut().zip(change.planes()).enumerate() {
            *to = encoding::decode(i / n, encoding::encode(i / n, *to) + by);
        }
        maps.clamp();
        maps
    }

    /// The maps of the code, averages of texels.
    pub fn averages(&self) -> &Svbrdf {
        self.code.maps()
    }

    /// Steps done, and all.
    pub fn work(&self) -> [usize; 2] {
        [self.position.done.min(self.steps()), self.steps()]
    }

    /// The photographs so far count as fitted, steps left or not: the next brings its own alone.
    pub fn count_as_fitted(&mut self) {
        self.position.fresh = 0;
    }

    /// The fit as it is; where steps are in progress, as it was before them.
    pub fn save(&self, in_progress: bool) -> SavedLatent {
        let settled = self.is_settled();
        let maps = if in_progress && !settled { self.start.clone() } else { self.maps() };
        SavedLatent { maps, fresh: if settled { 0 } else { self.position.fresh } }
    }

    /// Goes on from what was saved, with its photographs. Code and detail are found anew from the maps.
    ///
    /// # Errors
    /// When sizes do not fit each other or the networks, or a network is broken.
    pub fn restore(
        networks: Arc<Networks>,
        saved: SavedLatent,
        photographs: &Photographs,
        options: &LatentOptions,
    ) -> Result<Self> {
        let (all, SavedLatent { maps, fresh }) = (photographs.full(), saved);
        let of_maps = size(&maps);
        let first = photographs.working().full().first();
        if first.map(|first| [first.width(), first.height()]) != Some(of_maps) {
            return Err(Error::argument("latent", "maps of the photographs' size are expected"));
        }
        let mut fit = Self::new(networks, &maps, of_maps, options)?;
        fit.first = None;
        for (i, photograph) in all.iter().enumerate().filter(|_| all.len() < options.all_steps_to) {
            // As it came, before anything was corrected.
            let mut photograph = photograph.clone();
            photograph.view = photographs.given()[i];
            let maps = to_size(&fit.networks.photo_maps(&photograph)?, of_maps)?;
            let part = (i as f32 + 1.0).recip();
            fit.first = Some(match &fit.first {
                Some(mean) => moved(mean, &maps, part),
                None => maps,
            });
        }
        (fit.photographs, fit.position.fresh) = (all.len(), fresh.min(all.len()));
        if fresh == 0 {
            fit.position.done = fit.steps();
        }
        Ok(fit)
    }

    /// Steps for the photographs that the fit has not settled on: each has those that it would have had
    /// alone.
    fn steps(&self) -> usize {
        let LatentOptions { first_steps, steps, all_steps_to, .. } = self.options;
        let of = |count: usize| match count {
            ..=1 => first_steps,
            _ => (steps * all_steps_to).div_ceil(count.max(all_steps_to)),
        };
        let (fresh, all) = (self.position.fresh, self.photographs.max(1));
        let steps: usize = (all + 1 - fresh.clamp(1, all)..=all).take(MAX_PENDING).map(of).sum();
        steps.max(1)
    }

    fn report(&self) -> StepReport {
        StepReport { loss: self.position.loss, settled: self.is_settled() }
    }

    /// Brings the maps up to the code.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn refresh(&mut self) -> Result<()> {
        self.code.refresh(&self.networks)
    }
}

/// Maps moved a part of the way to others, in coordinates.
fn moved(maps: &Svbrdf, to: &Svbrdf, part: f32) -> Svbrdf {
    let (mut maps, from) = (maps.clone(), coordinates(maps));
    let n = maps.texels();
    let moved = from.iter().zip(coordinates(to)).map(|(from, to)| from + part * (to - from));
    for (i, (value, x)) in maps.planes_mut().iter_mut().zip(moved).enumerate() {
        *value = from_coordinate(i / n, x);
    }
    maps
}

fn size(maps: &Svbrdf) -> [usize; 2] {
    [maps.width(), maps.height()]
}

/// Averages of as many texels as the code is fitted at.
fn averaged(maps: &Svbrdf) -> Svbrdf {
    let halvings = halvings_to(size(maps), CODE_TEXELS);
    halved(maps, halvings, Svbrdf::downsampled)
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
    if size(&maps) == [width, height] {
        return Ok(maps);
    }
    Err(Error::argument(
        "start",
        format!("{}x{} texels do not scale to {width}x{height}", maps.width(), maps.height()),
    ))
}
