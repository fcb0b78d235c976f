//! Photos that are judged without being added.

use std::ffi::c_char;

use engine::session::Probe;

use crate::handles::svbrdf_session;
use crate::image::svbrdf_image;
use crate::live::act;
use crate::options::{SVBRDF_FLASH_OFF, svbrdf_photo_info};
use crate::reports::{
    SVBRDF_ADVICE_BYTES, hint_fields, measured, rejection_code, svbrdf_hints, svbrdf_measure,
    svbrdf_rejection, text, words,
};
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// The verdict on a photo or preview image that is not added; see svbrdf_session_probe(). Lengths
/// in px belong to the image as given, after svbrdf_image.rotation.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_probe {
    /// Size of this struct.
    pub size: usize,
    /// 1 when a photo like it would be accepted.
    pub acceptable: u32,
    /// Why not: one of SVBRDF_REJECTION_.
    pub rejection: svbrdf_rejection,
    /// Hints, whether it would be accepted or not: bits of SVBRDF_HINT_.
    pub hints: svbrdf_hints,
    /// As in svbrdf_photo_report.
    pub same_view_as: i32,
    /// Corners of the board that were found.
    pub corners_found: u32,
    /// Corners that lie inside the image; 0 where the board was not found.
    pub corners_in_view: u32,
    /// Corners that the board has.
    pub corners_expected: u32,
    /// 1 when the fields up to azimuth_deg are known, also for a photo that would be rejected.
    pub has_pose: u32,
    /// Rotation from the board to the camera, row by row.
    pub rotation: [f64; 9],
    /// Board origin in the camera frame, mm.
    pub translation_mm: [f64; 3],
    /// Reprojection error of the board's corners, px.
    pub reprojection_rms_px: f64,
    /// From the sample's centre to the camera, mm.
    pub distance_mm: f32,
    /// Angle off the vertical, degrees.
    pub tilt_deg: f32,
    /// Side of the camera: degrees counter-clockwise from the board's +X, 0 to 360.
    pub azimuth_deg: f32,
    /// Angle to the view that svbrdf_session_next_view() suggests, degrees; negative without one.
    pub off_next_deg: f32,
    /// Share of the sample inside the image, 0 to 1; negative when not known.
    pub sample_seen: f32,
    /// Share of the visible sample that is saturated in all channels, 0 to 1; negative when not known.
    pub sample_clipped: f32,
    /// The sample's corners, x and y, px, clockwise from the upper left of the maps; they may lie outside
    /// the image. NaN when not known.
    pub sample_px: [f32; 8],
    /// Mean scale of the sample in the image, px/mm; 0 when not known. Each texel of the maps should
    /// have a pixel.
    pub px_per_mm: f32,
    /// Width of the board's edges (one sigma), px; negative when not known. Large images are reduced
    /// first, so widths below one pixel of the reduced image cannot be distinguished.
    pub blur_px: f32,
    /// Direction of the blur, degrees clockwise from the image's x axis, 0 to 180; negative: the same
    /// in all directions, or not known.
    pub blur_direction_deg: f32,
    /// Median level of the white squares, 1 is full scale, linear; negative when not known.
    pub white_level: f32,
    /// Share of the white squares that are clipped, 0 to 1; negative when not known.
    pub white_clipped: f32,
    /// As in svbrdf_photo_report.
    pub over_white: f32,
    /// As in svbrdf_photo_report.
    pub measure: svbrdf_measure,
    /// As in svbrdf_photo_report.
    pub measured: f32,
    /// As in svbrdf_photo_report.
    pub limit: f32,
    /// The timestamp that was given with the photo.
    pub timestamp_ns: i64,
    /// Advice for the user, in English, UTF-8: why it would be rejected, or the hints; may be empty.
    pub advice: [c_char; SVBRDF_ADVICE_BYTES],
    /// Set by the caller: memory for the corners found, x and y of each, px; or NULL.
    pub corners_px: *mut f32,
    /// Set by the caller: number of corners that fit there.
    pub corners_capacity: u32,
    /// 0.
    pub reserved: u32,
}

defaults!(svbrdf_probe {
    same_view_as: -1,
    off_next_deg: -1.0,
    sample_seen: -1.0,
    sample_clipped: -1.0,
    sample_px: [f32::NAN; 8],
    blur_px: -1.0,
    blur_direction_deg: -1.0,
    white_level: -1.0,
    white_clipped: -1.0,
    over_white: -1.0,
});
versioned!(svbrdf_probe, size_of::<svbrdf_probe>());

