//! Optimisation of the latent code against all photographs.
//!
//! The objective is that of the paper (section 5), `argmin_z sum_i L(I_i, R(D(z), C_i))`, with three
//! additions:
//!
//! - A fixed detail holds the part of the start that the decoder cannot express: `maps = D(z) + (start -
//!   D(E(start)))` in encoded space. The fit begins exactly at the start.
//! - Gains of the maps as a whole come first for each photograph.
//! - A prior holds the slopes to the start's; its weight falls with every photograph.
//!
//! The code works on averages of at most [`CODE_TEXELS`] texels a side; finer detail is that of the start:
//! `maps = start + upsampled(D(z) + detail - averaged start)`, in encoded space.
//!
//! Photographs may be added, and maps taken, between any two steps. With each photograph, the code is encoded
//! again from the current maps, so that a saved fit needs only maps. With the third, it is encoded from the
//! mean of each photograph's own maps, because one or two photographs are ambiguous and Adam does not escape
//! a wrong basin.

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

/// Largest number of photographs, added during a fit, that add their steps.
const MAX_PENDING: usize = 8;

/// Result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StepReport {
    /// Mean log-L1 before the step.
    pub loss: f64,
    /// Whether no step remains until a photograph is added.
    pub settled: bool,
}

/// A fit in progress.
pub(crate) struct LatentFit {
    networks: Arc<Networks>,
    options: LatentOptions,
    /// The maps that the code started from with the latest photograph, at the resolution of the phases.
    start: Svbrdf,
    /// The code of averages of texels.
    code: Code,
    /// Number of photographs.
    photographs: usize,
    position: LatentPosition,
}

/// Progress of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LatentPosition {
    /// Steps done since the latest photograph.
    done: usize,
    /// Photographs since the fit last converged.
    fresh: usize,
    /// Mean log-L1 of the latest step; NaN before the first, while the maps are the start's.
    loss: f64,
}

/// A [`LatentFit`] as plain data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SavedLatent {
    /// The maps of the code.
    maps: Svbrdf,
    /// Photographs with remaining steps.
    fresh: usize,
}

impl LatentFit {
    /// Starts from maps for photographs of `[width, height]` texels. `start` has this resolution or a power
    /// of two of it, like that of [`Networks::photo_maps`].
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
        Ok(Self { networks, options: *options, start, code, photographs: 0, position })
    }

    /// Adds the last of all photographs: the fit restarts from its maps, with the third from the mean of the
    /// photographs' own.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn add_photograph(&mut self, all: &[Observation]) -> Result<()> {
        let mut fresh = if self.is_settled() { 1 } else { self.position.fresh + 1 };
        if all.len() > 1 {
            self.refresh()?;
            self.start = self.maps();
            if all.len() == self.options.all_steps_to {
                self.start = self.mean_of_first_maps(all)?;
                // The fit has converged on none of them.
                fresh = all.len();
            }
            self.code = Code::new(&self.networks, &averaged(&self.start))?;
        }
        self.photographs = all.len();
        self.position = LatentPosition { done: 0, fresh, loss: f64::NAN };
        Ok(())
    }

    /// Mean of the maps that the photo network makes of each photograph alone.
    fn mean_of_first_maps(&self, all: &[Observation]) -> Result<Svbrdf> {
        let of = |observation: &Observation| {
            to_size(&self.networks.photo_maps(observation)?, size(&self.start))
        };
        let [first, others @ ..] = all else { return Ok(self.start.clone()) };
        let mut mean = of(first)?;
        for (i, other) in others.iter().enumerate() {
            mean = moved(&mean, &of(other)?, (i as f32 + 2.0).recip());
        }
        Ok(mean)
    }

    /// One step; does nothing after the last.
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
        // Moments start at zero with each photograph, which makes the first steps long: with many
        // photographs, steps are shorter.
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

    /// Whether no step remains until a photograph is added.
    pub fn is_settled(&self) -> bool {
        self.position.done >= self.steps()
    }

    /// The current maps: the start plus the interpolated change of the averages.
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

    /// Steps done, and their total.
    pub fn work(&self) -> [usize; 2] {
        [self.position.done.min(self.steps()), self.steps()]
    }

    /// The current fit; a fit in progress is saved as of its start.
    pub fn save(&self, in_progress: bool) -> SavedLatent {
        let settled = self.is_settled();
        let maps = if in_progress && !settled { self.start.clone() } else { self.maps() };
        SavedLatent { maps, fresh: if settled { 0 } else { self.position.fresh } }
    }

    /// Continues a saved fit with its photographs. Code and detail are encoded from the maps.
    ///
    /// # Errors
    /// When sizes do not fit each other or the networks, or a network is broken.
    pub fn restore(
        networks: Arc<Networks>,
        saved: SavedLatent,
        photographs: &Photographs,
        options: &LatentOptions,
    ) -> Result<Self> {
        let SavedLatent { maps, fresh } = saved;
        let of_maps = size(&maps);
        let first = photographs.working().full().first();
        if first.map(|first| [first.width(), first.height()]) != Some(of_maps) {
            return Err(Error::argument("latent", "maps of the photographs' size are expected"));
        }
        let mut fit = Self::new(networks, &maps, of_maps, options)?;
        (fit.photographs, fit.position.fresh) = (photographs.len(), fresh.min(photographs.len()));
        if fresh == 0 {
            fit.position.done = fit.steps();
        }
        Ok(fit)
    }

    /// Total steps for the photographs since the fit last converged: the sum of those that each has alone.
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

    /// Updates the maps from the code.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn refresh(&mut self) -> Result<()> {
        self.code.refresh(&self.networks)
    }
}

/// Maps moved by a fraction towards others, in coordinates.
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

/// Averages at the resolution of the code.
fn averaged(maps: &Svbrdf) -> Svbrdf {
    let halvings = halvings_to(size(maps), CODE_TEXELS);
    halved(maps, halvings, Svbrdf::downsampled)
}

/// Maps at a power of two of their size.
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
