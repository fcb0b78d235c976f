//! Steps of the phases.

use super::baseline::Baseline;
use super::belief::{Belief, Update};
use super::budget::{Meter, Shown, Trend, predicted_change};
use super::correction::{Correction, Exposure};
use super::estimation::{Cut, Estimation, Work};
use super::lights::{Free, LightFit, Start};
use super::options::EstimateOptions;
use super::photographs::Photographs;
use super::schedule::Phase;
use super::solver::Solver;
use super::structured::{self, WidthTrials};
use super::updates::{ClassTrials, FitRecord, LearnedPrior, PoolGloss, Pooling, RegressSlopes};
use crate::observation::Observation;
use crate::{Error, Result};

impl Estimation {
    /// A step of a phase; whether it has ended.
    pub(super) fn phase_step(&mut self, phase: Phase, meter: &mut Meter) -> Result<bool> {
        match phase {
            Phase::Latent => return self.latent_step(meter),
            Phase::Widths => return self.widths_step(),
            Phase::Baseline => return self.baseline_step(meter),
            Phase::HeldLights => return Ok(self.lights_step(false)),
            Phase::TurningLights => return Ok(self.lights_step(true)),
            Phase::Classes => return self.classes_step(),
            Phase::Network => self.network()?,
            Phase::PoolGloss => self.update(&PoolGloss(Pooling::new(&self.options)))?,
            Phase::Slopes => {
                let EstimateOptions { slopes, noise, .. } = self.options;
                self.update(&RegressSlopes { slopes, noise })?;
            }
            Phase::Maps => {}
        }
        Ok(true)
    }

    fn update(&mut self, update: &impl Update) -> Result<()> {
        let belief = self.belief.as_mut().ok_or(Error::NoMaps)?;
        update.update(self.photographs.working(), belief)
    }

    fn network(&mut self) -> Result<()> {
        let (networks, options) = (self.networks.clone(), self.options.clone());
        if self.keep_record {
            let belief = self.belief.as_ref().ok_or(Error::NoMaps)?;
            self.record = Some(FitRecord::new(self.photographs.working(), belief, &options)?);
        }
        self.update(&LearnedPrior { networks, options })
    }

    /// A step of the latent code; whether it has settled.
    fn latent_step(&mut self, meter: &mut Meter) -> Result<bool> {
        let share = if self.task.refine { self.options.schedule.latent_fraction } else { 1.0 };
        let latent = self.latent.as_mut().ok_or(Error::NoMaps)?;
        if meter.exhausted(share) {
            latent.refresh()?;
            self.cut = Some(Cut::Budget);
        } else {
            let report = latent.step(&self.photographs)?;
            meter.count();
            self.loss = report.loss as f32;
            if !report.settled {
                if !(meter.budget.stop_when_invisible && self.is_still()) {
                    return Ok(false);
                }
                self.cut = Some(Cut::Invisible);
                let latent = self.latent.as_mut().ok_or(Error::NoMaps)?;
                latent.refresh()?;
                latent.count_as_fitted();
            }
        }
        self.begin_belief();
        self.measure();
        Ok(true)
    }

    /// Whether nothing visible is left to do for the latent fit.
    fn is_still(&mut self) -> bool {
        let Some(latent) = &self.latent else { return false };
        let [done, steps] = latent.work();
        let now = Shown::of(latent.maps());
        let change = self.previous.as_ref().map(|before| now.visible_change(before));
        self.previous = Some(now);
        change.is_some_and(|c| predicted_change(c, done as u32, steps as u32) < 1.0)
    }

    /// A step of the maps, of so many; whether it was the last.
    pub(super) fn maps_step(&mut self, steps: usize, meter: &mut Meter) -> Result<bool> {
        let fine = self.position.is_some_and(|at| self.rows()[at.row].fine);
        if fine && matches!(self.work, Work::Pending) {
            self.refine_belief();
        }
        let which = self.photographs_of_maps();
        let belief = self.belief.as_mut().ok_or(Error::NoMaps)?;
        let observations = &self.photographs.like(&belief.maps).some(&which)[..];
        if !matches!(self.work, Work::Maps(_)) {
            let EstimateOptions { solver, noise, .. } = &self.options;
            let (maps, prior) = (&mut belief.maps, &belief.prior);
            let solver = Solver::new(maps, observations, prior, solver, noise)?;
            self.work = Work::Maps(solver.with_noise(belief.fixed_noise));
        }
        let Work::Maps(solver) = &mut self.work else { return Ok(true) };
        let loss = solver.step(&mut belief.maps, &belief.mean, observations)?;
        let summary = solver.summary();
        (belief.found, belief.noise, self.loss) =
            (summary.prior, summary.mean_noise(), loss as f32);
        meter.count();
        let step = summary.steps;
        let trend = self.trend.get_or_insert_with(|| Trend::new(steps, 1));
        // At full size steps are dear, and they begin close to their end.
        let may_end = fine || meter.budget.stop_when_invisible;
        let is_flat = trend.is_flat(step, loss) && may_end;
        if is_flat && step < steps && meter.budget.stop_when_invisible {
            self.cut = self.cut.or(Some(Cut::Invisible));
        }
        Ok(is_flat || step >= steps)
    }

