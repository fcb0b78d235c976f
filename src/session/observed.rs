//! Photographs that are looked at and not added.

use std::sync::PoisonError;

use super::reports::{BoardPose, Observed};
use super::settings::Settings;
use super::taken::Taken;
use super::{Session, memory};
use crate::frame::Photo;
use crate::{Rejection, Result};

impl Session {
    /// Calibrates and rectifies a photograph of a board with what is known so far, without adding
    /// it: nothing of the session changes. The result is what the maps should predict, for
    /// instance to measure them on photographs that they were not fitted to.
    ///
    /// The inner result is a [`Rejection`] where the photograph cannot be used.
    ///
    /// # Errors
    /// As [`Session::push`].
    pub fn observe(&self, photo: &Photo) -> Result<std::result::Result<Observed, Rejection>> {
        self.look(photo, None)
    }

    /// As [`Session::observe`] for a photograph that is already rectified, with camera and light
    /// positions in mm.
    ///
    /// # Errors
    /// As [`Session::push_rectified`].
    pub fn observe_rectified(
        &self,
        photo: &Photo,
        camera_mm: [f32; 3],
        light_mm: [f32; 3],
    ) -> Result<std::result::Result<Observed, Rejection>> {
        self.look(photo, Some((camera_mm, light_mm)))
    }

    fn look(
        &self,
        photo: &Photo,
        rectified: Option<([f32; 3], [f32; 3])>,
    ) -> Result<std::result::Result<Observed, Rejection>> {
        self.usable()?;
        if !photo.is_finite() {
            return Ok(Err(Rejection::NotFinite));
        }
        let mut intake = self.intake.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let Settings { sample_mm, resolution, .. } = self.settings;
        let photographs = self.shared.lock().progress.frames + 1;
        let beside = memory::while_pushed(photo, 2 * intake.kept_bytes());
        self.check_memory(photographs, beside)?;
        let taken = self.pool.install(|| match rectified {
            None => intake.take(photo, sample_mm, resolution),
            Some((camera, light)) => {
                intake.take_rectified(photo, camera, light, sample_mm, resolution)
            }
        })?;
        Ok(taken.map(|Taken { observation, pose, rms_px, hints, .. }| Observed {
            observation,
            pose: pose
                .zip(rms_px)
                .map(|(pose, reprojection_rms_px)| BoardPose { pose, reprojection_rms_px }),
            hints,
        }))
    }
}
