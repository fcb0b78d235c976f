//! The plan of a fit: first maps, latent code, per-texel refinement.

use std::ops::ControlFlow;
use std::sync::Arc;

use super::board::Update;
use super::budget::{LATENT_BUDGET, LATENT_WORK, Meter, Shown, Trend, predicted_change};
use super::{Method, Settings};
use crate::classic;
use crate::completion::Incomplete;
use crate::initial_estimate::Networks;
use crate::latent_fit::{FitOptions, LatentFit};
use crate::light_refinement::{
    self, Correction, LEAST_PHOTOGRAPHS, LEAST_TO_TURN, Offset, refine_lights,
};
use crate::observation::{Observation, View};
use crate::propagation::{choose_glosses, propagate, propagate_corrections, propagate_slopes};
use crate::refinement::{self, Prior};
use crate::render;
use crate::{Error, Result, Svbrdf};

/// Maps of the first photograph at its own resolution, before any optimisation.
pub(super) fn first_maps(networks: &Networks, observation: &Observation) -> Result<Svbrdf> {
    let mut maps = networks.photo_maps(observation)?;
    while maps.width() < observation.width() {
        maps = maps.upsampled();
    }
    maps.clamp();
    Ok(maps)
}

/// Corrections at most: of what a board's photographs mirror of the room, or of the ambient light
/// alone, then of lights and ambient light.
const SURROUND_ROUNDS: usize = 2;
const AMBIENT_ROUNDS: usize = 4;
const LIGHT_ROUNDS: usize = 4;
/// Steps of the refinement before a correction.
const STEPS_BEFORE_CORRECTION: usize = 4;
/// Photographs from which on slopes are told to texels alike after a refinement of so many steps,
/// so many follow. In one photograph a slope looks like a darker colour.
const LEAST_TO_TELL_SLOPES: usize = 2;
const STEPS_BEFORE_SLOPES: usize = 6;
const STEPS_AFTER_SLOPES: usize = 4;
/// Photographs from which on kinds of gloss compete for the texels as well, before the steps that
/// follow, which are so many then. Fewer photographs do not tell the kinds apart.
const LEAST_TO_CHOOSE: usize = 3;
const STEPS_AFTER_CHOICE: usize = 2;
/// Photographs from which on what the refinement has found is told to texels alike, for another
/// refinement of so many steps, and how often. Fewer photographs' corrections are too uncertain.
const LEAST_TO_TELL: usize = 5;
const TELLING_ROUNDS: usize = 2;
const STEPS_AFTER_TELLING: usize = 4;
/// Steps after the network has completed what photographs leave open.
const STEPS_AFTER_COMPLETION: usize = 4;
/// Radiance of ambient light, white paper under the flash being 1, from which on a smooth sample
/// shows that a surround is not uniform.
const LEAST_SURROUND: f32 = 0.01;
/// Change of a light, in units of its expected error, that is worth another refinement.
const LIGHT_TOLERANCE: f64 = 0.02;
/// Change of a light, in units of its expected error, by which the latent fit before was led astray.
const MISLEADING: f64 = 0.4;

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

/// A photograph for the fit; the first one brings the maps to start from. `updates` better what is
/// known of earlier ones.
pub(super) struct NewFrame {
    pub(super) observation: Observation,
    pub(super) start: Option<Arc<Svbrdf>>,
    pub(super) updates: Vec<Update>,
    /// Earlier ones lie so far elsewhere now that the maps so far are no start any more.
    pub(super) restart: bool,
}

/// How a refinement ended.
#[derive(Debug, Clone, Copy, Default)]
struct Ended {
    loss: f32,
    /// As wide as the material has shown.
    prior: Prior,
    noise: f32,
    /// By the caller.
    stopped: bool,
    cut: Option<Cut>,
}

impl Ended {
    /// Ends what would follow where the budget has come to its end.
    fn checked(mut self, meter: &Meter) -> Self {
        if !self.stopped && meter.exhausted(1.0) {
            self.cut = Some(Cut::Budget);
        }
        self
    }

    /// Whether another may follow. That little more of the loss is to be gained does not mean that
    /// other gloss would not be seen.
    fn goes_on(&self) -> bool {
        !self.stopped && self.cut != Some(Cut::Budget)
    }
}

