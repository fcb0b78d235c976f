//! From a photograph to pose, light and radiometric scale: the target, its detector, pose,
//! photometry.

pub mod photometry;
mod target;

pub use target::{Hole, Target, TargetKind, TopLeft};
