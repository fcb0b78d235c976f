//! Settings and scene.

use glam::DVec3;

use super::bytes::{Reader, Writer, damaged};
use crate::calibration::{Hole, Target, TargetKind, TopLeft};
use crate::estimate::{Budget, Method};
use crate::geometry::Camera;
use crate::observation::Falloff;
use crate::session::settings::{Driver, RectifiedFalloff, Scene, Settings};
use crate::{Error, Result};

pub(super) fn write_settings(w: &mut Writer, settings: &Settings, budget: &Budget) {
    w.f32s(&settings.sample_mm);
    w.u32(settings.resolution as u32);
    w.u8(match settings.method {
        Method::Deep => 1,
        Method::Classic => 2,
    });
    w.flag(settings.refine);
    w.u32(settings.threads as u32);
    w.option(budget.seconds, Writer::f32);
    w.option(budget.steps, Writer::u32);
    w.flag(budget.stop_when_invisible);
}

pub(super) fn read_settings(mut r: Reader) -> Result<(Settings, Budget)> {
    let settings = Settings {
        sample_mm: [r.f32()?, r.f32()?],
        resolution: r.u32()? as usize,
        method: match r.u8()? {
            1 => Method::Deep,
            2 => Method::Classic,
            other => return Err(damaged(format!("unknown method {other}"))),
        },
        refine: r.flag()?,
        threads: r.u32()? as usize,
        memory_limit_bytes: None,
        driver: Driver::Thread,
    };
    let budget = Budget {
        seconds: r.option(Reader::f32)?,
        steps: r.option(Reader::u32)?,
        stop_when_invisible: r.flag()?,
    };
    r.end()?;
    settings.check().and_then(|()| budget.check()).map_err(as_damage)?;
    Ok((settings, budget))
}

/// What a caller's argument would be at fault for is damage here.
pub(super) fn as_damage(fault: Error) -> Error {
    match fault {
        Error::Argument { argument, message } => damaged(format!("{argument}: {message}")),
        other => other,
    }
}

pub(super) fn write(w: &mut Writer, scene: &Scene) {
    match scene {
        Scene::Board { target, camera, flash_offset_mm, elevation_mm } => {
            w.u8(1);
            write_target(w, target);
            w.option(*camera, |w, c| write_camera(w, &c));
            w.option(*flash_offset_mm, |w, v| w.f64s(&v.to_array()));
            w.option(*elevation_mm, Writer::f64);
        }
        Scene::Rectified { falloff } => {
            w.u8(2);
            let (kind, power) = match *falloff {
                RectifiedFalloff::InverseSquareAuto => (1, [0.0; 3]),
                RectifiedFalloff::Given(Falloff::InverseSquare { power_mm2 }) => (2, power_mm2),
                RectifiedFalloff::Given(Falloff::None { power }) => (3, power),
            };
            w.u8(kind);
            w.f32s(&power);
        }
    }
}

pub(super) fn read(mut r: Reader) -> Result<Scene> {
    let scene = match r.u8()? {
        1 => {
            let target = read_target(&mut r)?;
            let camera = r.option(read_camera)?;
            let flash_offset_mm = r.option(|r| r.f64s().map(DVec3::from_array))?;
            let elevation_mm = r.option(Reader::f64)?;
            Scene::Board { target, camera, flash_offset_mm, elevation_mm }
        }
        2 => {
            let (kind, power) = (r.u8()?, r.three_f32s()?);
            let falloff = match kind {
                1 => RectifiedFalloff::InverseSquareAuto,
                2 => RectifiedFalloff::Given(Falloff::InverseSquare { power_mm2: power }),
                3 => RectifiedFalloff::Given(Falloff::None { power }),
                other => return Err(damaged(format!("unknown fall-off {other}"))),
            };
            Scene::Rectified { falloff }
        }
        other => return Err(damaged(format!("unknown scene {other}"))),
    };
    r.end()?;
    Ok(scene)
}

fn write_target(w: &mut Writer, target: &Target) {
    match &target.kind {
        TargetKind::CheckerboardRing => w.u8(1),
        TargetKind::CharucoRing { dictionary, marker_mm } => {
            w.u8(2);
            w.text(dictionary);
            w.f64(*marker_mm);
        }
    }
    w.u32(target.rows);
    w.u32(target.cols);
    let Hole { row_start, col_start, row_end, col_end } = target.hole;
    [row_start, col_start, row_end, col_end].into_iter().for_each(|v| w.u32(v));
    w.f64s(&[target.square_mm, target.white_albedo, target.black_albedo]);
    w.flag(target.top_left == TopLeft::White);
    w.flag(target.patches);
}

fn read_target(r: &mut Reader) -> Result<Target> {
    let kind = match r.u8()? {
        1 => TargetKind::CheckerboardRing,
        2 => TargetKind::CharucoRing { dictionary: r.text()?, marker_mm: r.f64()? },
        other => return Err(damaged(format!("unknown board {other}"))),
    };
    let (rows, cols) = (r.u32()?, r.u32()?);
    let hole =
        Hole { row_start: r.u32()?, col_start: r.u32()?, row_end: r.u32()?, col_end: r.u32()? };
    let [square_mm, white_albedo, black_albedo] = r.f64s()?;
    let top_left = if r.flag()? { TopLeft::White } else { TopLeft::Black };
    let patches = r.flag()?;
    let target =
        Target { kind, rows, cols, square_mm, hole, white_albedo, black_albedo, top_left, patches };
    match target.fault() {
        Some((field, _)) => Err(damaged(format!("board: {field} is out of range"))),
        None => Ok(target),
    }
}

pub(super) fn write_camera(w: &mut Writer, camera: &Camera) {
    w.u32(camera.width);
    w.u32(camera.height);
    w.f64s(&[camera.fx, camera.fy, camera.cx, camera.cy]);
    w.f64s(&camera.distortion);
}

pub(super) fn read_camera(r: &mut Reader) -> Result<Camera> {
    let (width, height) = (r.u32()?, r.u32()?);
    let [fx, fy, cx, cy] = r.f64s()?;
    let camera = Camera { width, height, fx, fy, cx, cy, distortion: r.f64s()? };
    match camera.fault() {
        Some((field, _)) => Err(damaged(format!("camera: {field} is out of range"))),
        None => Ok(camera),
    }
}
