//! Photographs: stored pixels, read as linear RGB.
//!
//! Integer pixels remain as stored (a 12-megapixel photo takes 36 MB, not 144) and are linearised
//! by tables on access. A photo holds relative radiance times [`Photo::exposure`].

mod camera_buffer;
mod encoding;
mod exif;
mod file;
mod jpeg;
mod pixels;
mod plane;
mod plateau;
mod primaries;
mod reduced;
mod stored;
mod surround;
mod tiff;
mod tone;
mod turn;

pub(crate) use file::read_picture;
#[cfg(feature = "files")]
pub(crate) use file::{MEMORY, Picture, decode, look_at, size_fault};
#[cfg(feature = "files")]
pub(crate) use tiff::is_tiff;
pub(crate) use tone::{Lift, LogCurve, ToneTable};

pub use camera_buffer::{Bayer, BayerPattern, Interleaved, YuvMatrix};
pub use encoding::Encoding;
pub use file::Limits;
pub use pixels::{MAX_PIXELS, Photo};
pub use plane::{Plane, Rotation};
pub use primaries::Primaries;
pub use surround::Surround;
pub use tone::ToneCurve;
