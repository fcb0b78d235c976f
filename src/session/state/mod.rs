//! A session as bytes, to go on with later or elsewhere.
//!
//! Stored: settings and scene, what is known of camera and light with what it was measured on
//! (corners, squares, and the photographs' parts that may be rectified again), every rectified
//! photograph (half floats), the maps, and code and moments of the fit. Numbers that only steer are
//! stored as they are, planes of which nothing but a rounding of 1/2048 is lost as half floats.

pub(super) mod bytes;
mod fit;
mod intake;
mod scene;

use std::sync::Arc;

use rayon::ThreadPool;

pub(super) use bytes::StateWriter;
use bytes::{Sections, damaged};
pub(super) use fit::{SavedProgress, write as write_fit};

use super::budget::Budget;
use super::fit::Fit;
use super::intake::Intake;
use super::settings::{Scene, Settings};
use crate::Result;
use crate::initial_estimate::Networks;

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
    pub(super) fit: Fit,
    pub(super) progress: SavedProgress,
    pub(super) pool: Arc<ThreadPool>,
}

/// Reads a saved session. `prepare` looks at the settings and the number of photographs and makes
/// the threads to work on.
pub(super) fn read(
    bytes: &[u8],
    networks: &Arc<Networks>,
    prepare: impl FnOnce(&mut Settings, usize) -> Result<Arc<ThreadPool>>,
) -> Result<Restored> {
    let sections = Sections::read(bytes)?;
    let (mut settings, budget) = scene::read_settings(sections.one(b"SETT")?)?;
    let scene = scene::read(sections.one(b"SCEN")?)?;
    let pool = prepare(&mut settings, sections.all(fit::OBSERVATION).count())?;
    let intake = intake::read(&sections, &scene)?;
    let (fit, progress) = pool.install(|| fit::read(&sections, networks, &settings))?;
    if let Intake::Board(board) = &intake
        && board.poses().len() != fit.frames()
    {
        return Err(damaged("photographs are missing"));
    }
    Ok(Restored { settings, scene, budget, intake, fit, progress, pool })
}

#[cfg(test)]
mod tests;
