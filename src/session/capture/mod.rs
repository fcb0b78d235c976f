//! What is known from photographs and board so far, and how one photograph more or less changes it:
//! calibration and rectification. A [`Capture`] with another photograph is a new one, which takes the
//! place of the old as a whole.

mod board;
mod photograph;
mod printed;

use std::f32::consts::PI;

use serde::{Deserialize, Serialize};

use super::reports::Observed;
use super::settings::{RectifiedFalloff, Scene, Settings};
use crate::observation::{Falloff, Observation, View};
use crate::photo::Photo;
use crate::rectification;
use crate::{Error, Rejection, Result};
pub(super) use board::Board;
pub(super) use photograph::{Conditions, Measured, Photograph, Remake, Taken};

/// The accepted photographs and what is known from them.
#[derive(Clone, Serialize, Deserialize)]
pub(super) enum Capture {
    Board(Box<Board>),
    Rectified(Rectified),
}

/// Photographs that came rectified.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Rectified {
    #[serde(skip)]
    falloff: RectifiedFalloff,
    #[serde(skip)]
    sample_mm: [f32; 2],
    #[serde(skip)]
    resolution: usize,
    pub(super) photographs: Vec<Observation>,
}

/// Camera and light of a photograph that comes rectified, mm.
#[derive(Debug, Clone, Copy)]
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
                Self::Rectified(Rectified { falloff, sample_mm, resolution, photographs })
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
            (Self::Rectified(rectified), Some(placed)) => {
                let with = rectified.with(photo, placed)?;
                Ok(with.map(|(rectified, taken)| (Self::Rectified(rectified), taken)))
            }
            (Self::Rectified(_), None) => Err(Error::argument(
                "photo",
                "this session expects rectified photographs with camera and light positions",
            )),
            (Self::Board(_), Some(_)) => Err(Error::argument(
                "photo",
                "this session expects photographs of a board, not rectified ones",
            )),
        }
    }

    /// As if a photograph had never come.
    ///
    /// # Errors
    /// The first photograph that would have been rejected without that one, and why.
    pub(super) fn without(&self, index: usize) -> std::result::Result<Self, (usize, Rejection)> {
        Ok(match self {
            Self::Board(board) => Self::Board(Box::new(board.without(index)?)),
            Self::Rectified(rectified) => Self::Rectified(rectified.without(index)),
        })
    }

    /// The rectified photographs; their texels are shared.
    pub(super) fn observations(&self) -> Vec<Observation> {
        match self {
            Self::Board(board) => {
                let rectified = board.photographs.iter().filter_map(|p| p.rectified.as_ref());
                rectified.map(|r| r.observation().clone()).collect()
            }
            Self::Rectified(rectified) => rectified.photographs.clone(),
        }
    }

    pub(super) fn board(&self) -> Option<&Board> {
        match self {
            Self::Board(board) => Some(board),
            Self::Rectified(_) => None,
        }
    }
}

impl Rectified {
    fn with(
        &self,
        photo: &Photo,
        Placed { camera_mm, light_mm }: Placed,
    ) -> Result<std::result::Result<(Self, Taken), Rejection>> {
        for (name, position) in [("camera_mm", camera_mm), ("light_mm", light_mm)] {
            if !(position.iter().all(|v| v.is_finite()) && position[2] > 0.0) {
                return Err(Error::argument(name, "three finite numbers with z > 0 are expected"));
            }
        }
        let (sample_mm, falloff) = (self.sample_mm, self.falloff(camera_mm));
        let view =
            View { sample_mm, camera_mm, light_mm, falloff, ambient: [0.0; 3], mirrored: 1.0 };
        let rectified =
            rectification::from_rectified(photo, view, self.resolution, self.resolution);
        Ok(rectified.map(|observation| {
            let mut with = self.clone();
            with.photographs.push(observation.clone());
            let observed = Observed { observation, pose: None, hints: Vec::new() };
            (with, Taken { observed, remakes: Vec::new(), restart: false })
        }))
    }

    fn without(&self, index: usize) -> Self {
        let mut left = self.clone();
        left.photographs.remove(index);
        if let Some(first) = left.photographs.first() {
            let falloff = left.falloff(first.view.camera_mm);
            left.photographs.iter_mut().for_each(|p| p.view.falloff = falloff);
        }
        left
    }

    /// Of a photograph taken from there, if it is the first.
    fn falloff(&self, camera_mm: [f32; 3]) -> Falloff {
        let first_mm = self.photographs.first().map_or(camera_mm, |first| first.view.camera_mm);
        match self.falloff {
            RectifiedFalloff::Given(falloff) => falloff,
            // as bright at the sample as pi at the first camera's distance
            RectifiedFalloff::InverseSquareAuto => Falloff::InverseSquare {
                power_mm2: [PI * first_mm.iter().map(|v| v * v).sum::<f32>(); 3],
            },
        }
    }
}
