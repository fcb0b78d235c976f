//! Saves a session as bytes and restores it.
//!
//! The bytes hold settings and scene, the measurements in the photographs, the kept pixels, the rectified photographs,
//! the latest maps, and the maps of the latent code. A restored session repeats a fit in progress.

mod check;
mod format;

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::format::{as_damage, damaged};
use super::capture::{Board, Capture, Rectified, Wanted};
use super::fit::Fit;
use super::settings::Settings;
use super::{RestoreOptions, Session, events, memory};
use crate::Result;
use crate::estimate::{EstimateOptions, Estimation, Meter, SavedEstimate};
use crate::networks::Networks;
use crate::scene::Scene;
use crate::threads::lock;

/// Largest number of threads of a restored session.
const MAX_THREADS: usize = 64;

/// The saved part of a session; the rest follows from it.
#[derive(Serialize, Deserialize)]
struct Saved<'a> {
    settings: Cow<'a, Settings>,
    scene: Cow<'a, Scene>,
    capture: Cow<'a, Capture>,
    /// The fit's photographs. Rectified again from the kept pixels, they would differ by rounding errors.
    rectified: Vec<Rectified>,
    estimate: SavedEstimate,
    meter: Meter,
    loss_before: f32,
}

impl Session {
    /// The session as bytes: settings, measurements in the photographs, rectified photographs, and maps.
    /// [`Session::restore`] continues from the maps. It repeats a fit in progress, whose maps then differ by far less
    /// than their stated deviations.
    ///
    /// Waits for a photograph that is being added and for a step of the fit, not for the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn save(&self) -> Result<Vec<u8>> {
        // Fit and record must have the same photographs.
        let _intake = lock(&self.intake);
        let (settings, scene) = (self.settings.clone(), self.scene.clone());
        let capture = self.capture();
        self.fit.ask(move |fit| {
            let rectified = (0..capture.wanted().len()).map(|index| fit.rectified(index));
            format::write(&Saved {
                settings: Cow::Owned(settings),
                scene: Cow::Owned(scene),
                capture: Cow::Borrowed(&*capture),
                rectified: rectified.collect(),
                estimate: fit.estimation.save(),
                meter: fit.meter(),
                loss_before: fit.shared.lock().progress.loss_before,
            })
        })
    }

    /// Continues a session that [`Session::save`] wrote. The networks may differ from those of the saved session: the
    /// maps stay, and the fit continues from them.
    ///
    /// # Errors
    /// [`Error::State`](crate::Error::State) when the bytes are damaged or of a newer version;
    /// [`Error::MemoryLimit`](crate::Error::MemoryLimit).
    pub fn restore(saved: &[u8], networks: Arc<Networks>, options: RestoreOptions) -> Result<Self> {
        let saved = format::read::<Saved>(format::content(saved)?)?;
        let Saved { settings, scene, capture, rectified, estimate, meter, loss_before } = saved;
        let (mut settings, scene) = (settings.into_owned(), scene.into_owned());
        settings.check().map_err(as_damage)?;
        check::scene(&scene)?;
        settings.threads = options.threads.unwrap_or(settings.threads).min(MAX_THREADS);
        settings.memory_limit_bytes = options.memory_limit_bytes;
        settings.driver = options.driver;
        let fresh = Capture::new(scene.clone(), &settings).map_err(as_damage)?;
        let capture = resumed(fresh, capture.into_owned())?;
        let wanted = capture.wanted();
        let kept = capture.board().map_or(0, Board::kept_bytes);
        memory::check(&settings, wanted.len().max(1), kept)?;
        if wanted.len() != rectified.len() {
            return Err(damaged("photographs are missing"));
        }
        meter.budget.check().map_err(as_damage)?;
        if !loss_before.is_finite() {
            return Err(damaged("progress is not a number"));
        }
        let (task, pool, maps) = (settings.task(&scene), settings.pool()?, estimate.maps.clone());
        let (estimation, made) = pool.install(|| {
            let each = wanted.iter().zip(rectified);
            let each = each.map(|(wanted, saved)| checked(wanted, saved, &settings));
            let each = each.map(|made| made.map(|made| (made.observation, made.conditions)));
            let (observations, made): (Vec<_>, Vec<_>) =
                each.collect::<Result<Vec<_>>>()?.into_iter().unzip();
            let options = EstimateOptions::default();
            let estimation =
                Estimation::restore(networks.clone(), task, options, estimate, observations);
            Ok((estimation.map_err(as_damage)?, made))
        })?;
        let budget = meter.budget;
        let fit = Fit::new(pool.clone(), estimation, made, meter);
        fit.shared.lock().budget = budget;
        let correction = fit.estimation.light_correction().clone();
        fit.show(maps, correction, loss_before, capture.board().and_then(Board::next_view));
        let session = Self::start(scene, settings, networks, capture, pool, fit)?;
        events::restored(session.progress().photos);
        Ok(session)
    }
}

/// A saved rectified photograph, after checks, with the view of the record.
fn checked(wanted: &Wanted, mut saved: Rectified, settings: &Settings) -> Result<Rectified> {
    check::rectified(&saved, wanted, [settings.resolution; 2])?;
    if let Wanted::Given(view) = wanted {
        saved.observation.view = *view;
    }
    Ok(saved)
}

/// A capture of a scene with the photographs of a saved one.
fn resumed(fresh: Capture, saved: Capture) -> Result<Capture> {
    match (fresh, saved) {
        (Capture::Given(fresh), Capture::Given(saved)) => {
            check::given(&saved)?;
            Ok(Capture::Given(fresh.resumed(saved)))
        }
        (Capture::Board(fresh), Capture::Board(saved)) => {
            check::board(&fresh, &saved)?;
            Ok(Capture::Board(Box::new(fresh.resumed(*saved))))
        }
        _ => Err(damaged("the photographs do not match the scene")),
    }
}

#[cfg(test)]
mod tests;
