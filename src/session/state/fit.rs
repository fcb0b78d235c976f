//! The fit: photographs, maps, code.

use std::collections::VecDeque;
use std::sync::Arc;

use super::bytes::{Reader, Sections, StateWriter, Tag, Writer};
use super::damaged;
use super::scene::as_damage;
use crate::initial_estimate::Networks;
use crate::latent_fit::{FitOptions, LatentFit, SavedFit, SavedLevel, SavedStage};
use crate::light_refinement::{Correction, MOST_MIRRORED};
use crate::network::Workspace;
use crate::observation::{Falloff, Observation, View};
use crate::session::fit::{Cut, Fit, NewFrame, Stage};
use crate::session::{Method, Settings};
use crate::svbrdf::CHANNELS;
use crate::{Result, Svbrdf};

const FIT: &Tag = b"FIT ";
const LATENT: &Tag = b"LATN";
const MAPS: &Tag = b"MAPS";
/// One for each photograph.
pub(super) const OBSERVATION: &Tag = b"OBSV";

/// Longest side of maps and photographs believed, texels.
const MAX_SIDE: u32 = 4096;

/// Progress beside the fit itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::session) struct SavedProgress {
    pub(in crate::session) loss_before: f32,
    pub(in crate::session) fraction: f32,
    /// Spent on the latest photograph.
    pub(in crate::session) seconds: f32,
    pub(in crate::session) steps: u32,
}

/// Adds a fit and photographs that it has not taken over yet. The fit's maps are up to date.
pub(in crate::session) fn write(
    state: &mut StateWriter,
    fit: &Fit,
    pending: &VecDeque<NewFrame>,
    progress: &SavedProgress,
) {
    let count = fit.observations.len() + pending.len();
    // With a photograph waiting, the next step is the first one with it.
    let stage = match (pending.is_empty(), fit.method) {
        (true, _) => fit.stage,
        (false, Method::Deep) => Stage::Latent,
        (false, Method::Classic) => Stage::Classic,
    };
    let progress = match pending.is_empty() {
        true => *progress,
        false => SavedProgress { loss_before: fit.loss(), fraction: 0.0, seconds: 0.0, steps: 0 },
    };
    state.section(FIT, |w| {
        w.u32(count as u32);
        w.u8(match stage {
            Stage::Latent => 1,
            Stage::Refine => 2,
            Stage::Classic => 3,
            Stage::Done => 4,
        });
        w.flag(fit.propagated);
        w.u8(match fit.cut {
            None => 0,
            Some(Cut::Budget) => 1,
            Some(Cut::Invisible) => 2,
        });
        w.f32s(&[fit.loss(), progress.loss_before, progress.fraction, progress.seconds]);
        w.u32(progress.steps);
        w.u32(fit.steps_at_level);
        w.f64(fit.correction.ambient);
        w.u32(fit.correction.turns.len() as u32);
        fit.correction.turns.iter().for_each(|turn| w.f64s(turn));
        w.u32(fit.correction.mirrored.len() as u32);
        w.f64s(&fit.correction.mirrored);
    });
    if let Ok(maps) = fit.maps() {
        state.section(MAPS, |w| {
            write_size(w, &maps);
            w.f32s(maps.planes());
        });
    }
    if let Some(latent) = &fit.latent {
        let mut saved = latent.save();
        if !pending.is_empty() {
            let before = if latent.is_settled() { 0 } else { saved.fresh };
            (saved.current, saved.done, saved.fresh) = (0, 0, before + pending.len());
        }
        let probe = probe(&fit.networks);
        state.section(LATENT, |w| {
            w.u32(probe.len() as u32);
            w.f32s(&probe);
            write_latent(w, &saved);
        });
    }
    for (index, observation) in fit.observations.iter().enumerate() {
        let updates = || pending.iter().flat_map(|f| &f.updates).filter(|u| u.index() == index);
        let given = fit.given.get(index).filter(|_| fit.free_lights);
        if updates().next().is_none() {
            state.section(OBSERVATION, |w| write_observation(w, observation, given));
            continue;
        }
        let mut updated = observation.clone();
        updates().for_each(|u| u.apply(&mut updated));
        state.section(OBSERVATION, |w| write_observation(w, &updated, given));
    }
    for (i, frame) in pending.iter().enumerate() {
        let index = fit.observations.len() + i;
        let mut updated = frame.observation.clone();
        let later = pending.iter().skip(i + 1).flat_map(|f| &f.updates);
        later.filter(|u| u.index() == index).for_each(|u| u.apply(&mut updated));
        let given = fit.free_lights.then_some(updated.view);
        if let Some(given) = &given {
            updated.view = fit.correction.apply(given, index);
        }
        state.section(OBSERVATION, |w| write_observation(w, &updated, given.as_ref()));
    }
}

