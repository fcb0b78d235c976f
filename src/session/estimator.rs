//! The session's fit without its thread.

use std::sync::Arc;

use super::budget::{Budget, Meter};
use super::fit::{Fit, NewFrame, first_maps};
use super::{Method, Settings};
use crate::completion::Incomplete;
use crate::initial_estimate::Networks;
use crate::observation::Observation;
use crate::{Result, Svbrdf};

/// Fits rectified photographs in the caller's thread: what a [`super::Session`] does on its own.
pub struct Estimator {
    networks: Arc<Networks>,
    fit: Fit,
    start: Option<Svbrdf>,
    begun: bool,
}

impl Estimator {
    /// Without photographs.
    pub fn new(networks: Arc<Networks>, method: Method, refine: bool) -> Self {
        let settings = Settings { method, refine, ..Settings::default() };
        let mut fit = Fit::new(networks.clone(), &settings);
        fit.free_lights = true;
        Self { fit, networks, start: None, begun: false }
    }

    /// Begins from given maps, of the size of the photographs, in place of the photo network's.
    /// To be called before the first photograph.
    pub fn start_from(&mut self, maps: Svbrdf) {
        self.start = Some(maps);
    }

    /// Whether lights are only roughly known, so that they and ambient light are corrected: they
    /// are unless said otherwise. To be called before the first photograph.
    pub fn correct_lights(&mut self, correct: bool) {
        self.fit.free_lights = correct;
    }

    /// Keeps what completions begin with, see [`Estimator::incomplete`].
    pub fn keep_incomplete(&mut self) {
        self.fit.keep_incomplete = true;
    }

    /// Adds a photograph; the first sets the size.
    ///
    /// # Errors
    /// When its size is not that of the first or does not suit the networks.
    pub fn add(&mut self, observation: Observation) -> Result<()> {
        let start = match (self.begun, self.start.take()) {
            (true, _) => None,
            (false, Some(maps)) => Some(Arc::new(maps)),
            (false, None) => Some(Arc::new(first_maps(&self.networks, &observation)?)),
        };
        self.fit.add(NewFrame { observation, start, updates: Vec::new(), restart: false })?;
        self.begun = true;
        Ok(())
    }

    /// What the latest completion began with: recorded fits are what its network learns from.
    /// `None` before the second photograph.
    pub fn incomplete(&self) -> Option<&Incomplete> {
        self.fit.incomplete.as_ref()
    }

    /// Photographs added.
    pub fn frames(&self) -> usize {
        self.fit.frames()
    }

    /// Fits until nothing is left to do; returns the maps.
    ///
    /// # Errors
    /// Without photographs, or when a network is broken.
    pub fn settle(&mut self) -> Result<Svbrdf> {
        let mut meter = Meter::new(Budget::default(), 0.0, 0);
        while !self.fit.step(&mut meter, &mut |_, _| true)?.done {}
        self.fit.maps()
    }
}
