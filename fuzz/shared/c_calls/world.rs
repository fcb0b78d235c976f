//! Live objects of a sequence of calls.

use std::ffi::{c_char, c_void};
use std::ptr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::bytes::Bytes;
use super::pictures::Picture;
use crate::buffer::*;
use crate::handles::svbrdf_session;
use crate::log::*;
use crate::options::*;
use crate::reports::*;
use crate::saved::*;
use crate::session::*;
use crate::status::*;
use crate::threads::*;

/// Photos that may get as far as the networks, in one sequence.
const MAX_PHOTOS: usize = 1;
/// Photos that are looked at, in one sequence: a board takes a while.
const MAX_LOOKS: usize = 4;

pub struct World {
    /// Everything that was ever handed out, whatever its kind.
    pub handles: Vec<usize>,
    pub buffers: Vec<usize>,
    pub noise: Picture,
    photos: usize,
    looks: usize,
    /// Photos that were added without waiting, and those that were answered.
    pub asked: usize,
    pub answered: Box<Answers>,
}

#[derive(Default)]
pub struct Answers {
    pub all: AtomicUsize,
    pub accepted: AtomicUsize,
}

impl World {
    pub fn new() -> Self {
        Self {
            handles: Vec::new(),
            buffers: Vec::new(),
            noise: Picture::noise(),
            photos: 0,
            looks: 0,
            asked: 0,
            answered: Box::default(),
        }
    }

    pub fn pick<T>(&self, bytes: &mut Bytes) -> *mut T {
        let choice = usize::from(bytes.u8());
        match choice {
            0xFF => ptr::null_mut(),
            0xFE => ptr::without_provenance_mut(usize::MAX),
            _ if self.handles.is_empty() => ptr::null_mut(),
            // The latest are the likeliest to be alive.
            _ => {
                let count = self.handles.len();
                ptr::without_provenance_mut(self.handles[count - 1 - choice % count.min(6)])
            }
        }
    }

    pub fn add<T>(&mut self, status: svbrdf_status, handle: *mut T) {
        assert_eq!(status == SVBRDF_OK, !handle.is_null(), "results come with success only");
        if !handle.is_null() {
            self.handles.push(handle.addr());
        }
    }

    /// A session that stands still until it is asked for something.
    pub fn add_paused(&mut self, status: svbrdf_status, session: *mut svbrdf_session) {
        if !session.is_null() {
            svbrdf_session_pause(session);
        }
        self.add(status, session);
    }

    /// Whether one more photo may be looked at.
    pub fn may_look(&mut self) -> bool {
        self.looks += 1;
        self.looks <= MAX_LOOKS
    }

    /// Whether one more photo may get as far as the networks.
    pub fn may_push(&mut self) -> bool {
        let added = self.photos + self.answered.accepted.load(Ordering::Relaxed);
        added < MAX_PHOTOS && self.may_look()
    }

    pub fn added(&mut self, status: svbrdf_status) {
        self.photos += usize::from(status == SVBRDF_OK);
    }
}

/// Counts an answer, and calls the library again.
pub unsafe extern "C" fn on_outcome(
    user: *mut c_void,
    session: *mut svbrdf_session,
    status: svbrdf_status,
    report: *const svbrdf_photo_report,
) {
    // SAFETY: the world's counters, which live until its sessions have ended; the report lives
    // during the call.
    let (answered, report) = unsafe { (&*user.cast::<Answers>(), &*report) };
    assert_eq!(report.accepted == 1, status == SVBRDF_OK);
    assert_ne!(status, SVBRDF_FAILED);
    if report.timestamp_ns % 4 == 3 {
        svbrdf_session_cancel(session);
    }
    answered.accepted.fetch_add(usize::from(status == SVBRDF_OK), Ordering::Relaxed);
    answered.all.fetch_add(1, Ordering::Relaxed);
}

pub unsafe extern "C" fn on_line(_: *mut c_void, level: svbrdf_log_level, _: *const c_char) {
    assert!(level <= SVBRDF_LOG_DEBUG);
}

pub unsafe extern "C" fn on_thread(_: *mut c_void, thread: svbrdf_thread) {
    assert!(thread <= SVBRDF_THREAD_PHOTOS);
}

/// A saved session with two photos: maps without waiting for the networks.
pub fn saved() -> &'static [u8] {
    static SAVED: OnceLock<Vec<u8>> = OnceLock::new();
    SAVED.get_or_init(|| {
        let options = svbrdf_session_options {
            scene: SVBRDF_SCENE_RECTIFIED,
            threads: 1,
            ..Default::default()
        };
        let mut session = ptr::null_mut();
        let picture = Picture::noise();
        // SAFETY: everything is alive and of the size said.
        unsafe {
            assert_eq!(svbrdf_session_create(&raw const options, &raw mut session), SVBRDF_OK);
            svbrdf_session_pause(session);
            for x in [0.0, 80.0] {
                let (image, position) = (picture.image(), [x, 0.0, 200.0]);
                let (camera, none) = (position.as_ptr(), ptr::null_mut());
                let status = svbrdf_session_add_rectified_photo(
                    session,
                    &raw const image,
                    ptr::null(),
                    camera,
                    camera,
                    none,
                );
                assert_eq!(status, SVBRDF_OK);
            }
            let (mut buffer, mut data, mut size) = (ptr::null_mut(), ptr::null(), 0);
            assert_eq!(svbrdf_session_save_state(session, &raw mut buffer), SVBRDF_OK);
            svbrdf_session_destroy(session);
            svbrdf_buffer_view(buffer, &raw mut data, &raw mut size);
            let saved = std::slice::from_raw_parts(data.cast::<u8>(), size).to_vec();
            svbrdf_buffer_destroy(buffer);
            saved
        }
    })
}
