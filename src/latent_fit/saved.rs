//! A fit as plain data, to go on with later.

use std::sync::Arc;

use super::level::Level;
use super::{COARSEST_TEXELS, FitOptions, LatentFit, Stage};
use crate::initial_estimate::Networks;
use crate::observation::Observation;
use crate::{Error, Result, Svbrdf};

/// What a [`LatentFit`] holds apart from photographs and networks.
#[derive(Debug, Clone, PartialEq)]
pub struct SavedFit {
    /// Level of the next step.
    pub current: usize,
    /// Steps done at that level since the latest photograph.
    pub done: usize,
    /// Photographs that came since the fit was last settled.
    pub fresh: usize,
    /// Mean log-L1 of the latest step; not a number before the first.
    pub loss: f64,
    /// Levels from the coarsest on.
    pub stages: Vec<SavedStage>,
}

/// One resolution of a [`SavedFit`].
#[derive(Debug, Clone, PartialEq)]
pub struct SavedStage {
    /// The level, once begun.
    pub level: Option<SavedLevel>,
    /// Its maps when the next finer level was last started from them.
    pub carried: Option<Svbrdf>,
}

/// Code and maps of one resolution.
#[derive(Debug, Clone, PartialEq)]
pub struct SavedLevel {
    /// The latent code.
    pub code: Vec<f32>,
    /// Adam's first and second moments, as many as the code.
    pub moments: [Vec<f32>; 2],
    /// Steps that the moments have seen.
    pub steps: i32,
    /// Slopes that the prior holds on to: two encoded planes.
    pub anchor: Vec<f32>,
    /// Expected error of these.
    pub deviation: f32,
    /// Maps.
    pub maps: Svbrdf,
}

impl LatentFit {
    /// Brings the maps up to the code of the latest step, as the next step would.
    ///
    /// # Errors
    /// When a network is broken.
    pub fn refresh(&mut self) -> Result<()> {
        self.settle_current()
    }

    /// The fit without photographs and networks. [`LatentFit::refresh`] goes before, unless the fit
    /// is settled.
    pub fn save(&self) -> SavedFit {
        let save = |s: &Stage| SavedStage {
            level: s.level.as_ref().map(Level::save),
            carried: s.carried.clone(),
        };
        let stages = self.stages.iter().map(save).collect();
        SavedFit {
            current: self.current,
            done: self.done,
            fresh: self.fresh,
            loss: self.loss,
            stages,
        }
    }

    /// Goes on from a saved fit with its photographs. Without `same_networks` the codes are found
    /// anew from the maps.
    ///
    /// # Errors
    /// When sizes do not fit each other or the networks, or a network is broken.
    pub fn restore(
        networks: Arc<Networks>,
        saved: SavedFit,
        observations: &[Observation],
        same_networks: bool,
        options: FitOptions,
    ) -> Result<Self> {
        let first = observations.first().ok_or(Error::NoMaps)?;
        let (width, height) = (first.width(), first.height());
        let longest = width.max(height);
        let mut halvings = 0;
        while longest >> halvings > COARSEST_TEXELS {
            halvings += 1;
        }
        let SavedFit { current, done, fresh, loss, stages } = saved;
        let fault = |message: &str| Err(Error::argument("fit", message));
        if stages.is_empty() || stages.len() > halvings + 1 || current >= stages.len() {
            return fault("levels that the resolution has are expected");
        }
        if (1..stages.len()).any(|i| stages[i].level.is_some() && stages[i - 1].level.is_none())
            || (0..current).any(|i| stages[i].level.is_none())
            || stages[0].level.is_none()
        {
            return fault("a level is missing");
        }
        let mut made = Vec::with_capacity(stages.len());
        for (i, stage) in stages.into_iter().enumerate() {
            let size = [width, height].map(|n| n >> (halvings - i));
            let fits = |maps: &Svbrdf| [maps.width(), maps.height()] == size;
            let all = stage.level.iter().map(|l| &l.maps).chain(&stage.carried);
            if !all.into_iter().all(fits) {
                return fault("a level's maps are not of its size");
            }
            let level = match stage.level {
                Some(level) => Some(Level::restore(&networks, level, same_networks, &options)?),
                None => None,
            };
            made.push(Stage { observations: Vec::new(), level, carried: stage.carried });
        }
        let mut fit =
            Self { networks, options, stages: made, current: 0, done: 0, fresh: 0, loss, halvings };
        for observation in observations {
            fit.add_observation(observation)?;
        }
        (fit.current, fit.done, fit.fresh) = (current, done, fresh);
        Ok(fit)
    }
}
