//! Poses, cameras and homographies, in `f64`.

mod camera;
mod homography;
mod pose;

pub use camera::Camera;
pub use homography::Homography;
pub use pose::Pose;
