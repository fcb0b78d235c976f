//! Sequences of calls of the C library in any order with any arguments, as far as a caller may
//! choose them: pointers are NULL or what they should be, handles also stale or of another kind.

use std::ffi::{c_char, c_void};
use std::ptr;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::budget::*;
use crate::buffer::*;
use crate::capture::*;
use crate::confidence::*;
use crate::frame_fit::*;
use crate::handles::svbrdf_session;
use crate::image::*;
use crate::log::*;
use crate::maps::*;
use crate::options::*;
use crate::probe::*;
use crate::process::*;
use crate::reduced::*;
use crate::render::*;
use crate::reports::*;
use crate::saved::*;
use crate::session::*;
use crate::sheet::*;
use crate::status::*;
use crate::threads::*;

/// Calls of one sequence.
const MAX_CALLS: usize = 64;
/// Photos that may get as far as the networks, in one sequence.
const MAX_PHOTOS: usize = 1;

struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn u8(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// Mostly small and likely numbers, sometimes any.
    fn u32(&mut self) -> u32 {
        match self.u8() {
            0xFF => u32::from_le_bytes([self.u8(), self.u8(), self.u8(), self.u8()]),
            0xFE => u32::MAX,
            0xFD => 256,
            0xFC => 512,
            small => u32::from(small % 16),
        }
    }

    fn usize(&mut self) -> usize {
        match self.u8() {
            0xFF => usize::MAX,
            0xFE => usize::MAX / 2 + 1,
            other => usize::from(other) * 64,
        }
    }

    fn f32(&mut self) -> f32 {
        match self.u8() {
            0xFF => {
                f32::from_bits(u32::from_le_bytes([self.u8(), self.u8(), self.u8(), self.u8()]))
            }
            0xFE => f32::NAN,
            0xFD => f32::INFINITY,
            0xFC => -1.0,
            0xFB => f32::MIN_POSITIVE,
            other => f32::from(other),
        }
    }

    fn done(&self) -> bool {
        self.0.is_empty()
    }
}

#[derive(Default)]
struct World {
    /// Everything that was ever handed out, whatever its kind.
    handles: Vec<usize>,
    photos: usize,
    buffers: Vec<usize>,
    /// Photos that were pushed without waiting, and those that were answered.
    asked: usize,
    answered: Box<AtomicUsize>,
}

/// Counts an answer, and calls the library again.
unsafe extern "C" fn on_pushed(
    user: *mut c_void,
    session: *mut svbrdf_session,
    status: svbrdf_status,
    report: *const svbrdf_frame_report,
) {
    // SAFETY: the world's counter, which lives until its sessions have ended; the report lives
    // during the call.
    let (answered, report) = unsafe { (&*user.cast::<AtomicUsize>(), &*report) };
    assert_eq!(report.accepted == 1, status == SVBRDF_OK);
    assert_ne!(status, SVBRDF_FAILED);
    if report.timestamp_ns % 4 == 3 {
        svbrdf_session_cancel(session);
    }
    answered.fetch_add(1, Ordering::Relaxed);
}

unsafe extern "C" fn on_line(_: *mut c_void, level: svbrdf_log_level, _: *const c_char) {
    assert!(level <= SVBRDF_LOG_INFO);
}

unsafe extern "C" fn on_thread(_: *mut c_void, thread: svbrdf_thread) {
    assert!(thread <= SVBRDF_THREAD_PUSH);
}

fn board(bytes: &mut Bytes) -> svbrdf_board {
    let mut board = svbrdf_board::default();
    for _ in 0..bytes.u8() % 5 {
        match bytes.u8() % 9 {
            0 => board.rows = bytes.u32(),
            1 => board.cols = bytes.u32(),
            2 => board.hole_row_start = bytes.u32(),
            3 => board.hole_col_end = bytes.u32(),
            4 => board.square_mm = f64::from(bytes.f32()),
            5 => board.patches = bytes.u32(),
            6 => board.top_left_white = bytes.u32(),
            7 => board.size = bytes.usize().min(size_of::<svbrdf_board>()),
            _ => {
                board.kind = SVBRDF_BOARD_CHARUCO_RING;
                board.marker_mm = f64::from(bytes.f32());
                board.dictionary = c"DICT_4X4_250".as_ptr();
            }
        }
    }
    board
}

