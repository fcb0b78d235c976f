//! The session's fit without its thread.

use std::sync::Arc;

use super::budget::{Budget, Meter};
use super::fit::{Fit, NewFrame, first_maps};
use super::{Method, Settings};
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