/// A fit to all photographs so far, in steps.
pub(super) struct Fit {
    pub(super) networks: Arc<Networks>,
    pub(super) method: Method,
    refine: bool,
    pub(super) observations: Vec<Observation>,
    /// Whether lights are only roughly known: they and ambient light are corrected.
    pub(super) free_lights: bool,
    /// Views of the observations before their correction.
    pub(super) given: Vec<View>,
    pub(super) correction: Correction,
    pub(super) latent: Option<LatentFit>,
    pub(super) stage: Stage,
    /// The latest finished maps at full resolution.
    pub(super) maps: Option<Svbrdf>,
    /// Whether what the refinement begins with was done to these already.
    pub(super) propagated: bool,
    pub(super) loss: f32,
    /// What ended the fit before its time.
    pub(super) cut: Option<Cut>,
    /// Steps of the latent fit at its present level since the latest photograph, and its maps
    /// before the latest.
    pub(super) steps_at_level: u32,
    previous: Option<Shown>,
    /// Whether the latent code was fitted anew with these photographs' corrected lights.
    relit: bool,
    /// Whether to keep what the latest completion began with.
    pub(super) keep_incomplete: bool,
    pub(super) incomplete: Option<Incomplete>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    Latent,
    Refine,
    Classic,
    Done,
}

/// Why a fit ended early.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cut {
    /// Time or steps were used up.
    Budget,
    /// What was left could not be seen.
    Invisible,
}

impl Fit {
    /// Without photographs.
    pub(super) fn new(networks: Arc<Networks>, settings: &Settings) -> Self {
        Self {
            networks,
            method: settings.method,
            refine: settings.refine,
            observations: Vec::new(),
            free_lights: false,
            given: Vec::new(),
            correction: Correction::default(),
            latent: None,
            stage: Stage::Done,
            maps: None,
            propagated: false,
            loss: 0.0,
            cut: None,
            steps_at_level: 0,
            previous: None,
            relit: false,
            keep_incomplete: false,
            incomplete: None,
        }
    }

    /// Photographs added.
    pub(super) fn frames(&self) -> usize {
        self.observations.len()
    }

    /// Whether nothing is left to do until a photograph is added.
    pub(super) fn is_done(&self) -> bool {
        self.stage == Stage::Done
    }

    /// Adds a photograph.
    pub(super) fn add(&mut self, frame: NewFrame) -> Result<()> {
        let NewFrame { mut observation, start, updates, restart } = frame;
        (self.cut, self.steps_at_level, self.previous, self.relit) = (None, 0, None, false);
        for update in &updates {
            let index = update.index();
            let earlier = self.observations.get_mut(index).zip(self.given.get_mut(index));
            if let Some((earlier, given)) = earlier {
                earlier.view = *given;
                update.apply(earlier);
                *given = earlier.view;
                earlier.view = self.correction.apply(given, index);
            }
        }
        self.given.push(observation.view);
        observation.view = self.correction.apply(&observation.view, self.observations.len());
        if let Some(start) = &start {
            self.maps = Some(Svbrdf::clone(start));
        }
        if self.maps.is_none() {
            return Err(Error::NoMaps);
        }
        if restart {
            self.restart()?;
        }
        self.stage = match self.method {
            Method::Classic => Stage::Classic,
            Method::Deep => {
                match &mut self.latent {
                    None => {
                        let start = start.ok_or(Error::NoMaps)?;
                        let options = FitOptions::default();
                        let networks = self.networks.clone();
                        self.latent =
                            Some(LatentFit::new(networks, &start, &observation, options)?);
                    }
                    Some(latent) => {
                        if !updates.is_empty() && !restart {
                            latent.set_observations(&self.observations)?;
                        }
                        latent.add_observation(&observation)?;
                    }
                }
                Stage::Latent
            }
        };
        self.observations.push(observation);
        if let Some(maps) = &self.maps {
            self.loss = render::loss(maps, &self.observations) as f32;
        }
        Ok(())
    }

    /// Begins anew with the photographs as they are now.
    fn restart(&mut self) -> Result<()> {
        let Some(first) = self.observations.first() else { return Ok(()) };
        let start = first_maps(&self.networks, first)?;
        if self.latent.is_some() {
            let (networks, options) = (self.networks.clone(), FitOptions::default());
            let mut latent = LatentFit::new(networks, &start, first, options)?;
            for observation in &self.observations[1..] {
                latent.add_observation(observation)?;
            }
            self.latent = Some(latent);
        }
        (self.maps, self.propagated) = (Some(start), false);
        Ok(())
    }

