//! The estimate: photographs, maps, belief, code, and the part in progress.

use std::borrow::Cow;
use std::sync::Arc;

use super::bytes::{Reader, Sections, StateWriter, Tag, Writer, damaged};
use super::scene::as_damage;
use crate::estimate::saved::{
    Adam, Belief, Correction, Cut, Exposure, LatentPosition, MAX_MIRRORED, Noise, Offset, Part,
    Position, Prior, Progress, SavedBaseline, SavedCode, SavedDescent, SavedEstimation, SavedFit,
    SavedLights, SavedWork, SolverState, State, Trend,
};
use crate::estimate::{EstimateOptions, Estimation, Task};
use crate::initial_estimate::Networks;
use crate::network::Workspace;
use crate::observation::{Falloff, Observation, View};
use crate::svbrdf::CHANNELS;
use crate::{Result, Svbrdf};

const ESTIMATION: &Tag = b"ESTM";
const BELIEF: &Tag = b"BELF";
const WORK: &Tag = b"WORK";
const LATENT: &Tag = b"LATN";
const MAPS: &Tag = b"MAPS";
/// One for each photograph.
pub(super) const OBSERVATION: &Tag = b"OBSV";

/// Largest logarithm of a gain, and exponent, believed.
const MAX_LOGARITHM: f64 = 20.0;

/// Longest side of maps and photographs believed, texels.
const MAX_SIDE: u32 = 4096;

/// Progress beside the estimate itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::session) struct SavedProgress {
    pub(in crate::session) loss_before: f32,
    /// Spent on the latest photograph.
    pub(in crate::session) seconds: f32,
    pub(in crate::session) steps: u32,
}

/// Adds an estimate.
pub(in crate::session) fn write(
    state: &mut StateWriter,
    estimation: &Estimation,
    progress: &SavedProgress,
) {
    let saved = estimation.save();
    state.section(ESTIMATION, |w| {
        w.u32(saved.photographs.len() as u32);
        w.option(saved.position, |w, at| {
            w.u32(at.row as u32);
            w.u32(at.round as u32);
            w.u8(match at.part {
                Part::Before => 1,
                Part::Phase => 2,
                Part::After => 3,
            });
        });
        w.u8(match saved.cut {
            None => 0,
            Some(Cut::Budget) => 1,
            Some(Cut::Invisible) => 2,
        });
        w.f32s(&[saved.loss, saved.fraction, saved.texel_residual]);
        w.f32s(&[progress.loss_before, progress.seconds]);
        w.u32(progress.steps);
        write_correction(w, saved.photographs.correction());
        write_correction(w, &saved.lights_before);
        w.flag(saved.repeated);
        w.flag(saved.structured);
        w.option(saved.previous.as_deref(), |w, values| {
            w.u32(values.len() as u32);
            w.f32s(values);
        });
        w.option(saved.trend.as_ref(), |w, trend| {
            w.u32(trend.every as u32);
            w.u32(trend.steps as u32);
            w.option(trend.previous, Writer::f64);
        });
    });
    if let Some(maps) = &saved.maps {
        state.section(MAPS, |w| write_maps(w, maps));
    }
    if let Some(belief) = &saved.belief {
        state.section(BELIEF, |w| {
            [&belief.maps, &belief.base, &belief.mean].into_iter().for_each(|m| write_maps(w, m));
            w.f32s(&belief.prior.sigma);
            w.f32s(&belief.found.sigma);
            w.f32(belief.noise);
            w.option(belief.fixed_noise, Writer::f32);
            w.f64s(&belief.offset.0);
        });
    }
    state.section(WORK, |w| write_work(w, &saved.work));
    if let Some(latent) = &saved.latent {
        let probe = probe(estimation.networks());
        state.section(LATENT, |w| {
            w.u32(probe.len() as u32);
            w.f32s(&probe);
            write_latent(w, latent);
        });
    }
    for (observation, given) in saved.photographs.full().iter().zip(saved.photographs.given()) {
        state.section(OBSERVATION, |w| write_observation(w, observation, given));
    }
}

