//! Calls about maps, pictures and files.

use std::ffi::c_void;
use std::ptr;

use super::arguments::{board, export, rendering};
use super::bytes::Bytes;
use super::world::World;
use crate::export::*;
use crate::maps::*;
use crate::reduced::*;
use crate::render::*;
use crate::session::*;
use crate::sheet::*;
use crate::status::*;
use crate::uncertainty::*;

pub const CALLS: u8 = 18;

pub fn call(choice: u8, bytes: &mut Bytes, world: &mut World) -> svbrdf_status {
    // SAFETY: every pointer is NULL or to something alive of the size said.
    unsafe {
        match choice {
            0..3 => take(choice, bytes, world),
            3 => {
                let mut maps = ptr::null_mut();
                let (from, level) = (world.pick(bytes), bytes.u32());
                let status = svbrdf_maps_reduced(from, level, &raw mut maps);
                world.add(status, maps);
                status
            }
            4 => svbrdf_maps_destroy(world.pick(bytes)),
            5 | 6 => {
                let mut view = svbrdf_map_view::default();
                let (map, format) = (bytes.u32(), bytes.u32());
                svbrdf_maps_view(world.pick(bytes), map, format, &raw mut view)
            }
            7 | 8 => {
                let mut out = vec![0_u8; if choice == 7 { 512 } else { 1 << 21 }];
                let (map, format, stride) = (bytes.u32(), bytes.u32(), bytes.usize());
                let data: *mut c_void = out.as_mut_ptr().cast();
                svbrdf_maps_copy(world.pick(bytes), map, format, data, out.len(), stride)
            }
            9 | 10 => {
                let options = rendering(bytes);
                let mut out = vec![0_u8; if choice == 9 { 1 << 16 } else { 1 << 21 }];
                let (maps, format, stride) = (world.pick(bytes), bytes.u32(), bytes.usize());
                let data: *mut c_void = out.as_mut_ptr().cast();
                svbrdf_maps_render(maps, &raw const options, format, data, out.len(), stride)
            }
            11 => {
                let mut uncertainty = svbrdf_uncertainty {
                    size: bytes.usize().min(size_of::<svbrdf_uncertainty>()),
                    ..Default::default()
                };
                svbrdf_maps_uncertainty(world.pick(bytes), &raw mut uncertainty)
            }
            12 => {
                let mut view = svbrdf_map_view {
                    size: bytes.usize().min(size_of::<svbrdf_map_view>()),
                    ..Default::default()
                };
                svbrdf_maps_deviations(world.pick(bytes), bytes.u32(), &raw mut view)
            }
            13 => {
                let (mut width, mut sample_mm) = (0, [0.0_f32; 2]);
                let none = ptr::null_mut();
                svbrdf_maps_size(world.pick(bytes), &raw mut width, none, sample_mm.as_mut_ptr())
            }
            14 => {
                let board = board(bytes);
                let mut file = ptr::null_mut();
                // Pictures take long.
                let (page, format) = (bytes.u32(), bytes.u32() % SVBRDF_SHEET_PNG);
                let status = svbrdf_board_print(&raw const board, page, format, &raw mut file);
                world.add(status, file);
                status
            }
            15 => {
                let options = export(bytes);
                let mut package = ptr::null_mut();
                let maps = world.pick(bytes);
                let status = svbrdf_maps_export_package(maps, &raw const options, &raw mut package);
                world.add(status, package);
                status
            }
            16 => {
                let mut count = 0;
                svbrdf_package_count(world.pick(bytes), &raw mut count)
            }
            _ => {
                let (mut name, mut data, mut size) = (ptr::null(), ptr::null(), 0);
                let (package, index) = (world.pick(bytes), bytes.u32());
                svbrdf_package_file(package, index, &raw mut name, &raw mut data, &raw mut size)
            }
        }
    }
}

/// # Safety
/// None beside those of the library.
unsafe fn take(choice: u8, bytes: &mut Bytes, world: &mut World) -> svbrdf_status {
    let mut maps = ptr::null_mut();
    let session = world.pick(bytes);
    // SAFETY: the result is alive.
    let status = unsafe {
        match choice {
            0 => svbrdf_session_snapshot_maps(session, &raw mut maps),
            1 => {
                let mut whole = ptr::null_mut();
                svbrdf_session_snapshot_maps(session, &raw mut whole);
                let status = svbrdf_maps_reduced(whole, bytes.u32(), &raw mut maps);
                svbrdf_maps_destroy(whole);
                status
            }
            _ => svbrdf_session_snapshot_with_uncertainty(session, &raw mut maps),
        }
    };
    world.add(status, maps);
    status
}
