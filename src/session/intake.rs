//! What happens to a photograph before the fit sees it: calibration and rectification.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::DVec3;

use super::board::replay::Replayed;
use super::board::{BoardIntake, Update};
use super::reports::BoardPose;
use super::settings::{RectifiedFalloff, Scene};
use super::sight::Known;
use super::taken::Taken;
use crate::calibration::PaperEstimate;
use crate::frame::{Photo, ToneCurve};
use crate::geometry::Camera;
use crate::observation::{Falloff, View};
use crate::rectification;
use crate::rectification::elevation::ElevationEstimate;
use crate::{Error, Rejection, Result};

/// An intake without one of its photographs.
pub(super) struct Remaining {
    pub(super) intake: Intake,
    /// What the rectified views of the others need, one entry each.
    pub(super) updates: Vec<Option<Update>>,
    /// Whether the power of their light is to be that of the first one left.
    pub(super) power: bool,
}

/// Takes photographs in, one at a time.
#[derive(Clone)]
pub(super) enum Intake {
    Board(Box<BoardIntake>),
    Rectified { falloff: RectifiedFalloff, power_mm2: Option<[f32; 3]> },
}

impl Intake {
    /// Checks the scene.
    pub(super) fn new(scene: Scene) -> Result<Self> {
        match scene {
            Scene::Board { target, camera, flash_offset_mm, elevation_mm } => {
                let board = BoardIntake::new(target, camera, flash_offset_mm, elevation_mm)?;
                Ok(Self::Board(Box::new(board)))
            }
            Scene::Rectified { falloff } => Ok(Self::Rectified { falloff, power_mm2: None }),
        }
    }

    /// Bytes held beside the rectified photographs.
    pub(super) fn kept_bytes(&self) -> u64 {
        self.board().map_or(0, BoardIntake::kept_bytes)
    }

    fn board(&self) -> Option<&BoardIntake> {
        match self {
            Self::Board(board) => Some(board),
            Self::Rectified { .. } => None,
        }
    }

    /// The camera as used.
    pub(super) fn camera(&self) -> Option<Camera> {
        self.board()?.camera()
    }

    /// Standard deviations of an estimated camera's nine numbers.
    pub(super) fn camera_sigma(&self) -> Option<[f64; 9]> {
        self.board()?.camera_sigma()
    }

    /// The printed sheet, for photographs of a board.
    pub(super) fn paper(&self) -> Option<PaperEstimate> {
        Some(self.board()?.paper())
    }

    /// The sample's height above the board, for photographs of one.
    pub(super) fn elevation(&self) -> Option<ElevationEstimate> {
        Some(self.board()?.elevation())
    }

    /// Poses as known now.
    pub(super) fn poses(&self) -> Vec<BoardPose> {
        self.board().map_or_else(Vec::new, BoardIntake::poses)
    }

    /// Light position in the camera frame as used, mm; zero for rectified photographs.
    pub(super) fn flash_offset_mm(&self) -> DVec3 {
        let photometry = self.board().and_then(|b| b.photometry());
        photometry.map_or(DVec3::ZERO, |p| p.flash_offset_mm)
    }

    /// Ambient irradiance as a share of the flash's at the sample's centre, mean of the channels.
    pub(super) fn ambient_fraction(&self) -> f32 {
        let photometry = self.board().and_then(|b| b.photometry());
        photometry.map_or(0.0, |p| (p.ambient.iter().sum::<f64>() / 3.0) as f32)
    }

    /// What undoes the camera's tone curve.
    pub(super) fn tone_curve(&self) -> ToneCurve {
        let photometry = self.board().and_then(|b| b.photometry());
        photometry.map_or_else(ToneCurve::default, |p| p.tone)
    }

    /// What probes look with; `None` for rectified photographs.
    pub(super) fn known(&self, sample_mm: [f32; 2]) -> Option<Arc<Known>> {
        Some(Arc::new(self.board()?.known(sample_mm)))
    }

    /// Calibrates and rectifies a photograph of a board.
    pub(super) fn take(
        &mut self,
        photo: &Photo,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> Result<std::result::Result<Taken, Rejection>> {
        match self {
            Self::Board(board) => Ok(board.take(photo, sample_mm, resolution)),
            Self::Rectified { .. } => Err(Error::argument(
                "photo",
                "this session expects rectified photographs with camera and light positions",
            )),
        }
    }

    /// As if one of so many photographs had never come.
    ///
    /// # Errors
    /// The first photograph that would have been rejected without that one, and why.
    pub(super) fn without(
        &self,
        index: usize,
        photographs: usize,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> std::result::Result<Remaining, (usize, Rejection)> {
        match self {
            Self::Board(board) => {
                let Replayed { intake, updates } = board.without(index, sample_mm, resolution)?;
                Ok(Remaining { intake: Self::Board(Box::new(intake)), updates, power: false })
            }
            Self::Rectified { falloff, .. } => Ok(Remaining {
                intake: self.clone(),
                updates: vec![None; photographs - 1],
                power: index == 0 && *falloff == RectifiedFalloff::InverseSquareAuto,
            }),
        }
    }

    /// Takes a rectified photograph.
    pub(super) fn take_rectified(
        &mut self,
        photo: &Photo,
        camera_mm: [f32; 3],
        light_mm: [f32; 3],
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> Result<std::result::Result<Taken, Rejection>> {
        let Self::Rectified { falloff, power_mm2 } = self else {
            return Err(Error::argument(
                "photo",
                "this session expects photographs of a board, not rectified ones",
            ));
        };
        for (name, position) in [("camera_mm", camera_mm), ("light_mm", light_mm)] {
            if !(position.iter().all(|v| v.is_finite()) && position[2] > 0.0) {
                return Err(Error::argument(name, "three finite numbers with z > 0 are expected"));
            }
        }
        let own_power = own_power(camera_mm);
        let falloff = match *falloff {
            RectifiedFalloff::Given(falloff) => falloff,
            RectifiedFalloff::InverseSquareAuto => {
                Falloff::InverseSquare { power_mm2: power_mm2.unwrap_or(own_power) }
            }
        };
        let view =
            View { sample_mm, camera_mm, light_mm, falloff, ambient: [0.0; 3], mirrored: 1.0 };
        match rectification::from_rectified(photo, view, resolution, resolution) {
            Ok(observation) => {
                power_mm2.get_or_insert(own_power);
                Ok(Ok(Taken {
                    observation,
                    pose: None,
                    rms_px: None,
                    updates: Vec::new(),
                    restart: false,
                    hints: Vec::new(),
                }))
            }
            Err(rejection) => Ok(Err(rejection)),
        }
    }
}

/// Power of a light that is as bright at the sample as pi at a camera's distance.
pub(super) fn own_power(camera_mm: [f32; 3]) -> [f32; 3] {
    [PI * camera_mm.iter().map(|v| v * v).sum::<f32>(); 3]
}