pub(super) fn read(
    sections: &Sections,
    networks: &Arc<Networks>,
    settings: &Settings,
) -> Result<(Fit, SavedProgress)> {
    let mut r = sections.one(FIT)?;
    let count = r.u32()? as usize;
    let stage = match r.u8()? {
        1 => Stage::Latent,
        2 => Stage::Refine,
        3 => Stage::Classic,
        4 => Stage::Done,
        other => return Err(damaged(format!("stage {other}"))),
    };
    let propagated = r.flag()?;
    let cut = match r.u8()? {
        0 => None,
        1 => Some(Cut::Budget),
        2 => Some(Cut::Invisible),
        other => return Err(damaged(format!("end {other}"))),
    };
    let (loss, loss_before, fraction) = (r.f32()?, r.f32()?, r.f32()?.clamp(0.0, 1.0));
    let progress =
        SavedProgress { loss_before, fraction, seconds: r.f32()?.max(0.0), steps: r.u32()? };
    let steps_at_level = r.u32()?;
    let ambient = r.f64()?;
    let turns = r.count(16)?;
    let turns = (0..turns).map(|_| r.f64s()).collect::<Result<_>>()?;
    // Version 1.0 ended here.
    let mirrored = if r.is_empty() { 0 } else { r.count(8)? };
    let mirrored = (0..mirrored).map(|_| Ok(r.f64()?.clamp(-MOST_MIRRORED, MOST_MIRRORED)));
    let mirrored = mirrored.collect::<Result<_>>()?;
    let correction = Correction { turns, ambient, mirrored };
    r.end()?;
    let size = settings.resolution;
    let (mut observations, mut views) = (Vec::new(), Vec::new());
    for r in sections.all(OBSERVATION) {
        let (mut observation, given) = read_observation(r)?;
        if (observation.width(), observation.height()) != (size, size) {
            return Err(damaged("a photograph is not of the session's resolution"));
        }
        views.push(given.unwrap_or(observation.view));
        observation.view.mirrored =
            correction.apply(&observation.view, observations.len()).mirrored;
        observations.push(observation);
    }
    let maps = sections.all(MAPS).next().map(read_maps).transpose()?;
    let latent = sections.all(LATENT).next();
    let latent = latent.map(|r| read_latent(r, networks, &observations)).transpose()?;
    let deep = settings.method == Method::Deep;
    let stage_fits = match stage {
        Stage::Latent | Stage::Refine => deep,
        Stage::Classic => !deep,
        Stage::Done => true,
    };
    let maps_fit = maps.as_ref().is_some_and(|m| (m.width(), m.height()) == (size, size));
    let begun = count > 0;
    if observations.len() != count
        || !stage_fits
        || maps_fit != begun
        || (!begun && stage != Stage::Done)
        || latent.is_some() != (begun && deep)
    {
        return Err(damaged("photographs, maps and fit do not fit each other"));
    }
    let mut fit = Fit::new(networks.clone(), settings);
    (fit.given, fit.correction) = (views, correction);
    fit.observations = observations;
    (fit.maps, fit.latent) = (maps, latent);
    (fit.stage, fit.propagated, fit.cut) = (stage, propagated, cut);
    (fit.loss, fit.steps_at_level) = (loss, steps_at_level);
    Ok((fit, progress))
}

fn write_size(w: &mut Writer, maps: &Svbrdf) {
    w.u32(maps.width() as u32);
    w.u32(maps.height() as u32);
}

fn read_size(r: &mut Reader) -> Result<(usize, usize)> {
    let (width, height) = (r.u32()?, r.u32()?);
    if (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height) {
        return Ok((width as usize, height as usize));
    }
    Err(damaged(format!("{width}x{height} texels")))
}

fn read_maps(mut r: Reader) -> Result<Svbrdf> {
    let (width, height) = read_size(&mut r)?;
    let planes = r.f32s(CHANNELS * width * height)?;
    r.end()?;
    clamped(width, height, planes)
}

fn clamped(width: usize, height: usize, planes: Vec<f32>) -> Result<Svbrdf> {
    let mut maps = Svbrdf::from_planes(width, height, planes).map_err(as_damage)?;
    maps.clamp();
    Ok(maps)
}

/// Maps as half floats.
fn write_coarse(w: &mut Writer, maps: &Svbrdf) {
    write_size(w, maps);
    w.halves(maps.planes());
}

