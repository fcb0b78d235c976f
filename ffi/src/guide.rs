//! Pictures of a preview judged, and instructions for the hand that holds the camera.

use std::ffi::c_char;
use std::sync::PoisonError;

use engine::guide::{Action, Guidance, GuideOptions};

use crate::handles::svbrdf_session;
use crate::image::svbrdf_image;
use crate::live::act;
use crate::options::{SVBRDF_FLASH_OFF, svbrdf_photo_info};
use crate::probe::{self, svbrdf_probe};
use crate::reports::{SVBRDF_ADVICE_BYTES, text};
use crate::status::{entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// The user's next action: one of SVBRDF_ACTION_.
pub type svbrdf_action = u32;
/// Correct the fault that svbrdf_probe.rejection names: a photo would not be used.
pub const SVBRDF_ACTION_ADJUST: svbrdf_action = 1;
/// Keep the camera where it is, until it is steady or a photo has been taken in.
pub const SVBRDF_ACTION_HOLD: svbrdf_action = 2;
/// Go to the target.
pub const SVBRDF_ACTION_MOVE: svbrdf_action = 3;
/// Nothing: the app takes the photo now and adds it.
pub const SVBRDF_ACTION_SHOOT: svbrdf_action = 4;
/// Nothing more: a further photo would add little.
pub const SVBRDF_ACTION_ENOUGH: svbrdf_action = 5;

/// Options of guidance.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_guide_options {
    /// Size of this struct.
    pub size: usize,
    /// Smallest gain of a photo worth taking, as a share of that of the best view, 0 to 1. High values: fewer
    /// photos; low values: less walking.
    pub worth: f32,
    /// Largest movement of the sample across the image with a steady camera, in widths of the sample a
    /// second.
    pub steady: f32,
    /// Time for which the camera must be steady, seconds.
    pub steady_seconds: f32,
    /// Guidance ends where the best view would remove less than this share of the expected squared error, 0
    /// to 1.
    pub enough: f32,
    /// Smallest number of photos.
    pub least: u32,
    /// Largest number of photos.
    pub most: u32,
    /// Largest angle of the first photo off the vertical, degrees.
    pub first_tilt_deg: f32,
    /// Time after SVBRDF_ACTION_SHOOT from which on the photo is no longer expected, seconds.
    pub shot_seconds: f32,
}

impl Default for svbrdf_guide_options {
    fn default() -> Self {
        let o = GuideOptions::default();
        Self {
            size: size_of::<Self>(),
            worth: o.worth,
            steady: o.steady,
            steady_seconds: o.steady_seconds,
            enough: o.enough,
            least: o.least as u32,
            most: o.most as u32,
            first_tilt_deg: o.first_tilt_deg,
            shot_seconds: o.shot_seconds as f32,
        }
    }
}
versioned!(svbrdf_guide_options, size_of::<svbrdf_guide_options>());

impl From<svbrdf_guide_options> for GuideOptions {
    fn from(o: svbrdf_guide_options) -> Self {
        Self {
            worth: o.worth,
            steady: o.steady,
            steady_seconds: o.steady_seconds,
            enough: o.enough,
            least: o.least as usize,
            most: o.most as usize,
            first_tilt_deg: o.first_tilt_deg,
            shot_seconds: o.shot_seconds.into(),
        }
    }
}

/// The next action, see svbrdf_session_guide().
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_guidance {
    /// Size of this struct.
    pub size: usize,
    /// One of SVBRDF_ACTION_.
    pub action: svbrdf_action,
    /// Accepted photos so far.
    pub photos: u32,
    /// 1 when the fields up to degrees are known.
    pub has_target: u32,
    /// Angle of the target off the vertical, degrees.
    pub target_tilt_deg: f32,
    /// The target's side: degrees counter-clockwise from the board's +X, 0 to 360.
    pub target_azimuth_deg: f32,
    /// From the camera to the target, camera frame, mm: x right, y down, z forward. An arrow along x and
    /// y in the image shows the way.
    pub offset_mm: [f32; 3],
    /// Angle between the view and the target, seen from the sample, degrees.
    pub degrees: f32,
    /// Share of the expected squared error of renderings that a photo from here would remove, 0 to 1;
    /// negative when not known.
    pub gain: f32,
    /// The same for the most informative view.
    pub best_gain: f32,
    /// For the user, in English, UTF-8.
    pub message: [c_char; SVBRDF_ADVICE_BYTES],
}

