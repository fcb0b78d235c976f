//! A capture in progress.

use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use engine::frame::Photo;
use engine::session::{Pushed, Session};
use engine::{Error, Rejection};

use crate::handles::Handles;
use crate::image::svbrdf_image;
use crate::maps::{self, svbrdf_maps};
use crate::models;
use crate::notifier::{self, Callbacks};
use crate::options::{
    SVBRDF_FLASH_OFF, SVBRDF_LOG_ERROR, SVBRDF_LOG_INFO, SVBRDF_LOG_WARNING, svbrdf_camera,
    svbrdf_frame_info, svbrdf_session_options,
};
use crate::reports::{
    SVBRDF_STATE_CANCELLED, SVBRDF_STATE_FAILED, SVBRDF_STATE_FITTING, SVBRDF_STATE_PAUSED,
    SVBRDF_STATE_READY, svbrdf_frame_report, svbrdf_next_view, svbrdf_paper, svbrdf_progress,
    words,
};
use crate::status::{
    Fault, SVBRDF_FAILED, SVBRDF_REJECTED, SVBRDF_TIMEOUT, entry, panic_text, svbrdf_status,
};
use crate::versioned;

/// A capture in progress: push photos, take maps at any time.
pub struct svbrdf_session {
    _opaque: (),
}

/// A session behind a handle. Lives until destroyed and the last call inside it has returned.
pub(crate) struct Live {
    pub(crate) session: Session,
    pub(crate) callbacks: Callbacks,
    /// No callback starts after this.
    pub(crate) destroyed: AtomicBool,
    handle: usize,
    sample_mm: [f32; 2],
    paused: AtomicBool,
    cancelled: AtomicBool,
    /// What a panic inside one of the calls said.
    failed: OnceLock<String>,
    notifier: Mutex<Option<JoinHandle<()>>>,
}

static SESSIONS: Handles<Live> = Handles::new("session");

impl Live {
    pub(crate) fn handle(&self) -> *mut svbrdf_session {
        std::ptr::without_provenance_mut(self.handle)
    }

    pub(crate) fn progress(&self) -> svbrdf_progress {
        let progress = self.session.progress();
        let state = if self.failed.get().is_some() || self.session.failure().is_some() {
            SVBRDF_STATE_FAILED
        } else if self.cancelled.load(Ordering::Relaxed) {
            SVBRDF_STATE_CANCELLED
        } else if progress.settled {
            SVBRDF_STATE_READY
        } else if self.paused.load(Ordering::Relaxed) {
            SVBRDF_STATE_PAUSED
        } else {
            SVBRDF_STATE_FITTING
        };
        svbrdf_progress::new(&progress, state, self.session.revision().maps)
    }

    /// Runs a call; a panic makes the session fail for ever.
    fn guarded(&self, body: impl FnOnce() -> Result<(), Fault>) -> Result<(), Fault> {
        catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|panic| {
            let message = self.failed.get_or_init(|| panic_text(&*panic)).clone();
            self.session.cancel();
            self.callbacks.log(SVBRDF_LOG_ERROR, || message.clone());
            Err(Fault::new(SVBRDF_FAILED, message))
        })
    }

    /// Refuses calls after a panic.
    fn usable(&self) -> Result<(), Fault> {
        match self.failed.get() {
            Some(message) => Err(Fault::new(SVBRDF_FAILED, message.clone())),
            None => Ok(()),
        }
    }
}

/// A call that a failed session still answers.
fn look(
    session: *const svbrdf_session,
    body: impl FnOnce(&Live) -> Result<(), Fault>,
) -> svbrdf_status {
    entry(|| {
        let live = SESSIONS.get(session.addr())?;
        live.guarded(|| body(&live))
    })
}

/// A call that a failed session refuses.
pub(crate) fn act(
    session: *const svbrdf_session,
    body: impl FnOnce(&Live) -> Result<(), Fault>,
) -> svbrdf_status {
    look(session, |live| {
        live.usable()?;
        body(live)
    })
}

/// Starts a session. On success `*session` is a handle to free with svbrdf_session_destroy();
/// otherwise it is left as it was.
///
/// # Safety
/// `options` is NULL or initialised by svbrdf_session_options_init(); what it points to is what
/// the header says; `session` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_create(
    options: *const svbrdf_session_options,
    session: *mut *mut svbrdf_session,
) -> svbrdf_status {
    // SAFETY: the caller vouches for the options, what they point to, and the result.
    unsafe {
        open(options, session, |options| {
            let (scene, settings) = (options.scene()?, options.settings()?);
            let networks = models::networks(options.models)?;
            Ok(Session::with_networks(scene, settings, networks)?)
        })
    }
}

