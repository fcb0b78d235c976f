//! What is known of camera and light, and what it was measured on.

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};

use super::bytes::{Reader, Sections, StateWriter, Tag, Writer, damaged};
use super::scene::{as_damage, read_camera, write_camera};
use crate::Result;
use crate::calibration::photometry::{Lobe, Radiometry, Square, Squares, Vignetting};
use crate::calibration::{CameraEstimate, CameraPrior, Corner, Paper, PaperEstimate};
use crate::frame::{Encoding, MAX_PIXELS, Photo, Stored, ToneCurve};
use crate::geometry::Pose;
use crate::observation::Observation;
use crate::rectification::elevation::{self, ElevationEstimate};
use crate::session::capture::{Board, Capture, Conditions, Measured, Part, Photograph};
use crate::session::settings::{Scene, Settings};

const INTAKE: &Tag = b"INTK";
/// One for each photograph of a board.
const FRAME: &Tag = b"FRAM";
/// Of photographs of a board, as the next.
const PAPER: &Tag = b"PAPR";
const ELEVATION: &Tag = b"ELEV";

pub(super) fn write(state: &mut StateWriter, capture: &Capture) {
    match capture {
        Capture::Rectified(_) => {}
        Capture::Board(board) => {
            state.section(INTAKE, |w| {
                w.option(board.estimate(), |w, estimate| {
                    write_camera(w, &estimate.camera);
                    w.f64s(estimate.covariance.as_flattened());
                    w.f64(estimate.rms_px);
                });
            });
            state.section(PAPER, |w| {
                let PaperEstimate { paper, sigma } = board.paper();
                w.f64s(&[paper.aspect, paper.bow_mm[0], paper.bow_mm[1]]);
                w.f64s(&sigma);
            });
            state.section(ELEVATION, |w| {
                let ElevationEstimate { mm, sigma_mm } = board.elevation();
                w.f64s(&[mm, sigma_mm]);
            });
            for photograph in board.photographs() {
                state.section(FRAME, |w| write_photograph(w, photograph));
            }
        }
    }
}

pub(super) fn read(
    sections: &Sections,
    scene: &Scene,
    settings: &Settings,
    observations: Vec<Observation>,
) -> Result<Capture> {
    let mut capture = Capture::new(scene.clone(), settings).map_err(as_damage)?;
    match &mut capture {
        Capture::Rectified(rectified) => rectified.photographs = observations,
        Capture::Board(board) => {
            let mut r = sections.one(INTAKE)?;
            let paper = read_paper(sections.one(PAPER)?)?;
            let estimate = r.option(|r| {
                let camera = read_camera(r)?;
                let flat: [f64; 81] = r.f64s()?;
                let covariance = std::array::from_fn(|i| std::array::from_fn(|j| flat[9 * i + j]));
                let rms_px = r.f64()?;
                Ok(CameraEstimate { camera, covariance, paper, rms_px, views: Vec::new() })
            })?;
            r.end()?;
            let frames: Vec<Reader> = sections.all(FRAME).collect();
            if frames.len() != observations.len() {
                return Err(damaged("photographs are missing"));
            }
            let photographs = frames.into_iter().zip(observations);
            let photographs = photographs.map(|(r, o)| read_photograph(r, o));
            let photographs = photographs.collect::<Result<Vec<_>>>()?;
            let elevation = read_elevation(sections.one(ELEVATION)?)?;
            resume(board, estimate, paper, elevation, photographs)?;
        }
    }
    Ok(capture)
}

fn resume(
    board: &mut Board,
    estimate: Option<CameraEstimate>,
    paper: PaperEstimate,
    elevation: ElevationEstimate,
    photographs: Vec<Photograph>,
) -> Result<()> {
    let estimated = board.camera().is_none();
    let camera = estimate.as_ref().map(|e| e.camera).or(board.camera());
    let fits = |photograph: &Photograph| {
        (photograph.part.is_some() || !estimated)
            && camera.is_some_and(|c| (c.width, c.height) == photograph.picture_size())
    };
    if estimate.is_some() != (estimated && !photographs.is_empty()) || !photographs.iter().all(fits)
    {
        return Err(damaged("the photographs do not match the camera"));
    }
    board.resume(estimate, paper, elevation, photographs);
    Ok(())
}

fn read_paper(mut r: Reader) -> Result<PaperEstimate> {
    let [aspect, x, y] = r.f64s()?;
    let paper = Paper { aspect, bow_mm: [x, y] };
    let sigma: [f64; 3] = r.f64s()?;
    r.end()?;
    if !paper.is_plausible() || sigma.iter().any(|s| *s < 0.0) {
        return Err(damaged("the shape of the paper is out of range"));
    }
    Ok(PaperEstimate { paper, sigma })
}

