//! Folders of photographs, and the capture that they amount to.

mod description;
mod files;
mod watch;

pub use description::{Setup, describe};
pub use files::{Folder, find};
pub use watch::Watch;
