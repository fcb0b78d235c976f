//! Maps to files and back: PNG, OpenEXR, previews.
//!
//! Every file appears under its name complete or not at all: it is written under a temporary name
//! in the same folder, then renamed.

mod files;
mod floats;
mod maps;
mod preview;
mod resample;

pub use files::{check_writable, write_atomic, write_png16_image};
pub use floats::write_exr_image;
pub use maps::{read_maps, write_maps};
pub use preview::{Relit, relit, write_preview};
pub use resample::resized;

#[cfg(test)]
mod tests;
