//! Where the next photograph tells most.

use std::sync::{Arc, PoisonError};

use crossbeam_channel::{Receiver, TryRecvError, bounded};
use glam::DVec3;

use super::feedback::{self, Candidate, NextView};
use super::worker::Command;
use super::{Pose, Session};
use crate::Result;
use crate::estimate::Place;

/// What photographs from all round would tell, see [`Session::survey`].
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// Accepted photographs that it knows of.
    pub photographs: usize,
    /// Whether the fit had settled on them.
    pub settled: bool,
    /// Views within reach of a hand, in rings of equal tilt, from the top outwards.
    pub views: Vec<SurveyedView>,
    /// Usual distance of the camera from the sample, mm.
    pub distance_mm: f32,
}

/// What a photograph from one place would tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurveyedView {
    /// Where it would be taken from.
    pub view: NextView,
    /// Share of the expected squared error of renderings that it would take away, 0 to 1.
    pub gain: f32,
}

/// Surveys asked for and told.
#[derive(Default)]
pub(super) struct Surveys {
    /// Photographs and whether the fit had settled when the last one was asked for.
    asked: Option<(usize, bool)>,
    pending: Option<Pending>,
    latest: Option<Arc<Survey>>,
}

struct Pending {
    answer: Receiver<Result<Vec<f64>>>,
    candidates: Vec<Candidate>,
    poses: Vec<Pose>,
    settled: bool,
}

impl Pending {
    fn survey(&self, gains: &[f64]) -> Survey {
        let views = self.candidates.iter().zip(gains);
        let views = views
            .map(|(candidate, &gain)| SurveyedView { view: candidate.view, gain: gain as f32 });
        Survey {
            photographs: self.poses.len(),
            settled: self.settled,
            views: views.collect(),
            distance_mm: self.candidates[0].camera_mm.length() as f32,
        }
    }
}

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

impl Survey {
    /// The view that tells most.
    pub fn best(&self) -> Option<&SurveyedView> {
        self.views.iter().max_by(|a, b| a.gain.total_cmp(&b.gain))
    }

    /// What a photograph from a direction would tell: between the views of the rings on both sides of
    /// it; above the first ring towards its mean, outside of the last one as on it.
    pub fn gain(&self, direction: [f32; 3]) -> f32 {
        let d = DVec3::from_array(direction.map(f64::from)).normalize_or(DVec3::Z);
        let tilt = d.z.clamp(-1.0, 1.0).acos().to_degrees() as f32;
        let azimuth = (d.y.atan2(d.x).to_degrees() as f32).rem_euclid(360.0);
        let rings: Vec<&[SurveyedView]> =
            self.views.chunk_by(|a, b| a.view.tilt_deg == b.view.tilt_deg).collect();
        let (Some(first), Some(last)) = (rings.first(), rings.last()) else { return 0.0 };
        let above = rings.iter().rposition(|ring| ring[0].view.tilt_deg <= tilt);
        let Some(above) = above else {
            let mean = first.iter().map(|v| v.gain).sum::<f32>() / first.len() as f32;
            let share = tilt / first[0].view.tilt_deg;
            return mean + share * (on_ring(first, azimuth) - mean);
        };
        let Some(below) = rings.get(above + 1) else { return on_ring(last, azimuth) };
        let [low, high] = [rings[above][0].view.tilt_deg, below[0].view.tilt_deg];
        let share = (tilt - low) / (high - low);
        on_ring(rings[above], azimuth) * (1.0 - share) + on_ring(below, azimuth) * share
    }
}

/// Gain on a ring of views whose sides are evenly spaced from 0 on.
fn on_ring(ring: &[SurveyedView], azimuth_deg: f32) -> f32 {
    let n = ring.len();
    let at = azimuth_deg / 360.0 * n as f32;
    let (left, share) = (at as usize % n, at.fract());
    ring[left].gain * (1.0 - share) + ring[(left + 1) % n].gain * share
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_lie_between_those_of_the_views_around() {
        let view = |tilt_deg: f32, azimuth_deg: f32| {
            let ((s, c), (y, x)) =
                (tilt_deg.to_radians().sin_cos(), azimuth_deg.to_radians().sin_cos());
            NextView { direction: [s * x, s * y, c], tilt_deg, azimuth_deg }
        };
        // Linear in the tilt, and the cosine of the side: at the views, and half way between them.
        let gain = |tilt: f32, azimuth: f32| 0.01 * tilt + 0.1 * azimuth.to_radians().cos();
        let views =
            [10.0, 30.0].into_iter().flat_map(|t| (0..8).map(move |k| (t, 45.0 * k as f32)));
        let views = views.map(|(t, a)| SurveyedView { view: view(t, a), gain: gain(t, a) });
        let survey =
            Survey { photographs: 1, settled: true, views: views.collect(), distance_mm: 300.0 };
        let check = |tilt, azimuth, expected: f32| {
            let found = survey.gain(view(tilt, azimuth).direction);
            assert!((found - expected).abs() < 1e-4, "{tilt} {azimuth}: {found} {expected}");
        };
        check(10.0, 90.0, gain(10.0, 90.0));
        check(30.0, 315.0, gain(30.0, 315.0));
        check(20.0, 180.0, gain(20.0, 180.0));
        check(10.0, 22.5, 0.5 * (gain(10.0, 0.0) + gain(10.0, 45.0)));
        check(30.0, 337.5, 0.5 * (gain(30.0, 315.0) + gain(30.0, 0.0)));
        // From the top: the first ring's mean; outside: as on the last one.
        check(0.0, 0.0, 0.1);
        check(5.0, 180.0, 0.05);
        check(60.0, 0.0, gain(30.0, 0.0));
        let best = survey.best().unwrap().view;
        assert_eq!((best.tilt_deg, best.azimuth_deg), (30.0, 0.0));
    }
}
