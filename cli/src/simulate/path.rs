//! Photographs along the path of a hand: round a circle, or as a guide leads it.

use std::f64::consts::{PI, TAU};
use std::time::Duration;

use clap::ValueEnum;
use glam::{DMat3, DVec3};
use svbrdf::calibration::Target;
use svbrdf::geometry::Pose;
use svbrdf::guide::{Action, Guidance, Guide, GuideOptions};
use svbrdf::photo::{Encoding, Photo};
use svbrdf::random::Random;
use svbrdf::session::{
    self, BoardPose, Budget, Hint, Outcome, Probe, ProbedView, Scene, Session, Settings,
};

use super::scene::{DISTANCE_MM, camera};
use crate::failure::{Failure, Result};

/// How the camera goes from one photograph to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Path {
    /// From above, then once round the sample
    Circle,
    /// As the library's guide leads a hand, picture by picture of a preview
    Guided,
}

/// Pictures of the preview a second.
const RATE: f64 = 30.0;
/// A hand that goes somewhere, mm/s, and how fast it gets there: it slows down as it arrives.
const SPEED: f64 = 150.0;
const ARRIVAL_SECONDS: f64 = 0.4;
/// Trembling of a hand that moves and of one that is held still: standard deviation of its velocity, mm/s,
/// and how long it remembers it, seconds.
const TREMBLING: [f64; 2] = [15.0, 4.0];
const TREMBLING_SECONDS: f64 = 0.2;
/// Nobody goes exactly to the target: standard deviation over the way, and the distance that counts as
/// arrived, mm.
const AIM: f64 = 0.15;
const ARRIVED_MM: f64 = 10.0;
/// Tilt of a person's circle, degrees, and how evenly it is kept.
const CIRCLE_TILT_DEG: [f64; 2] = [30.0, 6.0];
const CIRCLE_SIDE_DEG: f64 = 5.0;
/// Longest way to a photograph, seconds.
const PATIENCE: f64 = 60.0;
/// Views closer than this are the same to a probe, degrees.
const SAME_DEG: f64 = 2.0;

/// Where one photograph was taken, and why there.
pub struct Stop {
    pub pose: Pose,
    /// Time since the beginning, s.
    pub seconds: f64,
    /// Gain that the guide expected of it, and of the best place.
    pub gains: Option<[f32; 2]>,
}

/// A hand with a camera.
struct Hand {
    at: DVec3,
    trembling: DVec3,
    roll: f64,
    random: Random,
    seconds: f64,
}

impl Hand {
    fn new(seed: u64) -> Self {
        let mut random = Random::new(seed ^ 0x4A4D);
        let roll = PI / 2.0 + 0.2 * (random.uniform() - 0.5);
        // Above and a little aside, further away than photographs are.
        let at = DVec3::new(60.0, -90.0, 1.2 * DISTANCE_MM);
        Self { at, trembling: DVec3::ZERO, roll, random, seconds: 0.0 }
    }

    /// Goes on for one picture, towards a place or held still.
    fn step(&mut self, goal: Option<DVec3>) {
        let dt = 1.0 / RATE;
        let sigma = TREMBLING[usize::from(goal.is_none())];
        let keep = (-dt / TREMBLING_SECONDS).exp();
        let mut bell = || self.random.bell();
        let kick = DVec3::new(bell(), bell(), bell()) * sigma * (1.0 - keep * keep).sqrt();
        self.trembling = self.trembling * keep + kick;
        let velocity = goal.map_or(DVec3::ZERO, |goal| {
            ((goal - self.at) / ARRIVAL_SECONDS).clamp_length_max(SPEED)
        });
        self.at += (velocity + self.trembling) * dt;
        self.seconds += dt;
    }

    /// Aimed at the sample's centre, the long side of the picture along that of the board.
    fn pose(&self) -> Pose {
        let forward = -self.at.normalize();
        let right = DVec3::new(self.roll.cos(), self.roll.sin(), 0.0);
        let right = right.reject_from(forward).normalize();
        let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Pose { rotation, translation: -(rotation * self.at) }
    }
}

/// The path of one capture.
pub struct Walk {
    hand: Hand,
    led: Option<Led>,
    frames: u32,
    taken: Vec<DVec3>,
    sample_mm: [f32; 2],
}

/// A hand that is led.
struct Led {
    session: Session,
    guide: Guide,
}

impl Walk {
    /// `flash_mm`: `None` where the session is to find it.
    pub fn new(
        path: Path,
        frames: u32,
        seed: u64,
        sample_mm: [f32; 2],
        target: Target,
        flash_mm: Option<DVec3>,
    ) -> Result<Self> {
        let led = match path {
            Path::Circle => None,
            Path::Guided => {
                let scene = Scene::Board {
                    target,
                    camera: Some(camera()),
                    flash_offset_mm: flash_mm,
                    elevation_mm: None,
                };
                let settings = Settings { sample_mm, ..Settings::default() };
                // All photographs are to be taken.
                let options =
                    GuideOptions { enough: 0.0, most: usize::MAX, ..GuideOptions::default() };
                let session = Session::new(scene, settings)?;
                // As apps do, without waiting for invisible changes.
                session.set_budget(Budget { stop_when_invisible: true, ..Budget::default() })?;
                Some(Led { session, guide: Guide::new(options) })
            }
        };
        Ok(Self { hand: Hand::new(seed), led, frames, taken: Vec::new(), sample_mm })
    }

