//! An estimate in progress: photographs, latent code, belief, and where in the schedule it is.

use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::sync::Arc;

use super::baseline::Baseline;
use super::belief::Belief;
use super::budget::{Meter, Shown, Trend};
use super::correction::{Correction, Exposure};
use super::finer::interpolated;
use super::latent::LatentFit;
use super::lights::LightFit;
use super::options::{EstimateOptions, NoiseOptions};
use super::photographs::Photographs;
use super::schedule::{LightsKnown, Part, Phase, Position, Row, Situation, rows};
use super::solver::Solver;
use super::structured::WidthTrials;
use super::updates::{ClassTrials, FitRecord};
use crate::initial_estimate::Networks;
use crate::observation::Observation;
use crate::render;
use crate::{Error, Result, Svbrdf};

/// How maps are found from photographs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Method {
    /// Latent code of the auto-encoder, then the posterior of every texel.
    #[default]
    Deep,
    /// Inverse rendering directly on the maps from the same start: the baseline.
    Classic,
}

/// Maps of the first photograph at its own resolution, before any optimisation.
pub(crate) fn first_maps(networks: &Networks, observation: &Observation) -> Result<Svbrdf> {
    let mut maps = networks.photo_maps(observation)?;
    while maps.width() < observation.width() {
        maps = maps.upsampled();
    }
    maps.clamp();
    Ok(maps)
}

/// What a step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// What it was a step of; `None` where nothing was left to do.
    pub phase: Option<Phase>,
    /// Mean log-L1 over all photographs.
    pub loss: f32,
    /// Fraction of the work on the photographs so far that is done; never goes back.
    pub fraction: f32,
    /// Nothing is left to do until a photograph is added.
    pub done: bool,
}

/// Why an estimate ended early.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Cut {
    /// Time or steps were used up.
    Budget,
    /// What was left could not be seen.
    Invisible,
}

/// A photograph for an estimate, and what it changes about earlier ones.
#[derive(Debug, Clone)]
pub(crate) struct Addition<I> {
    pub observation: Observation,
    /// Earlier ones rectified better, by their indices; views are as given.
    pub replaced: I,
    /// Whether these lie so far elsewhere now that the maps so far are no start any more.
    pub restart: bool,
}

impl Addition<[(usize, Observation); 0]> {
    /// One that changes nothing about others.
    pub fn new(observation: Observation) -> Self {
        Self { observation, replaced: [], restart: false }
    }
}

/// What an estimate is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Task {
    pub method: Method,
    /// Whether maps are refined after the latent fit.
    pub refine: bool,
    /// Whether lights are only roughly known: they and ambient light are corrected.
    pub free_lights: bool,
}

/// Where an estimate is, with the maps that it shows there.
pub(super) enum Stage {
    /// Nothing is left to do; no maps before the first photograph.
    Settled(Option<Svbrdf>),
    /// The latent code is fitted; its maps are shown.
    Latent {
        /// Whether this is once more, with these photographs' corrected lights.
        again: bool,
        /// The maps before the latest step.
        previous: Option<Shown>,
    },
    /// The posterior of every texel, along the schedule.
    Texels(Box<Texels>),
    /// Inverse rendering without a prior.
    Baseline { maps: Svbrdf, run: Option<(Baseline, Trend)> },
}

/// The posterior of every texel, on its way along the schedule.
pub(super) struct Texels {
    pub belief: Belief,
    pub at: Position,
    pub work: Work,
    /// The correction of the lights when the latent fit ended.
    pub lights_before: Correction,
    /// Whether the latent fit was done once more.
    pub again: bool,
}

/// The part in progress. One that has not begun needs nothing.
pub(super) enum Work {
    Pending,
    Maps(Box<Solver>, Trend),
    Widths(Box<WidthTrials>),
    Lights(Box<LightFit>),
    Classes(Box<ClassTrials>),
}

/// An estimate of all photographs so far, in steps.
pub(crate) struct Estimation {
    pub(super) networks: Arc<Networks>,
    pub(super) options: EstimateOptions,
    /// Noise expected of photographs whose calibration shows none.
    pub(super) least_noise: NoiseOptions,
    pub(super) task: Task,
    pub(super) photographs: Photographs,
    /// From the first photograph on; the baseline has none.
    pub(super) latent: Option<LatentFit>,
    pub(super) stage: Stage,
    pub(super) loss: f32,
    fraction: f32,
    /// What ended it before its time.
    pub(super) cut: Option<Cut>,
    /// Whether the structured prior was chosen for these photographs.
    pub(super) structured: bool,
    /// Mean of absolute log residuals that texels leave which share their gloss; 0 where not known.
    pub(super) texel_residual: f32,
    /// Whether to keep what the learned prior begins with.
    pub(super) keep_record: bool,
    pub(super) record: Option<FitRecord>,
}

