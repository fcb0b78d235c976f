//! Photographs that are judged and not taken in.

use std::sync::PoisonError;

use super::intake::Intake;
use super::reports::Probe;
use super::{Session, memory};
use crate::frame::Photo;
use crate::{Error, Result};

impl Session {
    /// Judges a photograph of a board, or a picture of a camera's preview, without taking it in:
    /// corners, pose, blur, exposure, view, and what a push would say of a photograph like it. Nothing
    /// of the session changes.
    ///
    /// A picture of another size than the session's camera is taken for a preview of it: scaled to its
    /// width or height and cut at the other sides. Where that does not fit, and before a camera is
    /// known, the camera is estimated from the picture. Pictures from 1280 px on are reduced first.
    ///
    /// A push may still come to another verdict where it is a matter of pixels, or of what all
    /// photographs tell together. Runs on the calling thread alone and waits neither for the fit nor
    /// for a push.
    ///
    /// # Errors
    /// On misuse, when the session has failed or was cancelled, and when the memory limit is reached.
    pub fn probe(&self, photo: &Photo) -> Result<Probe> {
        self.judge(photo, true)
    }

    /// As [`Session::probe`] for a picture without the flash: how it is lit says nothing about the
    /// photograph to come.
    ///
    /// # Errors
    /// As [`Session::probe`].
    pub fn probe_without_flash(&self, photo: &Photo) -> Result<Probe> {
        self.judge(photo, false)
    }

    fn judge(&self, photo: &Photo, lit: bool) -> Result<Probe> {
        self.usable()?;
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let known = known.ok_or_else(|| {
            Error::argument("photo", "a session of rectified photographs has no board to look for")
        })?;
        let photographs = self.shared.lock().progress.frames;
        self.check_memory(photographs.max(1), memory::while_probed(photo))?;
        Ok(known.look(photo, lit))
    }

    /// Lets probes look with what the intake knows now.
    pub(super) fn remember(&self, intake: &Intake) {
        self.beside.keep(intake.kept_bytes());
        let known = intake.known(self.settings.sample_mm);
        *self.known.lock().unwrap_or_else(PoisonError::into_inner) = known;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Capture;
    use crate::session::{Pushed, Settings};

    /// Whoever pushes or saves holds the intake, and a fit the threads: a probe needs neither.
    #[test]
    fn a_probe_waits_for_nobody() {
        let dir = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile");
        let capture = Capture::load(dir).unwrap();
        let settings = Settings { sample_mm: capture.sample_mm, threads: 1, ..Settings::default() };
        let session = Session::new(capture.scene.clone(), settings).unwrap();
        let photo = capture.frames[0].read().unwrap();
        assert!(matches!(session.push(&photo), Ok(Pushed::Accepted(_))));
        let (tell, told) = crossbeam_channel::bounded(1);
        let _held = session.intake.lock().unwrap();
        std::thread::scope(|scope| {
            session.pool.install(|| {
                scope.spawn(|| tell.send(session.probe(&photo).map(|p| p.pose.is_some())));
                let probed = told.recv_timeout(std::time::Duration::from_secs(60));
                assert!(matches!(probed, Ok(Ok(true))), "{probed:?}");
            });
        });
    }
}
