//! Guides the user of a camera: for each preview picture, the answer is hold, move, shoot or enough.

mod motion;
mod options;

use std::sync::Arc;

use self::motion::Motion;
pub use self::options::GuideOptions;
use crate::Rejection;
use crate::session::{Hint, NextView, Probe, ProbedView, Session, Survey};

/// Instruction for the user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Correct the fault in [`Guidance::rejection`]: a photograph would be rejected.
    Adjust,
    /// Keep the camera still, until it is steady or a photograph has been processed.
    Hold,
    /// Move to [`Guidance::target`].
    Move,
    /// Take the photograph now.
    Shoot,
    /// Stop: another photograph would add little information.
    Enough,
}

/// Answer of a [`Guide`] to a preview picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Guidance {
    /// Instruction.
    pub action: Action,
    /// Reason why a photograph like the picture would be rejected.
    pub rejection: Option<Rejection>,
    /// Position to move to; `None` if the camera's position or the target is unknown.
    pub target: Option<Target>,
    /// Share of the expected squared rendering error that a photograph from here would remove, 0 to
    /// 1; `None` before the first photograph and during the computation.
    pub gain: Option<f32>,
    /// The same for the most informative view.
    pub best_gain: Option<f32>,
    /// Number of accepted photographs.
    pub photos: usize,
    /// Text for the user, in English.
    pub message: String,
}

/// A position to photograph from, relative to the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// The view.
    pub view: NextView,
    /// Vector from the camera to the position, camera frame, mm: x right, y down, z forward. An
    /// arrow along x and y in the picture shows the way.
    pub offset_mm: [f32; 3],
    /// Angle between both views at the sample, degrees.
    pub degrees: f32,
}

/// Share of the best gain from which a view counts as equally good. The nearest of these is the target.
const AS_GOOD: f32 = 0.95;

/// Guides one capture. Use it from one thread at a time.
#[derive(Debug, Clone, Default)]
pub struct Guide {
    options: GuideOptions,
    motion: Motion,
    /// Time of the latest [`Action::Shoot`], and the number of photographs at that time.
    shot: Option<(f64, usize)>,
    /// The target, and the survey it comes from.
    target: Option<(NextView, Arc<Survey>)>,
}

/// Desired next photograph.
struct Wanted {
    view: NextView,
    distance_mm: f32,
    here: Option<f32>,
    best: Option<f32>,
    /// Whether a photograph from here is worth taking.
    worth: bool,
}