impl Estimation {
    /// Without photographs.
    pub fn new(networks: Arc<Networks>, task: Task, options: EstimateOptions) -> Self {
        Self {
            networks,
            photographs: Self::no_photographs(&options),
            least_noise: options.noise,
            options,
            task,
            latent: None,
            stage: Stage::Settled(None),
            loss: 0.0,
            fraction: 0.0,
            cut: None,
            structured: false,
            texel_residual: 0.0,
            keep_record: false,
            record: None,
        }
    }

    /// Photographs to add to.
    pub fn no_photographs(options: &EstimateOptions) -> Photographs {
        Photographs::new().limited(options.schedule.photographs, options.schedule.texels)
    }

    /// What was found of exposure and flash.
    pub fn exposure(&self) -> &Exposure {
        &self.photographs.correction().exposure
    }

    /// The networks in use.
    pub fn networks(&self) -> &Arc<Networks> {
        &self.networks
    }

    /// Photographs added.
    pub fn frames(&self) -> usize {
        self.photographs.len()
    }

    /// Whether nothing is left to do until a photograph is added.
    pub fn is_done(&self) -> bool {
        matches!(self.stage, Stage::Settled(_))
    }

    /// Whether the budget, or that nothing was to be seen, ended it before its time.
    pub fn is_cut(&self) -> bool {
        self.cut.is_some()
    }

    /// Fraction of the work on the photographs so far that is done.
    pub fn fraction(&self) -> f32 {
        if self.is_done() { 1.0 } else { self.fraction }
    }

    /// Mean log-L1 over all photographs.
    pub fn loss(&self) -> f32 {
        self.loss
    }

    /// Adds a photograph, the first with the maps to start from.
    ///
    /// # Errors
    /// When sizes differ, the first has no start, or a network is broken.
    pub fn add(
        &mut self,
        addition: Addition<impl IntoIterator<Item = (usize, Observation)>>,
        start: Option<&Svbrdf>,
    ) -> Result<()> {
        let Addition { observation, replaced, restart } = addition;
        self.settle(None);
        for (index, observation) in replaced {
            self.photographs.replace(index, observation)?;
        }
        if let Some(start) = start {
            self.stage = Stage::Settled(Some(start.clone()));
        }
        if self.shown().is_none() {
            return Err(Error::NoMaps);
        }
        if restart {
            self.restart()?;
        }
        self.photographs.add(observation)?;
        self.set_contradictions_aside()?;
        self.texel_residual = 0.0;
        self.expect_noise();
        if self.task.method == Method::Deep {
            if self.latent.is_none() {
                let start = start.ok_or(Error::NoMaps)?;
                self.latent = Some(self.begin_latent(start)?);
            }
            if let (Some(latent), Some(added)) = (&mut self.latent, self.photographs.full().last())
            {
                latent.add_photograph(added)?;
            }
        }
        (self.cut, self.structured, self.record) = (None, false, None);
        self.measure();
        self.begin();
        Ok(())
    }

    fn begin_latent(&self, start: &Svbrdf) -> Result<LatentFit> {
        let first = self.photographs.working().full().first().ok_or(Error::NoMaps)?;
        let size = [first.width(), first.height()];
        LatentFit::new(self.networks.clone(), start, size, &self.options.latent)
    }

    /// Begins anew with the photographs as they are now.
    fn restart(&mut self) -> Result<()> {
        let Some(first) = self.photographs.full().first() else { return Ok(()) };
        let start = first_maps(&self.networks, first)?;
        if self.latent.is_some() {
            let mut latent = self.begin_latent(&start)?;
            for photograph in self.photographs.full() {
                latent.add_photograph(photograph)?;
            }
            self.latent = Some(latent);
        }
        self.stage = Stage::Settled(Some(start));
        Ok(())
    }

    /// Begins the fit of the photographs so far.
    pub(super) fn begin(&mut self) {
        self.fraction = 0.0;
        self.stage = match std::mem::replace(&mut self.stage, Stage::Settled(None)) {
            Stage::Settled(Some(maps)) if self.task.method == Method::Classic => {
                Stage::Baseline { maps, run: None }
            }
            Stage::Settled(Some(_)) => Stage::Latent { again: false, previous: None },
            stage => stage,
        };
    }

    /// Begins the schedule round the maps of the latent code.
    pub(super) fn begin_texels(&mut self, again: bool) {
        let Some(latent) = &self.latent else { return };
        self.stage = match Position::default().settled(&self.rows()) {
            Some(at) => Stage::Texels(Box::new(Texels {
                belief: Belief::new(latent.maps(), &self.options),
                at,
                work: Work::Pending,
                lights_before: self.photographs.correction().clone(),
                again,
            })),
            None => Stage::Settled(Some(self.full_size(latent.maps()))),
        };
    }

    /// Ends what is in progress, its maps being the latest.
    pub(super) fn settle(&mut self, cut: Option<Cut>) {
        self.cut = self.cut.or(cut);
        let stage = std::mem::replace(&mut self.stage, Stage::Settled(None));
        let maps = match stage {
            Stage::Settled(maps) => maps,
            Stage::Latent { .. } => self.latent.as_ref().map(LatentFit::maps),
            Stage::Texels(texels) => Some(texels.belief.maps),
            Stage::Baseline { maps, .. } => Some(maps),
        };
        self.stage = Stage::Settled(maps.map(|maps| self.full_size(maps)));
    }

