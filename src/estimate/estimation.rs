//! An estimate in progress: photographs, latent code, and remaining phases.

use std::borrow::Cow;
use std::sync::Arc;

use super::budget::Meter;
use super::bundle::EstimatedLobes;
use super::correction::{Correction, LightCorrection};
use super::finer::interpolated;
use super::joint;
use super::latent::LatentFit;
use super::map_state::MapState;
use super::options::{EstimateOptions, NoiseOptions};
use super::phases::{Context, Phase, PhaseReport, Schedule};
use super::photographs::Photographs;
use super::relief::FitRecord;
use super::task::{EarlyStop, Method, Task};
use crate::networks::Networks;
use crate::observation::Observation;
use crate::render;
use crate::{Error, Result, Svbrdf};

/// The photo network's maps of the first photograph, at its resolution.
pub(crate) fn first_maps(networks: &Networks, observation: &Observation) -> Result<Svbrdf> {
    let mut maps = networks.photo_maps(observation)?;
    while maps.width() < observation.width() {
        maps = maps.upsampled();
    }
    maps.clamp();
    Ok(maps)
}

/// Result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// The phase of the step; `None` after the last.
    pub phase: Option<Phase>,
    /// Mean log-L1 over all photographs.
    pub loss: f32,
    /// Fraction of the work on the photographs so far that is done; never decreases.
    pub fraction: f32,
    /// Whether no step remains until a photograph is added.
    pub done: bool,
}

/// Stage of an estimate, with its current maps.
pub(super) enum Stage {
    /// No phase remains; no maps before the first photograph.
    Settled(Option<Svbrdf>),
    /// Phases remain.
    Running(Box<Run>),
}

/// Remaining phases and their data.
pub(super) struct Run {
    schedule: Schedule,
    /// Maps and prior; `None` during the latent phase, whose maps are those of the code.
    map_state: Option<MapState>,
}

/// An estimate of all photographs so far, which works in steps.
pub(crate) struct Estimation {
    pub(crate) networks: Arc<Networks>,
    pub(crate) options: EstimateOptions,
    /// Expected noise without the deviations of boards.
    pub(crate) least_noise: NoiseOptions,
    pub(crate) task: Task,
    pub(crate) photographs: Photographs,
    /// From the first photograph on; `None` in the baseline.
    pub(super) latent: Option<LatentFit>,
    pub(super) stage: Stage,
    /// Optional lobes of the maps, if any: of all texels or of each direction.
    pub(crate) lobes: Vec<EstimatedLobes>,
    pub(super) loss: f32,
    fraction: f32,
    /// The correction at the start of the latest fit and, in the baseline, the maps.
    pub(super) begun_with: (Correction, Option<Svbrdf>),
    /// Reason of an early stop.
    pub(super) early_stop: Option<EarlyStop>,
    /// Reports of the phases after the last one.
    reports: Vec<PhaseReport>,
    /// Whether to keep the relief network's inputs.
    pub(crate) keep_record: bool,
    pub(crate) record: Option<FitRecord>,
}

impl Estimation {
    /// An estimate without photographs.
    pub fn new(networks: Arc<Networks>, task: Task, options: EstimateOptions) -> Self {
        Self {
            networks,
            photographs: Self::no_photographs(&options),
            least_noise: options.noise,
            options,
            task,
            latent: None,
            stage: Stage::Settled(None),
            lobes: Vec::new(),
            loss: 0.0,
            fraction: 0.0,
            begun_with: Default::default(),
            early_stop: None,
            reports: Vec::new(),
            keep_record: false,
            record: None,
        }
    }

    /// An empty set of photographs with the limits of the options.
    pub fn no_photographs(options: &EstimateOptions) -> Photographs {
        Photographs::new().limited(options.schedule.photographs, options.schedule.texels)
    }

    /// A new estimate with the same settings, without photographs.
    pub fn afresh(&self) -> Self {
        let mut fresh = Self::new(self.networks.clone(), self.task, self.least_options());
        fresh.keep_record = self.keep_record;
        fresh
    }

    /// The options before any board states its deviation.
    pub(super) fn least_options(&self) -> EstimateOptions {
        EstimateOptions { noise: self.least_noise, ..self.options.clone() }
    }

    /// Sets the expected noise from the boards' deviations.
    pub(super) fn expect_noise(&mut self) {
        self.options.noise = self.least_noise.calibrated(self.photographs.log_sigma());
    }

    /// Estimated exposure of each photograph and offset of the flash.
    pub fn light_correction(&self) -> &LightCorrection {
        &self.photographs.correction().exposure
    }

