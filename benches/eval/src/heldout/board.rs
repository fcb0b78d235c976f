//! Held-out photographs of a board: calibrated like the others, never fitted.

use svbrdf::calibration::photometry::{FlashOffset, PhotometricCalibrator};
use svbrdf::capture::Capture;
use svbrdf::rectification::{TopView, rectify_raised};
use svbrdf::session::{Scene, Session};
use svbrdf::{Error, Rejection, Result};

use super::score::{HeldOut, SIDE};
use crate::streaming::push;

/// Rectified photographs `held_out` with their radiometry from the board's squares. The session is
/// paused, so it calibrates them without fitting; it has accepted the photos `fitted`.
pub fn photographs(
    session: &Session,
    capture: &Capture,
    fitted: &[usize],
    held_out: &[usize],
) -> Result<Vec<HeldOut>> {
    let Scene::Board { target, .. } = &capture.scene else {
        return Err(Error::argument("capture", "a capture of a board expected"));
    };
    session.pause();
    for &index in held_out {
        let file = &capture.photos[index];
        if let Some(reason) = push(session, file)? {
            return Err(unusable(capture, index, reason));
        }
    }
    let camera = session.camera().ok_or(Error::NoMaps)?;
    let flash = FlashOffset::Known(session.flash_offset_mm());
    let height_mm = session.elevation().map_or(0.0, |e| e.mm as f32);
    let mut calibrator = PhotometricCalibrator::new(target.clone(), flash);
    let all: Vec<usize> = fitted.iter().chain(held_out).copied().collect();
    let poses = session.poses();
    for (&index, known) in all.iter().zip(&poses) {
        let photo = capture.photos[index].read()?;
        calibrator
            .push(&photo, &camera, &known.pose)
            .map_err(|reason| unusable(capture, index, reason))?;
    }
    let mut photographs = Vec::new();
    for (i, &index) in all.iter().enumerate().skip(fitted.len()) {
        let photo = capture.photos[index].read()?;
        let Some(radiometry) = calibrator.radiometry(i) else { continue };
        let pose = &poses[i].pose;
        let sample_mm = capture.sample_mm;
        let top = TopView { sample_mm, height_mm, width: SIDE, height: SIDE, edge_px: 0.0 };
        let observation = rectify_raised(&photo, &camera, pose, &radiometry, top)
            .map_err(|reason| unusable(capture, index, reason))?;
        // values as in the file, corrected for lens and flash fall-off
        let exposure = (3.0 / radiometry.gain.iter().sum::<f64>()) as f32;
        let n = observation.texels();
        photographs.push(HeldOut {
            view: observation.view,
            exposure,
            observed: (0..3 * n)
                .map(|k| exposure * observation.radiance(k / n, k % n).abs())
                .collect(),
            side: SIDE,
            seen: Some((0..n).map(|k| observation.weight(k) > 0.0).collect()),
        });
    }
    Ok(photographs)
}

fn unusable(capture: &Capture, index: usize, reason: Rejection) -> Error {
    Error::Image { path: capture.photos[index].path.clone(), message: reason.to_string() }
}
