//! The record: measurements in the photographs so far, and the estimates of board, camera and light from them.
//! Adding or removing a photograph makes a new [`Capture`], which replaces the old one as a whole.

mod board;
mod photograph;
mod printed;

use std::f32::consts::PI;

use serde::{Deserialize, Serialize};

use super::settings::Settings;
use crate::observation::{Falloff, View};
use crate::photo::Photo;
use crate::rectification;
use crate::scene::{RectifiedFalloff, Scene};
use crate::{Error, Rejection, Result};
pub(super) use board::Board;
pub(super) use photograph::{Conditions, Measured, Photograph, Rectified, Taken, Wanted};

/// The accepted photographs and the estimates from them. The fit owns the rectified photographs.
#[derive(Clone, Serialize, Deserialize)]
pub(super) enum Capture {
    Board(Box<Board>),
    Given(Given),
}

/// Photographs that were added rectified: their cameras and lights.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Given {
    #[serde(skip)]
    falloff: RectifiedFalloff,
    #[serde(skip)]
    sample_mm: [f32; 2],
    #[serde(skip)]
    resolution: usize,
    pub(super) photographs: Vec<Placed>,
}

/// Positions of camera and light of a photograph that is added rectified, mm.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Placed {
    pub(super) camera_mm: [f32; 3],
    pub(super) light_mm: [f32; 3],
}

impl Capture {
    /// A capture without photographs.
    ///
    /// # Errors
    /// When the scene is out of range.
    pub(super) fn new(scene: Scene, settings: &Settings) -> Result<Self> {
        let Settings { sample_mm, resolution, .. } = *settings;
        Ok(match scene {
            Scene::Board { target, camera, flash_offset_mm: flash, elevation_mm } => {
                let board = Board::new(target, camera, flash, elevation_mm, sample_mm, resolution)?;
                Self::Board(Box::new(board))
            }
            Scene::Rectified { falloff } => {
                let photographs = Vec::new();
                Self::Given(Given { falloff, sample_mm, resolution, photographs })
            }
        })
    }

    /// The capture with another photograph. `placed` states camera and light of a rectified one.
    ///
    /// # Errors
    /// When the session expects photographs of the other kind, or a position is out of range.
    pub(super) fn with(
        &self,
        photo: &Photo,
        placed: Option<Placed>,
    ) -> Result<std::result::Result<(Self, Taken), Rejection>> {
        match (self, placed) {
            (Self::Board(board), None) => {
                let with = board.with(photo);
                Ok(with.map(|(board, taken)| (Self::Board(Box::new(board)), taken)))
            }
            (Self::Given(given), Some(placed)) => {
                let with = given.with(photo, placed)?;
                Ok(with.map(|(given, taken)| (Self::Given(given), taken)))
            }
            (Self::Given(_), None) => Err(Error::argument(
                "photo",
                "this session expects rectified photographs with camera and light positions",
            )),
            (Self::Board(_), Some(_)) => Err(Error::argument(
                "photo",
                "this session expects photographs of a board, not rectified ones",
            )),
        }
    }

    /// The capture without a photograph, and instructions to rectify the others.
    ///
    /// # Errors
    /// The first photograph that would have been rejected without that one, and its rejection.
    pub(super) fn without(
        &self,
        index: usize,
    ) -> std::result::Result<(Self, Vec<Wanted>), (usize, Rejection)> {
        Ok(match self {
            Self::Board(board) => {
                let (board, wanted) = board.without(index)?;
                (Self::Board(Box::new(board)), wanted)
            }
            Self::Given(given) => {
                let mut left = given.clone();
                left.photographs.remove(index);
                let wanted = left.wanted();
                (Self::Given(left), wanted)
            }
        })
    }

    /// Instructions to rectify the photographs.
    pub(super) fn wanted(&self) -> Vec<Wanted> {
        match self {
            Self::Board(board) => board.wanted(),
            Self::Given(given) => given.wanted(),
        }
    }

    pub(super) fn board(&self) -> Option<&Board> {
        match self {
            Self::Board(board) => Some(board),
            Self::Given(_) => None,
        }
    }
}

impl Placed {
    /// The name of a position that is not above the sample, or not finite.
    pub(super) fn fault(&self) -> Option<&'static str> {
        let is_above = |mm: [f32; 3]| mm.iter().all(|v| v.is_finite()) && mm[2] > 0.0;
        let positions = [("camera_mm", self.camera_mm), ("light_mm", self.light_mm)];
        positions.into_iter().find(|(_, mm)| !is_above(*mm)).map(|(name, _)| name)
    }
}

impl Given {
    fn with(
        &self,
        photo: &Photo,
        placed: Placed,
    ) -> Result<std::result::Result<(Self, Taken), Rejection>> {
        if let Some(name) = placed.fault() {
            return Err(Error::argument(name, "three finite numbers with z > 0 are expected"));
        }
        let mut with = self.clone();
        with.photographs.push(placed);
        let (view, size) = (with.view(&placed), self.resolution);
        Ok(rectification::from_rectified(photo, view, size, size).map(|observation| {
            let rectified = Rectified { conditions: None, observation };
            (with, Taken { rectified, pose: None, earlier: Vec::new(), restart: false })
        }))
    }

    /// This capture with the photographs of a saved one of the same scene.
    pub(super) fn resumed(self, saved: Self) -> Self {
        Self { photographs: saved.photographs, ..self }
    }

    fn wanted(&self) -> Vec<Wanted> {
        self.photographs.iter().map(|placed| Wanted::Given(self.view(placed))).collect()
    }

    fn view(&self, placed: &Placed) -> View {
        let &Placed { camera_mm, light_mm } = placed;
        let falloff = match self.falloff {
            RectifiedFalloff::Given(falloff) => falloff,
            // Irradiance pi at the first camera's distance.
            RectifiedFalloff::InverseSquareAuto => {
                let first_mm = self.photographs.first().unwrap_or(placed).camera_mm;
                let square = first_mm.iter().map(|v| v * v).sum::<f32>();
                Falloff::InverseSquare { power_mm2: [PI * square; 3] }
            }
        };
        let sample_mm = self.sample_mm;
        View { sample_mm, camera_mm, light_mm, falloff, ambient: [0.0; 3], mirrored: 1.0 }
    }
}
