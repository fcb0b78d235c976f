//! Reports for callers: outcome of a photo, next view, progress.

use std::ffi::c_char;
use std::mem::offset_of;

use engine::Rejection;
use engine::session::{AcceptedPhoto, BoardPose, Hint, NextView, Progress};

use crate::phase::{phase_code, svbrdf_phase};
use crate::status::{entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// Reason for which a photo was rejected. Values may be added.
pub type svbrdf_rejection = u32;
/// The photo was used.
pub const SVBRDF_REJECTION_NONE: svbrdf_rejection = 0;
/// A reason that this version of the header does not know.
pub const SVBRDF_REJECTION_OTHER: svbrdf_rejection = 1;
/// The size is not that of the camera.
pub const SVBRDF_REJECTION_WRONG_SIZE: svbrdf_rejection = 2;
/// No board was found.
pub const SVBRDF_REJECTION_BOARD_NOT_FOUND: svbrdf_rejection = 3;
/// Too little of the board is visible.
pub const SVBRDF_REJECTION_TOO_FEW_CORNERS: svbrdf_rejection = 4;
/// The corners do not fit the board as seen by the camera.
pub const SVBRDF_REJECTION_POSE_UNCERTAIN: svbrdf_rejection = 5;
/// The photo is blurred.
pub const SVBRDF_REJECTION_BLURRED: svbrdf_rejection = 6;
/// The photo is too dark.
pub const SVBRDF_REJECTION_TOO_DARK: svbrdf_rejection = 7;
/// Too much of the photo is over-exposed.
pub const SVBRDF_REJECTION_CLIPPED: svbrdf_rejection = 8;
/// The camera is too far off the vertical.
pub const SVBRDF_REJECTION_TOO_GRAZING: svbrdf_rejection = 9;
/// Too little of the sample is in the image.
pub const SVBRDF_REJECTION_SAMPLE_OUTSIDE: svbrdf_rejection = 10;
/// The flash does not light the board, or is stated to be off.
pub const SVBRDF_REJECTION_LIGHT_NOT_VISIBLE: svbrdf_rejection = 11;
/// The photo contains values that are not finite.
pub const SVBRDF_REJECTION_NOT_FINITE: svbrdf_rejection = 12;
/// The visible part of the board fits in several places.
pub const SVBRDF_REJECTION_PLACEMENT_AMBIGUOUS: svbrdf_rejection = 13;
/// The printed board is not the one described; the advice says how it differs.
pub const SVBRDF_REJECTION_BOARD_DIFFERS: svbrdf_rejection = 14;
/// The photo was taken with another lens or zoom.
pub const SVBRDF_REJECTION_OTHER_CAMERA: svbrdf_rejection = 15;
/// The board's squares are too small.
pub const SVBRDF_REJECTION_SQUARES_TOO_SMALL: svbrdf_rejection = 16;
/// Bright and dark stripes run across the photo: the light flickers.
pub const SVBRDF_REJECTION_FLICKERS: svbrdf_rejection = 17;
/// The contrast of the photo was changed: black is not as dark as printed.
pub const SVBRDF_REJECTION_EDITED: svbrdf_rejection = 18;

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
        Rejection::PlacementAmbiguous { .. } => SVBRDF_REJECTION_PLACEMENT_AMBIGUOUS,
        Rejection::BoardDiffers(_) => SVBRDF_REJECTION_BOARD_DIFFERS,
        Rejection::OtherCamera { .. } => SVBRDF_REJECTION_OTHER_CAMERA,
        Rejection::SquaresTooSmall { .. } => SVBRDF_REJECTION_SQUARES_TOO_SMALL,
        Rejection::Flickers { .. } => SVBRDF_REJECTION_FLICKERS,
        Rejection::Edited { .. } => SVBRDF_REJECTION_EDITED,
        _ => SVBRDF_REJECTION_OTHER,
    }
}

/// Hints about an accepted photo: bits. Bits may be added; svbrdf_photo_report.advice has words for
/// all.
pub type svbrdf_hints = u32;
/// A hint that this version of the header does not know.
pub const SVBRDF_HINT_OTHER: svbrdf_hints = 1;
/// An earlier photo has nearly the same view.
pub const SVBRDF_HINT_NOTHING_NEW: svbrdf_hints = 2;
/// The board's black or gray is not as bright as linear values would be: a tone curve is on, or
/// svbrdf_image.transfer is wrong. The advice says whether the curve was estimated and undone, so that
/// the photo is as good as a linear one.
pub const SVBRDF_HINT_NOT_LINEAR: svbrdf_hints = 4;

