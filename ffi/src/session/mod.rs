//! A capture in progress.

mod create;
mod frames;
mod frames_async;
mod inspect;
mod steer;

pub use create::*;
pub use frames::*;
pub use frames_async::*;
pub use inspect::*;
pub use steer::*;

#[cfg(test)]
mod tests;