fn read_coarse(r: &mut Reader) -> Result<Svbrdf> {
    let (width, height) = read_size(r)?;
    let planes = r.halves(CHANNELS * width * height)?;
    clamped(width, height, planes)
}

fn write_latent(w: &mut Writer, saved: &SavedFit) {
    w.u32(saved.current as u32);
    w.u32(saved.done as u32);
    w.u32(saved.fresh as u32);
    w.f64(saved.loss);
    w.u32(saved.stages.len() as u32);
    for stage in &saved.stages {
        w.option(stage.level.as_ref(), |w, level| {
            w.u32(level.code.len() as u32);
            w.f32s(&level.code);
            w.f32s(&level.moments[0]);
            w.f32s(&level.moments[1]);
            w.i32(level.steps);
            w.u32(level.anchor.len() as u32);
            w.halves(&level.anchor);
            w.f32(level.deviation);
            write_coarse(w, &level.maps);
        });
        w.option(stage.carried.as_ref(), write_coarse);
    }
}

fn read_latent(
    mut r: Reader,
    networks: &Arc<Networks>,
    observations: &[Observation],
) -> Result<LatentFit> {
    let count = r.count(4)?;
    let same_networks = same(&r.f32s(count)?, &probe(networks));
    let [current, done, fresh] = [r.u32()?, r.u32()?, r.u32()?].map(|n| n as usize);
    let loss = r.any_f64()?;
    let count = r.count(2)?;
    let stages = (0..count).map(|_| read_stage(&mut r)).collect::<Result<_>>()?;
    r.end()?;
    let saved = SavedFit { current, done, fresh, loss, stages };
    LatentFit::restore(networks.clone(), saved, observations, same_networks, FitOptions::default())
        .map_err(as_damage)
}

fn read_stage(r: &mut Reader) -> Result<SavedStage> {
    let level = r.option(|r| {
        let count = r.count(12)?;
        let (code, moments) = (r.f32s(count)?, [r.f32s(count)?, r.f32s(count)?]);
        if moments[1].iter().any(|v| *v < 0.0) {
            return Err(damaged("a mean square is negative"));
        }
        let steps = r.i32()?.max(0);
        let count = r.count(2)?;
        let (anchor, deviation) = (r.halves(count)?, r.f32()?);
        Ok(SavedLevel { code, moments, steps, anchor, deviation, maps: read_coarse(r)? })
    })?;
    Ok(SavedStage { level, carried: r.option(read_coarse)? })
}

/// A photograph, and its view before lights were corrected.
fn write_observation(w: &mut Writer, observation: &Observation, given: Option<&View>) {
    w.u32(observation.width() as u32);
    w.u32(observation.height() as u32);
    write_view(w, &observation.view);
    w.option(given, write_view);
    w.packed(observation.packed());
}

fn read_observation(mut r: Reader) -> Result<(Observation, Option<View>)> {
    let (width, height) = read_size(&mut r)?;
    let view = read_view(&mut r)?;
    let given = r.option(read_view)?;
    let packed = r.packed(3 * width * height)?;
    r.end()?;
    Ok((Observation::from_packed(width, height, view, packed), given))
}

fn write_view(w: &mut Writer, view: &View) {
    w.f32s(&view.sample_mm);
    w.f32s(&view.camera_mm);
    w.f32s(&view.light_mm);
    let (kind, power) = match view.falloff {
        Falloff::None { power } => (1, power),
        Falloff::InverseSquare { power_mm2 } => (2, power_mm2),
    };
    w.u8(kind);
    w.f32s(&power);
    w.f32s(&view.ambient);
}

fn read_view(r: &mut Reader) -> Result<View> {
    let sample_mm = [r.f32()?, r.f32()?];
    let (camera_mm, light_mm) = (r.three_f32s()?, r.three_f32s()?);
    let (kind, power) = (r.u8()?, r.three_f32s()?);
    let falloff = match kind {
        1 => Falloff::None { power },
        2 => Falloff::InverseSquare { power_mm2: power },
        other => return Err(damaged(format!("falloff {other}"))),
    };
    let ambient = r.three_f32s()?;
    if sample_mm.iter().chain(&power).any(|v| *v <= 0.0) || camera_mm[2] <= 0.0 {
        return Err(damaged("a photograph's view is none"));
    }
    Ok(View { sample_mm, camera_mm, light_mm, falloff, ambient, mirrored: 1.0 })
}

/// What a decoder makes of a certain code: codes of one decoder mean nothing to another.
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
