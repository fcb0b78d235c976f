//! How far the maps may be off.

use std::sync::Arc;

use crossbeam_channel::bounded;

use super::Session;
use super::reports::Assessed;
use super::worker::Command;
use crate::estimate::Evidence;
use crate::{Error, Result};

impl Session {
    /// The maps of the moment with the standard deviation of each at every texel. Computed when asked
    /// for; meaningful once the fit has settled. Waits for a step of the fit.
    ///
    /// Deviations are calibrated with materials whose maps are known, photographed as well and as badly
    /// as real ones are: about two errors of three are within them. Of a material that is not
    /// Cook-Torrance's there is no true roughness; deviations are then those of a material that
    /// leaves such residuals.
    ///
    /// # Errors
    /// [`Error::NoMaps`] before the first photograph was accepted; when the session has failed or was
    /// cancelled.
    pub fn assess(&self) -> Result<Assessed> {
        let evidence = self.evidence()?;
        let confidence = self.pool.install(|| evidence.confidence())?;
        Ok(Assessed { maps: Arc::new(evidence.into_maps()), confidence })
    }

    /// What those deviations are computed from.
    ///
    /// # Errors
    /// As [`Session::assess`].
    pub fn evidence(&self) -> Result<Evidence> {
        self.usable()?;
        let (reply, answer) = bounded(1);
        match self.ask(Command::Evidence(reply), &answer) {
            Some(evidence) => evidence,
            None => Err(self.usable().err().unwrap_or(Error::Cancelled)),
        }
    }
}
