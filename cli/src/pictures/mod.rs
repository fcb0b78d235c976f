//! Photographs as cameras write them: what their metadata say, and their colours by the profile
//! inside.

mod choice;
mod description;
mod files;
mod metadata;
mod profile;
mod read;
mod watch;

pub use choice::{Choice, Chosen, LeftOut, choose};
pub use description::{Setup, describe};
pub use files::find;
pub use metadata::Metadata;
pub use read::{Remark, read};
pub use watch::Watch;