    /// The networks in use.
    pub fn networks(&self) -> &Arc<Networks> {
        &self.networks
    }

    /// Number of photographs.
    pub fn photos(&self) -> usize {
        self.photographs.len()
    }

    /// Whether no step remains until a photograph is added.
    pub fn is_done(&self) -> bool {
        matches!(self.stage, Stage::Settled(_))
    }

    /// Whether the budget or invisible changes ended the fit early.
    pub fn is_stopped_early(&self) -> bool {
        self.early_stop.is_some()
    }

    /// Fraction of the work on the photographs so far that is done.
    pub fn fraction(&self) -> f32 {
        if self.is_done() { 1.0 } else { self.fraction }
    }

    /// Whether the maps are those of the joint solve, or will be.
    pub(crate) fn is_joint(&self) -> bool {
        self.task.method == Method::Deep && self.task.refine && self.photographs.len() > 1
    }

    /// The class of colour of each texel in the joint solve: 0 is the largest class. Empty without a joint
    /// solve (one photograph, or no refinement).
    pub fn classes(&self) -> Vec<u8> {
        if self.is_joint() { joint::classes(&self.photographs, &self.options) } else { Vec::new() }
    }

    /// Mean log-L1 over all photographs.
    pub fn loss(&self) -> f32 {
        self.loss
    }

    /// A photograph with its uncorrected view, without its mask.
    pub fn observation(&self, index: usize) -> Observation {
        let mut observation = self.photographs.unmasked(index);
        observation.view = self.photographs.given()[index];
        observation
    }

    /// Replaces a photograph by a better rectified one. A call of [`Estimation::add`] must follow.
    ///
    /// # Errors
    /// When its size is another.
    pub fn replace(&mut self, index: usize, observation: Observation) -> Result<()> {
        self.settle(None);
        self.photographs.replace(index, observation)
    }

    /// Takes a photograph for [`Estimation::add`]; [`Estimation::start`] begins the fit.
    ///
    /// # Errors
    /// When sizes differ, or the first has no start.
    pub(crate) fn take(
        &mut self,
        observation: Observation,
        restart: bool,
        start: Option<&Svbrdf>,
    ) -> Result<()> {
        self.settle(None);
        if let Some(start) = start {
            self.stage = Stage::Settled(Some(start.clone()));
        }
        if self.shown().is_none() {
            return Err(Error::NoMaps);
        }
        if restart {
            self.restart()?;
        }
        self.photographs.add(observation)
    }

    /// Begins the fit. `start` has the maps of the first photograph.
    ///
    /// # Errors
    /// When a network is broken.
    pub(crate) fn start(&mut self, start: Option<&Svbrdf>) -> Result<()> {
        self.expect_noise();
        if self.task.method == Method::Deep {
            if self.latent.is_none() {
                let start = start.ok_or(Error::NoMaps)?;
                self.latent = Some(self.begin_latent(start)?);
            }
            if let Some(latent) = &mut self.latent {
                latent.add_photograph(self.photographs.full())?;
            }
        }
        (self.early_stop, self.record) = (None, None);
        self.measure();
        self.begin();
        Ok(())
    }

    fn begin_latent(&self, start: &Svbrdf) -> Result<LatentFit> {
        let first = self.photographs.working().full().first().ok_or(Error::NoMaps)?;
        let size = [first.width(), first.height()];
        LatentFit::new(self.networks.clone(), start, size, &self.options.latent)
    }

    /// Restarts from the photo network's maps with the photographs as they are now.
    fn restart(&mut self) -> Result<()> {
        let Some(first) = self.photographs.full().first() else { return Ok(()) };
        let start = first_maps(&self.networks, first)?;
        if self.latent.is_some() {
            let mut latent = self.begin_latent(&start)?;
            let all = self.photographs.full();
            for count in 1..=all.len() {
                latent.add_photograph(&all[..count])?;
            }
            self.latent = Some(latent);
        }
        self.stage = Stage::Settled(Some(start));
        Ok(())
    }

    pub(super) fn begin(&mut self) {
        (self.fraction, self.reports, self.lobes) = (0.0, Vec::new(), Vec::new());
        let Stage::Settled(maps) = &mut self.stage else { return };
        // The baseline continues with the maps, the other method with the latent code.
        let maps = maps.take().filter(|_| self.task.method == Method::Classic);
        self.begun_with = (self.photographs.correction().clone(), maps.clone());
        let map_state = maps.map(|maps| MapState::new(maps, &self.options));
        let without = &self.options.schedule.without;
        let schedule = Schedule::new(self.task, self.photographs.len(), without);
        self.stage = Stage::Running(Box::new(Run { schedule, map_state }));
    }

