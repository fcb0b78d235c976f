//! Queries of a session.

use std::sync::Arc;

use glam::DVec3;

use super::capture::{Board, Capture, Photograph};
use super::fit::Fit;
use super::reports::{BoardPose, MapsWithUncertainty, Probe, Progress, Revision};
use super::survey::{NextView, Survey};
use super::{Hint, Session, deviations, diagnosis, memory};
use crate::assessment::{Evidence, PhotoFit};
use crate::calibration::PaperEstimate;
use crate::calibration::photometry::Photometry;
use crate::estimate::{LightCorrection, PhaseReport};
use crate::geometry::Camera;
use crate::photo::{Photo, ToneCurve};
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

    /// The corrections of light that belong to the current maps: gain of each accepted photograph, exposure over
    /// distance, offset of the flash. There are none if a board determines them, and while they are unknown.
    pub fn light_correction(&self) -> LightCorrection {
        self.fit.shared.lock().light_correction.clone()
    }

    /// The report of each phase of the fit of the photographs so far, in order.
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

    /// The internal error that ended the fit. Every call that needs the fit returns it from then on.
    pub fn failure(&self) -> Option<String> {
        self.fit.shared.lock().failed.clone()
    }

    /// Counters of changes of state and maps.
    pub fn revision(&self) -> Revision {
        self.fit.shared.lock().revision
    }

    /// The camera in use: given, or estimated from the photographs so far. `None` for rectified
    /// photographs, and while it is unknown.
    pub fn camera(&self) -> Option<Camera> {
        self.board(Board::camera)?
    }

    /// Standard deviations of fx, fy, cx, cy (px), k1, k2, p1, p2, k3 of an estimated camera.
    pub fn camera_sigma(&self) -> Option<[f64; 9]> {
        self.board(|board| board.estimate.as_ref().map(|e| e.sigma()))?
    }

    /// Stretch and bow of the printed board in use: none unless two photographs or more clearly show some.
    /// `None` for rectified photographs.
    pub fn paper(&self) -> Option<PaperEstimate> {
        self.board(|board| board.paper)
    }

    /// Height of the sample's surface above the board in use: that of the scene if it states one, otherwise 0 unless
    /// two photographs or more clearly show another. `None` for rectified photographs.
    pub fn elevation(&self) -> Option<ElevationEstimate> {
        self.board(|board| board.elevation)
    }

    /// Latest estimates of the poses of the accepted photographs. Empty for rectified photographs.
    pub fn poses(&self) -> Vec<BoardPose> {
        let pose = |p: &Photograph| BoardPose { pose: p.pose, reprojection_rms_px: p.rms_px };
        self.board(|board| board.photographs.iter().map(pose).collect()).unwrap_or_default()
    }

    /// Flash position in use, in the camera frame, mm.
    pub fn flash_offset_mm(&self) -> DVec3 {
        self.board(Board::flash_offset_mm).unwrap_or_default()
    }

    /// Ambient irradiance as a share of the flash's at the sample's centre, facing the flash at the
    /// first photograph's distance.
    pub fn ambient_fraction(&self) -> f32 {
        let mean = |light: &Photometry| (light.ambient.iter().sum::<f64>() / 3.0) as f32;
        self.board(|board| board.photometry.as_ref().map(mean)).flatten().unwrap_or_default()
    }

    /// The inverse of the camera's tone curve. It is the identity for rectified photographs, and as long as
    /// values seem linear.
    pub fn tone_curve(&self) -> ToneCurve {
        let tone = |light: &Photometry| light.tone;
        self.board(|board| board.photometry.as_ref().map(tone)).flatten().unwrap_or_default()
    }

    /// The fit of the current maps to each accepted photograph, and whether it contradicts the
    /// others. Empty before the first. Waits for a step of the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn photo_fits(&self) -> Result<Vec<PhotoFit>> {
        // Without photographs there are no residuals.
        self.fit.ask(|fit| Ok(fit.estimation.residuals().unwrap_or_default()))
    }

    /// Hints about each accepted photograph from all present knowledge: hints given when it was added may no
    /// longer hold, and others may. Computed by the call; meaningful once the fit has settled. For rectified
    /// photographs only contradictions are reported. Waits for a step of the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn hints(&self) -> Result<Vec<Vec<Hint>>> {
        let (capture, (photographs, maps, fits)) = self.with_fit(|fit| {
            // Without photographs there are no residuals.
            let fits = fit.estimation.residuals().unwrap_or_default();
            let maps = fit.shared.lock().maps.clone();
            Ok((fit.observations(), maps, fits))
        })?;
        let hints = || diagnosis::of_capture(&capture, &photographs, maps.as_deref(), &fits);
        Ok(self.pool.install(hints))
    }

    /// The record, and an answer of the fit about the same photographs. Waits for a photograph that is being added, and
    /// for a step of the fit.
    fn with_fit<T: Send + 'static>(
        &self,
        question: impl FnOnce(&mut Fit) -> Result<T> + Send + 'static,
    ) -> Result<(Arc<Capture>, T)> {
        let _intake = lock(&self.intake);
        let capture = self.capture();
        Ok((capture, self.fit.ask(question)?))
    }

    /// The current maps with the standard deviation of each at every texel. Computed by the call;
    /// meaningful once the fit has settled. Waits for a step of the fit.
    ///
    /// Deviations are calibrated with photographs of materials whose maps are known: about two errors of
    /// three are within them. A material that does not follow the Cook-Torrance model has no true roughness; its
    /// deviations are those of a material with such residuals. If all highlights of a material are saturated, the
    /// deviations of specular albedo and roughness cover all values that the tails of the highlights allow. If
    /// photographs show highlights that the maps do not explain, they cover the difference. If the height of
    /// the sample is unknown, those of the albedos cover its effect.
    ///
    /// # Errors
    /// [`Error::NoMaps`] before the first photograph was accepted; when the session has failed or was
    /// cancelled.
    pub fn snapshot_with_uncertainty(&self) -> Result<MapsWithUncertainty> {
        let (capture, (photographs, evidence)) =
            self.with_fit(|fit| Ok((fit.observations(), fit.estimation.evidence()?)))?;
        let uncertainty = || deviations::of_maps(&evidence, &capture, &photographs);
        let uncertainty = self.pool.install(uncertainty)?;
        Ok(MapsWithUncertainty { maps: Arc::new(evidence.into_maps()), uncertainty })
    }

    /// The class of colour of each texel of the maps, row by row. A class shares its gloss; 0 is the class of most
    /// texels. Empty with one photograph and without refinement. Waits for a step of the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn classes(&self) -> Result<Vec<u8>> {
        self.fit.ask(|fit| Ok(fit.estimation.classes()))
    }

    /// The inputs of those deviations, for evaluation.
    ///
    /// # Errors
    /// As [`Session::snapshot_with_uncertainty`].
    #[doc(hidden)]
    pub fn evidence(&self) -> Result<Evidence> {
        self.fit.ask(|fit| fit.estimation.evidence())
    }

    /// The most informative view for the next photograph: of the views within reach of a hand, 10 to 50
    /// degrees off the vertical, the one that lowers the expected error of renderings most. Later probes
    /// refer to it. `None` before the first photograph, and for rectified ones.
    ///
    /// Waits for a step of the fit. If the fit has failed or was cancelled, the result is the view whose
    /// highlights reach slopes of the sample that no photograph has covered.
    pub fn next_view(&self) -> Option<NextView> {
        let candidates = self.board(Board::candidates)??;
        match self.fit.ask(move |fit| fit.survey(&candidates, false)) {
            Ok(survey) => survey.best().map(|best| best.view),
            Err(_) => self.board(Board::next_view)?,
        }
    }

    /// Expected information of photographs from all sides. Does not wait: when photographs were added or the
    /// fit has settled, it asks the fit for a new survey and returns `None` until that covers all
    /// photographs. Also `None` for rectified photographs, and when the fit has failed or was cancelled.
    pub fn survey(&self) -> Option<Arc<Survey>> {
        self.fit.shared.usable().ok()?;
        let candidates = self.board(Board::candidates)??;
        let mut state = self.fit.shared.lock();
        let (photos, settled) = (state.progress.photos, state.progress.settled);
        let latest = state.survey.clone().filter(|survey| survey.photos == photos);
        // The fit can survey only the photographs that it has received.
        if state.fitted == photos && state.surveyed != Some((photos, settled)) {
            state.surveyed = Some((photos, settled));
            drop(state);
            self.fit.send(move |fit| {
                // On an error the latest survey stays.
                if let Ok(survey) = fit.survey(&candidates, settled) {
                    fit.shared.lock().survey = Some(Arc::new(survey));
                }
                Ok(())
            });
        }
        latest
    }

    /// Judges a photograph of a board, or an image of a camera's preview, without adding it: corners, pose,
    /// blur, exposure, view, and the outcome that `add_photo` would have for such a photograph. Faults that
    /// only the full resolution or all photographs together show are not found.
    ///
    /// An image of another size than the session's camera counts as a preview of it, scaled to its width or
    /// height and cropped at the other sides. If that does not fit, and before a camera is known, the camera
    /// is estimated from the image. Images of 1280 px or more are reduced first.
    ///
    /// Runs only on the calling thread and waits neither for the fit nor for a photograph that is being added.
    ///
    /// # Errors
    /// On misuse, when the session has failed or was cancelled, and when the memory limit is reached.
    pub fn probe(&self, photo: &Photo) -> Result<Probe> {
        self.judge(photo, true)
    }

    /// As [`Session::probe`] for an image without the flash: its light is not judged, because it says
    /// nothing about the photograph to come.
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
            (state.progress.photos, state.next)
        };
        self.check_memory(photographs.max(1), memory::while_probed(photo))?;
        Ok(board.judge(photo, lit, next))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Capture;
    use crate::session::{Outcome, Settings};

    fn session() -> (Session, Capture) {
        let dir = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile");
        let capture = Capture::load(dir).unwrap();
        let settings = Settings { sample_mm: capture.sample_mm, threads: 1, ..Settings::default() };
        (Session::new(capture.scene.clone(), settings).unwrap(), capture)
    }

    /// The same number of photographs need not mean the same photographs.
    #[test]
    fn a_survey_tells_of_the_photographs_there_are() {
        let (session, capture) = session();
        session.pause();
        let add = |i: usize| {
            let outcome = session.add_photo(&capture.photos[i].read().unwrap());
            assert!(matches!(outcome, Ok(Outcome::Accepted(_))), "{outcome:?}");
        };
        // The fit answers questions in order.
        let surveyed = || {
            session.survey();
            session.photo_fits().unwrap();
            session.survey().unwrap()
        };
        add(0);
        add(1);
        session.photo_fits().unwrap();
        let before = surveyed();
        session.remove_photo(1).unwrap();
        add(4);
        session.photo_fits().unwrap();
        assert!(session.survey().is_none(), "that of a photograph taken back");
        let after = surveyed();
        assert_eq!([before.photos, after.photos], [2, 2]);
        assert_ne!(before.views, after.views);
    }

    /// A caller that adds a photograph or saves holds the intake, and a fit the threads: a probe needs neither.
    #[test]
    fn a_probe_waits_for_nobody() {
        let (session, capture) = session();
        let photo = capture.photos[0].read().unwrap();
        assert!(matches!(session.add_photo(&photo), Ok(Outcome::Accepted(_))));
        let (sender, receiver) = crossbeam_channel::bounded(1);
        let _held = session.intake.lock().unwrap();
        std::thread::scope(|scope| {
            session.pool.install(|| {
                scope.spawn(|| sender.send(session.probe(&photo).map(|p| p.pose.is_some())));
                let probed = receiver.recv_timeout(std::time::Duration::from_secs(600));
                assert!(matches!(probed, Ok(Ok(true))), "{probed:?}");
            });
        });
    }
}
