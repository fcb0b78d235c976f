//! Steps of the phases.

use super::baseline::{self, Baseline};
use super::belief::Belief;
use super::budget::{Meter, Shown, Trend, predicted_change};
use super::correction::{Correction, Exposure};
use super::estimation::{Cut, Estimation, Stage, Texels, Work};
use super::latent::LatentFit;
use super::lights::{Free, LightFit, Start};
use super::options::EstimateOptions;
use super::photographs::Photographs;
use super::schedule::{Part, Phase, Row};
use super::solver::Solver;
use super::structured::{self, WidthTrials};
use super::updates::{ClassTrials, FitRecord, Pooling, regress_slopes};
use crate::Result;

/// Fraction of a budget that the latent code may take: a step of the solver gains more.
const LATENT_FRACTION: f32 = 0.5;
/// Change of the lights, in units of their expected errors, that is worth another round.
const LIGHT_TOLERANCE: f64 = 0.02;

impl Estimation {
    /// A step of a part of a row; goes on where it has ended.
    pub(super) fn texels_step(&mut self, row: Row, meter: &mut Meter) -> Result<()> {
        let Stage::Texels(texels) = &self.stage else { return Ok(()) };
        let at = texels.at;
        let ended = match at.part {
            Part::Before => self.maps_step(row.before, meter)?,
            Part::Phase => self.phase_step(row.phase)?,
            Part::After => self.maps_step(row.after, meter)?,
        };
        if !ended {
            return Ok(());
        }
        let rows = self.rows();
        let Stage::Texels(texels) = &mut self.stage else { return Ok(()) };
        texels.work = Work::Pending;
        // A phase may have gone elsewhere already.
        let next = if texels.at == at { at.following(&row) } else { texels.at };
        match next.settled(&rows) {
            Some(next) => texels.at = next,
            None => self.finish(meter)?,
        }
        Ok(())
    }

    /// A step of a phase; whether it has ended.
    fn phase_step(&mut self, phase: Phase) -> Result<bool> {
        match phase {
            Phase::Widths => return self.widths_step(),
            Phase::HeldLights => return Ok(self.lights_step(false)),
            Phase::TurningLights => return Ok(self.lights_step(true)),
            Phase::Classes => return self.classes_step(),
            Phase::PoolGloss | Phase::Slopes | Phase::Network => self.update_prior(phase)?,
            Phase::Maps | Phase::Latent | Phase::Baseline => {}
        }
        Ok(true)
    }

