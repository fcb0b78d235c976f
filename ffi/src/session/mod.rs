//! A capture in progress.

mod create;
mod inspect;
mod photos;
mod photos_async;
mod steer;

pub use create::*;
pub use inspect::*;
pub use photos::*;
pub use photos_async::*;
pub use steer::*;

#[cfg(test)]
mod tests;
