//! The plan of a fit: first maps, latent code, per-texel refinement.

use std::ops::ControlFlow;
use std::sync::Arc;

use super::board::Update;
use super::{Method, Settings};
use crate::classic;
use crate::initial_estimate::Networks;
use crate::latent_fit::{FitOptions, LatentFit};
use crate::observation::Observation;
use crate::propagation::propagate;
use crate::refinement::{self, Prior};
use crate::render;
use crate::{Error, Result, Svbrdf};

/// Maps of the first photograph at its own resolution, before any optimisation.
pub(super) fn first_maps(networks: &Networks, observation: &Observation) -> Result<Svbrdf> {
    let mut maps = networks.photo_maps(observation)?;
    while maps.width() < observation.width {
        maps = maps.upsampled();
    }
    maps.clamp();
    Ok(maps)
}

/// What a step did.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Mean log-L1 over all photographs.
    pub(super) loss: f32,
    /// Share of the work on the photographs so far that is done.
    pub(super) fraction: f32,
    /// Nothing is left to do until a photograph is added.
    pub(super) done: bool,
}

/// Share of a deep fit's time that the latent code takes.
const LATENT_SHARE: f32 = 0.8;

/// A fit to all photographs so far, in steps.
pub(super) struct Fit {
    networks: Arc<Networks>,
    method: Method,
    refine: bool,
    observations: Vec<Observation>,
    start: Option<Arc<Svbrdf>>,
    latent: Option<LatentFit>,
    stage: Stage,
    /// The latest finished maps at full resolution.
    maps: Option<Svbrdf>,
    loss: f32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Latent,
    Refine,
    Classic,
    Done,
}

impl Fit {
    /// Without photographs.
    pub(super) fn new(networks: Arc<Networks>, settings: &Settings) -> Self {
        Self {
            networks,
            method: settings.method,
            refine: settings.refine,
            observations: Vec::new(),
            start: None,
            latent: None,
            stage: Stage::Done,
            maps: None,
            loss: 0.0,
        }
    }

    /// Adds a photograph; the first brings the maps to start from. `updates` better what is
    /// known of earlier ones.
    pub(super) fn add(
        &mut self,
        observation: Observation,
        start: Option<Arc<Svbrdf>>,
        updates: &[Update],
    ) -> Result<()> {
        for update in updates {
            if let Some(earlier) = self.observations.get_mut(update.index()) {
                update.apply(earlier);
            }
        }
        self.observations.push(observation.clone());
        if let Some(start) = start {
            self.maps = Some(Svbrdf::clone(&start));
            self.start = Some(start);
        }
        let start = self.start.as_ref().ok_or(Error::NoMaps)?;
        self.stage = match self.method {
            Method::Classic => Stage::Classic,
            Method::Deep => {
                match &mut self.latent {
                    None => {
                        self.latent = Some(LatentFit::new(
                            self.networks.clone(),
                            start,
                            observation,
                            FitOptions::default(),
                        )?);
                    }
                    Some(latent) if updates.is_empty() => latent.add_observation(observation)?,
                    Some(latent) => latent.set_observations(self.observations.iter().cloned())?,
                }
                Stage::Latent
            }
        };
        if let Some(maps) = &self.maps {
            self.loss = render::loss(maps, &self.observations) as f32;
        }
        Ok(())
    }

    /// Mean log-L1 over all photographs.
    pub(super) fn loss(&self) -> f32 {
        self.loss
    }

    /// The maps as they are now.
    pub(super) fn maps(&self) -> Result<Svbrdf> {
        match (&self.latent, self.stage) {
            (Some(latent), Stage::Latent) => Ok(latent.maps()),
            _ => self.maps.clone().ok_or(Error::NoMaps),
        }
    }
}

impl Fit {
    /// One step. `go_on` is asked inside long steps and ends them early.
    pub(super) fn step(&mut self, go_on: &dyn Fn() -> bool) -> Result<Step> {
        let mut after = |_: usize, _: f64| {
            if go_on() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let mut fraction = 1.0;
        match self.stage {
            Stage::Latent => {
                let latent = self.latent.as_mut().ok_or(Error::NoMaps)?;
                let report = latent.step()?;
                self.loss = report.loss as f32;
                fraction = report.fraction;
                if report.settled {
                    let maps = latent.maps();
                    self.loss = render::loss(&maps, &self.observations) as f32;
                    self.maps = Some(maps);
                    self.stage = if self.refine { Stage::Refine } else { Stage::Done };
                }
                if self.refine {
                    fraction *= LATENT_SHARE;
                }
            }
            Stage::Refine => {
                let maps = self.maps.as_mut().ok_or(Error::NoMaps)?;
                propagate(maps, &self.observations)?;
                let deep = maps.clone();
                let options = refinement::Options::default();
                let report = refinement::refine(
                    maps,
                    &deep,
                    &Prior::default(),
                    &self.observations,
                    &options,
                    &mut after,
                )?;
                self.loss = report.loss_after as f32;
                self.stage = Stage::Done;
            }
            Stage::Classic => {
                let maps = self.maps.as_mut().ok_or(Error::NoMaps)?;
                let options = classic::Options::default();
                let report = classic::fit(maps, &self.observations, &options, &mut after)?;
                self.loss = report.loss_after as f32;
                self.stage = Stage::Done;
            }
            Stage::Done => {}
        }
        Ok(Step { loss: self.loss, fraction, done: self.stage == Stage::Done })
    }
}
