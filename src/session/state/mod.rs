//! A session as bytes, to go on with later or elsewhere.
//!
//! Stored: settings and scene, what is known of the board, every photograph, the latest maps, and the estimate
//! where the latest photograph came or, once settled, as it is. What the fit has done since is done
//! again, to the same bits.

mod check;
mod format;

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::format::{as_damage, damaged};
use super::capture::{Board, Capture};
use super::fit::{Fit, Milestone};
use super::settings::{Scene, Settings};
use super::{RestoreOptions, Session, memory};
use crate::estimate::{Budget, EstimateOptions, Estimation, LightCorrection};
use crate::networks::Networks;
use crate::{Result, Svbrdf};

/// Most threads a saved session may ask for.
const MAX_THREADS: usize = 64;

/// What has to be known before anything large is read.
#[derive(Serialize, Deserialize)]
struct Head<'a> {
    settings: Cow<'a, Settings>,
    scene: Cow<'a, Scene>,
    budget: Budget,
    photographs: usize,
}

#[derive(Serialize, Deserialize)]
struct Body<'a> {
    capture: Cow<'a, Capture>,
    milestone: Milestone,
    loss_before: f32,
    /// The latest maps, and what the fit corrected of exposure and flash with them.
    maps: Option<Cow<'a, Svbrdf>>,
    light_correction: LightCorrection,
}

impl Session {
    /// The session as bytes, the fit as it was when the latest photograph came, or settled.
    /// [`Session::restore`] does again what the fit has done since, and ends with the same bits as this
    /// session if the budget stays the same and is none of time.
    ///
    /// Waits for a photograph that is being added and for a step of the fit, not for the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn save(&self) -> Result<Vec<u8>> {
        // No photograph may come between what the fit and the capture know.
        let (_intake, capture) = self.settled()?;
        let (settings, scene) = (self.settings.clone(), self.scene.clone());
        self.fit.ask(move |fit| {
            let (budget, loss_before, maps, correction) = {
                let state = fit.shared.lock();
                let (maps, correction) = (state.maps.clone(), state.light_correction.clone());
                (state.budget, state.progress.loss_before, maps, correction)
            };
            let (settings, scene) = (Cow::Owned(settings), Cow::Owned(scene));
            let photographs = fit.estimation.photos();
            let head = Head { settings, scene, budget, photographs };
            let (capture, maps) = (Cow::Borrowed(&*capture), maps.as_deref().map(Cow::Borrowed));
            let milestone = fit.milestone();
            format::write(
                &head,
                &Body { capture, milestone, loss_before, maps, light_correction: correction },
            )
        })
    }

    /// Continues a session that [`Session::save`] wrote, with these networks. They may be others than
    /// before: the maps stay, and the fit continues from them.
    ///
    /// # Errors
    /// [`Error::State`](crate::Error::State) when the bytes are not what was written or of a newer
    /// version, [`Error::MemoryLimit`](crate::Error::MemoryLimit).
    pub fn restore(saved: &[u8], networks: Arc<Networks>, options: RestoreOptions) -> Result<Self> {
        let (head, rest) = format::read::<Head>(format::content(saved)?)?;
        let Head { settings, scene, budget, photographs } = head;
        let (mut settings, scene) = (settings.into_owned(), scene.into_owned());
        settings.check().and_then(|()| budget.check()).map_err(as_damage)?;
        check::scene(&scene)?;
        settings.threads = options.threads.unwrap_or(settings.threads).min(MAX_THREADS);
        settings.memory_limit_bytes = options.memory_limit_bytes;
        settings.driver = options.driver;
        memory::check(&settings, photographs.max(1), 0)?;
        let (body, rest) = format::read::<Body>(rest)?;
        let fresh = Capture::new(scene.clone(), &settings).map_err(as_damage)?;
        let capture = resumed(fresh, body.capture.into_owned(), settings.resolution)?;
        let observations = capture.observations();
        if observations.len() != photographs || !rest.is_empty() {
            return Err(damaged("photographs are missing, or there is more than a session"));
        }
        let Milestone { estimate, meter } = body.milestone;
        let correction = body.light_correction.within_limits().map_err(as_damage)?;
        meter.budget.check().map_err(as_damage)?;
        if !body.loss_before.is_finite() {
            return Err(damaged("progress is not a number"));
        }
        let (maps, options) = (body.maps.map(Cow::into_owned), EstimateOptions::default());
        let (task, pool, shown) = (settings.task(&scene), settings.pool()?, maps.clone());
        let estimation = pool.install(|| {
            Estimation::restore(networks.clone(), task, options, estimate, observations, shown)
        });
        let estimation = estimation.map_err(as_damage)?;
        let mut fit = Fit::new(pool.clone(), estimation, meter);
        fit.shared.lock().budget = budget;
        fit.show(maps, correction, body.loss_before, capture.board().and_then(Board::next_view));
        pool.install(|| fit.follow_budget());
        Self::start(scene, settings, networks, capture, pool, fit)
    }
}

/// A capture without photographs, with what was saved of another of the same scene.
fn resumed(fresh: Capture, saved: Capture, resolution: usize) -> Result<Capture> {
    match (fresh, saved) {
        (Capture::Rectified(mut fresh), Capture::Rectified(saved)) => {
            saved.photographs.iter().try_for_each(|p| check::observation(p, resolution))?;
            fresh.photographs = saved.photographs;
            Ok(Capture::Rectified(fresh))
        }
        (Capture::Board(fresh), Capture::Board(saved)) => {
            check::board(&fresh, &saved, resolution)?;
            Ok(Capture::Board(Box::new(fresh.resumed(*saved))))
        }
        _ => Err(damaged("the photographs do not match the scene")),
    }
}

#[cfg(test)]
mod tests;
