//! Encoded photographs with their metadata and colour profiles.
//!
//! [`read`] and [`decode`] make a [`Photo`](crate::photo::Photo) from JPEG, PNG, TIFF, OpenEXR and
//! DNG files, with feature `heic` also from HEIC files. The content determines the format.
//! `docs/formats.md` lists all supported variants and checks.

mod choice;
mod colours;
mod dng;
#[cfg(any(feature = "heic", feature = "jxl"))]
mod guard;
#[cfg(feature = "heic")]
mod heic;
mod jpeg;
mod kind;
mod metadata;
mod order;
mod png_colours;
mod profile;
mod read;
mod remark;
mod renditions;

pub use choice::{CameraKey, Choice, Chosen};
pub use kind::{HEAD_BYTES, Kind};
pub use metadata::Metadata;
pub use order::by_name;
pub use read::{Decoded, Options, decode, read};
pub use remark::Remark;
pub use renditions::LeftOut;

pub use crate::photo::Limits;
