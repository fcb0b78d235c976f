//! Calls about photos.

use std::ptr;

use super::arguments::{image, info};
use super::bytes::Bytes;
use super::world::{World, on_outcome};
use crate::capture::*;
use crate::handles::svbrdf_session;
use crate::photo_fit::*;
use crate::probe::*;
use crate::reports::*;
use crate::session::*;
use crate::status::*;

pub const CALLS: u8 = 14;

pub fn call(choice: u8, bytes: &mut Bytes, world: &mut World) -> svbrdf_status {
    // SAFETY: every pointer is NULL or to something alive of the size said.
    unsafe {
        match choice {
            0..3 => push(choice == 2, false, bytes, world),
            3..5 => push(choice == 4, true, bytes, world),
            5 | 6 => probe(choice == 6, bytes, world),
            7 | 8 => add_photo_async(bytes, world),
            9 => svbrdf_session_remove_photo(world.pick(bytes), bytes.u32()),
            10 => {
                let mut fit = svbrdf_photo_fit {
                    size: bytes.usize().min(size_of::<svbrdf_photo_fit>()),
                    ..Default::default()
                };
                svbrdf_session_photo_fit(world.pick(bytes), bytes.u32(), &raw mut fit)
            }
            11 => {
                let (mut rotation, mut rms) = ([0.0; 9], 0.0);
                let (session, index) = (world.pick(bytes), bytes.u32());
                let rotation = rotation.as_mut_ptr();
                svbrdf_session_pose(session, index, rotation, ptr::null_mut(), &raw mut rms)
            }
            12 => {
                let mut capture = ptr::null_mut();
                let status = svbrdf_capture_open(c"/nowhere".as_ptr(), &raw mut capture);
                world.add(status, capture);
                status
            }
            _ => {
                let (session, capture) = (world.pick(bytes), world.pick(bytes));
                let (mut count, index) = (0, bytes.u32());
                svbrdf_capture_photos(capture, &raw mut count);
                svbrdf_session_add_capture_photo(session, capture, index, ptr::null_mut())
            }
        }
    }
}

/// # Safety
/// None beside those of the library.
unsafe fn push(more: bool, board: bool, bytes: &mut Bytes, world: &mut World) -> svbrdf_status {
    let session = world.pick(bytes);
    let image = image(bytes, &world.noise);
    let positions = [bytes.f32(), bytes.f32(), bytes.f32()];
    let mut report = svbrdf_photo_report::default();
    let mut info = info(bytes);
    let ambient;
    if more {
        ambient = super::arguments::image(bytes, &world.noise);
        info.ambient = &raw const ambient;
        info.ambient_exposure = bytes.f32();
        report.size = bytes.usize().min(size_of::<svbrdf_photo_report>());
    }
    if !world.may_push() {
        return SVBRDF_BUSY;
    }
    let (image, info, report) = (&raw const image, &raw const info, &raw mut report);
    // SAFETY: every pointer is to something alive of the size said.
    let status = unsafe {
        if board {
            svbrdf_session_add_photo(session, image, info, report)
        } else {
            let position = positions.as_ptr();
            svbrdf_session_add_rectified_photo(session, image, info, position, position, report)
        }
    };
    // SAFETY: as above.
    assert_eq!(unsafe { (*report).accepted } == 1, status == SVBRDF_OK);
    world.added(status);
    status
}

/// # Safety
/// None beside those of the library.
unsafe fn probe(more: bool, bytes: &mut Bytes, world: &mut World) -> svbrdf_status {
    let session: *mut svbrdf_session = world.pick(bytes);
    let (image, info) = (image(bytes, &world.noise), info(bytes));
    let mut corners = [0.0_f32; 2 * 64];
    let mut probe = svbrdf_probe::default();
    if more {
        probe.size = bytes.usize().min(size_of::<svbrdf_probe>());
        probe.corners_px = corners.as_mut_ptr();
        probe.corners_capacity = bytes.u32() % 65;
    }
    if !world.may_look() {
        return SVBRDF_BUSY;
    }
    // SAFETY: every pointer is to something alive of the size said.
    let status =
        unsafe { svbrdf_session_probe(session, &raw const image, &raw const info, &raw mut probe) };
    assert!(status == SVBRDF_OK || probe.acceptable == 0);
    assert!(corners.iter().all(|v| v.is_finite()));
    status
}

/// # Safety
/// None beside those of the library.
unsafe fn add_photo_async(bytes: &mut Bytes, world: &mut World) -> svbrdf_status {
    let (session, image) = (world.pick(bytes), image(bytes, &world.noise));
    let mut info = info(bytes);
    let ambient;
    if bytes.u8() > 200 {
        ambient = super::arguments::image(bytes, &world.noise);
        info.ambient = &raw const ambient;
    }
    let callback: svbrdf_photo_callback = if bytes.u8() < 240 { Some(on_outcome) } else { None };
    if !world.may_push() {
        return SVBRDF_BUSY;
    }
    let answers = ptr::from_ref(&*world.answered).cast_mut().cast();
    // SAFETY: every pointer is NULL or to something alive of the size said.
    let status = unsafe {
        svbrdf_session_add_photo_async(
            session,
            &raw const image,
            &raw const info,
            callback,
            answers,
        )
    };
    world.asked += usize::from(status == SVBRDF_OK);
    status
}
