//! A session as bytes, to go on with later or elsewhere.
//!
//! Stored: settings and scene, what is known of camera and light with what it was measured on
//! (corners, squares, and the photographs' parts that may be rectified again), every rectified
//! photograph, the maps, and the estimate in progress, all to the bit; the board's photographs as half
//! floats.

pub(super) mod bytes;
mod estimation;
mod intake;
mod scene;

use std::sync::Arc;

pub(super) use bytes::StateWriter;
use bytes::{Sections, damaged};
pub(super) use estimation::{SavedProgress, write as write_estimation};

use super::intake::Intake;
use super::settings::{Scene, Settings};
use crate::Result;
use crate::estimate::{Budget, EstimateOptions, Estimation};
use crate::initial_estimate::Networks;
use crate::threads::Pool;

/// Adds what the caller's side of a session holds.
pub(super) fn write_session(
    state: &mut StateWriter,
    settings: &Settings,
    scene: &Scene,
    budget: &Budget,
    intake: &Intake,
) {
    state.section(b"SETT", |w| scene::write_settings(w, settings, budget));
    state.section(b"SCEN", |w| scene::write(w, scene));
    intake::write(state, intake);
}

/// A session read back.
pub(super) struct Restored {
    pub(super) settings: Settings,
    pub(super) scene: Scene,
    pub(super) budget: Budget,
    pub(super) intake: Intake,
    pub(super) estimation: Estimation,
    pub(super) progress: SavedProgress,
    pub(super) pool: Arc<Pool>,
}

/// Reads a saved session. `prepare` looks at the settings and the number of photographs and makes
/// the threads to work on.
pub(super) fn read(
    bytes: &[u8],
    networks: &Arc<Networks>,
    prepare: impl FnOnce(&mut Settings, usize) -> Result<Arc<Pool>>,
) -> Result<Restored> {
    let sections = Sections::read(bytes)?;
    let (mut settings, budget) = scene::read_settings(sections.one(b"SETT")?)?;
    let scene = scene::read(sections.one(b"SCEN")?)?;
    let pool = prepare(&mut settings, sections.all(estimation::OBSERVATION).count())?;
    let intake = intake::read(&sections, &scene)?;
    let task = settings.task(&scene);
    let (estimation, progress) = pool.install(|| {
        estimation::read(&sections, networks, task, settings.resolution, EstimateOptions::default())
    })?;
    if let Intake::Board(board) = &intake
        && board.poses().len() != estimation.frames()
    {
        return Err(damaged("photographs are missing"));
    }
    Ok(Restored { settings, scene, budget, intake, estimation, progress, pool })
}

#[cfg(test)]
mod tests;
