//! What photographs from all round would tell.

use std::sync::Arc;

use crossbeam_channel::Receiver;
use glam::DVec3;

use super::advice::{Candidate, NextView};
use crate::Result;
use crate::geometry::Pose;

/// What photographs from all round would tell, see [`Session::survey`](super::Session::survey).
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

/// The survey in progress and the latest result.
#[derive(Default)]
pub(super) struct Surveys {
    /// Photographs and whether the fit had settled when the last one was asked for.
    pub(super) asked: Option<(usize, bool)>,
    pub(super) pending: Option<Pending>,
    pub(super) latest: Option<Arc<Survey>>,
}

pub(super) struct Pending {
    pub(super) answer: Receiver<Result<Vec<f64>>>,
    pub(super) candidates: Vec<Candidate>,
    pub(super) poses: Vec<Pose>,
    pub(super) settled: bool,
}

impl Pending {
    pub(super) fn survey(&self, gains: &[f64]) -> Survey {
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
