//! Pictures in the layouts that the C library knows: noise, and a photo of a board.

use std::path::Path;
use std::sync::OnceLock;

use engine::photo::{Encoding, Photo};
use half::f16;

use crate::image::*;

pub struct Picture {
    format: svbrdf_pixel_format,
    width: u32,
    height: u32,
    transfer: svbrdf_transfer,
    /// Of each plane: bytes, row and pixel stride.
    planes: Vec<(Vec<u8>, usize, usize)>,
}

impl Picture {
    /// 16 x 16 pixels of noise, in memory that is enough for any layout.
    pub fn noise() -> Self {
        let plane = |_| ((0..2048_u32).map(|i| (i * 37 % 251) as u8).collect(), 48, 0);
        Self {
            format: SVBRDF_PIXEL_RGB8,
            width: 16,
            height: 16,
            transfer: SVBRDF_TRANSFER_SRGB,
            planes: (0..3).map(plane).collect(),
        }
    }

    pub fn image(&self) -> svbrdf_image {
        let (width, height, transfer) = (self.width, self.height, self.transfer);
        let mut image =
            svbrdf_image { format: self.format, width, height, transfer, ..Default::default() };
        for (plane, (data, row_stride, pixel_stride)) in image.planes.iter_mut().zip(&self.planes) {
            plane.data = data.as_ptr().cast();
            plane.bytes = data.len();
            (plane.row_stride, plane.pixel_stride) = (*row_stride, *pixel_stride);
        }
        image
    }

    fn packed(
        photo: &Photo,
        format: svbrdf_pixel_format,
        encoding: Encoding,
        pixel: impl Fn([f64; 3]) -> Vec<u8>,
    ) -> Self {
        let (width, height) = (photo.width(), photo.height());
        let data: Vec<u8> = (0..width * height)
            .flat_map(|i| pixel(coded(photo, i % width, i / width, encoding)))
            .collect();
        let row = data.len() / height as usize;
        let planes = vec![(data, row, 0)];
        Self { format, width, height, transfer: transfer(encoding), planes }
    }

    /// YUV of BT.601 with the chroma of every fourth pixel, in words of `bytes` bytes.
    fn yuv(photo: &Photo, format: svbrdf_pixel_format, encoding: Encoding, bytes: usize) -> Self {
        let (width, height) = (photo.width(), photo.height());
        let word = |v: f64| match bytes {
            1 => vec![(255.0 * v).round() as u8],
            _ => (((1023.0 * v).round() as u16) << 6).to_ne_bytes().to_vec(),
        };
        let luma = |[r, g, b]: [f64; 3]| 0.299 * r + 0.587 * g + 0.114 * b;
        let at = |x, y| coded(photo, x, y, encoding);
        let y = (0..width * height).flat_map(|i| word(luma(at(i % width, i / width)))).collect();
        let [half_width, half_height] = [width.div_ceil(2), height.div_ceil(2)];
        let chroma = |channel: usize, scale: f64| -> Vec<u8> {
            (0..half_width * half_height)
                .flat_map(|i| {
                    let rgb = at(2 * (i % half_width), 2 * (i / half_width));
                    word((0.5 + (rgb[channel] - luma(rgb)) / scale).clamp(0.0, 1.0))
                })
                .collect()
        };
        let (rows, half_rows) = (bytes * width as usize, bytes * half_width as usize);
        let planes =
            vec![(y, rows, 0), (chroma(2, 1.772), half_rows, 0), (chroma(0, 1.402), half_rows, 0)];
        Self { format, width, height, transfer: transfer(encoding), planes }
    }
}

fn transfer(encoding: Encoding) -> svbrdf_transfer {
    match encoding {
        Encoding::Linear => SVBRDF_TRANSFER_LINEAR,
        Encoding::Srgb => SVBRDF_TRANSFER_SRGB,
        Encoding::Gamma22 => SVBRDF_TRANSFER_GAMMA22,
        Encoding::Hlg => SVBRDF_TRANSFER_HLG,
        Encoding::Pq => SVBRDF_TRANSFER_PQ,
    }
}

/// A pixel as a camera stores it, 0 to 1: found by halving, as every curve rises.
fn coded(photo: &Photo, x: u32, y: u32, encoding: Encoding) -> [f64; 3] {
    photo.pixel(x, y).map(|linear| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..12 {
            let middle = 0.5 * (low + high);
            if encoding.decode(middle) < f64::from(linear) { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    })
}

/// The photo of the board among the seeds in one of eight layouts.
pub fn board_picture(layout: u8) -> &'static Picture {
    static PICTURES: OnceLock<Vec<Picture>> = OnceLock::new();
    let pictures = PICTURES.get_or_init(|| {
        // The C library's folder, or that of the targets.
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        let seed = here.join("../fuzz/seeds/photo/board.png");
        let seed = std::fs::read(seed).expect("a seed");
        let photo = Photo::decode(&seed[1..], Encoding::Srgb, 1.0).expect("a picture");
        let bytes = |rgb: [f64; 3]| rgb.map(|v| (255.0 * v).round() as u8);
        let words = |v: f64| ((65_535.0 * v).round() as u16).to_ne_bytes();
        let (srgb, linear) = (Encoding::Srgb, Encoding::Linear);
        vec![
            Picture::packed(&photo, SVBRDF_PIXEL_RGB8, srgb, |c| bytes(c).to_vec()),
            Picture::packed(&photo, SVBRDF_PIXEL_BGRA8, srgb, |c| {
                let [r, g, b] = bytes(c);
                vec![b, g, r, 255]
            }),
            Picture::yuv(&photo, SVBRDF_PIXEL_YUV420, srgb, 1),
            Picture::yuv(&photo, SVBRDF_PIXEL_P010, Encoding::Hlg, 2),
            Picture::yuv(&photo, SVBRDF_PIXEL_P010, Encoding::Pq, 2),
            Picture::packed(&photo, SVBRDF_PIXEL_RGBA_F16, linear, |[r, g, b]| {
                [r, g, b, 1.0].iter().flat_map(|v| f16::from_f64(*v).to_ne_bytes()).collect()
            }),
            Picture::packed(&photo, SVBRDF_PIXEL_RGB16, linear, |c| c.map(words).concat()),
            // Gray, so that every filter sees the same.
            Picture::packed(&photo, SVBRDF_PIXEL_BAYER16, linear, |[_, g, _]| words(g).to_vec()),
        ]
    });
    &pictures[usize::from(layout) % pictures.len()]
}
