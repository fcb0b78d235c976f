//! Rigid motion from the board to the camera.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// `x_cam = rotation * x_board + translation`, lengths in mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Rotation, board to camera.
    pub rotation: DMat3,
    /// Board origin in the camera frame, mm.
    pub translation: DVec3,
}

impl Pose {
    /// Whether it is a rotation and a finite translation.
    pub(crate) fn is_plausible(&self) -> bool {
        let identity = self.rotation * self.rotation.transpose();
        let off = (identity - DMat3::IDENTITY).to_cols_array();
        // NaN must fail too.
        off.iter().all(|v| v.abs() <= 1e-6) && self.translation.is_finite()
    }

    /// Transforms a point from the board frame to the camera frame.
    pub fn transform(&self, board: DVec3) -> DVec3 {
        self.rotation * board + self.translation
    }

    /// Transforms a point from the camera frame to the board frame.
    pub fn to_board(&self, camera: DVec3) -> DVec3 {
        self.rotation.transpose() * (camera - self.translation)
    }

    /// Camera centre in the board frame, mm.
    pub fn camera_centre(&self) -> DVec3 {
        self.to_board(DVec3::ZERO)
    }

    /// Angle between the board's normal and the direction from its origin to the camera, radians.
    pub fn view_angle(&self) -> f64 {
        let c = self.camera_centre();
        (c.z / c.length()).clamp(-1.0, 1.0).acos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn board_and_camera_frames_invert_each_other() {
        let pose = Pose {
            rotation: DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 2.5),
            translation: DVec3::new(3.0, -4.0, 200.0),
        };
        let x = DVec3::new(10.0, -20.0, 1.0);
        assert!((pose.to_board(pose.transform(x)) - x).length() < 1e-12);
        assert!(pose.transform(pose.camera_centre()).length() < 1e-12);
    }
}