    /// An update of the prior that is one step.
    fn update_prior(&mut self, phase: Phase) -> Result<()> {
        let Self { stage: Stage::Texels(texels), networks, options, .. } = self else {
            return Ok(());
        };
        let (photographs, belief) = (self.photographs.working(), &mut texels.belief);
        match phase {
            Phase::PoolGloss => Pooling::new(options).pool(photographs, belief),
            Phase::Slopes => regress_slopes(photographs, belief, &options.noise),
            Phase::Network => {
                let record = FitRecord::new(photographs, belief, options)?;
                record.update(networks, belief)?;
                self.record = self.keep_record.then_some(record);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// A step of the latent code.
    pub(super) fn latent_step(&mut self, meter: &mut Meter) -> Result<()> {
        let (Stage::Latent { again, previous }, Some(latent)) = (&mut self.stage, &mut self.latent)
        else {
            return Ok(());
        };
        let again = *again;
        if meter.exhausted(if self.task.refine { LATENT_FRACTION } else { 1.0 }) {
            latent.refresh()?;
            self.cut = Some(Cut::Budget);
        } else {
            let report = latent.step(&self.photographs)?;
            meter.count();
            self.loss = report.loss as f32;
            if !report.settled {
                if !(meter.budget.stop_when_invisible && is_still(latent, previous)) {
                    return Ok(());
                }
                self.cut = Some(Cut::Invisible);
                latent.refresh()?;
                latent.count_as_fitted();
            }
        }
        self.begin_texels(again);
        self.measure();
        Ok(())
    }

    /// A step of the maps, of so many; whether it was the last.
    fn maps_step(&mut self, steps: usize, meter: &mut Meter) -> Result<bool> {
        let rows = self.rows();
        let Stage::Texels(texels) = &mut self.stage else { return Ok(true) };
        let (at, fine) = (texels.at.row, rows[texels.at.row].fine);
        if fine && matches!(texels.work, Work::Pending) {
            texels.belief.refine(&self.photographs);
        }
        // The last steps see all photographs.
        let which = match at + 1 < rows.len() {
            true => self.photographs.drawn(at),
            false => (0..self.photographs.len()).collect(),
        };
        let Texels { belief, work, .. } = &mut **texels;
        let observations = &self.photographs.like(&belief.maps).some(&which)[..];
        if !matches!(work, Work::Maps(..)) {
            let (maps, prior) = (&mut belief.maps, &belief.prior);
            let solver = Solver::new(maps, observations, prior, &self.options.noise)?;
            let solver = Box::new(solver.with_noise(belief.fixed_noise));
            *work = Work::Maps(solver, Trend::new(steps, 1));
        }
        let Work::Maps(solver, trend) = work else { return Ok(true) };
        let loss = solver.step(&mut belief.maps, &belief.mean, observations)?;
        let summary = solver.summary();
        (belief.found, belief.noise, self.loss) =
            (summary.prior, summary.mean_noise(), loss as f32);
        meter.count();
        let step = summary.steps;
        // At full size steps are dear, and they begin close to their end.
        let may_end = fine || meter.budget.stop_when_invisible;
        let is_flat = trend.is_flat(step, loss) && may_end;
        if is_flat && step < steps && meter.budget.stop_when_invisible {
            self.cut = self.cut.or(Some(Cut::Invisible));
        }
        Ok(is_flat || step >= steps)
    }

    /// A trial of widths, or the fit with those chosen; whether it was the last.
    fn widths_step(&mut self) -> Result<bool> {
        let options = self.least_options();
        let Stage::Texels(texels) = &mut self.stage else { return Ok(true) };
        let Texels { belief, work, .. } = &mut **texels;
        let Work::Widths(trials) = work else {
            let trials = WidthTrials::new(self.photographs.working(), &belief.maps, &options);
            if self.photographs.len() >= options.schedule.determined_from {
                self.texel_residual = trials.texel_residual();
            }
            *work = Work::Widths(Box::new(trials));
            self.expect_noise();
            return Ok(false);
        };
        if !trials.is_done() {
            trials.step();
            return Ok(false);
        }
        let chosen = trials.chosen();
        self.structured = chosen.is_some();
        match chosen {
            Some(widths) => {
                // It knows every texel's colour.
                belief.refine(&self.photographs);
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
        let lights = &self.options.lights;
        let Stage::Texels(texels) = &mut self.stage else { return true };
        let Texels { belief, work, at, .. } = &mut **texels;
        let (photographs, free_lights) = (self.photographs.working(), self.task.free_lights);
        if !matches!(work, Work::Lights(_)) {
            match Self::lights(photographs, belief, free_lights, turn, &self.options) {
                Some(fit) => *work = Work::Lights(Box::new(fit)),
                None => return true,
            }
        }
        let Work::Lights(fit) = work else { return true };
        fit.step();
        if !fit.is_done() {
            return false;
        }
        let mut moved = false;
        if let Some((correction, offset)) = fit.result() {
            let before = self.photographs.correction();
            moved = correction.distance(before, lights) > LIGHT_TOLERANCE;
            self.photographs.correct(correction);
            // With lights that a board tells the base is right as a whole: the offset takes up what
            // the model cannot say.
            belief.offset = if free_lights { offset } else { Default::default() };
            belief.mean = belief.corrected_base();
        }
        if moved {
            // Narrow lobes do not find back from where wrong lights took them.
            belief.maps.clone_from(&belief.mean);
        } else {
            *at = at.next_row();
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
        let Stage::Texels(texels) = &mut self.stage else { return Ok(true) };
        let (Texels { belief, work, .. }, photographs) =
            (&mut **texels, self.photographs.working());
        if !matches!(work, Work::Classes(_)) {
            let trials = ClassTrials::new(photographs, belief, &self.options)?;
            *work = Work::Classes(Box::new(trials));
        }
        let Work::Classes(trials) = work else { return Ok(true) };
        if !trials.is_done() {
            trials.step(photographs)?;
        }
        if trials.is_done() {
            trials.assign(belief);
        }
        Ok(trials.is_done())
    }

    /// An iteration of the baseline.
    pub(super) fn baseline_step(&mut self, meter: &mut Meter) -> Result<()> {
        let observations = self.photographs.full();
        let Stage::Baseline { maps, run } = &mut self.stage else { return Ok(()) };
        if run.is_none() {
            let baseline = Baseline::new(maps, observations)?;
            // Adam's loss jumps about: every fiftieth is compared.
            *run = Some((baseline, Trend::new(baseline::STEPS, 50)));
        }
        let Some((baseline, trend)) = run else { return Ok(()) };
        let loss = baseline.step(maps, observations);
        self.loss = loss as f32;
        meter.count();
        let is_flat = meter.budget.stop_when_invisible && trend.is_flat(baseline.steps(), loss);
        let is_done = baseline.is_done();
        if is_flat || is_done {
            self.settle((!is_done).then_some(Cut::Invisible));
            self.measure();
        }
        Ok(())
    }
}

/// Whether nothing visible is left to do for the latent fit, `previous` being its maps before the latest
/// step.
fn is_still(latent: &LatentFit, previous: &mut Option<Shown>) -> bool {
    let [done, steps] = latent.work();
    let now = Shown::of(latent.averages());
    let change = previous.as_ref().map(|before| now.visible_change(before));
    *previous = Some(now);
    change.is_some_and(|c| predicted_change(c, done as u32, steps as u32) < 1.0)
}