    /// Brings the maps up to the latest step.
    pub(super) fn refresh(&mut self) -> Result<()> {
        self.latent.as_mut().map_or(Ok(()), LatentFit::refresh)
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
    /// One step. `between` is asked inside long steps and ends them early.
    pub(super) fn step(
        &mut self,
        meter: &mut Meter,
        between: &mut dyn FnMut(&Self, &mut Meter) -> bool,
    ) -> Result<Step> {
        let mut fraction = 1.0;
        match self.stage {
            Stage::Latent => fraction = self.latent_step(meter)?,
            Stage::Refine if meter.exhausted(1.0) => self.end(Some(Cut::Budget)),
            Stage::Refine => {
                self.refine(meter, between)?;
                fraction = if self.is_done() { 1.0 } else { 0.0 };
            }
            Stage::Classic => self.classic(meter, between)?,
            Stage::Done => {}
        }
        if self.relit {
            // The second fit is not foreseen in the first one's share.
            fraction = LATENT_WORK + (1.0 - LATENT_WORK) * fraction;
        }
        Ok(Step { loss: self.loss, fraction, done: self.is_done() })
    }

    /// Goes on with a fit that was cut short, if the budget allows it now; whether there is
    /// something to do.
    pub(super) fn extend(&mut self, meter: &Meter) -> bool {
        let allowed = match self.cut {
            None => false,
            Some(Cut::Budget) => !meter.exhausted(1.0),
            Some(Cut::Invisible) => !meter.budget.stop_when_invisible && !meter.exhausted(1.0),
        };
        if !allowed {
            return false;
        }
        self.cut = None;
        self.stage = match &self.latent {
            None => Stage::Classic,
            Some(latent) if !latent.is_settled() => Stage::Latent,
            Some(latent) => {
                (self.maps, self.propagated) = (Some(latent.maps()), false);
                if self.refine { Stage::Refine } else { Stage::Done }
            }
        };
        !self.is_done()
    }

    fn end(&mut self, cut: Option<Cut>) {
        self.cut = self.cut.or(cut);
        self.stage = Stage::Done;
    }

    /// A step of the latent fit; the share of all work that is done.
    fn latent_step(&mut self, meter: &mut Meter) -> Result<f32> {
        let share = if self.refine { LATENT_BUDGET } else { 1.0 };
        let latent = self.latent.as_mut().ok_or(Error::NoMaps)?;
        let (mut settled, mut fraction) = (true, 1.0);
        if meter.exhausted(share) {
            latent.refresh()?;
            self.cut = Some(Cut::Budget);
        } else {
            let level = latent.coarse_maps().width();
            let report = latent.step()?;
            meter.count();
            self.loss = report.loss as f32;
            (settled, fraction) = (report.settled, report.fraction);
            self.steps_at_level += 1;
            if latent.coarse_maps().width() != level {
                (self.steps_at_level, self.previous) = (0, None);
            } else if meter.budget.stop_when_invisible && !settled && self.is_still() {
                settled = true;
                self.cut = Some(Cut::Invisible);
                let latent = self.latent.as_mut().ok_or(Error::NoMaps)?;
                latent.refresh()?;
                latent.count_as_fitted();
            }
        }
        if settled {
            fraction = 1.0;
            let maps = self.latent.as_ref().ok_or(Error::NoMaps)?.maps();
            self.loss = render::loss(&maps, &self.observations) as f32;
            (self.maps, self.propagated, self.previous) = (Some(maps), false, None);
            self.stage = if self.refine { Stage::Refine } else { Stage::Done };
        }
        Ok(if self.refine { fraction * LATENT_WORK } else { fraction })
    }

    /// Whether nothing visible is left to do for the latent fit: on its finest level.
    fn is_still(&mut self) -> bool {
        let Some(latent) = &self.latent else { return false };
        let Some(steps) = latent.steps_at_finest() else { return false };
        let now = Shown::of(latent.coarse_maps());
        let change = self.previous.as_ref().map(|before| now.visible_change(before));
        self.previous = Some(now);
        change.is_some_and(|c| predicted_change(c, self.steps_at_level, steps as u32) < 1.0)
    }

    fn refine(
        &mut self,
        meter: &mut Meter,
        between: &mut dyn FnMut(&Self, &mut Meter) -> bool,
    ) -> Result<()> {
        let mut maps = self.maps.take().ok_or(Error::NoMaps)?;
        if !self.propagated {
            propagate(&mut maps, &self.observations)?;
        }
        // What is saved meanwhile is the state before.
        (self.maps, self.propagated) = (Some(maps.clone()), true);
        let tells = self.observations.len() >= LEAST_TO_TELL_SLOPES;
        let steps = if tells { STEPS_BEFORE_SLOPES } else { refinement::Options::default().steps };
        let corrects = (self.free_lights || self.sees_surround())
            && self.observations.len() >= LEAST_PHOTOGRAPHS;
        let turns = self.free_lights && self.observations.len() >= LEAST_TO_TURN;
        let held = if self.free_lights { AMBIENT_ROUNDS } else { SURROUND_ROUNDS };
        let rounds = held + if turns { LIGHT_ROUNDS } else { 0 };
        let mut corrections = 0..if corrects { rounds } else { 0 };
        let mut offset = Offset::default();
        let given = self.correction.clone();
        let ended = loop {
            let next = corrections.next();
            let steps = if next.is_some() { STEPS_BEFORE_CORRECTION } else { steps };
            let deep = self.maps.as_ref().ok_or(Error::NoMaps)?;
            let mean = offset.applied(deep);
            let mut ended = self.refine_once(&mut maps, &mean, steps, meter, between)?;
            self.loss = ended.loss;
            let Some(round) = next else { break ended };
            ended = ended.checked(meter);
            // little left to see here does not mean that the lights are right
            if !ended.goes_on() {
                break ended;
            }
            let turn = round >= held;
            let moved = self.correct_lights(&maps, turn, &ended.prior, &mut offset);
            if moved {
                // narrow lobes do not find back from where wrong lights took them
                let deep = self.maps.as_ref().ok_or(Error::NoMaps)?;
                maps = offset.applied(deep).into_owned();
            } else {
                // nothing to correct: on to turning, or to the end
                corrections = if turn { 0..0 } else { held..rounds };
            }
        };
        let mut cut = ended.cut;
        if tells {
            cut = self.tell(&mut maps, &offset, ended, meter, between)?;
        }
        (self.maps, self.propagated) = (Some(maps), false);
        // the room leads lobes astray less than a light: another latent fit gains nothing
        let given = Correction { mirrored: self.correction.mirrored.clone(), ..given };
        let moved = self.correction.distance(&given, &light_refinement::Options::default());
        if moved > MISLEADING && !self.relit && cut != Some(Cut::Budget) {
            self.latent.as_mut().ok_or(Error::NoMaps)?.set_observations(&self.observations)?;
            (self.stage, self.relit) = (Stage::Latent, true);
            (self.steps_at_level, self.previous) = (0, None);
        } else {
            self.end(cut);
        }
        Ok(())
    }

    /// Tells slopes to texels alike, chooses among kinds of gloss for maps as refined, tells
    /// corrections to texels alike, completes what is still open, refining after each; what ended
    /// that before its time, or the refinement before.
    fn tell(
        &mut self,
        maps: &mut Svbrdf,
        offset: &Offset,
        before: Ended,
        meter: &mut Meter,
        between: &mut dyn FnMut(&Self, &mut Meter) -> bool,
    ) -> Result<Option<Cut>> {
        let mut ended = before.checked(meter);
        let mut cut = ended.cut;
        if !ended.goes_on() {
            return Ok(cut);
        }
        let mut mean = offset.applied(self.maps.as_ref().ok_or(Error::NoMaps)?).into_owned();
        propagate_slopes(&mut mean, maps, &self.observations, &ended.prior)?;
        let chooses = self.observations.len() >= LEAST_TO_CHOOSE;
        let mut go_on = || between(self, meter);
        if chooses && !choose_glosses(&mut mean, maps, &self.observations, &mut go_on)? {
            return Ok(cut);
        }
        let steps = if chooses { STEPS_AFTER_CHOICE } else { STEPS_AFTER_SLOPES };
        ended = self.refine_once(maps, &mean, steps, meter, between)?;
        let tells = self.observations.len() >= LEAST_TO_TELL;
        let rounds = if tells { TELLING_ROUNDS } else { 0 };
        for _ in 0..rounds {
            (self.loss, ended) = (ended.loss, ended.checked(meter));
            cut = ended.cut.or(cut);
            if !ended.goes_on() {
                return Ok(cut);
            }
            propagate_corrections(&mut mean, maps, &self.observations)?;
            ended = self.refine_once(maps, &mean, STEPS_AFTER_TELLING, meter, between)?;
        }
        (self.loss, ended) = (ended.loss, ended.checked(meter));
        cut = ended.cut.or(cut);
        if !ended.goes_on() {
            return Ok(cut);
        }
        let estimate = offset.applied(self.maps.as_ref().ok_or(Error::NoMaps)?);
        let incomplete = Incomplete::new(&estimate, &mean, maps, &self.observations, &ended.prior)?;
        drop(estimate);
        let prior = incomplete.narrowed_prior(&mean, maps, ended.noise);
        incomplete.complete(&self.networks, &mut mean, maps)?;
        if self.keep_incomplete {
            self.incomplete = Some(incomplete);
        }
        ended = self.refine_with(&prior, maps, &mean, STEPS_AFTER_COMPLETION, meter, between)?;
        self.loss = ended.loss;
        Ok(ended.cut.or(cut))
    }

    /// Refines maps around `mean`.
    fn refine_once(
        &self,
        maps: &mut Svbrdf,
        mean: &Svbrdf,
        steps: usize,
        meter: &mut Meter,
        between: &mut dyn FnMut(&Self, &mut Meter) -> bool,
    ) -> Result<Ended> {
        self.refine_with(&Prior::default(), maps, mean, steps, meter, between)
    }

    /// As [`Fit::refine_once`], with another prior.
    fn refine_with(
        &self,
        prior: &Prior,
        maps: &mut Svbrdf,
        mean: &Svbrdf,
        steps: usize,
        meter: &mut Meter,
        between: &mut dyn FnMut(&Self, &mut Meter) -> bool,
    ) -> Result<Ended> {
        let options = refinement::Options { steps, ..Default::default() };
        let mut trend = Trend::new(steps, 1);
        let mut ended = Ended::default();
        let mut after = |step: usize, loss: f64| {
            ended.stopped |= !between(self, meter);
            ended.cut = after_step(meter, &mut trend, step, steps, loss);
            if !ended.stopped && ended.cut.is_none() {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            }
        };
        let observations = &self.observations;
        let report = refinement::refine(maps, mean, prior, observations, &options, &mut after)?;
        ended.loss = report.loss_after as f32;
        (ended.prior, ended.noise) = (report.prior, report.mean_noise());
        Ok(ended)
    }

    /// Whether ambient light is known to be there that a smooth sample would mirror.
    fn sees_surround(&self) -> bool {
        !self.free_lights && self.given.iter().any(|view| view.ambient[1] > LEAST_SURROUND)
    }

    /// Corrects lights for maps; whether that was worth another refinement.
    fn correct_lights(
        &mut self,
        maps: &Svbrdf,
        turn: bool,
        prior: &Prior,
        offset: &mut Offset,
    ) -> bool {
        let options = light_refinement::Options {
            turn,
            ambient: self.free_lights,
            mirror: self.sees_surround(),
            prior: *prior,
            ..Default::default()
        };
        let before = self.correction.clone();
        let views = &self.given;
        let Some(deep) = &self.maps else { return false };
        let correction = &mut self.correction;
        let observations = &self.observations;
        if !refine_lights(maps, deep, observations, views, &options, correction, offset) {
            return false;
        }
        for (i, (observation, given)) in self.observations.iter_mut().zip(views).enumerate() {
            observation.view = self.correction.apply(given, i);
        }
        if !self.free_lights {
            // With lights that a board tells the estimate is right as a whole: the offset takes up
            // what the model cannot say.
            *offset = Offset::default();
        }
        if let Some(latent) = &mut self.latent {
            latent.set_views(self.observations.iter().map(|o| o.view));
        }
        self.correction.distance(&before, &options) > LIGHT_TOLERANCE
    }

    fn classic(
        &mut self,
        meter: &mut Meter,
        between: &mut dyn FnMut(&Self, &mut Meter) -> bool,
    ) -> Result<()> {
        let mut maps = self.maps.clone().ok_or(Error::NoMaps)?;
        let options = classic::Options::default();
        // Adam's loss jumps about: every fiftieth is compared.
        let mut trend = Trend::new(options.steps, 50);
        let mut cut = None;
        let this = &*self;
        let mut after = |step: usize, loss: f64| {
            let go_on = between(this, meter);
            cut = after_step(meter, &mut trend, step, options.steps, loss);
            if go_on && cut.is_none() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let report = classic::fit(&mut maps, &this.observations, &options, &mut after)?;
        self.loss = report.loss_after as f32;
        self.maps = Some(maps);
        self.end(cut);
        Ok(())
    }
}

/// Counts a step (from 1) of an optimiser that has `steps`: what ends it early, if anything.
fn after_step(
    meter: &mut Meter,
    trend: &mut Trend,
    step: usize,
    steps: usize,
    loss: f64,
) -> Option<Cut> {
    meter.count();
    if step < steps && meter.exhausted(1.0) {
        Some(Cut::Budget)
    } else if step < steps && meter.budget.stop_when_invisible && trend.is_flat(step, loss) {
        Some(Cut::Invisible)
    } else {
        None
    }
}
