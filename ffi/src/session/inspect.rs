//! Queries of a session: the fit's state, camera and light, maps.

use std::time::Duration;

use crate::handles::svbrdf_session;
use crate::live::{act, look};
use crate::maps::{self, svbrdf_maps};
use crate::options::svbrdf_camera;
use crate::paper::svbrdf_paper;
use crate::reports::{svbrdf_next_view, svbrdf_progress};
use crate::status::{Fault, SVBRDF_TIMEOUT, svbrdf_status};
use crate::versioned;

/// Waits until the fit has settled on all photos so far, at most `timeout_ms` milliseconds (negative: no
/// limit; 0: returns at once). SVBRDF_TIMEOUT if it has not settled by then.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_wait(
    session: *mut svbrdf_session,
    timeout_ms: i64,
) -> svbrdf_status {
    act(session, |live| {
        let settled = match u64::try_from(timeout_ms) {
            Ok(limit) => live.session.wait_timeout(Duration::from_millis(limit))?,
            Err(_) => live.session.wait().map(|()| true)?,
        };
        if settled {
            Ok(())
        } else {
            Err(Fault::new(SVBRDF_TIMEOUT, "the fit has not finished within the time given"))
        }
    })
}

/// State of the fit. Returns at once, also for a failed or cancelled session.
///
/// # Safety
/// `progress` is NULL or initialised by svbrdf_progress_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_progress(
    session: *const svbrdf_session,
    progress: *mut svbrdf_progress,
) -> svbrdf_status {
    look(session, |live| {
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("progress", progress) }?;
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(progress, size, live.progress()) };
        Ok(())
    })
}

/// The light as found so far: position of the flash in the camera frame, three numbers, mm, and
/// ambient light as a share of the flash's at the sample's centre. Results may be
/// NULL.
///
/// # Safety
/// Each result is NULL or writable, `flash_offset_mm` with three numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_light(
    session: *const svbrdf_session,
    flash_offset_mm: *mut f64,
    ambient_fraction: *mut f32,
) -> svbrdf_status {
    look(session, |live| {
        // SAFETY: the caller vouches for pointers that are not NULL.
        unsafe {
            if !flash_offset_mm.is_null() {
                let offset = live.session.flash_offset_mm().to_array();
                flash_offset_mm.cast::<[f64; 3]>().write_unaligned(offset);
            }
            if !ambient_fraction.is_null() {
                ambient_fraction.write_unaligned(live.session.ambient_fraction());
            }
        }
        Ok(())
    })
}

/// The most informative view for the next photo: of views 10 to 50 degrees off the vertical, the one
/// that lowers the expected error of renderings most. Waits for a step of the fit.
///
/// # Safety
/// `view` is NULL or initialised by svbrdf_next_view_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_next_view(
    session: *const svbrdf_session,
    view: *mut svbrdf_next_view,
) -> svbrdf_status {
    look(session, |live| {
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("view", view) }?;
        let next = svbrdf_next_view::new(live.session.next_view());
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(view, size, next) };
        Ok(())
    })
}

/// The camera as used: given, or estimated from the photos so far; all zeros while it is unknown and
/// for rectified photos. `sigma`, which may be NULL: standard deviations of fx, fy, cx, cy
/// (px), k1, k2, p1, p2, k3 of an estimated camera, otherwise zeros.
///
/// # Safety
/// `camera` is NULL or initialised by svbrdf_camera_init(); `sigma` is NULL or has nine writable
/// numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_camera(
    session: *const svbrdf_session,
    camera: *mut svbrdf_camera,
    sigma: *mut f64,
) -> svbrdf_status {
    look(session, |live| {
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("camera", camera) }?;
        let used = live.session.camera().map_or_else(Default::default, svbrdf_camera::new);
        let spread = live.session.camera_sigma().unwrap_or_default();
        // SAFETY: `size` bytes are there, and the caller vouches for the nine numbers.
        unsafe {
            versioned::write(camera, size, used);
            if !sigma.is_null() {
                sigma.cast::<[f64; 9]>().write_unaligned(spread);
            }
        }
        Ok(())
    })
}

/// The printed sheet and the sample's height above it, as used.
///
/// # Safety
/// `paper` is NULL or initialised by svbrdf_paper_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_paper(
    session: *const svbrdf_session,
    paper: *mut svbrdf_paper,
) -> svbrdf_status {
    look(session, |live| {
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("paper", paper) }?;
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(paper, size, svbrdf_paper::of(&live.session)) };
        Ok(())
    })
}

/// Current estimate of the pose of an accepted photo of a board. With an estimated camera, later photos
/// improve the poses of earlier ones. `index` counts the accepted photos from 0. Results as in
/// svbrdf_photo_report; each may be NULL.
///
/// # Safety
/// Each result is NULL or writable: nine numbers, three, one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_pose(
    session: *const svbrdf_session,
    index: u32,
    rotation: *mut f64,
    translation_mm: *mut f64,
    reprojection_rms_px: *mut f64,
) -> svbrdf_status {
    look(session, |live| {
        let poses = live.session.poses();
        let board = poses.get(index as usize).ok_or_else(|| {
            Fault::argument(format!("index: {index} given, but there are {} poses", poses.len()))
        })?;
        let rows = board.pose.rotation.transpose().to_cols_array();
        // SAFETY: the caller vouches for pointers that are not NULL.
        unsafe {
            if !rotation.is_null() {
                rotation.cast::<[f64; 9]>().write_unaligned(rows);
            }
            if !translation_mm.is_null() {
                let translation = board.pose.translation.to_array();
                translation_mm.cast::<[f64; 3]>().write_unaligned(translation);
            }
            if !reprojection_rms_px.is_null() {
                reprojection_rms_px.write_unaligned(board.reprojection_rms_px);
            }
        }
        Ok(())
    })
}

/// The current maps; SVBRDF_NO_MAPS before the first accepted photo. Returns at once, also for a failed
/// or cancelled session. Free with svbrdf_maps_destroy().
///
/// # Safety
/// `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_snapshot_maps(
    session: *const svbrdf_session,
    out: *mut *mut svbrdf_maps,
) -> svbrdf_status {
    look(session, |live| {
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        let snapshot = live.session.snapshot()?;
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(maps::hand_out(snapshot, live.sample_mm)) };
        Ok(())
    })
}