/// Bytes of svbrdf_photo_report.advice.
pub const SVBRDF_ADVICE_BYTES: usize = 256;

/// Meaning and unit of the value of a rejection. Values may be added.
pub type svbrdf_measure = u32;
/// Nothing was measured: value and limit are 0.
pub const SVBRDF_MEASURE_NONE: svbrdf_measure = 0;
/// Corners found. The limit is the number needed; 0: more would not help.
pub const SVBRDF_MEASURE_CORNERS: svbrdf_measure = 1;
/// Reprojection error of the corners, px.
pub const SVBRDF_MEASURE_REPROJECTION_PX: svbrdf_measure = 2;
/// Width of edges (one sigma), px.
pub const SVBRDF_MEASURE_BLUR_PX: svbrdf_measure = 3;
/// Level of the white squares, 1 is full scale.
pub const SVBRDF_MEASURE_WHITE_LEVEL: svbrdf_measure = 4;
/// Share of pixels that are clipped, 0 to 1.
pub const SVBRDF_MEASURE_CLIPPED_SHARE: svbrdf_measure = 5;
/// Angle of the camera off the vertical, degrees. The limit is the largest that is allowed.
pub const SVBRDF_MEASURE_TILT_DEG: svbrdf_measure = 6;
/// Share of the sample that is seen, 0 to 1.
pub const SVBRDF_MEASURE_SAMPLE_SHARE: svbrdf_measure = 7;
/// Focal length over that of the session's camera.
pub const SVBRDF_MEASURE_FOCAL_RATIO: svbrdf_measure = 8;
/// Side of the board's squares, px. The limit is the side needed.
pub const SVBRDF_MEASURE_SQUARE_PX: svbrdf_measure = 9;
/// Relative amplitude of the stripes.
pub const SVBRDF_MEASURE_STRIPES: svbrdf_measure = 10;
/// Value of the black squares over that of white. The limit is the ratio as printed.
pub const SVBRDF_MEASURE_OVER_WHITE: svbrdf_measure = 11;

/// Meaning of the measured value, the value, and its limit (0: none).
pub(crate) fn measured(rejection: &Rejection) -> (svbrdf_measure, f32, f32) {
    match *rejection {
        Rejection::TooFewCorners { found, needed, .. } => {
            (SVBRDF_MEASURE_CORNERS, found as f32, needed as f32)
        }
        Rejection::PlacementAmbiguous { found } => (SVBRDF_MEASURE_CORNERS, found as f32, 0.0),
        Rejection::PoseUncertain { rms_px } => (SVBRDF_MEASURE_REPROJECTION_PX, rms_px, 0.0),
        Rejection::Blurred { blur_px, .. } => (SVBRDF_MEASURE_BLUR_PX, blur_px, 0.0),
        Rejection::TooDark { level } => (SVBRDF_MEASURE_WHITE_LEVEL, level, 0.0),
        Rejection::Clipped { share } => (SVBRDF_MEASURE_CLIPPED_SHARE, share, 0.0),
        Rejection::TooGrazing { degrees, limit } => (SVBRDF_MEASURE_TILT_DEG, degrees, limit),
        Rejection::SampleOutside { share } => (SVBRDF_MEASURE_SAMPLE_SHARE, share, 0.0),
        Rejection::OtherCamera { focal_ratio } => (SVBRDF_MEASURE_FOCAL_RATIO, focal_ratio, 0.0),
        Rejection::SquaresTooSmall { square_px, needed_px } => {
            (SVBRDF_MEASURE_SQUARE_PX, square_px, needed_px)
        }
        Rejection::Flickers { amplitude } => (SVBRDF_MEASURE_STRIPES, amplitude, 0.0),
        Rejection::Edited { black, usual } => (SVBRDF_MEASURE_OVER_WHITE, black, usual),
        _ => (SVBRDF_MEASURE_NONE, 0.0, 0.0),
    }
}

