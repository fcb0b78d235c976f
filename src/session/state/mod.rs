//! A session as bytes, to go on with later or elsewhere.
//!
//! Stored: settings and scene, what is known of camera and light with what it was measured on
//! (corners, squares, and the photographs' parts that may be rectified again), every rectified
//! photograph, the maps, and the estimate in progress, all to the bit.

pub(super) mod bytes;
mod estimation;
mod intake;
mod scene;

use std::sync::Arc;

use self::bytes::{Sections, StateWriter};
use self::estimation::SavedProgress;
use super::fit::{Fit, Shared};
use super::reports::Progress;
use super::{RestoreOptions, Session, memory};
use crate::Result;
use crate::estimate::{EstimateOptions, Meter};
use crate::initial_estimate::Networks;

/// Most threads a saved session may ask for.
const MAX_THREADS: usize = 64;

impl Session {
    /// The session as bytes: settings, scene, budget, what is known of camera and light, the
    /// photographs as far as they are needed, the maps, and the state of the fit. [`Session::restore`]
    /// continues in the same phase, to the same bits.
    ///
    /// Waits for a push in progress and for a step of the fit, not for the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn save(&self) -> Result<Vec<u8>> {
        // No photograph may come between what the fit and the capture know.
        let capture = self.capture();
        self.fit.shared.usable()?;
        let mut state = StateWriter::new();
        let budget = self.fit.shared.lock().budget;
        state.section(b"SETT", |w| scene::write_settings(w, &self.settings, &budget));
        state.section(b"SCEN", |w| scene::write(w, &self.scene));
        intake::write(&mut state, &capture);
        self.fit.ask(move |fit| {
            let loss_before = fit.shared.lock().progress.loss_before;
            let (seconds, steps) = (fit.meter.elapsed().as_secs_f32(), fit.meter.steps());
            let progress = SavedProgress { loss_before, seconds, steps };
            estimation::write(&mut state, &fit.estimation, &progress);
            Ok(state.finish())
        })
    }

    /// Continues a session that [`Session::save`] wrote, with these networks. They may be others than
    /// before: the maps stay, and the fit continues from them.
    ///
    /// # Errors
    /// [`Error::State`](crate::Error::State) when the bytes are not what was written or of a newer major
    /// version, [`Error::MemoryLimit`](crate::Error::MemoryLimit).
    pub fn restore(saved: &[u8], networks: Arc<Networks>, options: RestoreOptions) -> Result<Self> {
        let sections = Sections::read(saved)?;
        let (mut settings, budget) = scene::read_settings(sections.one(b"SETT")?)?;
        let scene = scene::read(sections.one(b"SCEN")?)?;
        settings.threads = options.threads.unwrap_or(settings.threads).min(MAX_THREADS);
        settings.memory_limit_bytes = options.memory_limit_bytes;
        settings.driver = options.driver;
        let frames = sections.all(estimation::OBSERVATION).count();
        memory::check(&settings, frames.max(1), 0)?;
        let pool = settings.pool()?;
        let (task, size) = (settings.task(&scene), settings.resolution);
        let (estimation, observations, progress) = pool.install(|| {
            estimation::read(&sections, &networks, task, size, EstimateOptions::default())
        })?;
        let capture = intake::read(&sections, &scene, &settings, observations)?;
        let meter = Meter::new(budget, progress.seconds, progress.steps);
        let restored_maps = pool.install(|| estimation.maps()).ok();
        let shared = Shared::new();
        {
            let mut state = shared.lock();
            state.budget = budget;
            state.cut = estimation.is_cut();
            state.fitted = estimation.frames();
            state.progress = Progress {
                frames: estimation.frames(),
                fraction: estimation.fraction(),
                loss_before: progress.loss_before,
                loss: estimation.loss(),
                seconds_left: None,
                settled: estimation.is_done(),
                phase: None,
            };
            if let Some(maps) = restored_maps {
                state.publish(Arc::new(maps));
                state.exposure = estimation.exposure().clone();
            }
        }
        let fit = Fit::new(Arc::new(shared), pool.clone(), estimation, meter);
        Self::start(scene, settings, networks, capture, pool, fit)
    }
}

#[cfg(test)]
mod tests;
