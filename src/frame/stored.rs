//! Pixels as they are stored, for saving them.

use std::borrow::Cow;

use super::encoding::Encoding;
use super::photo::{Photo, Pixels};
use crate::Result;

/// Interleaved RGB as a photograph holds it.
pub(crate) enum Stored<'a> {
    U8(Cow<'a, [u8]>, Encoding),
    U16(Cow<'a, [u16]>, Encoding),
    F32(Cow<'a, [f32]>),
}

impl Photo {
    /// The pixels as stored.
    pub(crate) fn stored(&self) -> Stored<'_> {
        // Tables live once in a program: the same address is the same curve.
        let named = |same: &dyn Fn(Encoding) -> bool| {
            Encoding::ALL.into_iter().find(|&e| same(e)).unwrap_or(Encoding::Linear)
        };
        match &self.pixels {
            Pixels::U8(data, table) => {
                Stored::U8(data.into(), named(&|e| std::ptr::eq(e.table8(), *table)))
            }
            Pixels::U16(data, table) => {
                Stored::U16(data.into(), named(&|e| std::ptr::eq(e.table16(), *table)))
            }
            Pixels::F32(data) => Stored::F32(data.into()),
        }
    }

    /// Bytes of the pixels as stored.
    pub(crate) fn stored_bytes(&self) -> usize {
        match &self.pixels {
            Pixels::U8(data, _) => data.len(),
            Pixels::U16(data, _) => 2 * data.len(),
            Pixels::F32(data) => 4 * data.len(),
        }
    }

    /// A photograph from stored pixels.
    pub(crate) fn from_stored(
        width: u32,
        height: u32,
        stored: Stored<'_>,
        exposure: f32,
        saturation: f32,
    ) -> Result<Self> {
        match stored {
            Stored::U8(data, encoding) => {
                Self::from_u8(width, height, data.into_owned(), encoding, exposure)
            }
            Stored::U16(data, encoding) => {
                Self::from_u16(width, height, data.into_owned(), encoding, exposure)
            }
            Stored::F32(data) => {
                Self::from_linear(width, height, data.into_owned(), exposure, saturation)
            }
        }
        .map(|photo| photo.with_saturation(saturation))
    }
}