/// Text with a NUL at its end, as much of it as there is room for.
pub(crate) fn text<const N: usize>(text: &str) -> [c_char; N] {
    let end = text.floor_char_boundary(N - 1);
    let mut out = [0; N];
    for (to, from) in out.iter_mut().zip(text[..end].bytes()) {
        *to = c_char::from_ne_bytes([from]);
    }
    out
}

/// Outcome of a photo.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_photo_report {
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
    /// Hints about an accepted photo: bits of SVBRDF_HINT_.
    pub hints: svbrdf_hints,
    /// With SVBRDF_HINT_NOTHING_NEW: number of that photo among the accepted ones, from 0; otherwise -1.
    pub same_view_as: i32,
    /// With SVBRDF_HINT_NOT_LINEAR: value of the black squares or the gray patch over that of white;
    /// otherwise negative.
    pub over_white: f32,
    /// For a rejected photo: meaning and unit of `measured` and `limit`, one of SVBRDF_MEASURE_.
    pub measure: svbrdf_measure,
    /// The measured value.
    pub measured: f32,
    /// The value needed or allowed; 0: there is no single one.
    pub limit: f32,
    /// For a blurred photo: direction of the blur, degrees clockwise from the photo's x axis, 0 to
    /// 180; negative: the same in all directions, as out of focus.
    pub blur_direction_deg: f32,
    /// Advice for the user, in English, UTF-8: why a photo was rejected, or the hints about an
    /// accepted one; may be empty.
    pub advice: [c_char; SVBRDF_ADVICE_BYTES],
    /// 0.
    pub reserved: u32,
}

defaults!(svbrdf_photo_report { same_view_as: -1, over_white: -1.0, blur_direction_deg: -1.0 });
versioned!(svbrdf_photo_report, offset_of!(svbrdf_photo_report, hints));

impl svbrdf_photo_report {
    pub(crate) fn accepted(accepted: &AcceptedPhoto, timestamp_ns: i64) -> Self {
        let mut report = Self {
            accepted: 1,
            index: accepted.index as u32,
            maps_seconds: accepted.maps_seconds,
            timestamp_ns,
            ..Self::default()
        };
        if let Some(BoardPose { pose, reprojection_rms_px }) = accepted.pose {
            report.has_pose = 1;
            report.reprojection_rms_px = reprojection_rms_px;
            report.rotation = pose.rotation.transpose().to_cols_array();
            report.translation_mm = pose.translation.to_array();
        }
        (report.hints, report.same_view_as, report.over_white) = hint_fields(&accepted.hints);
        report.advice = text(&words(&accepted.hints));
        report
    }

    pub(crate) fn rejected(rejection: &Rejection, timestamp_ns: i64) -> Self {
        let (measure, measured, limit) = measured(rejection);
        let blur_direction_deg = match rejection {
            Rejection::Blurred { direction_deg, .. } => direction_deg.unwrap_or(-1.0),
            _ => -1.0,
        };
        Self {
            rejection: rejection_code(rejection),
            timestamp_ns,
            measure,
            measured,
            limit,
            blur_direction_deg,
            advice: text(&rejection.to_string()),
            ..Self::default()
        }
    }
}

/// Fills a report with defaults: pass sizeof(svbrdf_photo_report).
///
/// # Safety
/// `report` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_photo_report_init(
    report: *mut svbrdf_photo_report,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(report, size) })
}

/// Bits of hints, and the fields `same_view_as` and `over_white`.
pub(crate) fn hint_fields(hints: &[Hint]) -> (svbrdf_hints, i32, f32) {
    let (mut bits, mut same_view_as, mut over_white) = (0, -1, -1.0);
    for hint in hints {
        bits |= match *hint {
            Hint::NothingNew { index } => {
                same_view_as = index as i32;
                SVBRDF_HINT_NOTHING_NEW
            }
            Hint::NotLinear { ratio, .. } => {
                over_white = ratio;
                SVBRDF_HINT_NOT_LINEAR
            }
            _ => SVBRDF_HINT_OTHER,
        };
    }
    (bits, same_view_as, over_white)
}

/// Hints as the user may read them.
pub(crate) fn words(hints: &[Hint]) -> String {
    hints.iter().map(Hint::to_string).collect::<Vec<_>>().join("; ")
}

