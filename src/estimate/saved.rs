//! An estimate as plain data, to go on with later: between any two steps, to the same bits.

use std::borrow::Cow;
use std::sync::Arc;

pub(crate) use super::adam::Adam;
use super::baseline::Baseline;
pub(crate) use super::baseline::SavedBaseline;
pub(crate) use super::belief::Belief;
use super::budget::Shown;
pub(crate) use super::budget::Trend;
pub(crate) use super::bundle::{Progress, State};
pub(crate) use super::correction::{Correction, Exposure, MAX_MIRRORED, Offset};
pub(crate) use super::estimation::Cut;
use super::estimation::{Estimation, Method, Task, Work};
use super::latent::LatentFit;
pub(crate) use super::latent::{LatentPosition, SavedCode, SavedFit};
pub(crate) use super::lights::{SavedDescent, SavedLights};
pub(crate) use super::noise::Noise;
use super::options::EstimateOptions;
pub(crate) use super::photographs::Photographs;
pub(crate) use super::prior::Prior;
use super::schedule::Phase;
pub(crate) use super::schedule::{Part, Position};
use super::solver::Solver;
pub(crate) use super::solver::SolverState;
use super::structured::WidthTrials;
use super::updates::ClassTrials;
use crate::initial_estimate::Networks;
use crate::{Error, Result, Svbrdf};

/// An [`Estimation`] apart from networks, options and what it is asked for.
pub(crate) struct SavedEstimation<'a> {
    pub photographs: Cow<'a, Photographs>,
    pub latent: Option<SavedFit>,
    pub belief: Option<Cow<'a, Belief>>,
    pub maps: Option<Cow<'a, Svbrdf>>,
    pub position: Option<Position>,
    pub work: SavedWork<'a>,
    pub loss: f32,
    pub fraction: f32,
    pub cut: Option<Cut>,
    pub lights_before: Cow<'a, Correction>,
    pub repeated: bool,
    pub structured: bool,
    pub texel_residual: f32,
    /// What was to be seen before the latest step of the latent fit.
    pub previous: Option<Cow<'a, [f32]>>,
    pub trend: Option<Trend>,
}

