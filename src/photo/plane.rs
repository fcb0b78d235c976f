//! Planes of a picture in memory, and their rotation.
//!
//! Planes are bytes with strides in bytes and values in native byte order, without alignment requirements.

use super::pixels::MAX_PIXELS;
use crate::{Error, Result};

/// A plane of a picture in memory.
#[derive(Debug, Clone, Copy)]
pub struct Plane<'a> {
    /// The bytes, at least up to the last pixel; further bytes are ignored.
    pub data: &'a [u8],
    /// Bytes between rows.
    pub row_stride: usize,
    /// Bytes between pixels; 0: pixels are adjacent.
    pub pixel_stride: usize,
}

/// Clockwise rotation that makes a buffer upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rotation {
    /// No rotation.
    #[default]
    None,
    /// By 90 degrees.
    Quarter,
    /// By 180 degrees.
    Half,
    /// By 270 degrees.
    ThreeQuarters,
}

/// A plane whose pixels lie inside its bytes.
pub(super) struct Reader<'a> {
    data: &'a [u8],
    pub width: usize,
    pub height: usize,
    row: usize,
    pixel: usize,
    bytes: usize,
}

impl<'a> Reader<'a> {
    pub fn new([width, height]: [u32; 2], plane: Plane<'a>, bytes: usize) -> Result<Self> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || pixels > MAX_PIXELS {
            let message = format!("{width} x {height} px given, 1 to {MAX_PIXELS} pixels expected");
            return Err(Error::argument("width, height", message));
        }
        let (width, height) = (width as usize, height as usize);
        let pixel = if plane.pixel_stride == 0 { bytes } else { plane.pixel_stride };
        let row = plane.row_stride;
        let line = (width - 1).checked_mul(pixel).and_then(|n| n.checked_add(bytes));
        let total = line.and_then(|line| row.checked_mul(height - 1)?.checked_add(line));
        let (Some(line), Some(total)) = (line, total) else {
            return Err(Error::argument("stride", "width or height times stride overflows"));
        };
        if pixel < bytes || (height > 1 && row < line) {
            let message = format!(
                "{row} bytes a row and {pixel} a pixel given, at least {line} and {bytes} expected"
            );
            return Err(Error::argument("stride", message));
        }
        if plane.data.len() < total {
            let message = format!("{} bytes given, {total} expected", plane.data.len());
            return Err(Error::argument("plane size", message));
        }
        Ok(Self { data: plane.data, width, height, row, pixel, bytes })
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Bytes of a pixel.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> &'a [u8] {
        let i = y * self.row + x * self.pixel;
        &self.data[i..i + self.bytes]
    }

    /// RGB of all pixels, row by row.
    pub fn gather<T>(&self, value: impl Fn(&[u8]) -> [T; 3]) -> Vec<T> {
        let mut rgb = Vec::with_capacity(3 * self.pixels());
        for y in 0..self.height {
            for x in 0..self.width {
                rgb.extend(value(self.at(x, y)));
            }
        }
        rgb
    }
}

impl Rotation {
    /// Width and height after the rotation.
    pub(super) fn size(self, [width, height]: [u32; 2]) -> [u32; 2] {
        match self {
            Self::None | Self::Half => [width, height],
            Self::Quarter | Self::ThreeQuarters => [height, width],
        }
    }

    /// Rotates interleaved RGB of `width` x `height` pixels.
    pub(super) fn apply<T: Copy>(self, [width, height]: [u32; 2], rgb: Vec<T>) -> Vec<T> {
        let (w, h) = (width as usize, height as usize);
        let mut out = Vec::new();
        let mut push = |x: usize, y: usize| {
            let i = 3 * (y * w + x);
            out.extend_from_slice(&rgb[i..i + 3]);
        };
        match self {
            Self::None => return rgb,
            Self::Quarter => (0..w).for_each(|x| (0..h).rev().for_each(|y| push(x, y))),
            Self::Half => (0..h).rev().for_each(|y| (0..w).rev().for_each(|x| push(x, y))),
            Self::ThreeQuarters => (0..w).rev().for_each(|x| (0..h).for_each(|y| push(x, y))),
        }
        out
    }
}
