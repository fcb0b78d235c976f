//! What is known from photographs and board so far, and how one photograph more or less changes it:
//! calibration and rectification. A [`Capture`] with another photograph is a new one, which takes the
//! place of the old as a whole.

mod board;
mod photograph;
mod reasons;
mod removal;

use std::f32::consts::PI;
use std::sync::Arc;

use glam::DVec3;

use super::advice::Hint;
use super::preview::Preview;
use super::reports::BoardPose;
use super::settings::{RectifiedFalloff, Scene, Settings};
use crate::calibration::photometry::Photometry;
use crate::frame::Photo;
use crate::observation::{Falloff, Observation, View};
use crate::rectification;
use crate::{Error, Rejection, Result};
pub(super) use board::Board;
pub(super) use photograph::{Conditions, Measured, Part, Photograph, Remade, Remake};

/// The accepted photographs and what is known from them.
#[derive(Clone)]
pub(super) enum Capture {
    Board(Box<Board>),
    Rectified(Rectified),
}

/// Photographs that came rectified.
#[derive(Debug, Clone)]
pub(super) struct Rectified {
    falloff: RectifiedFalloff,
    sample_mm: [f32; 2],
    resolution: usize,
    pub(super) photographs: Vec<Observation>,
}

/// Camera and light of a photograph that comes rectified, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) camera_mm: [f32; 3],
    pub(super) light_mm: [f32; 3],
}

/// A photograph taken in.
pub(super) struct Taken {
    /// The capture with it.
    pub(super) capture: Capture,
    pub(super) observation: Observation,
    /// Earlier ones to be rectified better, which [`Capture::adopt`] waits for.
    pub(super) remakes: Vec<Remake>,
    /// Whether these lie so far elsewhere then that maps so far are no start any more.
    pub(super) restart: bool,
    pub(super) pose: Option<BoardPose>,
    pub(super) hints: Vec<Hint>,
}

impl Capture {
    /// Without photographs; checks the scene.
    pub(super) fn new(scene: Scene, settings: &Settings) -> Result<Self> {
        let Settings { sample_mm, resolution, .. } = *settings;
        match scene {
            Scene::Board { target, camera, flash_offset_mm: flash, elevation_mm } => {
                let board = Board::new(target, camera, flash, elevation_mm, sample_mm, resolution)?;
                Ok(Self::Board(Box::new(board)))
            }
            Scene::Rectified { falloff } => {
                let photographs = Vec::new();
                Ok(Self::Rectified(Rectified { falloff, sample_mm, resolution, photographs }))
            }
        }
    }

    /// The capture with another photograph, which `placed` comes with if it is rectified.
    ///
    /// # Errors
    /// When the session expects photographs of the other kind, or a position is out of range.
    pub(super) fn with(
        &self,
        photo: &Photo,
        placed: Option<Placed>,
    ) -> Result<std::result::Result<Taken, Rejection>> {
        match (self, placed) {
            (Self::Board(board), None) => Ok(board.with(photo).map(|with| Taken {
                capture: Self::Board(Box::new(with.board)),
                observation: with.observation,
                remakes: with.remakes,
                restart: with.restart,
                pose: Some(with.pose),
                hints: with.hints,
            })),
            (Self::Rectified(rectified), Some(placed)) => rectified.with(photo, placed),
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
        match self {
            Self::Board(board) => Ok(Self::Board(Box::new(board.without(index)?))),
            Self::Rectified(rectified) => Ok(Self::Rectified(rectified.without(index))),
        }
    }

    /// The rectified photographs; their texels are shared.
    pub(super) fn observations(&self) -> Vec<Observation> {
        match self {
            Self::Board(board) => {
                let rectified = board.photographs().iter().filter_map(|p| p.rectified.as_ref());
                rectified.map(|r| r.observation().clone()).collect()
            }
            Self::Rectified(rectified) => rectified.photographs.clone(),
        }
    }

    /// Bytes held beside the rectified photographs.
    pub(super) fn kept_bytes(&self) -> u64 {
        self.board().map_or(0, Board::kept_bytes)
    }

    /// Takes over what became of photographs that were to be rectified better.
    pub(super) fn adopt(&mut self, remade: Vec<Remade>) {
        if let Self::Board(board) = self {
            board.adopt(remade);
        }
    }

    pub(super) fn board(&self) -> Option<&Board> {
        match self {
            Self::Board(board) => Some(board),
            Self::Rectified(_) => None,
        }
    }

    /// What is known of the light of photographs of a board.
    pub(super) fn photometry(&self) -> Option<&Photometry> {
        self.board()?.photometry()
    }

    /// Poses as known now.
    pub(super) fn poses(&self) -> Vec<BoardPose> {
        let photographs = self.board().map_or(&[][..], Board::photographs);
        let pose = |p: &Photograph| BoardPose { pose: p.pose, reprojection_rms_px: p.rms_px };
        photographs.iter().map(pose).collect()
    }

    /// Light position in the camera frame as used, mm; zero for rectified photographs.
    pub(super) fn flash_offset_mm(&self) -> DVec3 {
        self.photometry().map_or(DVec3::ZERO, |p| p.flash_offset_mm)
    }

    /// What previews are judged with; `None` for rectified photographs.
    pub(super) fn preview(&self) -> Option<Arc<Preview>> {
        Some(Arc::new(self.board()?.preview()))
    }
}

impl Rectified {
    fn with(
        &self,
        photo: &Photo,
        Placed { camera_mm, light_mm }: Placed,
    ) -> Result<std::result::Result<Taken, Rejection>> {
        for (name, position) in [("camera_mm", camera_mm), ("light_mm", light_mm)] {
            if !(position.iter().all(|v| v.is_finite()) && position[2] > 0.0) {
                return Err(Error::argument(name, "three finite numbers with z > 0 are expected"));
            }
        }
        let (sample_mm, falloff) = (self.sample_mm, self.falloff(camera_mm));
        let view =
            View { sample_mm, camera_mm, light_mm, falloff, ambient: [0.0; 3], mirrored: 1.0 };
        let observation =
            match rectification::from_rectified(photo, view, self.resolution, self.resolution) {
                Ok(observation) => observation,
                Err(rejection) => return Ok(Err(rejection)),
            };
        let mut with = self.clone();
        with.photographs.push(observation.clone());
        let capture = Capture::Rectified(with);
        let (remakes, hints) = (Vec::new(), Vec::new());
        Ok(Ok(Taken { capture, observation, remakes, restart: false, pose: None, hints }))
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
