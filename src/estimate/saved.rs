//! An estimate as plain data, to go on with later to the same bits: where a photograph has just come, or
//! nothing is left to do. What happens between is done again.

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::correction::Correction;
use super::estimation::{Estimation, Stage};
use super::latent::{LatentFit, SavedFit};
use super::options::EstimateOptions;
use super::parts::Contradiction;
use super::task::{EarlyStop, Method, Task};
use crate::networks::{Networks, Workspace};
use crate::observation::Observation;
use crate::{Error, Result, Svbrdf};

/// An [`Estimation`] apart from photographs, networks, options and what it is asked for.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct SavedEstimate {
    latent: Option<SavedFit>,
    /// What a decoder makes of a certain code: codes of one decoder mean nothing to another.
    #[serde(with = "crate::little_endian")]
    probe: Vec<f32>,
    /// The maps, where there is no latent code to make them from.
    maps: Option<Svbrdf>,
    correction: Correction,
    /// What contradicts others in each photograph.
    contradictions: Vec<Option<Contradiction>>,
    /// Whether the schedule is to be gone through from its beginning.
    unfinished: bool,
    #[serde(rename = "cut")]
    early_stop: Option<EarlyStop>,
    loss: f32,
}

#[cfg(test)]
impl SavedEstimate {
    /// As if another decoder had been in use.
    pub fn forget_networks(&mut self) {
        self.probe.iter_mut().for_each(|v| *v += 9.0);
    }
}

impl Estimation {
    /// The estimate where a photograph has just come, or nothing is left to do.
    pub fn save(&self) -> SavedEstimate {
        let classic = self.task.method == Method::Classic;
        SavedEstimate {
            latent: self.latent.as_ref().map(LatentFit::save),
            probe: self.latent.as_ref().map_or_else(Vec::new, |_| probe(&self.networks)),
            maps: if classic { self.shown().map(Cow::into_owned) } else { None },
            correction: self.photographs.correction().clone(),
            contradictions: self.photographs.contradictions().map(Option::<&_>::cloned).collect(),
            unfinished: !self.is_done(),
            early_stop: self.early_stop,
            loss: self.loss,
        }
    }

    /// Goes on with what was saved of these photographs, `shown` being their latest maps. With other
    /// networks the latent code is found anew from its maps.
    ///
    /// # Errors
    /// When what was saved does not fit together or the networks, or a network is broken.
    pub fn restore(
        networks: Arc<Networks>,
        task: Task,
        options: EstimateOptions,
        saved: SavedEstimate,
        photographs: Vec<Observation>,
        shown: Option<Svbrdf>,
    ) -> Result<Self> {
        let mut estimation = Self::new(networks.clone(), task, options);
        let correction = saved.correction.within_limits()?;
        let none = Self::no_photographs(&estimation.options);
        estimation.photographs = none.restored(photographs, correction)?;
        if saved.contradictions.len() != estimation.photos() {
            return Err(Error::argument(
                "estimate",
                "photographs and their parts do not fit each other",
            ));
        }
        for (index, found) in saved.contradictions.into_iter().enumerate() {
            found.as_ref().map_or(Ok(()), Contradiction::check)?;
            estimation.photographs.mask(index, found);
        }
        estimation.expect_noise();
        let begun = estimation.photos() > 0;
        let maps = saved.maps.or(shown);
        let size = estimation.photographs.full().first().map(|o| [o.width(), o.height()]);
        if maps.as_ref().map(|maps| [maps.width(), maps.height()]) != size
            || saved.latent.is_some() != (begun && task.method == Method::Deep)
            || (saved.unfinished && !begun)
            || !saved.loss.is_finite()
        {
            return Err(Error::argument("estimate", "photographs and maps do not fit each other"));
        }
        if let Some(latent) = saved.latent {
            let same_networks = same(&saved.probe, &probe(&networks));
            let (photographs, options) = (&estimation.photographs, &estimation.options.latent);
            let fit = LatentFit::restore(networks, latent, photographs, same_networks, options)?;
            estimation.latent = Some(fit);
        }
        estimation.stage = Stage::Settled(maps);
        (estimation.early_stop, estimation.loss) = (saved.early_stop, saved.loss);
        if saved.unfinished {
            estimation.begin();
        }
        Ok(estimation)
    }
}

/// What the decoder makes of a certain code.
fn probe(networks: &Networks) -> Vec<f32> {
    let decoder = networks.decoder();
    let code: Vec<f32> = (0..decoder.code_channels()).map(|i| (0.7 * i as f32).sin()).collect();
    let decoded = Workspace::new(decoder, 1, 1)
        .and_then(|mut workspace| decoder.forward(&code, &mut workspace).map(<[f32]>::to_vec));
    decoded.unwrap_or_default().into_iter().step_by(37).collect()
}

fn same(a: &[f32], b: &[f32]) -> bool {
    // Processors round differently; decoders differ by tenths.
    !a.is_empty() && a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3)
}