    /// The maps as they are now, of the size that is worked with.
    pub(super) fn shown(&self) -> Option<Cow<'_, Svbrdf>> {
        match &self.stage {
            Stage::Settled(maps) => maps.as_ref().map(Cow::Borrowed),
            Stage::Latent { .. } => self.latent.as_ref().map(|latent| Cow::Owned(latent.maps())),
            Stage::Texels(texels) => Some(Cow::Borrowed(&texels.belief.maps)),
            Stage::Baseline { maps, .. } => Some(Cow::Borrowed(maps)),
        }
    }

    pub(super) fn measure(&mut self) {
        if let Some(maps) = self.shown() {
            self.loss = render::loss(&maps, self.photographs.like(&maps).full()) as f32;
        }
    }

    /// Maps in work at the photographs' resolution.
    pub(super) fn full_size(&self, maps: Svbrdf) -> Svbrdf {
        match self.photographs.full().first() {
            Some(full) if maps.width() < full.width() => {
                interpolated(&maps, self.photographs.thinning())
            }
            _ => maps,
        }
    }

    /// The maps as they are now.
    ///
    /// # Errors
    /// Without photographs.
    pub fn maps(&self) -> Result<Svbrdf> {
        let maps = self.shown().ok_or(Error::NoMaps)?;
        Ok(self.full_size(maps.into_owned()))
    }

    /// The schedule for the photographs so far.
    pub(super) fn rows(&self) -> Vec<Row> {
        if !self.task.refine {
            return Vec::new();
        }
        let situation = Situation {
            photographs: self.photographs.len(),
            lights: self.lights_known(),
            structured: self.structured,
            coarse: self.photographs.thinning() > 0,
        };
        rows(&situation, &self.options.schedule)
    }

    fn lights_known(&self) -> LightsKnown {
        let min = self.options.schedule.min_surround;
        if self.task.free_lights {
            LightsKnown::Roughly
        } else if self.photographs.given().iter().any(|view| view.ambient[1] > min) {
            LightsKnown::InRoom
        } else {
            LightsKnown::Well
        }
    }

    /// One step, counted on the meter where it is an optimiser's.
    ///
    /// # Errors
    /// When a network is broken or a loss is not finite.
    pub fn step(&mut self, meter: &mut Meter) -> Result<Step> {
        let is_over = meter.exhausted(1.0);
        let phase = match &self.stage {
            Stage::Settled(_) => None,
            Stage::Latent { .. } => {
                self.latent_step(meter)?;
                Some(Phase::Latent)
            }
            Stage::Texels(texels) => {
                let row = self.rows()[texels.at.row];
                let is_phase = texels.at.part == Part::Phase;
                if is_over {
                    self.settle(Some(Cut::Budget))
                } else {
                    self.texels_step(row, meter)?
                }
                Some(if is_phase { row.phase } else { Phase::Maps })
            }
            Stage::Baseline { .. } => {
                if is_over {
                    self.settle(Some(Cut::Budget))
                } else {
                    self.baseline_step(meter)?
                }
                Some(Phase::Baseline)
            }
        };
        self.fraction = if self.is_done() { 1.0 } else { self.fraction.max(self.fraction_done()) };
        Ok(Step { phase, loss: self.loss, fraction: self.fraction, done: self.is_done() })
    }

    /// Whether lights have misled the latent fit.
    pub(super) fn is_misled(&self, texels: &Texels) -> bool {
        let EstimateOptions { lights, schedule, .. } = &self.options;
        self.photographs.correction().misled(&texels.lights_before, lights, schedule)
    }

    /// After the last part: the latent code is fitted once more where lights have misled it.
    pub(super) fn finish(&mut self, meter: &Meter) -> Result<()> {
        let Stage::Texels(texels) = &self.stage else { return Ok(()) };
        let again = !texels.again && self.is_misled(texels) && !meter.exhausted(1.0);
        self.settle(None);
        if let (true, Some(latent)) = (again, &mut self.latent) {
            latent.begin_again()?;
            self.stage = Stage::Latent { again: true, previous: None };
        }
        Ok(())
    }

    /// Goes on with an estimate that was cut short, if the budget allows it now; whether there is
    /// something to do.
    pub fn extend(&mut self, meter: &Meter) -> bool {
        let allowed = match self.cut {
            None => false,
            Some(Cut::Budget) => !meter.exhausted(1.0),
            Some(Cut::Invisible) => !meter.budget.stop_when_invisible && !meter.exhausted(1.0),
        };
        if !allowed {
            return false;
        }
        (self.cut, self.structured) = (None, false);
        self.begin();
        if self.latent.as_ref().is_some_and(LatentFit::is_settled) {
            self.begin_texels(false);
        }
        !self.is_done()
    }
}