/// The part in progress.
#[allow(clippy::large_enum_variant)] // there is one at a time
pub(crate) enum SavedWork<'a> {
    Pending,
    Maps(Cow<'a, SolverState>),
    /// Errors of the trials of widths; negative where one is not done.
    Widths(Cow<'a, [f64]>),
    Lights(SavedLights),
    /// Costs of the trials done.
    Classes(Cow<'a, [Vec<f32>]>),
    Baseline(Cow<'a, SavedBaseline>),
}

impl Estimation {
    /// The estimate as it is between two steps.
    pub fn save(&self) -> SavedEstimation<'_> {
        let work = match &self.work {
            Work::Pending => SavedWork::Pending,
            Work::Maps(solver) => SavedWork::Maps(Cow::Borrowed(&solver.state)),
            Work::Widths(trials) => SavedWork::Widths(trials.save().into()),
            Work::Lights(fit) => SavedWork::Lights(fit.save()),
            Work::Classes(trials) => SavedWork::Classes(Cow::Borrowed(&trials.costs)),
            Work::Baseline(b) => SavedWork::Baseline(Cow::Borrowed(&b.state)),
        };
        SavedEstimation {
            photographs: Cow::Borrowed(&self.photographs),
            latent: self.latent.as_ref().map(LatentFit::save),
            belief: self.belief.as_ref().map(Cow::Borrowed),
            maps: self.maps.as_ref().map(Cow::Borrowed),
            position: self.position,
            work,
            loss: self.loss,
            fraction: self.fraction,
            cut: self.cut,
            lights_before: Cow::Borrowed(&self.lights_before),
            repeated: self.repeated,
            structured: self.structured,
            texel_residual: self.texel_residual,
            previous: self.previous.as_ref().map(|shown| Cow::Borrowed(&shown.values[..])),
            trend: self.trend.clone(),
        }
    }

    /// Goes on with what was saved. Without `same_networks` the latent code is found anew from its
    /// maps.
    ///
    /// # Errors
    /// When what was saved does not fit together or the networks, or a network is broken.
    pub fn restore(
        networks: Arc<Networks>,
        task: Task,
        options: EstimateOptions,
        saved: SavedEstimation,
        same_networks: bool,
    ) -> Result<Self> {
        let mut estimation = Self::new(networks.clone(), task, options);
        estimation.photographs = saved.photographs.into_owned();
        estimation.texel_residual = saved.texel_residual;
        estimation.expect_noise();
        if let Some(latent) = saved.latent {
            let EstimateOptions { latent: options, gains, .. } = &estimation.options;
            let photographs = &estimation.photographs;
            let fit =
                LatentFit::restore(networks, latent, photographs, same_networks, options, gains)?;
            estimation.latent = Some(fit);
        }
        estimation.belief = saved.belief.map(Cow::into_owned);
        estimation.maps = saved.maps.map(Cow::into_owned);
        (estimation.loss, estimation.fraction) = (saved.loss, saved.fraction);
        (estimation.position, estimation.cut) = (saved.position, saved.cut);
        estimation.lights_before = saved.lights_before.into_owned();
        estimation.repeated = saved.repeated;
        estimation.structured = saved.structured;
        estimation.check()?;
        estimation.previous = saved.previous.map(|values| Shown { values: values.into_owned() });
        estimation.trend = saved.trend;
        estimation.work = estimation.restored_work(saved.work)?;
        Ok(estimation)
    }

    /// Whether what was saved fits together.
    fn check(&self) -> Result<()> {
        let begun = self.photographs.len() > 0;
        let deep = self.task.method == Method::Deep;
        let size = self.photographs.full().first().map(|o| [o.width(), o.height()]);
        let fits = |maps: &Svbrdf| size == Some([maps.width(), maps.height()]);
        let belief_fits = self.belief.as_ref().is_none_or(|belief| {
            let size = |maps: &Svbrdf| [maps.width(), maps.height()];
            let [maps, mean, base] = [&belief.maps, &belief.mean, &belief.base].map(size);
            let taken = |photographs: &Photographs| {
                photographs.full().first().map(|o| [o.width(), o.height()])
            };
            taken(self.photographs.like(&belief.maps)) == Some(maps)
                && mean == maps
                && taken(self.photographs.working()) == Some(base)
        });
        let rows = self.rows();
        let phase = self.position.and_then(|at| Some(rows.get(at.row)?.phase));
        let round = self
            .position
            .is_none_or(|at| at.settled(&rows) == Some(at) && at.round < rows[at.row].rounds);
        let has_belief = deep && phase.is_some_and(|phase| phase != Phase::Latent);
        // Latest maps, or those in work.
        let sets = usize::from(self.maps.is_some()) + usize::from(self.belief.is_some());
        if sets != usize::from(begun)
            || !self.maps.iter().all(fits)
            || !belief_fits
            || self.latent.is_some() != (begun && deep)
            || self.position.is_some() != phase.is_some()
            || (phase.is_some() && !begun)
            || !round
            || self.belief.is_some() != has_belief
        {
            return Err(fault("photographs, maps and schedule do not fit each other"));
        }
        Ok(())
    }

    fn restored_work(&mut self, saved: SavedWork) -> Result<Work> {
        let phase = self.position.map(|at| {
            let phase = self.rows()[at.row].phase;
            if at.part == Part::Phase { phase } else { Phase::Maps }
        });
        let EstimateOptions { solver, noise, .. } = &self.options;
        let (which, least) = (self.photographs_of_maps(), self.least_options());
        Ok(match (saved, phase, &mut self.belief) {
            (SavedWork::Pending, ..) => Work::Pending,
            (SavedWork::Maps(state), Some(Phase::Maps), Some(belief)) => {
                let (maps, prior, state) = (&belief.maps, &belief.prior, state.into_owned());
                let observations = self.photographs.like(maps).some(&which);
                let solver = Solver::resume(maps, &observations, prior, solver, noise, state)?;
                Work::Maps(solver.with_noise(belief.fixed_noise))
            }
            (
                SavedWork::Lights(lights),
                Some(phase @ (Phase::HeldLights | Phase::TurningLights)),
                Some(belief),
            ) => {
                let (turn, free) = (phase == Phase::TurningLights, self.task.free_lights);
                let fit =
                    Self::lights(self.photographs.working(), belief, free, turn, &self.options);
                let fit = fit.and_then(|fit| fit.resume(lights));
                Work::Lights(Box::new(fit.ok_or_else(|| fault("lights are of another size"))?))
            }
            (SavedWork::Widths(errors), Some(Phase::Widths), Some(belief)) => {
                let photographs = self.photographs.working();
                let mut trials = WidthTrials::new(photographs, &belief.maps, &least);
                if !trials.resume(&errors) {
                    return Err(fault("trials of widths are of another size"));
                }
                Work::Widths(Box::new(trials))
            }
            (SavedWork::Classes(costs), Some(Phase::Classes), Some(belief)) => {
                let mut trials =
                    ClassTrials::new(self.photographs.working(), belief, &self.options)?;
                if !trials.resume(costs.into_owned()) {
                    return Err(fault("trials of classes are of another size"));
                }
                Work::Classes(Box::new(trials))
            }
            (SavedWork::Baseline(state), Some(Phase::Baseline), None) => {
                let maps = self.maps.as_ref().ok_or(Error::NoMaps)?;
                let (options, state) = (&self.options.baseline, state.into_owned());
                let observations = self.photographs.full();
                Work::Baseline(Baseline::resume(maps, observations, options, state)?)
            }
            _ => return Err(fault("the part in progress is not the schedule's")),
        })
    }
}

fn fault(message: &str) -> Error {
    Error::argument("estimate", message)
}