impl Guide {
    /// A guide with custom options.
    pub fn new(options: GuideOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// The instruction for a probe of the latest preview picture and the present state of the fit.
    /// `seconds` is the time of the picture by a monotonic clock. Does not block.
    ///
    /// After [`Action::Shoot`] the answer is [`Action::Hold`] until the photograph has been added
    /// or [`GuideOptions::shot_seconds`] have passed; [`Guide::missed`] ends that immediately.
    pub fn next(&mut self, session: &Session, probe: &Probe, seconds: f64) -> Guidance {
        let photos = session.progress().photos;
        self.decide(session.survey(), photos, probe, seconds)
    }

    /// Reports that the requested photograph was not taken, or was rejected.
    pub fn missed(&mut self) {
        self.shot = None;
    }

    fn decide(
        &mut self,
        survey: Option<Arc<Survey>>,
        photos: usize,
        probe: &Probe,
        seconds: f64,
    ) -> Guidance {
        self.motion.see(probe, seconds, &self.options);
        let steady = self.motion.is_steady(seconds, &self.options);
        let mut guidance = Guidance {
            action: Action::Hold,
            rejection: probe.rejection,
            target: None,
            gain: None,
            best_gain: survey.as_ref().and_then(|s| s.best()).map(|best| best.gain),
            photos,
            message: String::new(),
        };
        if self.is_enough(survey.as_deref(), photos) {
            return guidance.say(Action::Enough, "Enough: further photographs would tell little");
        }
        let waiting = self.shot.is_some_and(|(at, before)| {
            photos == before && (0.0..self.options.shot_seconds).contains(&(seconds - at))
        });
        if waiting {
            return guidance.say(Action::Hold, "Hold still: the photograph is being taken");
        }
        self.shot = None;
        let wanted = probe.view.as_ref().and_then(|view| self.wanted(survey, photos, view));
        if let Some(wanted) = &wanted {
            (guidance.gain, guidance.best_gain) = (wanted.here, wanted.best);
            guidance.target = target(probe, wanted);
        }
        if let Some(rejection) = probe.rejection {
            let action = match rejection {
                Rejection::Blurred { .. } => Action::Hold,
                _ => Action::Adjust,
            };
            return guidance.say(action, &sentence(&rejection));
        }
        let seen_before = probe.hints.iter().any(|h| matches!(h, Hint::NothingNew { .. }));
        match wanted {
            None => guidance.say(Action::Hold, "Hold still"),
            Some(wanted) if !wanted.worth || seen_before => {
                let way = words(&wanted, photos);
                guidance.say(Action::Move, &way)
            }
            Some(_) if !steady => guidance.say(Action::Hold, "Good: hold still"),
            Some(_) => {
                self.shot = Some((seconds, photos));
                guidance.say(Action::Shoot, "Taking the photograph")
            }
        }
    }

    fn is_enough(&self, survey: Option<&Survey>, photos: usize) -> bool {
        let surveyed = survey.filter(|s| s.settled).and_then(Survey::best);
        photos >= self.options.most
            || photos >= self.options.least
                && surveyed.is_some_and(|best| best.gain < self.options.enough)
    }

    /// `None` until the fit has computed the gains of views.
    fn wanted(
        &mut self,
        survey: Option<Arc<Survey>>,
        photos: usize,
        view: &ProbedView,
    ) -> Option<Wanted> {
        if photos == 0 {
            let top = NextView { direction: [0.0, 0.0, 1.0], tilt_deg: 0.0, azimuth_deg: 0.0 };
            let worth = view.tilt_deg <= self.options.first_tilt_deg;
            let distance_mm = view.distance_mm;
            return Some(Wanted { view: top, distance_mm, here: None, best: None, worth });
        }
        let survey = survey?;
        let best = survey.best()?.gain;
        let here = survey.gain(view.direction);
        let known = self.target.as_ref().filter(|(_, of)| Arc::ptr_eq(of, &survey));
        let chosen = match known {
            Some((chosen, _)) => *chosen,
            None => {
                let good = survey.views.iter().filter(|v| v.gain >= AS_GOOD * best);
                let off = |v: &NextView| degrees(v.direction, view.direction);
                good.map(|v| v.view).min_by(|a, b| off(a).total_cmp(&off(b)))?
            }
        };
        let distance_mm = survey.distance_mm;
        self.target = Some((chosen, survey));
        let worth = here >= self.options.worth * best;
        Some(Wanted { view: chosen, distance_mm, here: Some(here), best: Some(best), worth })
    }
}

impl Guidance {
    fn say(mut self, action: Action, message: &str) -> Self {
        (self.action, self.message) = (action, message.into());
        self
    }
}

/// The target relative to the camera.
fn target(probe: &Probe, wanted: &Wanted) -> Option<Target> {
    let (pose, view) = (probe.pose?.pose, probe.view?);
    let at = wanted.view.direction.map(|v| f64::from(v * wanted.distance_mm));
    Some(Target {
        view: wanted.view,
        offset_mm: pose.transform(at.into()).as_vec3().to_array(),
        degrees: degrees(wanted.view.direction, view.direction),
    })
}

/// Angle between two unit vectors, degrees.
fn degrees(a: [f32; 3], b: [f32; 3]) -> f32 {
    let dot = a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    dot.clamp(-1.0, 1.0).acos().to_degrees()
}

fn words(wanted: &Wanted, photos: usize) -> String {
    if photos == 0 {
        return "Go above the sample".into();
    }
    let NextView { tilt_deg, azimuth_deg, .. } = wanted.view;
    let sides =
        ["right", "far right", "far", "far left", "left", "near left", "near", "near right"];
    let side = sides[(azimuth_deg / 45.0).round() as usize % sides.len()];
    format!("Go to the {side} side, {tilt_deg:.0} degrees off the top")
}

/// Capitalises the text of a rejection.
fn sentence(rejection: &Rejection) -> String {
    let text = rejection.to_string();
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |c| c.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests;