impl World {
    fn pick<T>(&self, bytes: &mut Bytes) -> *mut T {
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

    fn add<T>(&mut self, status: svbrdf_status, handle: *mut T) {
        assert_eq!(status == SVBRDF_OK, !handle.is_null(), "results come with success only");
        if !handle.is_null() {
            self.handles.push(handle.addr());
        }
    }
}

fn options(bytes: &mut Bytes) -> svbrdf_session_options {
    let mut options = svbrdf_session_options { threads: 1, ..Default::default() };
    options.scene = SVBRDF_SCENE_RECTIFIED;
    for _ in 0..bytes.u8() % 4 {
        match bytes.u8() % 11 {
            0 => options.scene = bytes.u32(),
            1 => options.resolution = bytes.u32(),
            2 => options.sample_mm[usize::from(bytes.u8() % 2)] = bytes.f32(),
            3 => options.method = bytes.u32(),
            4 => options.refine = bytes.u32(),
            5 => options.threads = bytes.u32().min(70),
            6 => options.falloff = bytes.u32(),
            7 => options.light_power = [bytes.f32(), bytes.f32(), bytes.f32()],
            8 => options.memory_limit_bytes = u64::from(bytes.u32()) << 20,
            9 => options.size = bytes.usize().min(size_of::<svbrdf_session_options>()),
            _ => options.scene = SVBRDF_SCENE_BOARD,
        }
    }
    options
}

/// A picture whose planes are `pixels`, and what is said about them is anything.
fn image(bytes: &mut Bytes, pixels: &[u8]) -> svbrdf_image {
    let mut image = svbrdf_image { format: SVBRDF_PIXEL_RGB8, ..Default::default() };
    (image.width, image.height) = (16, 16);
    for plane in &mut image.planes {
        plane.data = pixels.as_ptr().cast();
        plane.bytes = pixels.len();
        plane.row_stride = 48;
    }
    for _ in 0..bytes.u8() % 6 {
        let plane = usize::from(bytes.u8() % 3);
        match bytes.u8() % 16 {
            0 => image.format = bytes.u32(),
            1 => image.width = bytes.u32(),
            2 => image.height = bytes.u32(),
            3 => image.transfer = bytes.u32(),
            4 => image.rotation = 90 * bytes.u32().min(5),
            5 => image.planes[plane].row_stride = bytes.usize(),
            6 => image.planes[plane].pixel_stride = bytes.usize(),
            7 => image.planes[plane].bytes = bytes.usize().min(pixels.len()),
            8 => image.planes[plane].data = ptr::null(),
            9 => image.saturation = bytes.f32(),
            10 => image.black_level[plane] = bytes.f32(),
            11 => image.white_level = bytes.f32(),
            12 => image.white_balance[plane] = bytes.f32(),
            13 => image.primaries = bytes.u32(),
            14 => image.yuv_matrix = bytes.u32(),
            _ => (image.format, image.bayer_pattern) = (SVBRDF_PIXEL_BAYER16, bytes.u32()),
        }
    }
    image
}

pub fn run(data: &[u8]) {
    let mut bytes = Bytes(data);
    let mut world = World::default();
    let pixels: Vec<u8> = (0..2048_u32).map(|i| (i * 37 % 251) as u8).collect();
    for _ in 0..MAX_CALLS {
        if bytes.done() {
            break;
        }
        call(&mut bytes, &mut world, &pixels);
    }
    // What lives is ended by whoever its kind is; the others say that they do not know it.
    for &handle in &world.handles {
        let session = svbrdf_session_destroy(ptr::without_provenance_mut(handle));
        let maps = svbrdf_maps_destroy(ptr::without_provenance_mut(handle));
        let buffer = svbrdf_buffer_destroy(ptr::without_provenance_mut(handle));
        let capture = svbrdf_capture_destroy(ptr::without_provenance_mut(handle));
        let ended = [session, maps, buffer, capture].iter().filter(|&&s| s == SVBRDF_OK).count();
        assert!(ended <= 1, "a handle is of one kind");
    }
    assert_eq!(world.answered.load(Ordering::Relaxed), world.asked, "answers of photos");
}

fn call(bytes: &mut Bytes, world: &mut World, pixels: &[u8]) {
    let choice = bytes.u8() % 43;
    // SAFETY: every pointer is NULL or to something alive of the size said.
    let status = unsafe {
        match choice {
            0 | 1 => {
                let options = options(bytes);
                let mut session = ptr::null_mut();
                let status = svbrdf_session_create(&raw const options, &raw mut session);
                if !session.is_null() {
                    svbrdf_session_pause(session);
                }
                world.add(status, session);
                status
            }
            2 | 3 | 24 => {
                let session = world.pick(bytes);
                let image = image(bytes, pixels);
                let positions = [bytes.f32(), bytes.f32(), bytes.f32()];
                let mut report = svbrdf_frame_report::default();
                let mut info = svbrdf_frame_info {
                    exposure: bytes.f32(),
                    flash: bytes.u32(),
                    ..Default::default()
                };
                let ambient;
                if choice == 24 {
                    ambient = self::image(bytes, pixels);
                    info.ambient = &raw const ambient;
                    (info.ambient_exposure, info.focal_35mm) = (bytes.f32(), bytes.f32());
                    report.size = bytes.usize().min(size_of::<svbrdf_frame_report>());
                }
                if world.photos >= MAX_PHOTOS {
                    return;
                }
                let status = svbrdf_session_push_rectified(
                    session,
                    &raw const image,
                    &raw const info,
                    positions.as_ptr(),
                    positions.as_ptr(),
                    &raw mut report,
                );
                assert_eq!(report.accepted == 1, status == SVBRDF_OK);
                world.photos += usize::from(status == SVBRDF_OK);
                status
            }
            4 => {
                let session = world.pick(bytes);
                let image = image(bytes, pixels);
                svbrdf_session_push_frame(session, &raw const image, ptr::null(), ptr::null_mut())
            }
            5 => svbrdf_session_wait(world.pick(bytes), 0),
            6 => {
                let mut progress = svbrdf_progress {
                    size: bytes.usize().min(size_of::<svbrdf_progress>()),
                    ..Default::default()
                };
                svbrdf_session_progress(world.pick(bytes), &raw mut progress)
            }
            7 => svbrdf_session_light(world.pick(bytes), ptr::null_mut(), ptr::null_mut()),
            8 => {
                let mut maps = ptr::null_mut();
                let status = svbrdf_session_snapshot_maps(world.pick(bytes), &raw mut maps);
                world.add(status, maps);
                status
            }
            9 => svbrdf_session_pause(world.pick(bytes)),
            10 => svbrdf_session_cancel(world.pick(bytes)),
            11 => svbrdf_session_destroy(world.pick(bytes)),
            12 => {
                let budget = svbrdf_budget {
                    seconds: bytes.f32(),
                    max_steps: bytes.u32(),
                    stop_when_invisible: bytes.u32(),
                    ..Default::default()
                };
                svbrdf_session_set_budget(world.pick(bytes), &raw const budget)
            }
            13 | 14 => {
                let mut buffer = ptr::null_mut();
                let status = svbrdf_session_save_state(world.pick(bytes), &raw mut buffer);
                if status == SVBRDF_OK {
                    world.buffers.push(buffer.addr());
                }
                world.add(status, buffer);
                status
            }
            15 | 16 => {
                let buffer = world.buffers.last().copied().unwrap_or(0);
                let (mut data, mut size) = (ptr::null(), 0_usize);
                let buffer: *mut svbrdf_buffer = ptr::without_provenance_mut(buffer);
                if svbrdf_buffer_view(buffer, &raw mut data, &raw mut size) != SVBRDF_OK {
                    return;
                }
                let options = options(bytes);
                let size = if bytes.u8() < 32 { bytes.usize().min(size) } else { size };
                let mut session = ptr::null_mut();
                let status =
                    svbrdf_session_load_state(&raw const options, data, size, &raw mut session);
                if !session.is_null() {
                    svbrdf_session_pause(session);
                }
                world.add(status, session);
                status
            }
            17 => svbrdf_buffer_destroy(world.pick(bytes)),
            18 => svbrdf_maps_destroy(world.pick(bytes)),
            19 => {
                let mut view = svbrdf_map_view::default();
                let (map, format) = (bytes.u32(), bytes.u32());
                svbrdf_maps_view(world.pick(bytes), map, format, &raw mut view)
            }
            20 => {
                let mut out = [0_u8; 512];
                let (map, format, stride) = (bytes.u32(), bytes.u32(), bytes.usize());
                let data: *mut c_void = out.as_mut_ptr().cast();
                svbrdf_maps_copy(world.pick(bytes), map, format, data, out.len(), stride)
            }
            21 => {
                let mut count = 0;
                svbrdf_capture_frames(world.pick(bytes), &raw mut count)
            }
            22 => {
                let mut capture = ptr::null_mut();
                let status = svbrdf_capture_open(c"/nowhere".as_ptr(), &raw mut capture);
                world.add(status, capture);
                status
            }
            25 => {
                let mut view = svbrdf_next_view {
                    size: bytes.usize().min(size_of::<svbrdf_next_view>()),
                    ..Default::default()
                };
                svbrdf_session_next_view(world.pick(bytes), &raw mut view)
            }
            26 => {
                let mut camera = svbrdf_camera::default();
                let mut sigma = [0.0; 9];
                let sigma = if bytes.u8() < 128 { sigma.as_mut_ptr() } else { ptr::null_mut() };
                svbrdf_session_camera(world.pick(bytes), &raw mut camera, sigma)
            }
            28 | 29 => {
                let session: *mut svbrdf_session = world.pick(bytes);
                let image = image(bytes, pixels);
                let info = svbrdf_frame_info {
                    exposure: bytes.f32(),
                    flash: bytes.u32(),
                    focal_35mm: bytes.f32(),
                    ..Default::default()
                };
                let mut corners = [0.0_f32; 2 * 64];
                let mut probe = svbrdf_probe::default();
                if choice == 29 {
                    probe.size = bytes.usize().min(size_of::<svbrdf_probe>());
                    probe.corners_px = corners.as_mut_ptr();
                    probe.corners_capacity = bytes.u32() % 65;
                }
                let status = svbrdf_session_probe(
                    session,
                    &raw const image,
                    &raw const info,
                    &raw mut probe,
                );
                assert!(status == SVBRDF_OK || probe.acceptable == 0);
                status
            }
            30 => svbrdf_session_remove_frame(world.pick(bytes), bytes.u32()),
            31 => {
                let mut fit = svbrdf_frame_fit {
                    size: bytes.usize().min(size_of::<svbrdf_frame_fit>()),
                    ..Default::default()
                };
                svbrdf_session_frame_fit(world.pick(bytes), bytes.u32(), &raw mut fit)
            }
            32 => {
                let mut maps = ptr::null_mut();
                let status = svbrdf_session_snapshot_confidence(world.pick(bytes), &raw mut maps);
                world.add(status, maps);
                status
            }
            33 => {
                let mut confidence = svbrdf_confidence {
                    size: bytes.usize().min(size_of::<svbrdf_confidence>()),
                    ..Default::default()
                };
                svbrdf_maps_confidence(world.pick(bytes), &raw mut confidence)
            }
            34 => {
                let mut view = svbrdf_map_view {
                    size: bytes.usize().min(size_of::<svbrdf_map_view>()),
                    ..Default::default()
                };
                svbrdf_maps_deviations(world.pick(bytes), bytes.u32(), &raw mut view)
            }
            35 | 36 => {
                let info = svbrdf_frame_info {
                    exposure: bytes.f32(),
                    flash: bytes.u32(),
                    timestamp_ns: bytes.u8().into(),
                    ..Default::default()
                };
                let (session, image) = (world.pick(bytes), image(bytes, pixels));
                let counter = ptr::from_ref(&*world.answered).cast_mut().cast();
                let callback: svbrdf_pushed_callback =
                    if bytes.u8() < 240 { Some(on_pushed) } else { None };
                let status = svbrdf_session_push_frame_async(
                    session,
                    &raw const image,
                    &raw const info,
                    callback,
                    counter,
                );
                world.asked += usize::from(status == SVBRDF_OK);
                status
            }
            37 => {
                let mut maps = ptr::null_mut();
                let (from, level) = (world.pick(bytes), bytes.u32());
                let status = svbrdf_maps_reduced(from, level, &raw mut maps);
                world.add(status, maps);
                status
            }
            38 => {
                let mut maps = ptr::null_mut();
                let (session, level) = (world.pick(bytes), bytes.u32());
                let status = svbrdf_session_snapshot_reduced(session, level, &raw mut maps);
                world.add(status, maps);
                status
            }
            39 => {
                let options = svbrdf_render_options {
                    size: bytes.usize().min(size_of::<svbrdf_render_options>()),
                    camera_mm: [bytes.f32(), bytes.f32(), bytes.f32()],
                    light_mm: [bytes.f32(), bytes.f32(), bytes.f32()],
                    light_power: [bytes.f32(); 3],
                    ambient: [bytes.f32(); 3],
                    falloff: bytes.u32(),
                    reserved: 0,
                };
                let mut out = vec![0_u8; 1 << 16];
                let (maps, format, stride) = (world.pick(bytes), bytes.u32(), bytes.usize());
                let data: *mut c_void = out.as_mut_ptr().cast();
                svbrdf_maps_render(maps, &raw const options, format, data, out.len(), stride)
            }
            40 => {
                let board = board(bytes);
                let mut file = ptr::null_mut();
                // Pictures take long.
                let (page, format) = (bytes.u32(), bytes.u32() % SVBRDF_SHEET_PNG);
                let status = svbrdf_board_print(&raw const board, page, format, &raw mut file);
                world.add(status, file);
                status
            }
            41 => {
                let callback: svbrdf_log_callback =
                    if bytes.u8() < 128 { Some(on_line) } else { None };
                svbrdf_set_log_callback(callback, ptr::null_mut())
            }
            42 => {
                let hook: svbrdf_thread_hook =
                    if bytes.u8() < 128 { Some(on_thread) } else { None };
                svbrdf_set_thread_hook(hook, ptr::null_mut())
            }
            27 => {
                let mut rms = 0.0;
                let (session, index) = (world.pick(bytes), bytes.u32());
                let none = ptr::null_mut();
                svbrdf_session_pose(session, index, none, none, &raw mut rms)
            }
            _ => svbrdf_session_push_capture(
                world.pick(bytes),
                world.pick(bytes),
                bytes.u32(),
                ptr::null_mut(),
            ),
        }
    };
    assert_ne!(status, SVBRDF_FAILED, "call {choice}");
}