fn read_elevation(mut r: Reader) -> Result<ElevationEstimate> {
    let [mm, sigma_mm] = r.f64s()?;
    r.end()?;
    if !elevation::is_possible(mm) || sigma_mm < 0.0 {
        return Err(damaged("the height of the sample is out of range"));
    }
    Ok(ElevationEstimate { mm, sigma_mm })
}

fn write_photograph(w: &mut Writer, photograph: &Photograph) {
    let Measured { corners, prior, squares } = &photograph.measured;
    w.u32(corners.len() as u32);
    for corner in corners {
        w.u32(corner.row);
        w.u32(corner.col);
        w.f64s(&corner.px.to_array());
    }
    write_camera(w, &prior.camera);
    w.f64s(&[prior.focal_sigma, prior.aspect_sigma, prior.centre_sigma_px]);
    w.f64s(&prior.distortion_sigma);
    write_pose(w, &photograph.pose);
    w.f64(photograph.rms_px);
    let Conditions { camera, pose, radiometry, elevation_mm, edge_px } = photograph.made_with();
    write_camera(w, camera);
    write_pose(w, pose);
    write_radiometry(w, radiometry);
    w.f32(squares.exposure);
    w.f32(squares.clipped_share);
    w.u32(squares.squares.len() as u32);
    for square in &squares.squares {
        write_square(w, square);
    }
    w.option(squares.gray, |w, square| write_square(w, &square));
    w.option(photograph.part.as_deref(), |w, part| {
        w.u32(part.corner[0]);
        w.u32(part.corner[1]);
        write_photo(w, &part.photo);
    });
    w.f64(*elevation_mm);
    w.f32(*edge_px);
}

fn write_square(w: &mut Writer, square: &Square) {
    w.flag(square.white);
    w.f64s(&square.board_mm.to_array());
    for value in square.value {
        w.option(value, Writer::f32);
    }
}

fn read_square(r: &mut Reader) -> Result<Square> {
    let (white, board_mm) = (r.flag()?, DVec2::from_array(r.f64s()?));
    let mut value = [None; 3];
    for v in &mut value {
        *v = r.option(Reader::f32)?.filter(|v| *v > 0.0);
    }
    Ok(Square { white, board_mm, value })
}

fn read_photograph(mut r: Reader, observation: Observation) -> Result<Photograph> {
    let count = r.count(24)?;
    let corner = |r: &mut Reader| {
        let (row, col) = (r.u32()?, r.u32()?);
        Ok(Corner { row, col, px: DVec2::from_array(r.f64s()?) })
    };
    let corners = (0..count).map(|_| corner(&mut r)).collect::<Result<_>>()?;
    let prior_camera = read_camera(&mut r)?;
    let [focal_sigma, aspect_sigma, centre_sigma_px] = r.f64s()?;
    let distortion_sigma = r.f64s()?;
    let prior = CameraPrior {
        camera: prior_camera,
        focal_sigma,
        aspect_sigma,
        centre_sigma_px,
        distortion_sigma,
    };
    let (latest, rms_px) = (read_pose(&mut r)?, r.f64()?);
    let (camera, pose, radiometry) =
        (read_camera(&mut r)?, read_pose(&mut r)?, read_radiometry(&mut r)?);
    let squares = read_squares(&mut r)?;
    let part = r.option(|r| {
        let corner = [r.u32()?, r.u32()?];
        let part = Part { photo: read_photo(r)?, corner };
        let inside = |from: u32, count: u32, size: u32| {
            from.checked_add(count).is_some_and(|end| end <= size)
        };
        let photo = &part.photo;
        if inside(corner[0], photo.width(), camera.width)
            && inside(corner[1], photo.height(), camera.height)
        {
            Ok(Arc::new(part))
        } else {
            Err(damaged("a region lies outside its photograph"))
        }
    })?;
    let (elevation_mm, edge_px) = (r.f64()?, r.f32()?);
    r.end()?;
    if !elevation::is_possible(elevation_mm) {
        return Err(damaged("the height of the sample is out of range"));
    }
    if edge_px < 0.0 || radiometry.log_sigma < 0.0 {
        return Err(damaged("a standard deviation is negative"));
    }
    let conditions = Conditions { camera, pose, radiometry, elevation_mm, edge_px };
    let measured = Measured { corners, prior, squares };
    Ok(Photograph::from_saved(measured, (latest, rms_px), part, conditions, observation))
}