/// The most informative view for the next photo.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_next_view {
    /// Size of this struct.
    pub size: usize,
    /// 1 when the other fields are known: in a session of a board, after the first photo.
    pub known: u32,
    /// Angle off the vertical, degrees.
    pub tilt_deg: f32,
    /// Side to go to: degrees counter-clockwise from the board's +X, seen from above.
    pub azimuth_deg: f32,
    /// Unit vector from the sample towards the camera, board frame.
    pub direction: [f32; 3],
}

defaults!(svbrdf_next_view {});
versioned!(svbrdf_next_view, size_of::<svbrdf_next_view>());

impl svbrdf_next_view {
    pub(crate) fn new(view: Option<NextView>) -> Self {
        let Some(view) = view else { return Self::default() };
        let NextView { direction, tilt_deg, azimuth_deg } = view;
        Self { known: 1, tilt_deg, azimuth_deg, direction, ..Self::default() }
    }
}

/// Fills a view with zeros: pass sizeof(svbrdf_next_view).
///
/// # Safety
/// `view` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_next_view_init(
    view: *mut svbrdf_next_view,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(view, size) })
}

/// State of a session.
pub type svbrdf_state = u32;
/// Idle: no photo yet, or the fit has settled on all photos so far.
pub const SVBRDF_STATE_READY: svbrdf_state = 1;
/// Fitting.
pub const SVBRDF_STATE_FITTING: svbrdf_state = 2;
/// Paused by svbrdf_session_pause(), with work left.
pub const SVBRDF_STATE_PAUSED: svbrdf_state = 3;
/// Ended by svbrdf_session_cancel().
pub const SVBRDF_STATE_CANCELLED: svbrdf_state = 4;
/// Ended by an error inside the library.
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
    pub photos: u32,
    /// 1 when the fit has finished on all photos so far.
    pub settled: u32,
    /// Fraction of the work that is done, 0 to 1. On photos announced by svbrdf_session_announce() it never
    /// falls before they have come; without, it is that of the latest photo and begins at 0 with each. It also
    /// begins again when a photo is removed or a larger budget resumes the fit, unless announced photos are
    /// still to come.
    pub fraction: f32,
    /// Mean error (log-L1 of renderings) before the fit of the latest photo.
    pub loss_before: f32,
    /// Mean error now.
    pub loss: f32,
    /// Estimated seconds left on the photos so far; negative when not known.
    pub seconds_left: f32,
    /// 0.
    pub reserved: u32,
    /// Sets of maps published so far: when it has grown, there are newer maps.
    pub maps_revision: u64,
    /// Phase of the fit: one of SVBRDF_PHASE_, see svbrdf_phase_name().
    pub phase: svbrdf_phase,
    /// 0.
    pub reserved_too: u32,
}

defaults!(svbrdf_progress { state: SVBRDF_STATE_READY, seconds_left: -1.0 });
versioned!(svbrdf_progress, offset_of!(svbrdf_progress, phase));

