//! Structs of the C library with anything in them.

use std::ptr;

use super::bytes::Bytes;
use super::pictures::{Picture, board_picture};
use crate::export::*;
use crate::image::*;
use crate::options::*;
use crate::render::*;

pub fn board(bytes: &mut Bytes) -> svbrdf_board {
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

pub fn options(bytes: &mut Bytes) -> svbrdf_session_options {
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

/// A picture with a description that is nearly right, or anything.
pub fn image(bytes: &mut Bytes, noise: &Picture) -> svbrdf_image {
    let layout = bytes.u8();
    let picture = if layout < 160 { noise } else { board_picture(layout % 8) };
    let mut image = picture.image();
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
            7 => image.planes[plane].bytes = bytes.usize().min(image.planes[plane].bytes),
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

pub fn info(bytes: &mut Bytes) -> svbrdf_photo_info {
    svbrdf_photo_info {
        exposure: bytes.f32(),
        flash: bytes.u32(),
        timestamp_ns: bytes.u8().into(),
        focal_35mm: bytes.f32(),
        ..Default::default()
    }
}

pub fn rendering(bytes: &mut Bytes) -> svbrdf_render_options {
    svbrdf_render_options {
        size: bytes.usize().min(size_of::<svbrdf_render_options>()),
        camera_mm: [bytes.f32(), bytes.f32(), bytes.f32()],
        light_mm: [bytes.f32(), bytes.f32(), bytes.f32()],
        light_power: [bytes.f32(); 3],
        ambient: [bytes.f32(); 3],
        falloff: bytes.u32(),
        reserved: 0,
    }
}

/// Of few texels: larger files take long.
pub fn export(bytes: &mut Bytes) -> svbrdf_export_options {
    let formats =
        [c"glb", c"usdz", c"materialx", c"unreal", c"unity-hdrp,unity-urp", c"blender", c"x"];
    svbrdf_export_options {
        formats: formats[usize::from(bytes.u8()) % formats.len()].as_ptr(),
        metallic: u32::from(bytes.u8()) / 100,
        texture: bytes.u32(),
        max_size: 1 + bytes.u32() % 64,
        photos: bytes.u32(),
        ..Default::default()
    }
}
