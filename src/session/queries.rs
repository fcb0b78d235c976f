//! What a session is asked.

use std::sync::Arc;

use glam::DVec3;

use super::capture::{Board, Photograph};
use super::reports::{Assessed, BoardPose, Probe, Progress, Revision};
use super::survey::{NextView, Survey};
use super::{Hint, Session, diagnosis, memory};
use crate::calibration::PaperEstimate;
use crate::calibration::photometry::Photometry;
use crate::estimate::{Evidence, Exposure, FrameFit, PhaseReport};
use crate::frame::{Photo, ToneCurve};
use crate::geometry::Camera;
use crate::rectification::elevation::ElevationEstimate;
use crate::threads::lock;
use crate::{Error, Result, Svbrdf};

impl Session {
    /// The current maps.
    ///
    /// # Errors
    /// Before the first photograph was accepted.
    pub fn snapshot(&self) -> Result<Arc<Svbrdf>> {
        self.fit.shared.lock().maps.clone().ok_or(Error::NoMaps)
    }

    /// Corrections that belong to the current maps: gain of each accepted photograph, exposure over
    /// distance, offset of the flash. None where a board determines them, and while they are unknown.
    pub fn exposure(&self) -> Exposure {
        self.fit.shared.lock().exposure.clone()
    }

    /// What each phase of the fit has done for the photographs so far, in their order.
    ///
    /// # Errors
    /// When the fit has failed or was cancelled.
    pub fn phase_reports(&self) -> Result<Vec<PhaseReport>> {
        self.fit.ask(|fit| Ok(fit.estimation.reports().to_vec()))
    }

    /// State of the fit.
    pub fn progress(&self) -> Progress {
        self.fit.shared.lock().progress
    }

    /// The internal error that ended the fit: what every call that needs the fit returns from then on.
    pub fn failure(&self) -> Option<String> {
        self.fit.shared.lock().failed.clone()
    }

    /// Counters of changes of state and maps.
    pub fn revision(&self) -> Revision {
        self.fit.shared.lock().revision
    }

    /// The camera as used: given, or estimated from the photographs so far. `None` for rectified
    /// photographs, and while it is unknown.
    pub fn camera(&self) -> Option<Camera> {
        self.board(Board::camera)?
    }

    /// Standard deviations of fx, fy, cx, cy (px), k1, k2, p1, p2, k3 of an estimated camera.
    pub fn camera_sigma(&self) -> Option<[f64; 9]> {
        self.board(|board| board.estimate.as_ref().map(|e| e.sigma()))?
    }

    /// How the printed board differs from its plan (stretch, bow), as used: as planned unless two
    /// photographs or more clearly say otherwise. `None` for rectified photographs.
    pub fn paper(&self) -> Option<PaperEstimate> {
        self.board(|board| board.paper)
    }

    /// Height of the sample's surface above the board, as used: as the scene states it, else 0 unless two
    /// photographs or more clearly say otherwise. `None` for rectified photographs.
    pub fn elevation(&self) -> Option<ElevationEstimate> {
        self.board(|board| board.elevation)
    }

    /// Poses of the accepted photographs as the latest tells them. Empty for rectified photographs.
    pub fn poses(&self) -> Vec<BoardPose> {
        let pose = |p: &Photograph| BoardPose { pose: p.pose, reprojection_rms_px: p.rms_px };
        self.board(|board| board.photographs.iter().map(pose).collect()).unwrap_or_default()
    }

    /// Light position in the camera frame as used, mm.
    pub fn flash_offset_mm(&self) -> DVec3 {
        self.board(Board::flash_offset_mm).unwrap_or_default()
    }

    /// Ambient irradiance as a share of the flash's at the sample's centre, facing the flash at the
    /// first photograph's distance.
    pub fn ambient_fraction(&self) -> f32 {
        let mean = |light: &Photometry| (light.ambient.iter().sum::<f64>() / 3.0) as f32;
        self.board(|board| board.photometry.as_ref().map(mean)).flatten().unwrap_or_default()
    }

    /// The inverse of the camera's tone curve: the identity for rectified photographs, and as long as
    /// values seem linear.
    pub fn tone_curve(&self) -> ToneCurve {
        let tone = |light: &Photometry| light.tone;
        self.board(|board| board.photometry.as_ref().map(tone)).flatten().unwrap_or_default()
    }

