//! Saved form of photographs, with pixels as stored.

use std::borrow::Cow;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::encoding::Encoding;
use super::pixels::{MAX_PIXELS, Photo, Pixels};
use crate::{Error, Result};

/// A photograph without metadata.
#[derive(Serialize, Deserialize)]
struct Stored<'a> {
    width: u32,
    height: u32,
    exposure: f32,
    saturation: f32,
    pixels: StoredPixels<'a>,
}

/// Interleaved RGB.
#[derive(Serialize, Deserialize)]
enum StoredPixels<'a> {
    U8(Encoding, #[serde(with = "borrowed")] Cow<'a, [u8]>),
    U16(Encoding, #[serde(with = "borrowed")] Cow<'a, [u16]>),
    F32(#[serde(with = "borrowed")] Cow<'a, [f32]>),
}

/// Borrowed when written, owned when read.
mod borrowed {
    use super::Cow;
    use crate::little_endian::{self, Number};
    use serde::{Deserializer, Serializer};

    pub(super) fn serialize<T: Number, S: Serializer>(
        values: &[T],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        little_endian::serialize(values, serializer)
    }

    pub(super) fn deserialize<'de, T: Number, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Cow<'static, [T]>, D::Error> {
        little_endian::deserialize(deserializer).map(Cow::Owned)
    }
}

impl Serialize for Photo {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        // Tables are unique in a program: an equal address means an equal curve.
        let named = |same: &dyn Fn(Encoding) -> bool| {
            Encoding::ALL.into_iter().find(|&e| same(e)).unwrap_or(Encoding::Linear)
        };
        let pixels = match &self.pixels {
            Pixels::U8(data, table) => {
                StoredPixels::U8(named(&|e| std::ptr::eq(e.table8(), *table)), data.into())
            }
            Pixels::U16(data, table) => {
                StoredPixels::U16(named(&|e| std::ptr::eq(e.table16(), *table)), data.into())
            }
            Pixels::F32(data) => StoredPixels::F32(data.into()),
        };
        let (width, height) = (self.width, self.height);
        let (exposure, saturation) = (self.exposure(), self.saturation());
        Stored { width, height, exposure, saturation, pixels }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Photo {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let stored = Stored::deserialize(deserializer)?;
        stored.into_photo().map_err(serde::de::Error::custom)
    }
}

impl Stored<'_> {
    fn into_photo(self) -> Result<Photo> {
        let Self { width, height, exposure, saturation, pixels } = self;
        let count = u64::from(width) * u64::from(height);
        if count == 0 || count > MAX_PIXELS {
            return Err(Error::argument("photo", "its size is out of range"));
        }
        if saturation.is_nan() || saturation <= 0.0 {
            return Err(Error::argument("saturation", "a positive number is expected"));
        }
        let photo = match pixels {
            StoredPixels::U8(curve, data) => {
                Photo::from_u8(width, height, data.into_owned(), curve, exposure)
            }
            StoredPixels::U16(curve, data) => {
                Photo::from_u16(width, height, data.into_owned(), curve, exposure)
            }
            StoredPixels::F32(data) => {
                Photo::from_linear(width, height, data.into_owned(), exposure, saturation)
            }
        };
        Ok(photo?.with_saturation(saturation))
    }
}

impl Photo {
    /// Bytes of the pixels as stored.
    pub(crate) fn stored_bytes(&self) -> usize {
        match &self.pixels {
            Pixels::U8(data, _) => data.len(),
            Pixels::U16(data, _) => 2 * data.len(),
            Pixels::F32(data) => 4 * data.len(),
        }
    }
}