    /// Ends the fit with its current maps.
    pub(super) fn settle(&mut self, early_stop: Option<EarlyStop>) {
        self.early_stop = self.early_stop.or(early_stop);
        let maps = match std::mem::replace(&mut self.stage, Stage::Settled(None)) {
            Stage::Settled(maps) => maps,
            Stage::Running(run) => {
                self.reports = run.schedule.reports;
                let latent = || self.latent.as_ref().map(LatentFit::maps);
                run.map_state.map(|map_state| map_state.maps).or_else(latent)
            }
        };
        self.stage = Stage::Settled(maps.map(|maps| self.full_size(maps)));
    }

    /// The current maps at the resolution of the stage.
    pub(super) fn shown(&self) -> Option<Cow<'_, Svbrdf>> {
        match &self.stage {
            Stage::Settled(maps) => maps.as_ref().map(Cow::Borrowed),
            Stage::Running(run) => match &run.map_state {
                Some(map_state) => Some(Cow::Borrowed(&map_state.maps)),
                None => self.latent.as_ref().map(|latent| Cow::Owned(latent.maps())),
            },
        }
    }

    /// Reports of the phases for the photographs so far, in order.
    pub fn reports(&self) -> &[PhaseReport] {
        match &self.stage {
            Stage::Settled(_) => &self.reports,
            Stage::Running(run) => &run.schedule.reports,
        }
    }

    pub(super) fn measure(&mut self) {
        if let Some(maps) = self.shown() {
            self.loss = render::loss(&maps, self.photographs.like(&maps).full()) as f32;
        }
    }

    /// Maps interpolated to the photographs' resolution.
    fn full_size(&self, maps: Svbrdf) -> Svbrdf {
        match self.photographs.full().first() {
            Some(full) if maps.width() < full.width() => {
                interpolated(&maps, self.photographs.stride_log2())
            }
            _ => maps,
        }
    }

    /// The maps of the latent code, at the photographs' resolution.
    pub fn latent_maps(&self) -> Option<Svbrdf> {
        self.latent.as_ref().map(|latent| self.full_size(latent.maps()))
    }

    /// The current maps at the photographs' resolution.
    ///
    /// # Errors
    /// Without photographs.
    pub fn maps(&self) -> Result<Svbrdf> {
        let maps = self.shown().ok_or(Error::NoMaps)?;
        Ok(self.full_size(maps.into_owned()))
    }

    /// One step; the meter counts those of optimisers.
    ///
    /// # Errors
    /// When a network is broken or a loss is not finite.
    pub fn step(&mut self, meter: &mut Meter) -> Result<Step> {
        let Stage::Running(run) = &mut self.stage else { return Ok(self.taken(None)) };
        let phase = run.schedule.phase();
        // The latent phase checks the budget itself.
        let ended = if run.map_state.is_some() && meter.exhausted(1.0) {
            self.early_stop = self.early_stop.or(Some(EarlyStop::Budget));
            true
        } else {
            let context = &mut Context {
                networks: &self.networks,
                options: &self.options,
                task: self.task,
                photographs: &mut self.photographs,
                latent: &mut self.latent,
                map_state: &mut run.map_state,
                lobes: &mut self.lobes,
                meter,
                loss: &mut self.loss,
                early_stop: &mut self.early_stop,
                record: self.keep_record.then_some(&mut self.record),
            };
            run.schedule.step(context)?
        };
        self.fraction = self.fraction.max(run.schedule.fraction());
        if ended {
            self.settle(None);
            self.measure();
        }
        Ok(self.taken(phase))
    }

    /// Report of a step.
    fn taken(&self, phase: Option<Phase>) -> Step {
        Step { phase, loss: self.loss, fraction: self.fraction(), done: self.is_done() }
    }

    /// Continues an estimate that stopped early, if the budget now allows it. Returns whether a step remains.
    pub fn extend(&mut self, meter: &Meter) -> bool {
        let allowed = match self.early_stop {
            None => false,
            Some(EarlyStop::Budget) => !meter.exhausted(1.0),
            Some(EarlyStop::Invisible) => {
                !meter.budget.stop_when_invisible && !meter.exhausted(1.0)
            }
        };
        if allowed {
            self.early_stop = None;
            self.begin();
        }
        !self.is_done()
    }
}
