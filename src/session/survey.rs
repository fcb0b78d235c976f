//! The most informative view for the next photograph, and the expected information of photographs from
//! all sides.

use glam::{DVec2, DVec3};

use crate::geometry::Pose;
use crate::statistics::median;

/// Largest slope of samples that highlights should reach (tangent of 20 degrees).
const SLOPE_MAX: f64 = 0.36;
/// Points of the sample along each side, and of the disc of slopes along its diameter.
const POINTS: u32 = 5;
const SLOPES: i32 = 9;
/// Proposed views: angles off the vertical in degrees, and number of azimuths at each.
const TILTS: [f64; 5] = [10.0, 20.0, 30.0, 40.0, 50.0];
const AZIMUTHS: u32 = 16;

/// The most informative view for the next photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NextView {
    /// Unit vector from the sample towards the camera, board frame.
    pub direction: [f32; 3],
    /// Angle off the vertical, degrees.
    pub tilt_deg: f32,
    /// Azimuth: degrees counter-clockwise from the sample's +X.
    pub azimuth_deg: f32,
}

/// Expected information of photographs from all sides, see [`Session::survey`](super::Session::survey).
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// Number of accepted photographs that it covers.
    pub photos: usize,
    /// Whether the fit had settled on them.
    pub settled: bool,
    /// Views within reach of a hand, in rings of equal tilt, from the top outwards.
    pub views: Vec<SurveyedView>,
    /// Usual distance of the camera from the sample, mm.
    pub distance_mm: f32,
}

/// Expected information of a photograph from one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurveyedView {
    /// The view from there.
    pub view: NextView,
    /// Share of the expected squared error of renderings that it would remove, 0 to 1.
    pub gain: f32,
}

/// The view whose highlights reach most of the slopes that no photograph has covered.
///
/// A texel is bright if its normal is near the half vector between light and camera. Slopes far from the half
/// vectors of all photographs are dark in each of them, so their gloss is unknown. The proposed view, with the
/// flash beside the lens, has the half vectors that come nearest to most of these slopes.
pub(super) fn next_view(
    views: &[Pose],
    flash_offset_mm: DVec3,
    sample_mm: [f32; 2],
) -> Option<NextView> {
    let half = |camera: DVec3, light: DVec3, p: DVec3| {
        let h = (camera - p).normalize() + (light - p).normalize();
        h.truncate() / h.z.max(1e-3)
    };
    let points = (0..POINTS * POINTS).map(|i| {
        let at = |k: u32| f64::from(k) / f64::from(POINTS - 1) - 0.5;
        let [width, height] = sample_mm.map(f64::from);
        DVec3::new(at(i % POINTS) * width, at(i / POINTS) * height, 0.0)
    });
    let slopes: Vec<DVec2> = (0..SLOPES * SLOPES)
        .map(|i| DVec2::new(f64::from(i % SLOPES), f64::from(i / SLOPES)))
        .map(|s| (s * 2.0 / f64::from(SLOPES - 1) - 1.0) * SLOPE_MAX)
        .filter(|s| s.length() <= SLOPE_MAX * 1.01)
        .collect();
    // Squared distance of each slope at each point from the nearest half vector so far.
    let nearest: Vec<(DVec3, Vec<f64>)> = points
        .map(|p| {
            let of = |v: &Pose| half(v.camera_centre(), v.to_board(flash_offset_mm), p);
            let seen: Vec<DVec2> = views.iter().map(of).collect();
            let least = |s: &DVec2| {
                seen.iter().map(|h| h.distance_squared(*s)).fold(f64::INFINITY, f64::min)
            };
            (p, slopes.iter().map(least).collect())
        })
        .collect();
    let mut best: Option<(f64, NextView)> = None;
    for Candidate { view, camera_mm, light_mm } in candidates(views, flash_offset_mm)? {
        let gain = nearest.iter().map(|(p, nearest)| {
            let h = half(camera_mm, light_mm, *p);
            let closer = |(s, n): (&DVec2, &f64)| (n - h.distance_squared(*s)).max(0.0);
            slopes.iter().zip(nearest).map(closer).sum::<f64>()
        });
        let gain = gain.sum::<f64>();
        if best.is_none_or(|b| gain > b.0 * (1.0 + 1e-9)) {
            best = Some((gain, view));
        }
    }
    best.map(|b| b.1)
}

