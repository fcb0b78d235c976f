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
//! The fit is a stepper: photographs may be added, and maps taken, between any two steps. After a
//! new photograph it begins again, with code and moments as they were. With the third it begins
//! anew, from the mean of what each photograph says alone: one or two photographs are ambiguous, and
//! steps do not lead out of where a wrong reading of them has led the code.

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
pub(crate) use code::SavedCode;

/// Photographs that came before the fit had settled and add their steps, at most.
const MAX_PENDING: usize = 8;
/// Most steps and photographs that a saved fit is believed.
const MAX_SAVED: usize = 1 << 24;

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
    /// Where the code began, of as many texels as the phases work with.
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct LatentPosition {
    /// Steps done since the latest photograph.
    pub done: usize,
    /// Photographs since the fit had settled.
    pub fresh: usize,
    /// Mean log-L1 of the latest step; not a number before the first.
    pub loss: f64,
}

/// What a [`LatentFit`] holds apart from photographs and networks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SavedFit {
    pub position: LatentPosition,
    pub start: Svbrdf,
    pub first: Option<Svbrdf>,
    pub code: SavedCode,
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

    /// A photograph was added; the fit begins again from where it is, with the third anew.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn add_photograph(&mut self, observation: &Observation) -> Result<()> {
        let photographs = self.photographs + 1;
        let fresh = if self.is_settled() { 1 } else { self.position.fresh + 1 };
        self.begin_again()?;
        (self.position.fresh, self.photographs) = (fresh, photographs);
        if photographs > 1
            && let Some(mean) = self.first.take()
        {
            let maps = to_size(&self.networks.photo_maps(observation)?, size(&self.start))?;
            let mean = moved(&mean, &maps, (photographs as f32).recip());
            if photographs < self.options.all_steps_to {
                self.first = Some(mean);
            } else {
                self.code = Code::new(&self.networks, &averaged(&mean))?;
                self.start = mean;
                // It has settled on none.
                self.position.fresh = photographs;
            }
        }
        Ok(())
    }

    /// Begins again from where the fit is, as light or ambient light were estimated anew.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn begin_again(&mut self) -> Result<()> {
        let fresh = if self.is_settled() { 0 } else { self.position.fresh };
        self.refresh()?;
        (self.position.done, self.position.fresh) = (0, fresh);
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
        // A restored fit may have done more than what one photograph asks for.
        let progress = (done as f32 / steps as f32).min(1.0);
        let rate = options.learning_rate * 0.5 * (1.0 + (std::f32::consts::PI * progress).cos());
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

    /// The fit as plain data.
    pub fn save(&self) -> SavedFit {
        SavedFit {
            position: self.position,
            start: self.start.clone(),
            first: self.first.clone(),
            code: self.code.save(),
        }
    }

    /// Goes on from a saved fit with its photographs. Without `same_networks` the code is found
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
    ) -> Result<Self> {
        let SavedFit { mut position, start, first, code } = saved;
        // More than anyone takes.
        position.done = position.done.min(MAX_SAVED);
        position.fresh = position.fresh.min(MAX_SAVED);
        let of = |all: &[Observation]| all.first().map(|first| [first.width(), first.height()]);
        if Some(size(&start)) != of(photographs.working().full())
            || first.as_ref().is_some_and(|first| size(first) != size(&start))
            || Some(size(&code.maps)) != of(&photographs.averaged())
        {
            return Err(Error::argument("fit", "maps of the photographs' size are expected"));
        }
        let code = Code::restore(&networks, code, same_networks)?;
        let photographs = photographs.len();
        Ok(Self { networks, options: *options, start, first, code, photographs, position })
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
