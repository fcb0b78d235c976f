//! Options of a session and of a photo.

mod board;
mod fit;
mod log;
mod photo;

pub use board::*;
pub use fit::*;
pub use log::*;
pub use photo::*;