impl svbrdf_progress {
    pub(crate) fn new(progress: &Progress, state: svbrdf_state, maps_revision: u64) -> Self {
        Self {
            state,
            photos: progress.photos as u32,
            settled: progress.settled.into(),
            fraction: progress.fraction,
            loss_before: progress.loss_before,
            loss: progress.loss,
            seconds_left: progress.seconds_left.unwrap_or(-1.0),
            maps_revision,
            phase: phase_code(progress.phase),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn advice(report: &svbrdf_photo_report) -> String {
        let bytes = report.advice.iter().take_while(|c| **c != 0).map(|c| c.to_ne_bytes()[0]);
        String::from_utf8(bytes.collect()).unwrap()
    }

    #[test]
    fn each_reason_has_its_constant() {
        let difference = engine::BoardDifference::MarkersUnknown { count: 5 };
        let all = [
            Rejection::WrongSize { found_width: 4, found_height: 3, width: 8, height: 6 },
            Rejection::BoardNotFound,
            Rejection::TooFewCorners { found: 31, expected: 72, needed: 40 },
            Rejection::PlacementAmbiguous { found: 60 },
            Rejection::BoardDiffers(difference),
            Rejection::OtherCamera { focal_ratio: 1.3 },
            Rejection::SquaresTooSmall { square_px: 7.0, needed_px: 9.0 },
            Rejection::PoseUncertain { rms_px: 3.1 },
            Rejection::Blurred { blur_px: 3.5, direction_deg: None },
            Rejection::TooDark { level: 0.01 },
            Rejection::Clipped { share: 0.4 },
            Rejection::TooGrazing { degrees: 71.0, limit: 65.0 },
            Rejection::SampleOutside { share: 0.6 },
            Rejection::LightNotVisible,
            Rejection::Flickers { amplitude: 0.1 },
            Rejection::Edited { black: 0.01, usual: 0.05 },
            Rejection::NotFinite,
        ];
        // Other crates cannot match without a wildcard, so that the list is compared with the source.
        let source = include_str!("../../src/error.rs");
        let reasons = source.split_once("impl Rejection {").unwrap().1;
        let codes: Vec<&str> =
            reasons.lines().filter_map(|line| Some(line.split_once("=> \"")?.1)).collect();
        let listed: Vec<String> = all.iter().map(|r| format!("{}\",", r.code())).collect();
        assert_eq!(codes, listed);
        let header = include_str!("../../include/svbrdf.h");
        for rejection in all {
            let name = rejection.code().to_uppercase();
            let define =
                format!("#define SVBRDF_REJECTION_{name} {}\n", rejection_code(&rejection));
            assert!(header.contains(&define), "{define}");
        }
    }

    #[test]
    fn figures_of_rejections_are_reported() {
        let fields = |rejection| {
            let report = svbrdf_photo_report::rejected(&rejection, 7);
            assert_eq!((advice(&report), report.timestamp_ns), (rejection.to_string(), 7));
            (report.measure, report.measured, report.limit, report.blur_direction_deg)
        };
        let blurred = |direction_deg| Rejection::Blurred { blur_px: 3.5, direction_deg };
        assert_eq!(fields(blurred(Some(30.0))), (SVBRDF_MEASURE_BLUR_PX, 3.5, 0.0, 30.0));
        assert_eq!(fields(blurred(None)), (SVBRDF_MEASURE_BLUR_PX, 3.5, 0.0, -1.0));
        assert_eq!(
            fields(Rejection::TooGrazing { degrees: 71.0, limit: 65.0 }),
            (SVBRDF_MEASURE_TILT_DEG, 71.0, 65.0, -1.0)
        );
        let corners = Rejection::TooFewCorners { found: 31, expected: 72, needed: 40 };
        assert_eq!(fields(corners), (SVBRDF_MEASURE_CORNERS, 31.0, 40.0, -1.0));
        assert_eq!(
            fields(Rejection::SampleOutside { share: 0.5 }),
            (SVBRDF_MEASURE_SAMPLE_SHARE, 0.5, 0.0, -1.0)
        );
        assert_eq!(
            fields(Rejection::Edited { black: 0.01, usual: 0.05 }),
            (SVBRDF_MEASURE_OVER_WHITE, 0.01, 0.05, -1.0)
        );
        assert_eq!(fields(Rejection::BoardNotFound), (SVBRDF_MEASURE_NONE, 0.0, 0.0, -1.0));
    }

    #[test]
    fn hints_of_accepted_photos_are_reported() {
        let fields = |hints| {
            let accepted = AcceptedPhoto { index: 9, pose: None, maps_seconds: 0.1, hints };
            svbrdf_photo_report::accepted(&accepted, 0)
        };
        let report = fields(vec![
            Hint::NothingNew { index: 4 },
            Hint::NotLinear { what: "gray", ratio: 0.52, undone: false },
        ]);
        assert_eq!(report.hints, SVBRDF_HINT_NOTHING_NEW | SVBRDF_HINT_NOT_LINEAR);
        assert_eq!((report.same_view_as, report.over_white), (4, 0.52));
        let words = advice(&report);
        assert!(words.starts_with("photo 5 has") && words.contains("gray is 0.520"), "{words}");
        let plain = fields(Vec::new());
        assert_eq!((plain.hints, advice(&plain)), (0, String::new()));
        assert_eq!((plain.same_view_as, plain.over_white), (-1, -1.0));
    }

    #[test]
    fn long_words_are_cut_between_characters() {
        let long = "\u{e4}".repeat(200);
        let report = svbrdf_photo_report { advice: text(&long), ..Default::default() };
        assert_eq!(advice(&report), "\u{e4}".repeat(127));
    }
}
