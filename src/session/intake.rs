//! What happens to a photograph before the fit sees it: calibration and rectification.

use std::f32::consts::PI;

use glam::DVec3;

use super::{RectifiedFalloff, Scene};
use crate::calibration::photometry::{FlashOffset, PhotometricCalibrator, Radiometry};
use crate::calibration::{self, LumaImage, Target};
use crate::frame::Photo;
use crate::geometry::{Camera, Pose};
use crate::observation::{Falloff, Observation, View};
use crate::rectification;
use crate::{Error, Rejection, Result};

/// A photograph ready for the fit.
pub(super) struct Taken {
    pub(super) observation: Observation,
    pub(super) pose: Option<Pose>,
    pub(super) rms_px: Option<f64>,
    /// New radiometry of earlier photographs: each one's index, then what it was and is.
    pub(super) updates: Vec<Update>,
}

/// A better radiometry of an earlier photograph.
#[derive(Debug, Clone)]
pub(super) struct Update {
    pub(super) index: usize,
    camera: Camera,
    pose: Pose,
    old: Radiometry,
    new: Radiometry,
}

impl Update {
    /// Brings the photograph's observation up to date.
    pub(super) fn apply(&self, observation: &mut Observation) {
        rectification::update_radiometry(
            observation,
            &self.camera,
            &self.pose,
            0.0,
            &self.old,
            &self.new,
        );
    }
}

/// Takes photographs in, one at a time.
pub(super) enum Intake {
    Board(Box<BoardIntake>),
    Rectified { falloff: RectifiedFalloff, power_mm2: Option<[f32; 3]> },
}

/// Photographs of a board.
pub(super) struct BoardIntake {
    target: Target,
    camera: Camera,
    photometry: PhotometricCalibrator,
    frames: Vec<(Pose, Radiometry)>,
}

impl Intake {
    /// Checks the scene.
    pub(super) fn new(scene: Scene) -> Result<Self> {
        match scene {
            Scene::Board { target, camera, flash_offset_mm } => {
                if let Some((field, expected)) = target.fault() {
                    return Err(Error::argument("board", format!("{field}: expected {expected}")));
                }
                if let Some((field, expected)) = camera.fault() {
                    return Err(Error::argument("camera", format!("{field}: expected {expected}")));
                }
                let offset = flash_offset_mm.unwrap_or(DVec3::ZERO);
                if !offset.is_finite() {
                    return Err(Error::argument("flash", "offset_mm: expected finite numbers"));
                }
                let photometry =
                    PhotometricCalibrator::new(target.clone(), FlashOffset::Known(offset));
                Ok(Self::Board(Box::new(BoardIntake {
                    target,
                    camera,
                    photometry,
                    frames: Vec::new(),
                })))
            }
            Scene::Rectified { falloff } => Ok(Self::Rectified { falloff, power_mm2: None }),
        }
    }

    /// Light position in the camera frame as used, mm; zero for rectified photographs.
    pub(super) fn flash_offset_mm(&self) -> DVec3 {
        match self {
            Self::Board(board) => {
                board.photometry.photometry().map_or(DVec3::ZERO, |p| p.flash_offset_mm)
            }
            Self::Rectified { .. } => DVec3::ZERO,
        }
    }

    /// Ambient irradiance as a share of the flash's at the sample's centre, mean of the channels.
    pub(super) fn ambient_fraction(&self) -> f32 {
        match self {
            Self::Board(board) => board
                .photometry
                .photometry()
                .map_or(0.0, |p| (p.ambient.iter().sum::<f64>() / 3.0) as f32),
            Self::Rectified { .. } => 0.0,
        }
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
                "this session takes rectified photographs with camera and light positions",
            )),
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
                "this session takes photographs of a board, not rectified ones",
            ));
        };
        for (name, position) in [("camera_mm", camera_mm), ("light_mm", light_mm)] {
            if !(position.iter().all(|v| v.is_finite()) && position[2] > 0.0) {
                return Err(Error::argument(name, "three finite numbers with z > 0 are expected"));
            }
        }
        let own_power = [PI * camera_mm.iter().map(|v| v * v).sum::<f32>(); 3];
        let falloff = match *falloff {
            RectifiedFalloff::Given(falloff) => falloff,
            RectifiedFalloff::InverseSquareAuto => {
                Falloff::InverseSquare { power_mm2: power_mm2.unwrap_or(own_power) }
            }
        };
        let view = View { sample_mm, camera_mm, light_mm, falloff, ambient: [0.0; 3] };
        match rectification::from_rectified(photo, view, resolution, resolution) {
            Ok(observation) => {
                power_mm2.get_or_insert(own_power);
                Ok(Ok(Taken { observation, pose: None, rms_px: None, updates: Vec::new() }))
            }
            Err(rejection) => Ok(Err(rejection)),
        }
    }
}

impl BoardIntake {
    /// Everything is computed on copies and kept on success only.
    fn take(
        &mut self,
        photo: &Photo,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> std::result::Result<Taken, Rejection> {
        let camera = &self.camera;
        if (photo.width(), photo.height()) != (camera.width, camera.height) {
            return Err(Rejection::WrongSize {
                found_width: photo.width(),
                found_height: photo.height(),
                width: camera.width,
                height: camera.height,
            });
        }
        let luma = LumaImage::from_photo(photo);
        let detection = calibration::detect(&luma, &self.target)?;
        let estimate = calibration::estimate_pose(camera, &self.target, &detection.corners)?;
        let mut photometry = self.photometry.clone();
        let radiometry = photometry.push(photo, camera, &estimate.pose)?;
        let observation = rectification::rectify(
            photo,
            camera,
            &estimate.pose,
            &radiometry,
            sample_mm,
            resolution,
            resolution,
        )?;
        let mut updates = Vec::new();
        for (index, (pose, old)) in self.frames.iter_mut().enumerate() {
            let Some(new) = photometry.radiometry(index) else { continue };
            if new != *old {
                updates.push(Update { index, camera: *camera, pose: *pose, old: *old, new });
                *old = new;
            }
        }
        self.frames.push((estimate.pose, radiometry));
        self.photometry = photometry;
        Ok(Taken { observation, pose: Some(estimate.pose), rms_px: Some(estimate.rms_px), updates })
    }
}
