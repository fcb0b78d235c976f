//! From a photograph to pose, light and radiometric scale: the target, its detector, pose,
//! photometry.

mod blur;
mod board_model;
mod corners;
mod detector;
mod lattice;
mod layout;
mod luma;
pub mod photometry;
mod pose;
mod projection;
mod subpixel;
mod target;

pub use detector::{Corner, Detection, detect};
pub use luma::LumaImage;
pub use pose::{PoseEstimate, VIEW_ANGLE_MAX_DEG, estimate_pose};
pub use projection::Projection;
pub use target::{Hole, Target, TargetKind, TopLeft};
