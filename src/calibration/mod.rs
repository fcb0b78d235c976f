//! From a photograph to pose, light and radiometric scale: the target, its detector, pose,
//! photometry.

mod target;

pub use target::{Hole, Target, TargetKind, TopLeft};
