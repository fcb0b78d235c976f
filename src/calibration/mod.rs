//! From a photograph to pose, light and radiometric scale: the target, its detector, pose,
//! photometry.
//!
//! # Corners
//! [`detect`] needs no camera. On the smallest version of the picture that shows the board it
//! finds X-corners, joins them to pieces of a square lattice and places these on the known layout:
//! colours of squares, corners missing along the hole and the outline leave one placement, or the
//! photograph is refused. The placement is followed to full size, completed by prediction, and
//! each corner refined to a few hundredths of a pixel. Markers in white squares, where they are read, place
//! pieces of a board that the picture crops, and refuse a wrong placement; refinement keeps clear
//! of them.
//!
//! # Pose
//! [`estimate_pose`] refines both poses that nearly explain a plane's picture, leaves out corners
//! that do not fit, and accepts on observables only: the number and share of fitting corners,
//! their reprojection error, the lead over the second pose.
//!
//! # Camera
//! [`estimate_camera`] finds intrinsics and distortion from the corners of one or more photographs;
//! what these do not tell stays at what [`CameraPrior`] expects. A print that is stretched or bent
//! ([`Paper`]) is estimated with it, or with a given camera by [`estimate_paper`].

mod blur;
mod board_model;
mod camera_estimation;
mod corners;
mod detector;
mod lattice;
mod layout;
mod luma;
mod marker_reading;
mod markers;
mod outline;
mod paper;
pub mod photometry;
mod placement;
mod pose;
mod projection;
pub(crate) mod reasons;
mod subpixel;
mod target;
mod turns;

pub use camera_estimation::{
    CameraEstimate, CameraPrior, ViewEstimate, estimate_camera, estimate_camera_and_paper,
    estimate_paper,
};
pub use detector::{Corner, Detection, detect};
pub(crate) use detector::{Sighting, sight};
pub use luma::LumaImage;
pub(crate) use marker_reading::{MarkersRead, read_markers};
pub use markers::Marker;
pub use paper::{Paper, PaperEstimate};
pub(crate) use pose::likeliest_pose;
pub use pose::{PoseEstimate, VIEW_ANGLE_MAX_DEG, estimate_pose, estimate_pose_on_paper};
pub use projection::Projection;
pub use target::{Hole, Patch, Target, TargetKind, TopLeft};