/// Makes a session with the callbacks of options and hands it out.
///
/// # Safety
/// As svbrdf_session_create().
pub(crate) unsafe fn open(
    options: *const svbrdf_session_options,
    session: *mut *mut svbrdf_session,
    make: impl FnOnce(&svbrdf_session_options) -> Result<Session, Fault>,
) -> svbrdf_status {
    entry(|| {
        if session.is_null() {
            return Err(Fault::argument("session: NULL given"));
        }
        // SAFETY: the caller vouches for the options.
        let options = unsafe { versioned::read(options) }?;
        let made = make(&options)?;
        let sample_mm = made.settings().sample_mm;
        let live = Arc::new(Live {
            session: made,
            callbacks: Callbacks::new(&options),
            destroyed: AtomicBool::new(false),
            handle: Handles::<Live>::reserve(),
            sample_mm,
            paused: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
            failed: OnceLock::new(),
            notifier: Mutex::new(None),
        });
        live.callbacks.log(SVBRDF_LOG_INFO, || {
            format!("session of {0} x {0} texels started", live.session.settings().resolution)
        });
        // Known before the first callback, which may use it.
        SESSIONS.insert(live.handle, live.clone());
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { session.write(live.handle()) };
        if live.callbacks.notifies() {
            let thread = notifier::start(&live).inspect_err(|_| {
                let _ = SESSIONS.remove(live.handle);
                // SAFETY: as above.
                unsafe { session.write(std::ptr::null_mut()) };
            })?;
            *live.notifier.lock().unwrap_or_else(PoisonError::into_inner) = Some(thread);
        }
        Ok(())
    })
}

/// Takes a photo of a board in: copied, calibrated, rectified. When it returns SVBRDF_OK, maps that
/// know of the photo are available; the fit goes on in the background. SVBRDF_REJECTED when the
/// photo cannot be used: nothing changed. `info` and `report` may be NULL. Calls from several
/// threads are served one after the other.
///
/// # Safety
/// Each pointer is NULL or initialised by its _init() function; the image's planes are NULL or
/// have as many readable bytes as said.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_push_frame(
    session: *mut svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_frame_info,
    report: *mut svbrdf_frame_report,
) -> svbrdf_status {
    // SAFETY: the caller vouches for every pointer.
    unsafe { push(session, image, info, report, |session, photo| session.push(photo)) }
}

/// As svbrdf_session_push_frame() for a photo that shows the sample's rectangle from the top, at
/// any size. Positions of camera and light: three numbers each, mm, board frame (origin at the
/// sample's centre, X right, Y up, Z towards the camera).
///
/// # Safety
/// As svbrdf_session_push_frame(); each position is NULL or three readable floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_push_rectified(
    session: *mut svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_frame_info,
    camera_mm: *const f32,
    light_mm: *const f32,
    report: *mut svbrdf_frame_report,
) -> svbrdf_status {
    let position = |name: &'static str, p: *const f32| {
        if p.is_null() {
            return Err(Error::argument(name, "NULL given"));
        }
        // SAFETY: not NULL, and the caller vouches for three floats.
        Ok(unsafe { p.cast::<[f32; 3]>().read_unaligned() })
    };
    let take = |session: &Session, photo: &Photo| {
        let camera = position("camera_mm", camera_mm)?;
        session.push_rectified(photo, camera, position("light_mm", light_mm)?)
    };
    // SAFETY: the caller vouches for every pointer.
    unsafe { push(session, image, info, report, take) }
}

/// # Safety
/// As [`svbrdf_session_push_frame`].
unsafe fn push(
    session: *mut svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_frame_info,
    report: *mut svbrdf_frame_report,
    take: impl FnOnce(&Session, &Photo) -> engine::Result<Pushed>,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for the structs and planes.
        let (image, info, size) = unsafe {
            (
                versioned::read(image)?,
                svbrdf_frame_info::from_caller(info)?,
                versioned::result_size(report)?,
            )
        };
        let pushed = if info.flash == SVBRDF_FLASH_OFF {
            Pushed::Rejected(Rejection::LightNotVisible)
        } else {
            // SAFETY: as above.
            let photo = unsafe { info.photo(&image) }?;
            take(&live.session, &photo)?
        };
        // SAFETY: `size` bytes are there.
        unsafe { tell(live, &pushed, info.timestamp_ns, report, size) }
    })
}

/// Logs and reports what became of a photo.
///
/// # Safety
/// `report` has `size` writable bytes, if any.
pub(crate) unsafe fn tell(
    live: &Live,
    pushed: &Pushed,
    timestamp_ns: i64,
    report: *mut svbrdf_frame_report,
    size: Option<usize>,
) -> Result<(), Fault> {
    let (result, value) = match pushed {
        Pushed::Accepted(accepted) => {
            live.callbacks.log(SVBRDF_LOG_INFO, || {
                let (index, seconds) = (accepted.index, accepted.maps_seconds);
                format!("photo {timestamp_ns} accepted as number {index} in {seconds:.2} s")
            });
            if !accepted.hints.is_empty() {
                live.callbacks.log(SVBRDF_LOG_WARNING, || {
                    format!("photo {timestamp_ns}: {}", words(&accepted.hints))
                });
            }
            (Ok(()), svbrdf_frame_report::accepted(accepted, timestamp_ns))
        }
        Pushed::Rejected(rejection) => {
            live.callbacks.log(SVBRDF_LOG_WARNING, || {
                format!("photo {timestamp_ns} rejected ({}): {rejection}", rejection.code())
            });
            let report = svbrdf_frame_report::rejected(rejection, timestamp_ns);
            (Err(Fault::new(SVBRDF_REJECTED, rejection.to_string())), report)
        }
    };
    if let Some(size) = size {
        // SAFETY: the caller vouches for the bytes.
        unsafe { versioned::write(report, size, value) };
    }
    result
}