fn read_squares(r: &mut Reader) -> Result<Squares> {
    let (exposure, clipped_share) = (r.f32()?, r.f32()?);
    if exposure <= 0.0 {
        return Err(damaged("an exposure is not positive"));
    }
    let count = r.count(20)?;
    let squares = (0..count).map(|_| read_square(r)).collect::<Result<_>>()?;
    let gray = r.option(read_square)?;
    Ok(Squares { squares, gray, exposure, clipped_share })
}

fn write_pose(w: &mut Writer, pose: &Pose) {
    w.f64s(&pose.rotation.to_cols_array());
    w.f64s(&pose.translation.to_array());
}

fn read_pose(r: &mut Reader) -> Result<Pose> {
    let rotation = DMat3::from_cols_array(&r.f64s()?);
    if (rotation * rotation.transpose() - DMat3::IDENTITY)
        .to_cols_array()
        .iter()
        .any(|v| v.abs() > 1e-6)
    {
        return Err(damaged("a rotation is not orthonormal"));
    }
    Ok(Pose { rotation, translation: DVec3::from_array(r.f64s()?) })
}

fn write_radiometry(w: &mut Writer, radiometry: &Radiometry) {
    w.f64s(&radiometry.gain);
    w.f64s(&radiometry.tone.log_slopes);
    w.f32(radiometry.tone.unknown_from);
    w.f64s(&[radiometry.vignetting.exponent, radiometry.vignetting.curvature]);
    w.f64(radiometry.lobe.exponent);
    w.f64s(&radiometry.lobe.pattern);
    w.f64s(&radiometry.flash_offset_mm.to_array());
    w.f32s(&radiometry.power_mm2);
    w.f32s(&radiometry.ambient);
    w.f32(radiometry.log_sigma);
}

fn read_radiometry(r: &mut Reader) -> Result<Radiometry> {
    let gain = r.f64s()?;
    let tone = ToneCurve { log_slopes: r.f64s()?, unknown_from: r.f32()? };
    let [exponent, curvature] = r.f64s()?;
    let radiometry = Radiometry {
        gain,
        tone,
        vignetting: Vignetting { exponent, curvature },
        lobe: Lobe { exponent: r.f64()?, pattern: r.f64s()? },
        flash_offset_mm: DVec3::from_array(r.f64s()?),
        power_mm2: r.three_f32s()?,
        ambient: r.three_f32s()?,
        log_sigma: r.f32()?,
    };
    if gain.iter().any(|g| *g <= 0.0) || radiometry.power_mm2.iter().any(|p| *p <= 0.0) {
        return Err(damaged("the gain or power of a light is not positive"));
    }
    if !tone.is_plausible() {
        return Err(damaged("a tone curve is out of range"));
    }
    Ok(radiometry)
}

fn write_photo(w: &mut Writer, photo: &Photo) {
    w.u32(photo.width());
    w.u32(photo.height());
    w.f32(photo.exposure());
    w.f32(photo.saturation());
    let curve = |e: Encoding| Encoding::ALL.iter().position(|a| *a == e).unwrap_or(0) as u8;
    match photo.stored() {
        Stored::U8(data, encoding) => {
            w.u8(1);
            w.u8(curve(encoding));
            w.bytes(&data);
        }
        Stored::U16(data, encoding) => {
            w.u8(2);
            w.u8(curve(encoding));
            w.u16s(&data);
        }
        Stored::F32(data) => {
            w.u8(3);
            w.u8(0);
            w.f32s(&data);
        }
    }
}

fn read_photo(r: &mut Reader) -> Result<Photo> {
    let (width, height) = (r.u32()?, r.u32()?);
    let (exposure, saturation) = (r.f32()?, r.any_f32()?);
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(damaged("the size of a photograph is out of range"));
    }
    if saturation.is_nan() || saturation <= 0.0 {
        return Err(damaged("a saturation level is not positive"));
    }
    let values = 3 * pixels as usize;
    let kind = r.u8()?;
    let curve = Encoding::ALL.get(usize::from(r.u8()?));
    let curve = *curve.ok_or_else(|| damaged("unknown transfer function"))?;
    let stored = match kind {
        1 => Stored::U8(r.take(values)?.into(), curve),
        2 => Stored::U16(r.u16s(values)?.into(), curve),
        3 => Stored::F32(r.f32s(values)?.into()),
        other => return Err(damaged(format!("unknown pixel type {other}"))),
    };
    Photo::from_stored(width, height, stored, exposure, saturation).map_err(as_damage)
}
