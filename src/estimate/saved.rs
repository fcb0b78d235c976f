//! The result of an estimate as plain data. An interrupted fit of the latest photograph is repeated after a
//! restore.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::bundle::EstimatedLobes;
use super::correction::Correction;
use super::estimation::{Estimation, Stage};
use super::latent::{LatentFit, SavedLatent};
use super::options::EstimateOptions;
use super::parts::Contradiction;
use super::task::{EarlyStop, Method, Task};
use crate::networks::Networks;
use crate::observation::Observation;
use crate::{Error, Result, Svbrdf};

/// State of an [`Estimation`] without photographs, networks, options and task.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct SavedEstimate {
    /// The latest maps; for a baseline in progress those at its start; `None` before the first photograph.
    pub maps: Option<Svbrdf>,
    lobes: Vec<EstimatedLobes>,
    /// Start of the next fit, and reference of the uncertainty; `None` in the baseline.
    latent: Option<SavedLatent>,
    pub correction: Correction,
    /// Outlier regions of each photograph.
    contradictions: Vec<Option<Contradiction>>,
    /// Whether the fit of the latest photograph must be repeated.
    unfinished: bool,
    #[serde(rename = "cut")]
    early_stop: Option<EarlyStop>,
    loss: f32,
}

impl Estimation {
    /// The current estimate; a fit in progress is saved as of its start.
    pub fn save(&self) -> SavedEstimate {
        let unfinished = !self.is_done();
        let (correction, maps) = match &self.begun_with {
            (correction, maps) if unfinished => (correction, maps.clone()),
            _ => (self.photographs.correction(), None),
        };
        SavedEstimate {
            maps: maps.or_else(|| self.maps().ok()),
            lobes: self.lobes.clone(),
            latent: self.latent.as_ref().map(|latent| latent.save(unfinished)),
            correction: correction.clone(),
            contradictions: self.photographs.contradictions().map(Option::<&_>::cloned).collect(),
            unfinished,
            early_stop: self.early_stop,
            loss: self.loss,
        }
    }

    /// Continues a saved estimate of these photographs. The networks may differ from the earlier ones.
    ///
    /// # Errors
    /// When the saved data are inconsistent or do not suit the networks, or a network is broken.
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
            || !saved.lobes.as_flattened().as_flattened().iter().all(|v| v.is_finite())
        {
            return Err(Error::argument("estimate", "photographs and maps do not fit each other"));
        }
        for (index, regions) in saved.contradictions.into_iter().enumerate() {
            regions.as_ref().map_or(Ok(()), Contradiction::check)?;
            estimation.photographs.mask(index, regions);
        }
        estimation.expect_noise();
        if let Some(latent) = saved.latent {
            let (photographs, options) = (&estimation.photographs, &estimation.options.latent);
            estimation.latent = Some(LatentFit::restore(networks, latent, photographs, options)?);
        }
        estimation.stage = Stage::Settled(saved.maps);
        (estimation.early_stop, estimation.loss) = (saved.early_stop, saved.loss);
        estimation.lobes = saved.lobes;
        if saved.unfinished {
            estimation.begin();
        }
        Ok(estimation)
    }
}
