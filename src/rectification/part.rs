//! The part of a photograph kept for another rectification.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::geometry::{Camera, Pose};
use crate::photo::{Photo, Surround};

/// Margin around the sample in a photograph, part of its extent and px, since later poses differ slightly.
const CROP_SHARE: f64 = 0.05;
const CROP_PX: f64 = 24.0;

/// The part of a photograph that shows the sample.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Part {
    pub photo: Photo,
    /// Position of its first pixel in the whole photograph.
    pub corner: [u32; 2],
    /// Strongly blurred whole photograph.
    pub surround: Surround,
}

impl Part {
    /// Crops to a sample at a height within `heights_mm` above the board's plane.
    pub fn new(
        photo: &Photo,
        camera: &Camera,
        pose: &Pose,
        sample_mm: [f32; 2],
        heights_mm: [f64; 2],
    ) -> Self {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        // Distortion bends edges, so sample points along them.
        for i in 0..9 * 9 {
            let (x, y) = (f64::from(i % 9) / 8.0 - 0.5, f64::from(i / 9) / 8.0 - 0.5);
            for z in heights_mm {
                let p = DVec3::new(x * f64::from(sample_mm[0]), y * f64::from(sample_mm[1]), z);
                if let Some(px) = camera.project(pose.transform(p)) {
                    (low, high) = (low.min(px), high.max(px));
                }
            }
        }
        let size = DVec2::new(photo.width().into(), photo.height().into());
        let margin = CROP_SHARE * (high - low) + CROP_PX;
        let low = (low - margin).floor().clamp(DVec2::ZERO, size - 1.0);
        let high = (high + margin).ceil().clamp(low + 1.0, size);
        let (corner, extent) = (low.as_uvec2(), (high - low).as_uvec2());
        let surround = Surround::of(photo);
        let photo = photo.cropped(corner.x, corner.y, extent.x, extent.y);
        Self { photo, corner: corner.to_array(), surround }
    }

    /// The camera for this part.
    pub fn camera(&self, whole: &Camera) -> Camera {
        Camera {
            width: self.photo.width(),
            height: self.photo.height(),
            cx: whole.cx - f64::from(self.corner[0]),
            cy: whole.cy - f64::from(self.corner[1]),
            ..*whole
        }
    }
}