pub(super) fn read(
    sections: &Sections,
    networks: &Arc<Networks>,
    task: Task,
    size: usize,
    options: EstimateOptions,
) -> Result<(Estimation, Vec<Observation>, SavedProgress)> {
    let mut r = sections.one(ESTIMATION)?;
    let count = r.u32()? as usize;
    let position = r.option(read_position)?;
    let cut = match r.u8()? {
        0 => None,
        1 => Some(Cut::Budget),
        2 => Some(Cut::Invisible),
        other => return Err(damaged(format!("end {other}"))),
    };
    let (loss, fraction) = (r.f32()?, r.f32()?.clamp(0.0, 1.0));
    let texel_residual = r.f32()?.max(0.0);
    let progress =
        SavedProgress { loss_before: r.f32()?, seconds: r.f32()?.max(0.0), steps: r.u32()? };
    let (correction, lights_before) = (read_correction(&mut r)?, read_correction(&mut r)?);
    let (repeated, structured) = (r.flag()?, r.flag()?);
    let previous = r.option(|r| {
        let count = r.count(4)?;
        r.f32s(count)
    })?;
    let trend = r.option(|r| {
        let (every, steps) = (r.u32()?.max(1) as usize, r.u32()? as usize);
        Ok(Trend { every, steps, previous: r.option(Reader::f64)? })
    })?;
    r.end()?;
    let mut observations = Vec::new();
    for r in sections.all(OBSERVATION) {
        let observation = read_observation(r)?;
        if (observation.width(), observation.height()) != (size, size) {
            return Err(damaged("a photograph is not of the session's resolution"));
        }
        observations.push(observation);
    }
    if observations.len() != count {
        return Err(damaged("photographs are missing"));
    }
    let photographs = Estimation::no_photographs(&options);
    let photographs = photographs.restored(observations.clone(), correction).map_err(as_damage)?;
    let maps = sections.all(MAPS).next();
    let maps = maps.map(|mut r| read_maps(&mut r).and_then(|m| r.end().map(|()| m))).transpose()?;
    let latent = sections.all(LATENT).next().map(|r| read_latent(r, networks)).transpose()?;
    let same_networks = latent.as_ref().is_none_or(|(same, _)| *same);
    let saved = SavedEstimation {
        photographs: Cow::Owned(photographs),
        latent: latent.map(|(_, latent)| latent),
        belief: sections.all(BELIEF).next().map(read_belief).transpose()?.map(Cow::Owned),
        maps: maps.map(Cow::Owned),
        position,
        work: read_work(sections.one(WORK)?)?,
        loss,
        fraction,
        cut,
        lights_before: Cow::Owned(lights_before),
        repeated,
        structured,
        texel_residual,
        previous: previous.map(Cow::Owned),
        trend,
    };
    let estimation = Estimation::restore(networks.clone(), task, options, saved, same_networks);
    Ok((estimation.map_err(as_damage)?, observations, progress))
}

fn read_position(r: &mut Reader) -> Result<Position> {
    let (row, round) = (r.u32()? as usize, r.u32()? as usize);
    let part = match r.u8()? {
        1 => Part::Before,
        2 => Part::Phase,
        3 => Part::After,
        other => return Err(damaged(format!("part {other}"))),
    };
    Ok(Position { row, round, part })
}

fn write_correction(w: &mut Writer, correction: &Correction) {
    w.f64(correction.ambient);
    w.u32(correction.turns.len() as u32);
    correction.turns.iter().for_each(|turn| w.f64s(turn));
    w.u32(correction.mirrored.len() as u32);
    w.f64s(&correction.mirrored);
    let Exposure { gains, exponent, log_distance, offset_mm } = &correction.exposure;
    w.u32(gains.len() as u32);
    w.f64s(gains);
    w.f64s(&[*exponent, *log_distance]);
    w.f64s(offset_mm);
}

fn read_correction(r: &mut Reader) -> Result<Correction> {
    let ambient = r.f64()?;
    let turns = r.count(16)?;
    let turns = (0..turns).map(|_| r.f64s()).collect::<Result<_>>()?;
    let mirrored = r.count(8)?;
    let mirrored = (0..mirrored).map(|_| Ok(r.f64()?.clamp(-MAX_MIRRORED, MAX_MIRRORED)));
    let mirrored = mirrored.collect::<Result<_>>()?;
    let gains = r.count(8)?;
    let gains = (0..gains).map(|_| Ok(r.f64()?.clamp(-MAX_LOGARITHM, MAX_LOGARITHM)));
    let gains = gains.collect::<Result<_>>()?;
    let [exponent, log_distance] = r.f64s()?;
    let exponent = exponent.clamp(-MAX_LOGARITHM, MAX_LOGARITHM);
    let exposure = Exposure { gains, exponent, log_distance, offset_mm: r.f64s()? };
    Ok(Correction { turns, ambient, mirrored, exposure })
}

