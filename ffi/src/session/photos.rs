//! Photos into a session.

use engine::photo::Photo;
use engine::session::{AcceptedPhoto, Outcome, Session};
use engine::{Error, Rejection};

use crate::capture::{CAPTURES, svbrdf_capture};
use crate::handles::svbrdf_session;
use crate::image::svbrdf_image;
use crate::live::{Live, act};
use crate::log::{SVBRDF_LOG_INFO, SVBRDF_LOG_WARNING};
use crate::options::{SVBRDF_FLASH_OFF, svbrdf_photo_info};
use crate::reports::{svbrdf_photo_report, words};
use crate::status::{Fault, SVBRDF_REJECTED, svbrdf_status};
use crate::versioned;

/// Takes in a photo of a board: copies, calibrates and rectifies it. When this returns SVBRDF_OK, the
/// maps include the photo, and the fit continues in the background. SVBRDF_REJECTED: the photo cannot
/// be used, and nothing changed. `info` and `report` may be NULL. Calls from several threads are
/// served one after the other.
///
/// # Safety
/// Each pointer is NULL or initialised by its _init() function; the image's planes are NULL or
/// have as many readable bytes as said.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_add_photo(
    session: *mut svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_photo_info,
    report: *mut svbrdf_photo_report,
) -> svbrdf_status {
    // SAFETY: the caller vouches for every pointer.
    unsafe { add(session, image, info, report, |session, photo| session.add_photo(photo)) }
}

/// As svbrdf_session_add_photo(), for a photo that shows exactly the sample's rectangle from above, at
/// any size. Positions of camera and light: three numbers each, mm, board frame (origin at the
/// sample's centre, X right, Y up, Z towards the camera).
///
/// # Safety
/// As svbrdf_session_add_photo(); each position is NULL or three readable floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_add_rectified_photo(
    session: *mut svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_photo_info,
    camera_mm: *const f32,
    light_mm: *const f32,
    report: *mut svbrdf_photo_report,
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
        session.add_rectified_photo(photo, camera, position("light_mm", light_mm)?)
    };
    // SAFETY: the caller vouches for every pointer.
    unsafe { add(session, image, info, report, take) }
}

/// # Safety
/// As [`svbrdf_session_add_photo`].
unsafe fn add(
    session: *mut svbrdf_session,
    image: *const svbrdf_image,
    info: *const svbrdf_photo_info,
    report: *mut svbrdf_photo_report,
    take: impl FnOnce(&Session, &Photo) -> engine::Result<Outcome<AcceptedPhoto>>,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for the structs and planes.
        let (image, info, size) = unsafe {
            (
                versioned::read(image)?,
                svbrdf_photo_info::from_caller(info)?,
                versioned::result_size(report)?,
            )
        };
        let outcome = if info.flash == SVBRDF_FLASH_OFF {
            live.session.reject(Rejection::LightNotVisible)
        } else {
            // SAFETY: as above.
            let photo = unsafe { info.photo(&image) }?;
            take(&live.session, &photo)?
        };
        // SAFETY: `size` bytes are there.
        unsafe { tell(live, &outcome, info.timestamp_ns, report, size) }
    })
}

/// Logs and reports the outcome of a photo.
///
/// # Safety
/// `report` has `size` writable bytes, if any.
pub(crate) unsafe fn tell(
    live: &Live,
    outcome: &Outcome<AcceptedPhoto>,
    timestamp_ns: i64,
    report: *mut svbrdf_photo_report,
    size: Option<usize>,
) -> Result<(), Fault> {
    let (result, value) = logged(live, outcome, timestamp_ns);
    if let Some(size) = size {
        // SAFETY: the caller vouches for the bytes.
        unsafe { versioned::write(report, size, value) };
    }
    result
}

/// Logs the outcome of a photo; returns the result of the call and its report.
pub(crate) fn logged(
    live: &Live,
    outcome: &Outcome<AcceptedPhoto>,
    timestamp_ns: i64,
) -> (Result<(), Fault>, svbrdf_photo_report) {
    match outcome {
        Outcome::Accepted(accepted) => {
            live.callbacks.log(SVBRDF_LOG_INFO, || {
                let (index, seconds) = (accepted.index, accepted.maps_seconds);
                format!("photo {timestamp_ns} accepted as number {index} in {seconds:.2} s")
            });
            if !accepted.hints.is_empty() {
                live.callbacks.log(SVBRDF_LOG_WARNING, || {
                    format!("photo {timestamp_ns}: {}", words(&accepted.hints))
                });
            }
            (Ok(()), svbrdf_photo_report::accepted(accepted, timestamp_ns))
        }
        Outcome::Rejected(rejection) => {
            live.callbacks.log(SVBRDF_LOG_WARNING, || {
                format!("photo {timestamp_ns} rejected ({}): {rejection}", rejection.code())
            });
            let report = svbrdf_photo_report::rejected(rejection, timestamp_ns);
            (Err(Fault::new(SVBRDF_REJECTED, rejection.to_string())), report)
        }
    }
}

/// Reads a photo of a capture and takes it in, as svbrdf_session_add_photo() or
/// svbrdf_session_add_rectified_photo(). The report's timestamp is the index. `report` may be NULL.
///
/// # Safety
/// `report` is NULL or initialised by svbrdf_photo_report_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_add_capture_photo(
    session: *mut svbrdf_session,
    capture: *const svbrdf_capture,
    index: u32,
    report: *mut svbrdf_photo_report,
) -> svbrdf_status {
    act(session, |live| {
        let capture = CAPTURES.get(capture.addr())?;
        // SAFETY: the caller vouches for the report.
        let size = unsafe { versioned::result_size(report) }?;
        let file = capture.photos.get(index as usize).ok_or_else(|| {
            Fault::argument(format!(
                "index: {index} given, but the capture has {} photos",
                capture.photos.len()
            ))
        })?;
        let photo = file.read()?;
        let outcome = match file.rectified {
            Some(view) => {
                live.session.add_rectified_photo(&photo, view.camera_mm, view.light_mm)?
            }
            None => live.session.add_photo(&photo)?,
        };
        // SAFETY: `size` bytes are there.
        unsafe { tell(live, &outcome, index.into(), report, size) }
    })
}

/// Takes back an accepted photo: the session, including its calibration, is as if the photo had never
/// come. `index` counts the accepted photos from 0; later ones move up by one. The fit starts again.
/// When this returns, the maps no longer include the photo; without any photo left there are none.
/// SVBRDF_INVALID_ARGUMENT for other indices, and if other photos would have been rejected without
/// this one. Waits for a photo that is being added and for a step of the fit.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_session_remove_photo(
    session: *mut svbrdf_session,
    index: u32,
) -> svbrdf_status {
    act(session, |live| {
        live.session.remove_photo(index as usize)?;
        live.callbacks.log(SVBRDF_LOG_INFO, || format!("photo number {index} taken back"));
        Ok(())
    })
}