defaults!(svbrdf_guidance { gain: -1.0, best_gain: -1.0 });
versioned!(svbrdf_guidance, size_of::<svbrdf_guidance>());

impl svbrdf_guidance {
    fn new(guidance: &Guidance) -> Self {
        let action = match guidance.action {
            Action::Adjust => SVBRDF_ACTION_ADJUST,
            Action::Hold => SVBRDF_ACTION_HOLD,
            Action::Move => SVBRDF_ACTION_MOVE,
            Action::Shoot => SVBRDF_ACTION_SHOOT,
            Action::Enough => SVBRDF_ACTION_ENOUGH,
        };
        let mut out = Self {
            action,
            photos: guidance.photos as u32,
            gain: guidance.gain.unwrap_or(-1.0),
            best_gain: guidance.best_gain.unwrap_or(-1.0),
            message: text(&guidance.message),
            ..Self::default()
        };
        if let Some(target) = &guidance.target {
            out.has_target = 1;
            out.target_tilt_deg = target.view.tilt_deg;
            out.target_azimuth_deg = target.view.azimuth_deg;
            (out.offset_mm, out.degrees) = (target.offset_mm, target.degrees);
        }
        out
    }
}

/// Fills options with defaults: pass sizeof(svbrdf_guide_options).
///
/// # Safety
/// `options` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_guide_options_init(
    options: *mut svbrdf_guide_options,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(options, size) })
}

/// Fills guidance with defaults: pass sizeof(svbrdf_guidance).
///
/// # Safety
/// `guidance` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_guidance_init(
    guidance: *mut svbrdf_guidance,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(guidance, size) })
}

/// Starts guidance again with options; NULL: the defaults. Guidance with defaults needs no start. Also says
/// that a requested photo was not taken, or was rejected.
///
/// # Safety
/// `options` is NULL or initialised by svbrdf_guide_options_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_guide_begin(
    session: *mut svbrdf_session,
    options: *const svbrdf_guide_options,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for the struct.
        let options = unsafe { versioned::read_or_default(options) }?;
        let guide = engine::guide::Guide::new(options.into());
        *live.guide.lock().unwrap_or_else(PoisonError::into_inner) = guide;
        Ok(())
    })
}

/// Judges an image of the camera's preview as svbrdf_session_probe() does, and returns the next action: adjust,
/// hold, move, shoot, or enough. It considers the place of the board, blur, exposure, the motion of the
/// camera, and the expected gain of a photo from here. Call it with every image, from a few to thirty a
/// second; `info.timestamp_ns` is the image's time on a monotonic clock.
///
/// After SVBRDF_ACTION_SHOOT it returns SVBRDF_ACTION_HOLD until the photo has been added, or
/// svbrdf_guide_options.shot_seconds have passed. Runs only on the calling thread; waits neither for the fit
/// nor for a photo that is being added. `probe` may be NULL.
///
/// # Safety
/// As svbrdf_session_probe(); `guidance` is NULL or initialised by svbrdf_guidance_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_guide(
    session: *mut svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_photo_info,
    probe: *mut svbrdf_probe,
    guidance: *mut svbrdf_guidance,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for the structs.
        let (image, info, size) = unsafe {
            (
                versioned::read(image)?,
                svbrdf_photo_info::from_caller(info)?,
                versioned::needed_size("guidance", guidance)?,
            )
        };
        // SAFETY: the caller vouches for the struct.
        let room = unsafe { probe::Room::of(probe) }?;
        // SAFETY: the caller vouches for the planes.
        let photo = unsafe { info.photo(&image) }?;
        let found = match info.flash {
            SVBRDF_FLASH_OFF => live.session.probe_without_flash(&photo)?,
            _ => live.session.probe(&photo)?,
        };
        let seconds = info.timestamp_ns as f64 * 1e-9;
        let told = {
            let mut guide = live.guide.lock().unwrap_or_else(PoisonError::into_inner);
            guide.next(&live.session, &found, seconds)
        };
        // SAFETY: the room was found above; `size` bytes are there.
        unsafe {
            if let Some(room) = room {
                room.write(&found, info.timestamp_ns);
            }
            versioned::write(guidance, size, svbrdf_guidance::new(&told));
        }
        Ok(())
    })
}