fn read_belief(mut r: Reader) -> Result<Belief> {
    let (maps, base, mean) = (read_maps(&mut r)?, read_maps(&mut r)?, read_maps(&mut r)?);
    let mut prior = || -> Result<Prior> {
        let sigma: [f32; CHANNELS] = r.f32s(CHANNELS)?.try_into().expect("as many as asked for");
        Ok(Prior { sigma })
    };
    let (prior, found) = (prior()?, prior()?);
    let (noise, fixed_noise) = (r.f32()?, r.option(Reader::f32)?);
    let offset = Offset(r.f64s()?);
    r.end()?;
    let mut positive = prior.sigma.iter().chain(&found.sigma).chain(&fixed_noise);
    if positive.any(|s| *s <= 0.0) {
        return Err(damaged("a sigma is not positive"));
    }
    Ok(Belief { maps, base, mean, prior, found, noise, fixed_noise, offset })
}

fn write_work(w: &mut Writer, work: &SavedWork) {
    match work {
        SavedWork::Pending => w.u8(0),
        SavedWork::Maps(state) => {
            w.u8(1);
            w.u32(state.steps as u32);
            // not a number before the first step
            w.f64(state.loss);
            w.f32(state.widening);
            state.noise.iter().for_each(|n| w.f32s(&[n.scale, n.huber]));
            w.u32(state.damping.len() as u32);
            w.f32s(&state.damping);
        }
        SavedWork::Lights(lights) => {
            w.u8(2);
            write_descent(w, &lights.free);
            w.option(lights.held.as_ref(), write_descent);
        }
        SavedWork::Widths(errors) => {
            w.u8(5);
            w.u32(errors.len() as u32);
            w.f64s(errors);
        }
        SavedWork::Classes(costs) => {
            w.u8(3);
            w.u32(costs.len() as u32);
            for cost in costs.iter() {
                w.u32(cost.len() as u32);
                w.f32s(cost);
            }
        }
        SavedWork::Baseline(state) => {
            w.u8(4);
            write_adam(w, &state.encoded, &state.adam);
        }
    }
}

fn read_work(mut r: Reader) -> Result<SavedWork<'static>> {
    let work = match r.u8()? {
        0 => SavedWork::Pending,
        1 => {
            let (steps, loss, widening) = (r.u32()? as usize, r.any_f64()?, r.f32()?);
            let mut noise = [Noise { scale: 1.0, huber: 1.0 }; 3];
            for noise in &mut noise {
                *noise = Noise { scale: r.f32()?, huber: r.f32()? };
                if noise.scale <= 0.0 || noise.huber <= 0.0 {
                    return Err(damaged("noise is not positive"));
                }
            }
            let count = r.count(4)?;
            let damping = r.f32s(count)?;
            if widening <= 0.0 {
                return Err(damaged("a width is not positive"));
            }
            SavedWork::Maps(Cow::Owned(SolverState { steps, loss, widening, noise, damping }))
        }
        2 => {
            let (free, held) = (read_descent(&mut r)?, r.option(read_descent)?);
            SavedWork::Lights(SavedLights { free, held })
        }
        3 => {
            let count = r.count(4)?;
            let cost = |_| {
                let count = r.count(4)?;
                r.f32s(count)
            };
            SavedWork::Classes(Cow::Owned((0..count).map(cost).collect::<Result<_>>()?))
        }
        4 => {
            let (encoded, adam) = read_adam(&mut r)?;
            SavedWork::Baseline(Cow::Owned(SavedBaseline { encoded, adam }))
        }
        5 => {
            let count = r.count(8)?;
            let errors = (0..count).map(|_| r.f64());
            SavedWork::Widths(Cow::Owned(errors.collect::<Result<_>>()?))
        }
        other => return Err(damaged(format!("work {other}"))),
    };
    r.end()?;
    Ok(work)
}

fn write_descent(w: &mut Writer, descent: &SavedDescent) {
    let Progress { state, damping, steps, changed, done } = &descent.progress;
    for texels in [&state.deviations, &state.groups] {
        w.u32(texels.len() as u32);
        texels.iter().for_each(|x| w.f64s(x));
    }
    write_correction(w, &state.correction);
    w.f64(*damping);
    w.u32(*steps as u32);
    w.flag(*changed);
    w.flag(*done);
    w.u32(descent.still_steps as u32);
}