    /// Goes to where the next photograph is taken.
    pub fn next(&mut self, index: u32) -> Result<Stop> {
        let began = self.hand.seconds;
        let gains = match &mut self.led {
            None => {
                let goal = circle(index, self.frames, &mut self.hand.random);
                while self.hand.at.distance(goal) > ARRIVED_MM
                    && self.hand.seconds < began + PATIENCE
                {
                    self.hand.step(Some(goal));
                }
                None
            }
            Some(led) => Some(led.lead(&mut self.hand, &self.taken, self.sample_mm, began)?),
        };
        self.taken.push(self.hand.at);
        Ok(Stop { pose: self.hand.pose(), seconds: self.hand.seconds, gains: gains.flatten() })
    }

    /// Takes the photograph in and waits for the fit, so that the path depends on the seed alone.
    pub fn taken(&mut self, bytes: &[u8]) -> Result<()> {
        let Some(Led { session, guide }) = &mut self.led else { return Ok(()) };
        match session.add_photo(&Photo::decode(bytes, Encoding::Srgb, 1.0)?)? {
            Outcome::Accepted(_) => session.wait()?,
            Outcome::Rejected(why) => {
                guide.missed();
                eprintln!("rejected: {why}");
            }
        }
        while session.progress().photos > 0 && session.survey().is_none_or(|s| !s.settled) {
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }
}

impl Led {
    fn lead(
        &mut self,
        hand: &mut Hand,
        taken: &[DVec3],
        sample_mm: [f32; 2],
        began: f64,
    ) -> Result<Option<[f32; 2]>> {
        let mut goal: Option<(session::NextView, DVec3)> = None;
        while hand.seconds < began + PATIENCE {
            let probe = probe(&hand.pose(), taken, sample_mm);
            let guidance = self.guide.next(&self.session, &probe, hand.seconds);
            let Guidance { action, target, gain, best_gain, .. } = guidance;
            match (action, target) {
                (Action::Shoot, _) => return Ok(gain.zip(best_gain).map(|(a, b)| [a, b])),
                (Action::Hold, _) | (_, None) => hand.step(None),
                (_, Some(target)) => {
                    // A user who has arrived and is sent on looks again.
                    let arrived = |(view, there): (session::NextView, DVec3)| {
                        view != target.view || hand.at.distance(there) < ARRIVED_MM
                    };
                    if goal.is_none_or(arrived) {
                        let offset = glam::Vec3::from(target.offset_mm).as_dvec3();
                        let there = hand.pose().to_board(offset);
                        let aim = AIM * f64::from(target.degrees).to_radians();
                        let mut bell = || hand.random.bell() * aim * there.length();
                        goal = Some((target.view, there + DVec3::new(bell(), bell(), 0.0)));
                    }
                    hand.step(goal.map(|(_, there)| there));
                }
            }
        }
        Err(Failure::Other("the guide has not asked for a photograph for a minute".into()))
    }
}

/// Place of a photograph of a person's circle.
fn circle(index: u32, frames: u32, random: &mut Random) -> DVec3 {
    let [tilt, spread] = CIRCLE_TILT_DEG;
    let mut about = |middle: f64, sigma: f64| (middle + sigma * random.bell()).to_radians();
    let distance = DISTANCE_MM * about(1.06f64.to_degrees(), 2.0);
    if index == 0 {
        return DVec3::new(about(0.0, 3.0), about(0.0, 3.0), 1.0).normalize() * distance;
    }
    let side = TAU * f64::from(index - 1) / f64::from((frames - 1).max(1));
    let (tilt, side) = (about(tilt, spread), side + about(0.0, CIRCLE_SIDE_DEG));
    DVec3::new(tilt.sin() * side.cos(), tilt.sin() * side.sin(), tilt.cos()) * distance
}

/// The probe that the preview would give for a view, from geometry.
fn probe(pose: &Pose, taken: &[DVec3], sample_mm: [f32; 2]) -> Probe {
    let (eye, camera) = (pose.camera_centre(), camera());
    let direction = eye.normalize();
    let [w, h] = sample_mm.map(|mm| f64::from(mm) / 2.0);
    let corners = [[-w, h], [w, h], [w, -h], [-w, -h]];
    let outline = corners
        .map(|[x, y]| camera.project(pose.transform(DVec3::new(x, y, 0.0))).unwrap_or_default());
    let same = |other: &DVec3| other.angle_between(eye).to_degrees() < SAME_DEG;
    let hints = taken.iter().position(same).map(|index| Hint::NothingNew { index });
    Probe {
        rejection: None,
        hints: hints.into_iter().collect(),
        corners: Vec::new(),
        corners_expected: 0,
        corners_in_view: 0,
        blur_px: None,
        blur_direction_deg: None,
        pose: Some(BoardPose { pose: *pose, reprojection_rms_px: 0.0 }),
        view: Some(ProbedView {
            direction: direction.as_vec3().to_array(),
            distance_mm: eye.length() as f32,
            tilt_deg: direction.z.clamp(-1.0, 1.0).acos().to_degrees() as f32,
            azimuth_deg: direction.y.atan2(direction.x).to_degrees().rem_euclid(360.0) as f32,
            off_next_deg: None,
            sample_seen: 1.0,
            sample_clipped: 0.0,
            sample_px: Some(outline.map(|p| p.as_vec2().to_array())),
            px_per_mm: (camera.fx / eye.length()) as f32,
        }),
        light: None,
    }
}
