//! The result of an estimate as plain data, to go on from later. What is in progress is no part of it: the fit
//! of the latest photograph is done again.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::correction::Correction;
use super::estimation::{Estimation, Stage};
use super::latent::{LatentFit, SavedLatent};
use super::options::EstimateOptions;
use super::parts::Contradiction;
use super::task::{EarlyStop, Method, Task};
use crate::networks::Networks;
use crate::observation::Observation;
use crate::{Error, Result, Svbrdf};

/// An [`Estimation`] apart from photographs, networks, options and what it is asked for.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct SavedEstimate {
    /// The latest maps, of the baseline in progress those that it began with; none before the first photograph.
    pub maps: Option<Svbrdf>,
    /// What the next fit begins from, and deviations refer to; none of the baseline.
    latent: Option<SavedLatent>,
    pub correction: Correction,
    /// The regions of each photograph that contradict the others.
    contradictions: Vec<Option<Contradiction>>,
    /// Whether the fit of the latest photograph is to be done again.
    unfinished: bool,
    #[serde(rename = "cut")]
    early_stop: Option<EarlyStop>,
    loss: f32,
}

impl Estimation {
    /// The estimate as it is; a fit in progress as it began.
    pub fn save(&self) -> SavedEstimate {
        let unfinished = !self.is_done();
        let (correction, maps) = match &self.begun_with {
            (correction, maps) if unfinished => (correction, maps.clone()),
            _ => (self.photographs.correction(), None),
        };
        SavedEstimate {
            maps: maps.or_else(|| self.maps().ok()),
            latent: self.latent.as_ref().map(|latent| latent.save(unfinished)),
            correction: correction.clone(),
            contradictions: self.photographs.contradictions().map(Option::<&_>::cloned).collect(),
            unfinished,
            early_stop: self.early_stop,
            loss: self.loss,
        }
    }

    /// Goes on from what was saved of these photographs. The networks may be others than before.
    ///
    /// # Errors
    /// When what was saved does not fit together or the networks, or a network is broken.
    pub fn restore(
        networks: Arc<Networks>,
        task: Task,
        options: EstimateOptions,
        saved: SavedEstimate,
        photographs: Vec<Observation>,
    ) -> Result<Self> {
        let mut estimation = Self::new(networks.clone(), task, options);
        let correction = saved.correction.within_limits()?;
        let none = Self::no_photographs(&estimation.options);
        estimation.photographs = none.restored(photographs, correction)?;
        let begun = estimation.photos() > 0;
        let size = estimation.photographs.full().first().map(|o| [o.width(), o.height()]);
        if saved.contradictions.len() != estimation.photos()
            || saved.maps.as_ref().map(|maps| [maps.width(), maps.height()]) != size
            || saved.latent.is_some() != (begun && task.method == Method::Deep)
            || (saved.unfinished && !begun)
            || !saved.loss.is_finite()
        {
            return Err(Error::argument("estimate", "photographs and maps do not fit each other"));
        }
        for (index, found) in saved.contradictions.into_iter().enumerate() {
            found.as_ref().map_or(Ok(()), Contradiction::check)?;
            estimation.photographs.mask(index, found);
        }
        estimation.expect_noise();
        if let Some(latent) = saved.latent {
            let (photographs, options) = (&estimation.photographs, &estimation.options.latent);
            estimation.latent = Some(LatentFit::restore(networks, latent, photographs, options)?);
        }
        estimation.stage = Stage::Settled(saved.maps);
        (estimation.early_stop, estimation.loss) = (saved.early_stop, saved.loss);
        if saved.unfinished {
            estimation.begin();
        }
        Ok(estimation)
    }
}