fn read_descent(r: &mut Reader) -> Result<SavedDescent> {
    let texels = |r: &mut Reader| -> Result<Vec<[f64; CHANNELS]>> {
        let count = r.count(8 * CHANNELS)?;
        (0..count).map(|_| r.f64s()).collect()
    };
    let (deviations, groups) = (texels(r)?, texels(r)?);
    let state = State { deviations, groups, correction: read_correction(r)? };
    let (damping, steps) = (r.f64()?, r.u32()? as usize);
    let progress = Progress { state, damping, steps, changed: r.flag()?, done: r.flag()? };
    Ok(SavedDescent { progress, still_steps: r.u32()? as usize })
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

fn write_maps(w: &mut Writer, maps: &Svbrdf) {
    write_size(w, maps);
    w.f32s(maps.planes());
}

fn read_maps(r: &mut Reader) -> Result<Svbrdf> {
    let (width, height) = read_size(r)?;
    let planes = r.f32s(CHANNELS * width * height)?;
    let mut maps = Svbrdf::from_planes(width, height, planes).map_err(as_damage)?;
    maps.clamp();
    Ok(maps)
}

fn write_latent(w: &mut Writer, saved: &SavedFit) {
    let SavedFit { position, code } = saved;
    w.u32(position.done as u32);
    w.u32(position.fresh as u32);
    w.f64(position.loss);
    write_adam(w, &code.code, &code.adam);
    w.u32(code.anchor.len() as u32);
    w.f32s(&code.anchor);
    w.f32(code.deviation);
    w.u32(code.detail.len() as u32);
    w.f32s(&code.detail);
    write_maps(w, &code.maps);
    w.flag(code.stale);
}

/// Whether the networks are those of the code, and the fit.
fn read_latent(mut r: Reader, networks: &Arc<Networks>) -> Result<(bool, SavedFit)> {
    let count = r.count(4)?;
    let same_networks = same(&r.f32s(count)?, &probe(networks));
    let [done, fresh] = [r.u32()?, r.u32()?].map(|n| n as usize);
    let position = LatentPosition { done, fresh, loss: r.any_f64()? };
    let code = read_code(&mut r)?;
    r.end()?;
    Ok((same_networks, SavedFit { position, code }))
}

/// Values and their moments.
fn write_adam(w: &mut Writer, values: &[f32], adam: &Adam) {
    w.u32(values.len() as u32);
    [values, &adam.first, &adam.second].into_iter().for_each(|v| w.f32s(v));
    w.i32(adam.steps);
}

fn read_adam(r: &mut Reader) -> Result<(Vec<f32>, Adam)> {
    let count = r.count(12)?;
    let (values, first, second) = (r.f32s(count)?, r.f32s(count)?, r.f32s(count)?);
    if second.iter().any(|v| *v < 0.0) {
        return Err(damaged("a mean square is negative"));
    }
    Ok((values, Adam { first, second, steps: r.i32()?.max(0) }))
}

fn read_code(r: &mut Reader) -> Result<SavedCode> {
    let (code, adam) = read_adam(r)?;
    let count = r.count(4)?;
    let (anchor, deviation) = (r.f32s(count)?, r.f32()?);
    let count = r.count(4)?;
    let detail = r.f32s(count)?;
    let (maps, stale) = (read_maps(r)?, r.flag()?);
    Ok(SavedCode { code, adam, anchor, deviation, detail, maps, stale })
}

/// A photograph with its view before lights were corrected.
fn write_observation(w: &mut Writer, observation: &Observation, given: &View) {
    w.u32(observation.width() as u32);
    w.u32(observation.height() as u32);
    write_view(w, given);
    w.f32(observation.log_sigma);
    w.packed(observation.packed());
}

fn read_observation(mut r: Reader) -> Result<Observation> {
    let (width, height) = read_size(&mut r)?;
    let view = read_view(&mut r)?;
    let log_sigma = r.f32()?;
    if log_sigma < 0.0 {
        return Err(damaged("a standard deviation is negative"));
    }
    let packed = r.packed(3 * width * height)?;
    r.end()?;
    let mut observation = Observation::from_packed(width, height, view, packed);
    observation.log_sigma = log_sigma;
    Ok(observation)
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
    w.f32(view.mirrored);
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
    let (ambient, mirrored) = (r.three_f32s()?, r.f32()?);
    if sample_mm.iter().chain(&power).any(|v| *v <= 0.0) || camera_mm[2] <= 0.0 {
        return Err(damaged("a photograph's view is none"));
    }
    Ok(View { sample_mm, camera_mm, light_mm, falloff, ambient, mirrored })
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
