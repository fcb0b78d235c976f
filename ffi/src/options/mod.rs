//! Options of a session and of a photo.

mod board;
mod callbacks;
mod fit;
mod photo;

pub use board::*;
pub use callbacks::*;
pub use fit::*;
pub use photo::*;