impl svbrdf_probe {
    fn new(probe: &Probe, timestamp_ns: i64) -> Self {
        let mut out = Self {
            acceptable: probe.rejection.is_none().into(),
            corners_found: probe.corners.len() as u32,
            corners_in_view: probe.corners_in_view as u32,
            corners_expected: probe.corners_expected as u32,
            blur_px: probe.blur_px.unwrap_or(-1.0),
            blur_direction_deg: probe.blur_direction_deg.unwrap_or(-1.0),
            timestamp_ns,
            ..Self::default()
        };
        (out.hints, out.same_view_as, out.over_white) = hint_fields(&probe.hints);
        if let Some(board) = &probe.pose {
            out.has_pose = 1;
            out.rotation = board.pose.rotation.transpose().to_cols_array();
            out.translation_mm = board.pose.translation.to_array();
            out.reprojection_rms_px = board.reprojection_rms_px;
        }
        if let Some(view) = &probe.view {
            out.distance_mm = view.distance_mm;
            out.tilt_deg = view.tilt_deg;
            out.azimuth_deg = view.azimuth_deg;
            out.off_next_deg = view.off_next_deg.unwrap_or(-1.0);
            (out.sample_seen, out.sample_clipped) = (view.sample_seen, view.sample_clipped);
            out.px_per_mm = view.px_per_mm;
            if let Some(corners) = view.sample_px {
                out.sample_px.copy_from_slice(corners.as_flattened());
            }
        }
        if let Some(light) = &probe.light {
            (out.white_level, out.white_clipped) = (light.white_level, light.clipped_share);
        }
        out.advice = text(&words(&probe.hints));
        if let Some(rejection) = &probe.rejection {
            out.rejection = rejection_code(rejection);
            (out.measure, out.measured, out.limit) = measured(rejection);
            out.advice = text(&rejection.to_string());
        }
        out
    }
}

/// The caller's memory for a probe and its corners.
pub(crate) struct Room {
    probe: *mut svbrdf_probe,
    size: usize,
    given: svbrdf_probe,
}

impl Room {
    /// `None` for NULL.
    ///
    /// # Safety
    /// `probe` is NULL or initialised.
    pub(crate) unsafe fn of(probe: *mut svbrdf_probe) -> Result<Option<Self>, Fault> {
        // SAFETY: as the caller vouches.
        let size = unsafe { versioned::result_size(probe) }?;
        let Some(size) = size else { return Ok(None) };
        // SAFETY: as the caller vouches.
        let given = unsafe { versioned::read(probe) }?;
        Ok(Some(Self { probe, size, given }))
    }

    /// Writes the result.
    ///
    /// # Safety
    /// The probe is still there, and there is room for as many corners as it says.
    pub(crate) unsafe fn write(&self, found: &Probe, timestamp_ns: i64) {
        let svbrdf_probe { corners_px, corners_capacity, .. } = self.given;
        let mut value = svbrdf_probe::new(found, timestamp_ns);
        (value.corners_px, value.corners_capacity) = (corners_px, corners_capacity);
        if !corners_px.is_null() {
            for (i, corner) in found.corners.iter().take(corners_capacity as usize).enumerate() {
                let px = corner.px.as_vec2().to_array();
                // SAFETY: the caller vouches for room for that many corners.
                unsafe { corners_px.cast::<[f32; 2]>().add(i).write_unaligned(px) };
            }
        }
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(self.probe, self.size, value) };
    }
}

/// Fills a probe with defaults: pass sizeof(svbrdf_probe).
///
/// # Safety
/// `probe` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_probe_init(probe: *mut svbrdf_probe, size: usize) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(probe, size) })
}

/// Judges a photo of a board, or an image of the camera's preview, without changing the session.
/// Returns SVBRDF_OK also for a photo that would be rejected: the probe says so. `info` may be NULL.
/// With SVBRDF_FLASH_OFF, the light is not judged.
///
/// An image whose size is not the camera's counts as a preview, scaled to the width or height and
/// cropped at the other sides. If that does not fit, and before a camera is known, the camera is
/// estimated from the image. Runs only on the calling thread; waits neither for the fit nor for a
/// photo that is being added.
///
/// # Safety
/// As svbrdf_session_add_photo(); `probe.corners_px` is NULL or has room for as many corners as
/// said.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_probe(
    session: *const svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_photo_info,
    probe: *mut svbrdf_probe,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for the structs.
        let (image, info, room) = unsafe {
            (versioned::read(image)?, svbrdf_photo_info::from_caller(info)?, Room::of(probe)?)
        };
        let room = room.ok_or_else(|| Fault::argument("svbrdf_probe: NULL given"))?;
        // SAFETY: the caller vouches for the planes.
        let photo = unsafe { info.photo(&image) }?;
        let found = match info.flash {
            SVBRDF_FLASH_OFF => live.session.probe_without_flash(&photo)?,
            _ => live.session.probe(&photo)?,
        };
        // SAFETY: the caller vouches for the pointers in `room`.
        unsafe { room.write(&found, info.timestamp_ns) };
        Ok(())
    })
}
