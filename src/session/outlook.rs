//! Where the next photograph tells most.

use std::sync::{Arc, PoisonError};

use crossbeam_channel::{TryRecvError, bounded};
use glam::DVec3;

use super::feedback::{self, Candidate, NextView};
use super::survey::{Pending, Survey};
use super::worker::Command;
use super::{Pose, Session};
use crate::estimate::Place;

fn places(candidates: &[Candidate]) -> Vec<Place> {
    let place = |candidate: &Candidate| Place {
        camera_mm: candidate.camera_mm.as_vec3().to_array(),
        light_mm: candidate.light_mm.as_vec3().to_array(),
    };
    candidates.iter().map(place).collect()
}

impl Session {
    /// Where the next photograph tells most: the view within reach of a hand, 10 to 50 degrees off the
    /// top, that lowers the expected error of renderings most, by what photographs have left open of
    /// the maps of the moment. `None` before the first photograph, and for rectified ones. Probes
    /// refer to it from then on.
    ///
    /// Waits for a push and a step of the fit. Where the fit has failed or was cancelled, the view whose
    /// highlights reach slopes of the sample that none has swept.
    pub fn next_view(&self) -> Option<NextView> {
        let (views, flash_mm) = {
            let intake = self.intake.lock().unwrap_or_else(PoisonError::into_inner);
            let views: Vec<Pose> = intake.poses().into_iter().map(|p| p.pose).collect();
            (views, intake.flash_offset_mm())
        };
        let candidates = feedback::candidates(&views, flash_mm)?;
        let next = match self.outlook(places(&candidates)) {
            Some(gains) => {
                let best = gains.iter().zip(&candidates).max_by(|a, b| a.0.total_cmp(b.0));
                best.map(|(_, candidate)| candidate.view)
            }
            None => feedback::next_view(&views, flash_mm, self.settings.sample_mm),
        };
        self.propose(&views, next);
        next
    }

    /// What photographs from all round would tell, as of the latest moment that the fit has told.
    /// Waits for nothing: asks the fit, where photographs have come or it has settled since, and answers with
    /// what it told. `None` until it has told of all photographs so far, before the first, for
    /// rectified photographs, and where the fit has failed or was cancelled.
    pub fn survey(&self) -> Option<Arc<Survey>> {
        self.usable().ok()?;
        let (frames, fitted, settled) = {
            let state = self.shared.lock();
            (state.progress.frames, state.fitted, state.progress.settled)
        };
        let mut surveys = self.surveys.lock().unwrap_or_else(PoisonError::into_inner);
        let answer = surveys.pending.as_ref().map(|pending| pending.answer.try_recv());
        match answer {
            None | Some(Err(TryRecvError::Empty)) => {}
            Some(Ok(Ok(gains))) => {
                if let Some(pending) = surveys.pending.take() {
                    let survey = pending.survey(&gains);
                    self.propose(&pending.poses, survey.best().map(|best| best.view));
                    surveys.latest = Some(Arc::new(survey));
                }
            }
            Some(_) => surveys.pending = None,
        }
        // What the fit has not taken over yet it cannot tell of.
        if surveys.pending.is_none() && fitted == frames && surveys.asked != Some((frames, settled))
        {
            surveys.asked = Some((frames, settled));
            surveys.pending = self.request(settled).filter(|pending| pending.poses.len() == frames);
        }
        surveys.latest.clone().filter(|survey| survey.photographs == frames)
    }

    /// Asks the fit for what it will tell between two steps.
    fn request(&self, settled: bool) -> Option<Pending> {
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner).clone()?;
        let flash_mm = known.photometry.as_ref().map_or(DVec3::ZERO, |p| p.flash_offset_mm);
        let candidates = feedback::candidates(&known.poses, flash_mm)?;
        let (reply, answer) = bounded(1);
        self.commands.send(Command::Outlook(places(&candidates), reply)).ok()?;
        Some(Pending { answer, candidates, poses: known.poses.clone(), settled })
    }

    /// Lets probes refer to a view, unless a photograph has come meanwhile.
    fn propose(&self, views: &[Pose], next: Option<NextView>) {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = known.as_mut().filter(|known| known.poses == views) {
            Arc::make_mut(known).next = next;
        }
    }

    /// By how much a photograph from each of some places lowers the expected error; `None` where the
    /// fit does not answer.
    fn outlook(&self, places: Vec<Place>) -> Option<Vec<f64>> {
        self.usable().ok()?;
        let (reply, answer) = bounded(1);
        self.ask(Command::Outlook(places, reply), &answer)?.ok()
    }
}
