//! Optimisation of the latent code against all photographs.
//!
//! The objective of the paper (Section 5), `argmin_z sum_i L(I_i, R(D(z), C_i))`, with two
//! additions. What the decoder cannot express of the start is kept as a fixed detail,
//! `maps = D(z) + (start - D(E(start)))` in encoded space, so that the fit begins exactly at the
//! start and moves it within what materials do. Each photograph begins with gains of the maps
//! as a whole; and a prior, weaker with every photograph, holds the slopes to the start's.
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

use super::options::LatentOptions;
use super::photographs::{Photographs, chosen};
use super::prior::{coordinates, from_coordinate};
use crate::initial_estimate::Networks;
use crate::observation::Observation;
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
        let code = Code::new(&networks, &to_size(start, [width, height])?)?;
        let position = LatentPosition { done: 0, fresh: 0, loss: f64::NAN };
        Ok(Self { networks, options: *options, code, photographs: 0, position })
    }

    /// A photograph was added; the fit begins again from where it is.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn add_photograph(&mut self) -> Result<()> {
        let photographs = self.photographs + 1;
        let fresh = if self.is_settled() { 1 } else { self.position.fresh + 1 };
        self.begin_again()?;
        // A code that begins anew has settled on none.
        let anew = photographs == self.options.all_steps_to;
        self.position.fresh = if anew { photographs } else { fresh };
        self.photographs = photographs;
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
        let observations = chosen(photographs.averaged(), &photographs.drawn(done));
        if done == 0 && self.begins_anew() {
            let first = photographs.averaged().iter().take(options.all_steps_to);
            let start = mean_of_first_maps(&self.networks, first)?;
            let maps = self.code.maps();
            let start = to_size(&start, [maps.width(), maps.height()])?;
            self.code = Code::new(&self.networks, &start)?;
        }
        if done == 0 && options.gains {
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

    /// Whether the code has settled on none of the photographs, which are enough to begin from all.
    fn begins_anew(&self) -> bool {
        let fresh = self.position.fresh == self.photographs;
        fresh && self.photographs >= self.options.all_steps_to.max(2)
    }

    /// Whether nothing is left to do until a photograph is added.
    pub fn is_settled(&self) -> bool {
        self.position.done >= self.steps()
    }

    /// The maps as they are now.
    pub fn maps(&self) -> &Svbrdf {
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
        SavedFit { position: self.position, code: self.code.save() }
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
        let first = photographs.averaged().first().ok_or(Error::NoMaps)?;
        let SavedFit { mut position, code } = saved;
        // More than anyone takes.
        position.done = position.done.min(MAX_SAVED);
        position.fresh = position.fresh.min(MAX_SAVED);
        if [code.maps.width(), code.maps.height()] != [first.width(), first.height()] {
            return Err(Error::argument("fit", "maps of the photographs' size are expected"));
        }
        let code = Code::restore(&networks, code, same_networks)?;
        Ok(Self { networks, options: *options, code, photographs: photographs.len(), position })
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

/// Mean, in coordinates, of what the photo network says of each photograph alone.
fn mean_of_first_maps<'a>(
    networks: &Networks,
    observations: impl ExactSizeIterator<Item = &'a Observation>,
) -> Result<Svbrdf> {
    let share = (observations.len().max(1) as f32).recip();
    let mut all: Option<(Svbrdf, Vec<f32>)> = None;
    for observation in observations {
        let maps = networks.photo_maps(observation)?;
        let found = coordinates(&maps);
        let (_, sum) = all.get_or_insert_with(|| (maps, vec![0.0; found.len()]));
        sum.iter_mut().zip(found).for_each(|(sum, x)| *sum += share * x);
    }
    let (mut maps, mean) = all.ok_or(Error::NoMaps)?;
    let texels = maps.texels();
    let values = mean.into_iter().enumerate().map(|(i, x)| from_coordinate(i / texels, x));
    maps.planes_mut().iter_mut().zip(values).for_each(|(to, value)| *to = value);
    Ok(maps)
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
