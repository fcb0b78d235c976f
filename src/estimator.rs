//! An estimate that runs in the caller's thread.

use std::sync::Arc;

use crate::assessment::{Evidence, Place};
use crate::estimate::{
    Budget, EstimateOptions, Estimation, FitRecord, LightCorrection, Meter, Method, PhaseReport,
    Step, Task, first_maps,
};
use crate::networks::Networks;
use crate::observation::Observation;
use crate::{Result, Svbrdf};

/// Estimates maps from rectified photographs in the caller's thread, one step at a time.
pub struct Estimator {
    networks: Arc<Networks>,
    estimation: Estimation,
    meter: Meter,
    start: Option<Svbrdf>,
}

impl Estimator {
    /// An estimator without photographs and with default options.
    pub fn new(networks: Arc<Networks>, method: Method, refine: bool) -> Self {
        Self::with_options(networks, method, refine, EstimateOptions::default())
    }

    /// An estimator without photographs.
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

    /// Starts from these maps, of the photographs' size, instead of the photo network's. Call this before the
    /// first photograph.
    pub fn start_from(&mut self, maps: Svbrdf) {
        self.start = Some(maps);
    }

    /// Whether to correct the photographs' lights and ambient light because they are only roughly known;
    /// default true. Call this before the first photograph.
    pub fn correct_lights(&mut self, correct: bool) {
        self.estimation.task.free_lights = correct;
    }

    /// Keeps the inputs of the relief network, see [`Estimator::record`].
    pub fn keep_record(&mut self) {
        self.estimation.keep_record = true;
    }

    /// Reports of the phases for the photographs so far, in order.
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

    /// Estimated exposure of each photograph and offset of the flash.
    pub fn light_correction(&self) -> &LightCorrection {
        self.estimation.light_correction()
    }

    /// The latest inputs of the relief network, its training data. `None` before the second photograph, or
    /// without [`Estimator::keep_record`].
    pub fn record(&self) -> Option<&FitRecord> {
        self.estimation.record.as_ref()
    }

    /// Evidence on the errors of the current maps, see
    /// [`Session::snapshot_with_uncertainty`](crate::session::Session::snapshot_with_uncertainty).
    ///
    /// # Errors
    /// Without photographs.
    pub fn evidence(&self) -> Result<Evidence> {
        self.estimation.evidence()
    }

    /// Fraction, 0 to 1, by which a photograph from each place would lower the expected squared error of
    /// renderings, see [`Session::next_view`](crate::session::Session::next_view).
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

    /// The current maps.
    ///
    /// # Errors
    /// Without photographs.
    pub fn maps(&self) -> Result<Svbrdf> {
        self.estimation.maps()
    }

    /// Steps until the estimate has converged; returns the maps.
    ///
    /// # Errors
    /// Without photographs, or when a network is broken.
    pub fn settle(&mut self) -> Result<Svbrdf> {
        while !self.step()?.done {}
        self.maps()
    }
}
