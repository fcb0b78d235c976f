//! The record: what was measured in photographs and board so far, and how one photograph more or less changes
//! it. A [`Capture`] with another photograph is a new one, which takes the place of the old as a whole.

mod board;
mod photograph;
mod printed;

use std::f32::consts::PI;

use serde::{Deserialize, Serialize};

use super::settings::{RectifiedFalloff, Scene, Settings};
use crate::observation::{Falloff, View};
use crate::photo::Photo;
use crate::rectification;
use crate::{Error, Rejection, Result};
pub(super) use board::Board;
pub(super) use photograph::{Conditions, Measured, Photograph, Rectified, Taken, Wanted};

/// The accepted photographs and what is known from them. The fit has them rectified.
#[derive(Clone, Serialize, Deserialize)]
pub(super) enum Capture {
    Board(Box<Board>),
    Given(Given),
}

/// Where the photographs were taken from that came rectified.
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

/// Camera and light of a photograph that comes rectified, mm.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Placed {
    pub(super) camera_mm: [f32; 3],
    pub(super) light_mm: [f32; 3],
}

impl Capture {
    /// Without photographs; checks the scene.
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

    /// The capture with another photograph, which `placed` comes with if it is rectified.
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

    /// As if a photograph had never come, and how the others are to be rectified.
    ///
    /// # Errors
    /// The first photograph that would have been rejected without that one, and why.
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

    /// How the photographs are to be rectified.
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
    /// The name of a position that no camera or light above the sample has.
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

    /// These photographs, with what was saved of others of the same scene.
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
            // as bright at the sample as pi at the first camera's distance
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
