//! An estimate in the caller's thread.

use std::sync::Arc;

use crate::assessment::{Evidence, Place};
use crate::estimate::{
    Budget, EstimateOptions, Estimation, FitRecord, LightCorrection, Meter, Method, PhaseReport,
    Step, Task, first_maps,
};
use crate::networks::Networks;
use crate::observation::Observation;
use crate::{Result, Svbrdf};

/// Estimates maps from rectified photographs in the caller's thread: what a session does on its own.
pub struct Estimator {
    networks: Arc<Networks>,
    estimation: Estimation,
    meter: Meter,
    start: Option<Svbrdf>,
}

impl Estimator {
    /// Without photographs.
    pub fn new(networks: Arc<Networks>, method: Method, refine: bool) -> Self {
        Self::with_options(networks, method, refine, EstimateOptions::default())
    }

    /// The same with other options.
    pub fn with_options(
        networks: Arc<Networks>,
        method: Method,
        refine: bool,
        options: EstimateOptions,
    ) -> Self {
        let task = Task { method, refine, free_lights: true };
        let estimation = Estimation::new(networks.clone(), task, options);
        let meter = Meter::new(Budget::default());
        Self { networks, estimation, meter, start: None }
    }

    /// Begins from given maps, of the size of the photographs, in place of the photo network's.
    /// To be called before the first photograph.
    pub fn start_from(&mut self, maps: Svbrdf) {
        self.start = Some(maps);
    }

    /// Whether lights are only roughly known, so that they and ambient light are corrected: they
    /// are unless said otherwise. To be called before the first photograph.
    pub fn correct_lights(&mut self, correct: bool) {
        self.estimation.task.free_lights = correct;
    }

    /// Keeps what the network is asked about, see [`Estimator::record`].
    pub fn keep_record(&mut self) {
        self.estimation.keep_record = true;
    }

    /// What each phase has done for the photographs so far, in their order.
    pub fn reports(&self) -> &[PhaseReport] {
        self.estimation.reports()
    }

    /// Adds a photograph; the first sets the size.
    ///
    /// # Errors
    /// When its size is not that of the first or does not suit the networks.
    pub fn add(&mut self, observation: Observation) -> Result<()> {
        let start = match (self.photos(), self.start.take()) {
            (0, Some(maps)) => Some(maps),
            (0, None) => Some(first_maps(&self.networks, &observation)?),
            _ => None,
        };
        self.estimation.add(observation, false, start.as_ref())
    }

    /// What was found of exposure and flash.
    pub fn light_correction(&self) -> &LightCorrection {
        self.estimation.light_correction()
    }

    /// What the network was asked about at last, if that is kept: recorded fits are what it learns from. `None` where it was not
    /// asked for the photographs so far, of which there is one.
    pub fn record(&self) -> Option<&FitRecord> {
        self.estimation.record.as_ref()
    }

    /// What is known of how far the maps of the moment may be off, see
    /// [`Session::snapshot_with_uncertainty`](crate::session::Session::snapshot_with_uncertainty).
    ///
    /// # Errors
    /// Without photographs.
    pub fn evidence(&self) -> Result<Evidence> {
        self.estimation.evidence()
    }

    /// By how much a photograph from each of some places would lower the expected squared error of
    /// renderings, see [`Session::next_view`](crate::session::Session::next_view): fractions, 0 to 1.
    ///
    /// # Errors
    /// Without photographs.
    pub fn outlook(&self, places: &[Place]) -> Result<Vec<f64>> {
        self.estimation.outlook(places)
    }

    /// Photographs added.
    pub fn photos(&self) -> usize {
        self.estimation.photos()
    }

    /// One step.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn step(&mut self) -> Result<Step> {
        self.estimation.step(&mut self.meter)
    }

    /// The maps as they are now.
    ///
    /// # Errors
    /// Without photographs.
    pub fn maps(&self) -> Result<Svbrdf> {
        self.estimation.maps()
    }

    /// Steps until nothing is left to do; returns the maps.
    ///
    /// # Errors
    /// Without photographs, or when a network is broken.
    pub fn settle(&mut self) -> Result<Svbrdf> {
        while !self.step()?.done {}
        self.maps()
    }
}