    /// Photographs that steps of the maps see: the last steps see all.
    pub(super) fn photographs_of_maps(&self) -> Vec<usize> {
        match self.position {
            Some(at) if at.row + 1 < self.rows().len() => self.photographs.drawn(at.row),
            _ => (0..self.photographs.len()).collect(),
        }
    }

    /// Brings the belief to the photographs' resolution.
    fn refine_belief(&mut self) {
        let full = self.photographs.full().first().map_or(0, Observation::width);
        if let Some(belief) = self.belief.as_mut().filter(|belief| belief.maps.width() < full) {
            belief.refine(&self.photographs, &self.options);
        }
    }

    /// A trial of widths, or the fit with those chosen; whether it was the last.
    fn widths_step(&mut self) -> Result<bool> {
        if !matches!(self.work, Work::Widths(_)) {
            let belief = self.belief.as_ref().ok_or(Error::NoMaps)?;
            let photographs = self.photographs.working();
            let trials = WidthTrials::new(photographs, &belief.maps, &self.least_options());
            if self.photographs.len() >= self.options.structured.leave_out_from {
                self.texel_residual = trials.texel_residual();
                self.expect_noise();
            }
            self.work = Work::Widths(Box::new(trials));
        }
        let Work::Widths(trials) = &mut self.work else { return Ok(true) };
        if !trials.is_done() {
            trials.step();
            return Ok(false);
        }
        let chosen = trials.chosen();
        self.structured = chosen.is_some();
        match chosen {
            Some(widths) => {
                // It knows every texel's colour.
                self.refine_belief();
                let belief = self.belief.as_mut().ok_or(Error::NoMaps)?;
                structured::fit(&mut self.photographs, belief, widths, &self.options);
            }
            None => {
                let correction = self.photographs.correction().clone();
                self.photographs
                    .correct(Correction { exposure: Exposure::default(), ..correction });
            }
        }
        Ok(true)
    }

    /// A step of the lights; whether the round has ended.
    fn lights_step(&mut self, turn: bool) -> bool {
        let (Some(belief), Some(at)) = (&mut self.belief, self.position) else { return true };
        if !matches!(self.work, Work::Lights(_)) {
            match Self::lights(
                self.photographs.working(),
                belief,
                self.task.free_lights,
                turn,
                &self.options,
            ) {
                Some(fit) => self.work = Work::Lights(Box::new(fit)),
                None => return true,
            }
        }
        let Work::Lights(fit) = &mut self.work else { return true };
        fit.step();
        if !fit.is_done() {
            return false;
        }
        let EstimateOptions { lights, schedule, .. } = &self.options;
        let mut moved = false;
        if let Some((correction, offset)) = fit.result() {
            let before = self.photographs.correction();
            moved = correction.distance(before, lights) > schedule.light_tolerance;
            self.photographs.correct(correction);
            // With lights that a board tells the base is right as a whole: the offset takes up what
            // the model cannot say.
            belief.offset = if self.task.free_lights { offset } else { Default::default() };
            belief.mean = belief.corrected_base();
        }
        if moved {
            // Narrow lobes do not find back from where wrong lights took them.
            belief.maps.clone_from(&belief.mean);
        } else {
            self.go_to(at.next_row());
        }
        true
    }

    pub(super) fn lights(
        photographs: &Photographs,
        belief: &Belief,
        free_lights: bool,
        turn: bool,
        options: &EstimateOptions,
    ) -> Option<LightFit> {
        let free = Free { turn, ambient: free_lights, mirror: !free_lights };
        let Belief { maps, base, found: prior, offset, .. } = belief;
        LightFit::new(Start { photographs, maps, base, prior, offset }, free, options)
    }

    /// A trial of a class; whether it was the last.
    fn classes_step(&mut self) -> Result<bool> {
        let belief = self.belief.as_mut().ok_or(Error::NoMaps)?;
        if !matches!(self.work, Work::Classes(_)) {
            let trials = ClassTrials::new(self.photographs.working(), belief, &self.options)?;
            self.work = Work::Classes(Box::new(trials));
        }
        let Work::Classes(trials) = &mut self.work else { return Ok(true) };
        if !trials.is_done() {
            trials.step(self.photographs.working())?;
        }
        if trials.is_done() {
            trials.assign(belief);
        }
        Ok(trials.is_done())
    }

    /// An iteration of the baseline; whether it was the last.
    fn baseline_step(&mut self, meter: &mut Meter) -> Result<bool> {
        let observations = self.photographs.full();
        let maps = self.maps.as_mut().ok_or(Error::NoMaps)?;
        if !matches!(self.work, Work::Baseline(_)) {
            let options = &self.options.baseline;
            self.work = Work::Baseline(Baseline::new(maps, observations, options)?);
        }
        let Work::Baseline(baseline) = &mut self.work else { return Ok(true) };
        let loss = baseline.step(maps, observations);
        self.loss = loss as f32;
        meter.count();
        // Adam's loss jumps about: every fiftieth is compared.
        let steps = self.options.baseline.steps;
        let trend = self.trend.get_or_insert_with(|| Trend::new(steps, 50));
        let is_flat = meter.budget.stop_when_invisible && trend.is_flat(baseline.steps(), loss);
        if is_flat && !baseline.is_done() {
            self.cut = self.cut.or(Some(Cut::Invisible));
        }
        Ok(is_flat || baseline.is_done())
    }
}