/// A view that can be proposed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    view: NextView,
    pub(super) camera_mm: DVec3,
    pub(super) light_mm: DVec3,
}

/// Views within reach of a hand, at the median distance of those so far; `None` before the first.
pub(super) fn candidates(views: &[Pose], flash_offset_mm: DVec3) -> Option<Vec<Candidate>> {
    let distance = median(views.iter().map(|v| v.camera_centre().length()))?;
    let candidate = |tilt: f64, azimuth: f64| {
        let (s, c) = tilt.to_radians().sin_cos();
        let (sa, ca) = azimuth.to_radians().sin_cos();
        let direction = DVec3::new(s * ca, s * sa, c);
        let camera_mm = distance * direction;
        // The camera is held upright as seen from its side, with the flash beside the lens.
        let right = DVec3::Z.cross(direction).try_normalize().unwrap_or(DVec3::X);
        let down = -direction.cross(right);
        let light_mm = camera_mm + flash_offset_mm.x * right + flash_offset_mm.y * down;
        let (tilt_deg, azimuth_deg) = (tilt as f32, azimuth as f32);
        let view = NextView { direction: direction.as_vec3().to_array(), tilt_deg, azimuth_deg };
        Candidate { view, camera_mm, light_mm }
    };
    let sides = (0..AZIMUTHS).map(|k| 360.0 * f64::from(k) / f64::from(AZIMUTHS));
    let ring = |tilt| sides.clone().map(move |side| candidate(tilt, side));
    Some(TILTS.into_iter().flat_map(ring).collect())
}

impl Survey {
    /// A survey of candidates, at least one, with the gain of each.
    pub(super) fn new(
        photos: usize,
        settled: bool,
        candidates: &[Candidate],
        gains: &[f64],
    ) -> Self {
        let views = candidates.iter().zip(gains);
        let views = views.map(|(c, &gain)| SurveyedView { view: c.view, gain: gain as f32 });
        let distance_mm = candidates[0].camera_mm.length() as f32;
        Self { photos, settled, views: views.collect(), distance_mm }
    }

    /// The most informative view.
    pub fn best(&self) -> Option<&SurveyedView> {
        self.views.iter().max_by(|a, b| a.gain.total_cmp(&b.gain))
    }

    /// Gain of a photograph from a direction: interpolated between the views around it, above the first ring
    /// towards that ring's mean; outside of the last ring as on it.
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

/// Gain on a ring of views whose azimuths are evenly spaced from 0 on.
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
            Survey { photos: 1, settled: true, views: views.collect(), distance_mm: 300.0 };
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

    fn from(direction: DVec3, distance: f64) -> Pose {
        let z = -direction.normalize();
        let x = DVec3::Y.cross(z).try_normalize().unwrap_or(DVec3::X);
        let rotation = glam::DMat3::from_cols(x, z.cross(x), z).transpose();
        Pose { rotation, translation: DVec3::new(0.0, 0.0, distance) }
    }

    #[test]
    fn views_go_where_none_was_and_round_the_sample() {
        assert_eq!(next_view(&[], DVec3::ZERO, [100.0; 2]), None);
        let mut views = vec![from(DVec3::Z, 250.0)];
        let mut sides = Vec::new();
        for _ in 0..4 {
            let next = next_view(&views, DVec3::ZERO, [100.0; 2]).unwrap();
            let direction = DVec3::from_array(next.direction.map(f64::from));
            let near = |v: &Pose| v.camera_centre().angle_between(direction).to_degrees();
            assert!(views.iter().all(|v| near(v) > 8.0), "{next:?}");
            sides.push(next.azimuth_deg);
            views.push(from(direction, 250.0));
        }
        // The second goes to the other side of the first.
        let apart = (sides[0] - sides[1]).abs();
        assert!((120.0..=240.0).contains(&apart), "{sides:?}");
    }
}
