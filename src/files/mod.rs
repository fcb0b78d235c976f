//! Photographs as cameras write them: encoded files with what their metadata say, and colours as
//! their profiles mean them.
//!
//! [`read`] and [`decode`] make a [`Photo`](crate::photo::Photo) of JPEG, PNG, TIFF, OpenEXR and DNG
//! files, with feature `heic` of HEIC ones too, told apart by their content. What is read, and how it is checked, is listed in
//! `docs/formats.md`.

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
