//! From a photograph to pose, light and radiometric scale: target, detector, pose, photometry.
//!
//! # Corners
//! [`detect`] needs no camera. It finds X-corners on the smallest version of the picture that shows
//! the board, joins them to pieces of a square lattice and places these on the known layout.
//! Colours of squares and missing corners along hole and outline must leave one placement, or the
//! photograph is rejected. The placement is tracked to full size and completed by prediction, and
//! each corner is refined to a few hundredths of a pixel. Legible markers in white squares place
//! pieces of a cropped board and veto a wrong placement; refinement avoids them.
//!
//! # Pose
//! [`estimate_pose`] refines both poses that nearly explain a plane's picture and rejects outlying
//! corners. Acceptance depends on observables only: number and share of inliers, reprojection
//! error, and the lead over the second pose.
//!
//! # Camera
//! [`estimate_camera`] finds intrinsics and distortion from the corners of one or more photographs;
//! undetermined values keep the mean of [`CameraPrior`]. Stretch and bend of the print ([`Paper`])
//! are estimated at the same time, or with a given camera by [`estimate_paper`].

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
