//! The content of photographs: a board round the sample, or the rectified sample.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::calibration::Target;
use crate::geometry::Camera;
use crate::observation::Falloff;

/// The content of the photographs, fixed for a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // there is one for each session
pub enum Scene {
    /// Photographs of a board round the sample.
    Board {
        /// The printed board.
        target: Target,
        /// Intrinsics of all photographs; `None`: estimated from the photographs so far, again with each
        /// new one. Earlier photographs are rectified again when the estimate moves them. For this the
        /// session keeps the part of each that shows the sample: about a third of a photograph that shows
        /// the whole board (12 MB of a 12-megapixel one). With a given camera it keeps the parts until it
        /// knows the sheet of paper and the sample's height, for seven photographs at most.
        camera: Option<Camera>,
        /// Flash position in the camera frame, mm; `None`: at the camera's centre until the
        /// photographs determine it.
        flash_offset_mm: Option<DVec3>,
        /// Height of the sample's surface above the printed side of the board, mm; `None`:
        /// estimated from two photographs or more, 0 unless they clearly contradict that.
        elevation_mm: Option<f64>,
    },
    /// Photographs already rectified to the top view, camera and light given with each.
    Rectified {
        /// Strength of the light over distance; inverse-square without a power takes
        /// pi * (first camera's distance)².
        falloff: RectifiedFalloff,
    },
}

impl Scene {
    /// Photographs of a board. Camera, flash and height of the sample are estimated unless the
    /// setters of [`BoardScene`] state them.
    pub fn board(target: Target) -> BoardScene {
        BoardScene { target, camera: None, flash_offset_mm: None, elevation_mm: None }
    }
}

/// Builds [`Scene::Board`]; made by [`Scene::board`].
#[derive(Debug, Clone, PartialEq)]
pub struct BoardScene {
    target: Target,
    camera: Option<Camera>,
    flash_offset_mm: Option<DVec3>,
    elevation_mm: Option<f64>,
}

impl BoardScene {
    /// States the intrinsics of all photographs.
    #[must_use]
    pub fn camera(self, camera: Camera) -> Self {
        Self { camera: Some(camera), ..self }
    }

    /// States the flash position in the camera frame, mm.
    #[must_use]
    pub fn flash_offset_mm(self, offset: DVec3) -> Self {
        Self { flash_offset_mm: Some(offset), ..self }
    }

    /// States the height of the sample's surface above the printed side of the board, mm.
    #[must_use]
    pub fn elevation_mm(self, height: f64) -> Self {
        Self { elevation_mm: Some(height), ..self }
    }
}

impl From<BoardScene> for Scene {
    fn from(board: BoardScene) -> Self {
        let BoardScene { target, camera, flash_offset_mm, elevation_mm } = board;
        Self::Board { target, camera, flash_offset_mm, elevation_mm }
    }
}

/// Light of rectified photographs.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub enum RectifiedFalloff {
    /// As given.
    Given(Falloff),
    /// Inverse square with `power_mm2 = pi * (first camera's distance)²`.
    #[default]
    InverseSquareAuto,
}
