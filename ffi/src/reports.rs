//! What callers are told: photos, progress.

use engine::Rejection;
use engine::session::{Accepted, Progress};

use crate::status::{entry, svbrdf_status};
use crate::versioned::{self, versioned};

/// Why a photo was not used. Values may be added.
pub type svbrdf_rejection = u32;
/// It was used.
pub const SVBRDF_REJECTION_NONE: svbrdf_rejection = 0;
/// For a reason that this version of the header does not know.
pub const SVBRDF_REJECTION_OTHER: svbrdf_rejection = 1;
/// Its size is not the camera's.
pub const SVBRDF_REJECTION_WRONG_SIZE: svbrdf_rejection = 2;
/// Nothing like the board was found.
pub const SVBRDF_REJECTION_BOARD_NOT_FOUND: svbrdf_rejection = 3;
/// Too little of the board is seen.
pub const SVBRDF_REJECTION_TOO_FEW_CORNERS: svbrdf_rejection = 4;
/// The corners do not fit the board seen by the camera.
pub const SVBRDF_REJECTION_POSE_UNCERTAIN: svbrdf_rejection = 5;
/// It is blurred.
pub const SVBRDF_REJECTION_BLURRED: svbrdf_rejection = 6;
/// It is too dark.
pub const SVBRDF_REJECTION_TOO_DARK: svbrdf_rejection = 7;
/// Too much of it is over-exposed.
pub const SVBRDF_REJECTION_CLIPPED: svbrdf_rejection = 8;
/// The camera looks too flat across the sample.
pub const SVBRDF_REJECTION_TOO_GRAZING: svbrdf_rejection = 9;
/// Too little of the sample is inside.
pub const SVBRDF_REJECTION_SAMPLE_OUTSIDE: svbrdf_rejection = 10;
/// The flash does not light the board, or is said to be off.
pub const SVBRDF_REJECTION_LIGHT_NOT_VISIBLE: svbrdf_rejection = 11;
/// It holds values that are not numbers.
pub const SVBRDF_REJECTION_NOT_FINITE: svbrdf_rejection = 12;

/// The number of a reason.
pub(crate) fn rejection_code(rejection: &Rejection) -> svbrdf_rejection {
    match rejection {
        Rejection::WrongSize { .. } => SVBRDF_REJECTION_WRONG_SIZE,
        Rejection::BoardNotFound => SVBRDF_REJECTION_BOARD_NOT_FOUND,
        Rejection::TooFewCorners { .. } => SVBRDF_REJECTION_TOO_FEW_CORNERS,
        Rejection::PoseUncertain { .. } => SVBRDF_REJECTION_POSE_UNCERTAIN,
        Rejection::Blurred { .. } => SVBRDF_REJECTION_BLURRED,
        Rejection::TooDark { .. } => SVBRDF_REJECTION_TOO_DARK,
        Rejection::Clipped { .. } => SVBRDF_REJECTION_CLIPPED,
        Rejection::TooGrazing { .. } => SVBRDF_REJECTION_TOO_GRAZING,
        Rejection::SampleOutside { .. } => SVBRDF_REJECTION_SAMPLE_OUTSIDE,
        Rejection::LightNotVisible => SVBRDF_REJECTION_LIGHT_NOT_VISIBLE,
        Rejection::NotFinite => SVBRDF_REJECTION_NOT_FINITE,
        _ => SVBRDF_REJECTION_OTHER,
    }
}

/// What became of a photo.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_frame_report {
    /// Size of this struct.
    pub size: usize,
    /// 1 when the photo takes part in the fit, 0 when it was rejected.
    pub accepted: u32,
    /// Why it was rejected: one of SVBRDF_REJECTION_.
    pub rejection: svbrdf_rejection,
    /// Number of photos accepted before this one.
    pub index: u32,
    /// 1 when the pose below is known: an accepted photo of a board.
    pub has_pose: u32,
    /// Rotation from the board to the camera, row by row.
    pub rotation: [f64; 9],
    /// Board origin in the camera frame, mm.
    pub translation_mm: [f64; 3],
    /// Reprojection error of the board's corners, px.
    pub reprojection_rms_px: f64,
    /// Seconds from the call to maps being available.
    pub maps_seconds: f64,
    /// The timestamp that was given with the photo.
    pub timestamp_ns: i64,
}

