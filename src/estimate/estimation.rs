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
use super::schedule::{
    LightsKnown, Part, Phase, Position, Row, Situation, cost, latent_cost, rounds_left, rows,
};
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

/// The part in progress. One that has not begun needs nothing.
pub(crate) enum Work {
    Pending,
    Maps(Solver),
    Widths(Box<WidthTrials>),
    Lights(Box<LightFit>),
    Classes(Box<ClassTrials>),
    Baseline(Baseline),
}

/// An estimate of all photographs so far, in steps.
pub(crate) struct Estimation {
    pub(super) networks: Arc<Networks>,
    pub(super) options: EstimateOptions,
    /// Noise expected of photographs whose calibration shows none.
    pub(super) least_noise: NoiseOptions,
    pub(super) task: Task,
    pub(super) photographs: Photographs,
    pub(super) latent: Option<LatentFit>,
    /// From the end of the latent fit to that of the schedule.
    pub(super) belief: Option<Belief>,
    /// The latest finished maps; `None` from the end of the latent fit to that of the schedule.
    pub(super) maps: Option<Svbrdf>,
    /// `None` where nothing is left to do.
    pub(super) position: Option<Position>,
    pub(super) work: Work,
    pub(super) loss: f32,
    pub(super) fraction: f32,
    /// What ended it before its time.
    pub(super) cut: Option<Cut>,
    /// The correction of the lights when the latent fit ended.
    pub(super) lights_before: Correction,
    /// Whether the latent code was fitted anew with these photographs' corrected lights.
    pub(super) repeated: bool,
    /// Whether the structured prior was chosen for these photographs.
    pub(super) structured: bool,
    /// Mean of absolute log residuals that texels leave which share their gloss; 0 where not known.
    pub(super) texel_residual: f32,
    /// The latent fit's maps before its latest step, and losses of the maps.
    pub(super) previous: Option<Shown>,
    pub(super) trend: Option<Trend>,
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
            belief: None,
            maps: None,
            position: None,
            work: Work::Pending,
            loss: 0.0,
            fraction: 0.0,
            cut: None,
            lights_before: Correction::default(),
            repeated: false,
            structured: false,
            texel_residual: 0.0,
            previous: None,
            trend: None,
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
        self.position.is_none()
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
        self.leave();
        for (index, observation) in replaced {
            self.photographs.replace(index, observation)?;
        }
        if let Some(start) = start {
            self.maps = Some(start.clone());
        }
        if self.maps.is_none() {
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
            if let Some(latent) = &mut self.latent {
                latent.add_photograph()?;
            }
        }
        (self.cut, self.repeated, self.fraction) = (None, false, 0.0);
        (self.structured, self.record) = (false, None);
        self.go_to(Position::default());
        self.measure();
        Ok(())
    }

    fn begin_latent(&self, start: &Svbrdf) -> Result<LatentFit> {
        let first = self.photographs.averaged().first().ok_or(Error::NoMaps)?;
        let size = [first.width(), first.height()];
        let EstimateOptions { latent, gains, .. } = &self.options;
        LatentFit::new(self.networks.clone(), start, size, latent, gains)
    }

    /// Begins anew with the photographs as they are now.
    fn restart(&mut self) -> Result<()> {
        let Some(first) = self.photographs.full().first() else { return Ok(()) };
        let start = first_maps(&self.networks, first)?;
        if self.latent.is_some() {
            let mut latent = self.begin_latent(&start)?;
            for _ in 0..self.photographs.len() {
                latent.add_photograph()?;
            }
            self.latent = Some(latent);
        }
        self.maps = Some(start);
        Ok(())
    }

    /// Ends what is in progress: its maps are the latest.
    fn leave(&mut self) {
        if let Some(Belief { maps, .. }) = self.belief.take() {
            self.maps = Some(match self.full_size(&maps) {
                Cow::Owned(larger) => larger,
                Cow::Borrowed(_) => maps,
            });
        }
        (self.work, self.position) = (Work::Pending, None);
        (self.previous, self.trend) = (None, None);
    }

    fn end(&mut self, cut: Option<Cut>) {
        self.cut = self.cut.or(cut);
        self.leave();
    }

    pub(super) fn measure(&mut self) {
        let maps = self.belief.as_ref().map(|belief| &belief.maps).or(self.maps.as_ref());
        if let Some(maps) = maps {
            self.loss = render::loss(maps, self.photographs.like(maps).full()) as f32;
        }
    }

    /// Begins a belief round the maps of the latent code.
    pub(super) fn begin_belief(&mut self) {
        self.lights_before = self.photographs.correction().clone();
        let maps = self.latent.as_ref().map(|latent| latent.maps().clone());
        self.belief = maps.map(|maps| Belief::new(maps, &self.options));
        self.maps = None;
    }

    /// Maps in work at the photographs' resolution.
    pub(super) fn full_size<'a>(&self, maps: &'a Svbrdf) -> Cow<'a, Svbrdf> {
        match self.photographs.full().first() {
            Some(full) if maps.width() < full.width() => {
                Cow::Owned(interpolated(maps, self.photographs.thinning()))
            }
            _ => Cow::Borrowed(maps),
        }
    }

    /// The maps as they are now.
    ///
    /// # Errors
    /// Without photographs.
    pub fn maps(&self) -> Result<Svbrdf> {
        match (&self.belief, &self.latent, self.position) {
            (Some(belief), ..) => Ok(self.full_size(&belief.maps).into_owned()),
            (None, Some(latent), Some(_)) => Ok(self.full_size(latent.maps()).into_owned()),
            _ => self.maps.clone().ok_or(Error::NoMaps),
        }
    }

    /// The schedule for the photographs so far.
    pub(super) fn rows(&self) -> Vec<Row> {
        let baseline = Row::new(Phase::Baseline, 1, 0, 0);
        let (photographs, Task { method, refine, .. }) = (self.photographs.len(), self.task);
        match method {
            Method::Classic => vec![baseline],
            Method::Deep => {
                let situation = Situation {
                    photographs,
                    lights: self.lights_known(),
                    structured: self.structured,
                    coarse: self.photographs.thinning() > 0,
                };
                let mut rows = rows(&situation, &self.options);
                rows.truncate(if refine { rows.len() } else { 1 });
                rows
            }
        }
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

    /// Goes to the first part at or after a position that has work.
    pub(super) fn go_to(&mut self, position: Position) {
        self.position = position.settled(&self.rows());
        (self.work, self.previous, self.trend) = (Work::Pending, None, None);
    }

    /// One step, counted on the meter where it is an optimiser's.
    ///
    /// # Errors
    /// When a network is broken or a loss is not finite.
    pub fn step(&mut self, meter: &mut Meter) -> Result<Step> {
        let mut phase = None;
        if let Some(at) = self.position {
            let rows = self.rows();
            let row = rows[at.row];
            phase = Some(if at.part == Part::Phase { row.phase } else { Phase::Maps });
            let ended = if row.phase != Phase::Latent && meter.exhausted(1.0) {
                self.end(Some(Cut::Budget));
                false
            } else {
                match at.part {
                    Part::Before => self.maps_step(row.before, meter)?,
                    Part::Phase => self.phase_step(row.phase, meter)?,
                    Part::After => self.maps_step(row.after, meter)?,
                }
            };
            // A phase may have gone elsewhere already.
            if ended && self.position == Some(at) {
                self.go_to(at.following(&row));
            }
            if ended && self.position.is_none() {
                self.finish(meter)?;
            }
        }
        self.fraction = if self.is_done() { 1.0 } else { self.fraction.max(self.fraction_done()) };
        Ok(Step { phase, loss: self.loss, fraction: self.fraction, done: self.is_done() })
    }

    /// Fraction of the work that is done, by what its parts cost.
    fn fraction_done(&self) -> f32 {
        let Some(at) = self.position else { return 1.0 };
        let (rows, photographs) = (self.rows(), self.photographs.len());
        let seen = photographs.min(self.options.schedule.photographs);
        let all = self.photographs.full().first().map_or(0, Observation::texels);
        let halvings = match self.task.method {
            Method::Deep => self.photographs.thinning(),
            Method::Classic => 0,
        };
        let texels = [all >> (2 * halvings), all];
        let [mut done, all] = self
            .latent
            .as_ref()
            .map_or([0.0; 2], |latent| latent_cost(latent.work(), latent.maps().texels(), seen));
        let mut left = all - done;
        for (i, row) in rows.iter().enumerate() {
            // The last steps see all photographs.
            let seen = if i + 1 < rows.len() { seen } else { photographs };
            let part = |part| cost(row, part, seen, texels, &self.options);
            let parts = [Part::Before, Part::Phase, Part::After];
            let round: f32 = parts.iter().map(|p| part(*p)).sum();
            match i.cmp(&at.row) {
                std::cmp::Ordering::Less => done += rounds_left(row, 0) * round,
                std::cmp::Ordering::Greater => left += rounds_left(row, 0) * round,
                std::cmp::Ordering::Equal => {
                    let before = parts.iter().take_while(|p| **p != at.part).map(|p| part(*p));
                    let here = before.sum::<f32>() + self.part_done(row, at.part) * part(at.part);
                    done += at.round as f32 * round + here;
                    left += round - here + rounds_left(row, at.round + 1) * round;
                }
            }
        }
        // What lights have misled is done twice.
        let total = done + left;
        if self.repeated {
            done += total;
        } else if self.is_misled() {
            left += total;
        }
        done / (done + left).max(f32::MIN_POSITIVE)
    }

    /// Fraction of a part that is done.
    fn part_done(&self, row: &Row, part: Part) -> f32 {
        let [done, all] = match &self.work {
            Work::Pending => [0, 1],
            Work::Maps(solver) => {
                let all = if part == Part::Before { row.before } else { row.after };
                [solver.state.steps, all]
            }
            Work::Widths(trials) => trials.work(),
            Work::Lights(fit) => fit.work(),
            Work::Classes(trials) => [trials.costs.len(), trials.count()],
            Work::Baseline(baseline) => [baseline.steps(), self.options.baseline.steps],
        };
        (done as f32 / all.max(1) as f32).min(1.0)
    }

    /// Whether lights have misled the latent fit.
    fn is_misled(&self) -> bool {
        let EstimateOptions { lights, schedule, .. } = &self.options;
        self.photographs.correction().misled(&self.lights_before, lights, schedule)
    }

    /// After the last part: the latent code is fitted once more where lights have misled it.
    fn finish(&mut self, meter: &Meter) -> Result<()> {
        let misled = self.is_misled();
        self.end(None);
        match &mut self.latent {
            Some(latent) if misled && !self.repeated && !meter.exhausted(1.0) => {
                latent.begin_again()?;
                self.repeated = true;
                self.go_to(Position::default());
            }
            _ if self.task.method == Method::Classic => self.measure(),
            _ => {}
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
        (self.cut, self.fraction, self.structured) = (None, 0.0, false);
        self.go_to(Position::default());
        if self.latent.as_ref().is_some_and(LatentFit::is_settled) {
            self.go_to(Position::default().next_row());
            if self.position.is_some() {
                self.begin_belief();
            }
        }
        !self.is_done()
    }
}