/// Blocks until the fit has settled on all photos so far, for at most `timeout_ms` milliseconds
/// (negative: no limit; 0: only looks). SVBRDF_TIMEOUT when it has not settled by then.
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
        if settled { Ok(()) } else { Err(Fault::new(SVBRDF_TIMEOUT, "the fit goes on")) }
    })
}

/// State of the fit; answered at once, also by a failed or cancelled session.
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
        let size = unsafe { versioned::result_size(progress) }?;
        let size = size.ok_or_else(|| Fault::argument("progress: NULL given"))?;
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(progress, size, live.progress()) };
        Ok(())
    })
}

/// The light as found so far: position of the flash in the camera frame, three numbers, mm, and
/// ambient light as a share of the flash's at the sample's centre. Waits for a push in progress.
/// Results may be NULL.
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
        // SAFETY: the caller vouches for what is not NULL.
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

/// Where the next photo tells most. Waits for a push in progress.
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
        let size = unsafe { versioned::result_size(view) }?;
        let size = size.ok_or_else(|| Fault::argument("view: NULL given"))?;
        let next = svbrdf_next_view::new(live.session.next_view());
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(view, size, next) };
        Ok(())
    })
}

/// The camera as used: given, or estimated from the photos so far; all zeros before the first photo
/// tells and for rectified photos. `sigma`, which may be NULL: standard deviations of fx, fy, cx, cy
/// (px), k1, k2, p1, p2, k3 of an estimated camera, otherwise zeros. Waits for a push in progress.
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
        let size = unsafe { versioned::result_size(camera) }?;
        let size = size.ok_or_else(|| Fault::argument("camera: NULL given"))?;
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

/// The printed sheet and the sample's height above it, as used. Waits for a push in progress.
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
        let size = unsafe { versioned::result_size(paper) }?;
        let size = size.ok_or_else(|| Fault::argument("paper: NULL given"))?;
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(paper, size, svbrdf_paper::of(&live.session)) };
        Ok(())
    })
}

/// Pose of an accepted photo of a board as known now: with a camera that is estimated, later photos
/// better those of earlier ones. `index` counts the accepted photos from 0. Results as in
/// svbrdf_frame_report; each may be NULL. Waits for a push in progress.
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
            Fault::argument(format!("index: {index} given, poses there are: {}", poses.len()))
        })?;
        let rows = board.pose.rotation.transpose().to_cols_array();
        // SAFETY: the caller vouches for what is not NULL.
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

/// The maps as they are now; SVBRDF_NO_MAPS before the first accepted photo. Answered at once, also
/// by a failed or cancelled session. Free with svbrdf_maps_destroy().
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

/// Writes the maps as they are now into a folder, as svbrdf_maps_export().
///
/// # Safety
/// `path` is NULL or a C string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_export(
    session: *const svbrdf_session,
    path: *const c_char,
) -> svbrdf_status {
    look(session, |live| {
        // SAFETY: the caller vouches for the string.
        let dir = unsafe { maps::folder(path) }?;
        maps::export(&*live.session.snapshot()?, live.sample_mm, dir)
    })
}

/// Holds the fit after the step in progress; photos are still taken in.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_pause(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.paused.store(true, Ordering::Relaxed);
        live.session.pause();
        Ok(())
    })
}

/// Goes on after svbrdf_session_pause().
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_resume(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.paused.store(false, Ordering::Relaxed);
        live.session.resume();
        Ok(())
    })
}

/// Ends the fit after the step in progress. Photos are refused from then on; maps stay available.
/// Calls that wait return SVBRDF_CANCELLED.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_cancel(session: *mut svbrdf_session) -> svbrdf_status {
    act(session, |live| {
        live.cancelled.store(true, Ordering::Relaxed);
        live.session.cancel();
        Ok(())
    })
}

/// Ends a session at any time, from any thread, also from its callbacks and while other threads
/// are inside its calls: those return SVBRDF_CANCELLED or their result. Blocks for the step in
/// progress at most, and for a callback in progress on another thread. When it has returned, no
/// progress or maps callback is running or will come (but the one it was called from). The handle
/// is never valid again; further calls with it answer SVBRDF_INVALID_HANDLE. NULL is fine.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_destroy(session: *mut svbrdf_session) -> svbrdf_status {
    entry(|| {
        if session.is_null() {
            return Ok(());
        }
        let live = SESSIONS.remove(session.addr())?;
        live.destroyed.store(true, Ordering::Release);
        live.cancelled.store(true, Ordering::Relaxed);
        live.session.cancel();
        let notifier = live.notifier.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(notifier) = notifier
            && notifier.thread().id() != thread::current().id()
        {
            // It catches nothing because nothing of ours panics there; a panic would end there.
            let _ = notifier.join();
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests;
