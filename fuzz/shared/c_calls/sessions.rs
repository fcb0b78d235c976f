//! Calls about sessions and the library as a whole.

use std::ptr;

use super::arguments::options;
use super::bytes::Bytes;
use super::world::{World, on_line, on_thread, saved};
use crate::budget::*;
use crate::buffer::*;
use crate::handles::svbrdf_session;
use crate::log::*;
use crate::options::*;
use crate::paper::*;
use crate::process::*;
use crate::reports::*;
use crate::saved::*;
use crate::session::*;
use crate::status::*;
use crate::threads::*;

pub const CALLS: u8 = 20;

pub fn call(choice: u8, bytes: &mut Bytes, world: &mut World) -> svbrdf_status {
    // SAFETY: every pointer is NULL or to something alive of the size said.
    unsafe {
        match choice {
            0 | 1 => {
                let options = options(bytes);
                let mut session = ptr::null_mut();
                let status = svbrdf_session_create(&raw const options, &raw mut session);
                world.add_paused(status, session);
                status
            }
            2 | 3 => load(bytes, world, saved().to_vec()),
            4 => {
                let buffer = world.buffers.last().copied().unwrap_or(0);
                let (mut data, mut size) = (ptr::null(), 0_usize);
                let buffer: *mut svbrdf_buffer = ptr::without_provenance_mut(buffer);
                match svbrdf_buffer_view(buffer, &raw mut data, &raw mut size) {
                    SVBRDF_OK => {
                        let copy = std::slice::from_raw_parts(data.cast::<u8>(), size).to_vec();
                        load(bytes, world, copy)
                    }
                    fault => fault,
                }
            }
            5 => {
                let mut buffer = ptr::null_mut();
                let status = svbrdf_session_save_state(world.pick(bytes), &raw mut buffer);
                if status == SVBRDF_OK {
                    world.buffers.push(buffer.addr());
                }
                world.add(status, buffer);
                status
            }
            6 => svbrdf_session_announce(world.pick(bytes), bytes.u32()),
            7 => svbrdf_session_wait(world.pick(bytes), 0),
            8 => svbrdf_session_pause(world.pick(bytes)),
            9 => svbrdf_session_cancel(world.pick(bytes)),
            10 => svbrdf_session_destroy(world.pick(bytes)),
            11 => {
                let budget = svbrdf_budget {
                    seconds: bytes.f32(),
                    max_steps: bytes.u32(),
                    stop_when_invisible: bytes.u32(),
                    ..Default::default()
                };
                svbrdf_session_set_budget(world.pick(bytes), &raw const budget)
            }
            12 => svbrdf_buffer_destroy(world.pick(bytes)),
            _ => ask(choice, bytes, world),
        }
    }
}

/// # Safety
/// None beside those of the library.
unsafe fn load(bytes: &mut Bytes, world: &mut World, mut state: Vec<u8>) -> svbrdf_status {
    let options = options(bytes);
    match bytes.u8() {
        0..16 => state.truncate(bytes.usize()),
        16..32 if !state.is_empty() => {
            let at = bytes.usize() % state.len();
            state[at] ^= 1 << (bytes.u8() % 8);
        }
        _ => {}
    }
    let mut session = ptr::null_mut();
    let data = state.as_ptr().cast();
    // SAFETY: so many bytes are there.
    let status = unsafe {
        svbrdf_session_load_state(&raw const options, data, state.len(), &raw mut session)
    };
    world.add_paused(status, session);
    status
}

/// # Safety
/// None beside those of the library.
unsafe fn ask(choice: u8, bytes: &mut Bytes, world: &mut World) -> svbrdf_status {
    let session: *mut svbrdf_session = world.pick(bytes);
    // SAFETY: every pointer is NULL or to something alive of the size said.
    unsafe {
        match choice {
            13 => {
                let mut progress = svbrdf_progress {
                    size: bytes.usize().min(size_of::<svbrdf_progress>()),
                    ..Default::default()
                };
                svbrdf_session_progress(session, &raw mut progress)
            }
            14 => {
                let (mut offset, mut ambient) = ([0.0_f64; 3], 0.0_f32);
                let offset = if bytes.u8() < 128 { offset.as_mut_ptr() } else { ptr::null_mut() };
                svbrdf_session_light(session, offset, &raw mut ambient)
            }
            15 => {
                let mut view = svbrdf_next_view {
                    size: bytes.usize().min(size_of::<svbrdf_next_view>()),
                    ..Default::default()
                };
                svbrdf_session_next_view(session, &raw mut view)
            }
            16 => {
                let mut camera = svbrdf_camera::default();
                let mut sigma = [0.0; 9];
                let sigma = if bytes.u8() < 128 { sigma.as_mut_ptr() } else { ptr::null_mut() };
                svbrdf_session_camera(session, &raw mut camera, sigma)
            }
            17 => {
                let mut paper = svbrdf_paper {
                    size: bytes.usize().min(size_of::<svbrdf_paper>()),
                    ..Default::default()
                };
                svbrdf_session_paper(session, &raw mut paper)
            }
            18 => {
                let callback: svbrdf_log_callback =
                    if bytes.u8() < 128 { Some(on_line) } else { None };
                svbrdf_set_log_callback(callback, ptr::null_mut())
            }
            _ => {
                let hook: svbrdf_thread_hook =
                    if bytes.u8() < 128 { Some(on_thread) } else { None };
                svbrdf_set_thread_hook(hook, ptr::null_mut())
            }
        }
    }
}