    /// How the maps of the moment explain each accepted photograph, and whether one contradicts the
    /// others. Empty before the first. Waits for a step of the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn frame_fits(&self) -> Result<Vec<FrameFit>> {
        // Without photographs there is nothing to tell.
        self.fit.ask(|fit| Ok(fit.estimation.residuals().unwrap_or_default()))
    }

    /// What there is to tell about each accepted photograph with all that is known now: hints given when it came
    /// may hold no longer, and others may. Computed when asked for; meaningful once the fit has settled. Empty for
    /// rectified photographs but for contradictions. Waits for a step of the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn hints(&self) -> Result<Vec<Vec<Hint>>> {
        // No photograph may come between what the fit and the record know.
        let _intake = lock(&self.intake);
        let capture = self.capture();
        let (photographs, fits) = self.fit.ask(|fit| {
            let fits = fit.estimation.residuals().unwrap_or_default();
            Ok((fit.observations(), fits))
        })?;
        let maps = self.snapshot().ok();
        let hints = || diagnosis::of_capture(&capture, &photographs, maps.as_deref(), &fits);
        Ok(self.pool.install(hints))
    }

    /// The maps of the moment with the standard deviation of each at every texel. Computed when asked
    /// for; meaningful once the fit has settled. Waits for a step of the fit.
    ///
    /// Deviations are calibrated with photographs of materials whose maps are known: about two errors of
    /// three are within them. A material that is not Cook-Torrance's has no true roughness; its deviations
    /// are those of one that leaves such residuals.
    ///
    /// # Errors
    /// [`Error::NoMaps`] before the first photograph was accepted; when the session has failed or was
    /// cancelled.
    pub fn assess(&self) -> Result<Assessed> {
        let evidence = self.evidence()?;
        let confidence = self.pool.install(|| evidence.confidence())?;
        Ok(Assessed { maps: Arc::new(evidence.into_maps()), confidence })
    }

    /// What those deviations are computed from.
    ///
    /// # Errors
    /// As [`Session::assess`].
    pub fn evidence(&self) -> Result<Evidence> {
        self.fit.ask(|fit| fit.estimation.evidence())
    }

    /// Where the next photograph tells most: the view within reach of a hand, 10 to 50 degrees off the
    /// top, that lowers the expected error of renderings most. Probes refer to it from then on. `None`
    /// before the first photograph, and for rectified ones.
    ///
    /// Waits for a step of the fit. Where the fit has failed or was cancelled, the view whose highlights
    /// reach slopes of the sample that none has swept.
    pub fn next_view(&self) -> Option<NextView> {
        let candidates = self.board(Board::candidates)??;
        match self.fit.ask(move |fit| fit.survey(&candidates, false)) {
            Ok(survey) => survey.best().map(|best| best.view),
            Err(_) => self.board(Board::next_view)?,
        }
    }

    /// What photographs from all round would tell. Waits for nothing: where photographs have come or the
    /// fit has settled since, the fit is asked, and until it has told of all photographs, this is `None`; so
    /// it is for rectified photographs, and where the fit has failed or was cancelled.
    pub fn survey(&self) -> Option<Arc<Survey>> {
        self.fit.shared.usable().ok()?;
        let candidates = self.board(Board::candidates)??;
        let mut state = self.fit.shared.lock();
        let (frames, settled) = (state.progress.frames, state.progress.settled);
        let latest = state.survey.clone().filter(|survey| survey.photographs == frames);
        // What the fit has not taken over yet it cannot tell of.
        if state.fitted == frames && state.surveyed != Some((frames, settled)) {
            state.surveyed = Some((frames, settled));
            drop(state);
            self.fit.send(move |fit| {
                // without an answer the latest stays
                if let Ok(survey) = fit.survey(&candidates, settled) {
                    fit.shared.lock().survey = Some(Arc::new(survey));
                }
                Ok(())
            });
        }
        latest
    }

    /// Judges a photograph of a board, or a picture of a camera's preview, without taking it in: corners,
    /// pose, blur, exposure, view, and what a push would say of a photograph like it, unless it is a
    /// matter of pixels, or of what all photographs tell together.
    ///
    /// A picture of another size than the session's camera is taken for a preview of it: scaled to its
    /// width or height and cut at the other sides. Where that does not fit, and before a camera is
    /// known, the camera is estimated from the picture. Pictures from 1280 px on are reduced first.
    ///
    /// Runs on the calling thread alone and waits neither for the fit nor for a push.
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
        self.fit.shared.usable()?;
        let capture = self.capture();
        let board = capture.board().ok_or_else(|| {
            Error::argument("photo", "a session of rectified photographs has no board to look for")
        })?;
        let (photographs, next) = {
            let state = self.fit.shared.lock();
            (state.progress.frames, state.next)
        };
        self.check_memory(photographs.max(1), memory::while_probed(photo))?;
        Ok(board.judge(photo, lit, next))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Capture;
    use crate::session::{Pushed, Settings};

    fn session() -> (Session, Capture) {
        let dir = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile");
        let capture = Capture::load(dir).unwrap();
        let settings = Settings { sample_mm: capture.sample_mm, threads: 1, ..Settings::default() };
        (Session::new(capture.scene.clone(), settings).unwrap(), capture)
    }

    /// As many photographs as before need not be the same ones.
    #[test]
    fn a_survey_tells_of_the_photographs_there_are() {
        let (session, capture) = session();
        session.pause();
        let push = |i: usize| {
            let pushed = session.push(&capture.frames[i].read().unwrap());
            assert!(matches!(pushed, Ok(Pushed::Accepted(_))), "{pushed:?}");
        };
        // The fit answers what it is asked in turn.
        let surveyed = || {
            session.survey();
            session.frame_fits().unwrap();
            session.survey().unwrap()
        };
        push(0);
        push(1);
        session.frame_fits().unwrap();
        let before = surveyed();
        session.remove_frame(1).unwrap();
        push(4);
        session.frame_fits().unwrap();
        assert!(session.survey().is_none(), "that of a photograph taken back");
        let after = surveyed();
        assert_eq!([before.photographs, after.photographs], [2, 2]);
        assert_ne!(before.views, after.views);
    }

    /// Whoever pushes or saves holds the intake, and a fit the threads: a probe needs neither.
    #[test]
    fn a_probe_waits_for_nobody() {
        let (session, capture) = session();
        let photo = capture.frames[0].read().unwrap();
        assert!(matches!(session.push(&photo), Ok(Pushed::Accepted(_))));
        let (tell, told) = crossbeam_channel::bounded(1);
        let _held = session.intake.lock().unwrap();
        std::thread::scope(|scope| {
            session.pool.install(|| {
                scope.spawn(|| tell.send(session.probe(&photo).map(|p| p.pose.is_some())));
                let probed = told.recv_timeout(std::time::Duration::from_secs(600));
                assert!(matches!(probed, Ok(Ok(true))), "{probed:?}");
            });
        });
    }
}
