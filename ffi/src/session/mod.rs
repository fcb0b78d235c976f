//! A capture in progress.

mod create;
mod frames;
mod inspect;
mod steer;

pub use create::*;
pub use frames::*;
pub use inspect::*;
pub use steer::*;

#[cfg(test)]
mod tests;