impl Default for svbrdf_frame_report {
    fn default() -> Self {
        Self {
            size: size_of::<Self>(),
            accepted: 0,
            rejection: SVBRDF_REJECTION_NONE,
            index: 0,
            has_pose: 0,
            rotation: [0.0; 9],
            translation_mm: [0.0; 3],
            reprojection_rms_px: 0.0,
            maps_seconds: 0.0,
            timestamp_ns: 0,
        }
    }
}
versioned!(svbrdf_frame_report, size_of::<svbrdf_frame_report>());

impl svbrdf_frame_report {
    pub(crate) fn accepted(accepted: &Accepted, timestamp_ns: i64) -> Self {
        let mut report = Self {
            accepted: 1,
            index: accepted.index as u32,
            reprojection_rms_px: accepted.reprojection_rms_px.unwrap_or(0.0),
            maps_seconds: accepted.maps_seconds,
            timestamp_ns,
            ..Self::default()
        };
        if let Some(pose) = &accepted.pose {
            report.has_pose = 1;
            report.rotation = pose.rotation.transpose().to_cols_array();
            report.translation_mm = pose.translation.to_array();
        }
        report
    }

    pub(crate) fn rejected(rejection: &Rejection, timestamp_ns: i64) -> Self {
        Self { rejection: rejection_code(rejection), timestamp_ns, ..Self::default() }
    }
}

/// Fills a report with defaults: pass sizeof(svbrdf_frame_report).
///
/// # Safety
/// `report` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_frame_report_init(
    report: *mut svbrdf_frame_report,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(report, size) })
}

/// What a session is doing.
pub type svbrdf_state = u32;
/// Nothing: no photo yet, or the fit has settled on all photos so far.
pub const SVBRDF_STATE_READY: svbrdf_state = 1;
/// Fitting.
pub const SVBRDF_STATE_FITTING: svbrdf_state = 2;
/// Held by svbrdf_session_pause() with work left.
pub const SVBRDF_STATE_PAUSED: svbrdf_state = 3;
/// Ended by svbrdf_session_cancel().
pub const SVBRDF_STATE_CANCELLED: svbrdf_state = 4;
/// Ended by a fault inside the library.
pub const SVBRDF_STATE_FAILED: svbrdf_state = 5;

/// State of a fit.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_progress {
    /// Size of this struct.
    pub size: usize,
    /// One of SVBRDF_STATE_.
    pub state: svbrdf_state,
    /// Photos accepted so far.
    pub frames: u32,
    /// 1 when the fit has finished on all photos so far.
    pub settled: u32,
    /// Share of the work on the photos so far that is done, 0 to 1.
    pub fraction: f32,
    /// Mean error (log-L1 of renderings) before the fit of the latest photo.
    pub loss_before: f32,
    /// Mean error now.
    pub loss: f32,
    /// Estimated seconds left; negative when not known.
    pub seconds_left: f32,
    /// 0.
    pub reserved: u32,
    /// Sets of maps published so far: when it has grown there are newer maps.
    pub maps_revision: u64,
}

impl Default for svbrdf_progress {
    fn default() -> Self {
        Self {
            size: size_of::<Self>(),
            state: SVBRDF_STATE_READY,
            frames: 0,
            settled: 0,
            fraction: 0.0,
            loss_before: 0.0,
            loss: 0.0,
            seconds_left: -1.0,
            reserved: 0,
            maps_revision: 0,
        }
    }
}
versioned!(svbrdf_progress, size_of::<svbrdf_progress>());

impl svbrdf_progress {
    pub(crate) fn new(progress: &Progress, state: svbrdf_state, maps_revision: u64) -> Self {
        Self {
            state,
            frames: progress.frames as u32,
            settled: progress.settled.into(),
            fraction: progress.fraction,
            loss_before: progress.loss_before,
            loss: progress.loss,
            seconds_left: progress.seconds_left.unwrap_or(-1.0),
            maps_revision,
            ..Self::default()
        }
    }
}

/// Fills a progress with defaults: pass sizeof(svbrdf_progress).
///
/// # Safety
/// `progress` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_progress_init(
    progress: *mut svbrdf_progress,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(progress, size) })
}
