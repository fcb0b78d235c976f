//! An accepted photograph of a board: its measurements, and its rectification.
//!
//! The record ([`Photograph`]) decides how a photograph is to be rectified ([`Wanted`]); the fit rectifies it and
//! owns the result ([`Rectified`]).

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::Rejection;
use crate::calibration::photometry::{Radiometry, Squares};
use crate::calibration::{CameraPrior, Corner};
use crate::geometry::{Camera, Pose};
use crate::observation::{Observation, View};
use crate::photo::{Photo, Surround};
use crate::rectification::elevation::Detail;
use crate::rectification::{self, Part, TopView};
use crate::session::reports::BoardPose;

/// A new estimate that moves the sample by no more than this keeps the rectified photograph, px.
const MOVED_PX: f64 = 0.03;
/// The same for the camera's position, relative to its distance.
const MOVED_SHARE: f64 = 3e-4;

/// The estimates that a photograph is rectified with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Conditions {
    pub camera: Camera,
    pub pose: Pose,
    pub radiometry: Radiometry,
    /// Height of the sample above the board, mm.
    pub elevation_mm: f64,
    /// Reach of the sample's surroundings, see [`TopView::edge_px`].
    pub edge_px: f32,
}

impl Conditions {
    /// `latest` if the pixels are kept and the sample has moved or the response has changed; otherwise these
    /// conditions with the light of `latest`, which needs no pixels.
    pub(super) fn improved(&self, latest: &Self, kept: bool, sample_mm: [f32; 2]) -> Self {
        if kept
            && (self.radiometry.reads_otherwise(&latest.radiometry)
                || self.moves(latest, sample_mm))
        {
            *latest
        } else {
            Self { radiometry: latest.radiometry, ..*self }
        }
    }

    /// Whether the sample or the camera is elsewhere with `new`.
    pub(super) fn moves(&self, new: &Self, sample_mm: [f32; 2]) -> bool {
        let (from, to) = (self.pose.camera_centre(), new.pose.camera_centre());
        if from.distance(to) > MOVED_SHARE * to.length() {
            return true;
        }
        let (then, now) = (marks(sample_mm, self.elevation_mm), marks(sample_mm, new.elevation_mm));
        then.into_iter().zip(now).any(|(then, now)| {
            let then = self.camera.project(self.pose.transform(then));
            let now = new.camera.project(new.pose.transform(now));
            !matches!((then, now), (Some(a), Some(b)) if a.distance(b) <= MOVED_PX)
        })
    }

    fn same_geometry(&self, other: &Self) -> bool {
        (self.camera, self.pose, self.elevation_mm)
            == (other.camera, other.pose, other.elevation_mm)
    }
}

/// Measurements in a photograph, made when it was added.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Measured {
    pub corners: Vec<Corner>,
    pub prior: CameraPrior,
    pub squares: Squares,
}

/// A photograph's details, and the camera and pose that they were found with.
#[derive(Debug)]
pub(super) struct Details {
    pub(super) camera: Camera,
    pub(super) pose: Pose,
    /// `None` if the photograph shows too little of the sample.
    pub(super) detail: Option<Detail>,
}

impl Details {
    pub(super) fn new(part: &Part, camera: Camera, pose: Pose, sample_mm: [f32; 2]) -> Arc<Self> {
        let detail = Detail::new(&part.photo, &part.camera(&camera), &pose, sample_mm);
        Arc::new(Self { camera, pose, detail })
    }
}

/// An accepted photograph.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Photograph {
    pub measured: Measured,
    /// The latest estimate.
    pub pose: Pose,
    /// Reprojection error of the corners, px.
    pub rms_px: f64,
    /// The pixels around the sample, kept until camera, paper and height are settled.
    #[serde(serialize_with = "write_part", deserialize_with = "read_part")]
    pub part: Option<Arc<Part>>,
    /// Found in `part` when needed.
    #[serde(skip)]
    pub(super) details: Option<Arc<Details>>,
    /// The estimates to rectify it with.
    pub conditions: Conditions,
}

/// Instructions for the fit to rectify a photograph.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // there are as many as photographs, for a moment
pub enum Wanted {
    /// A photograph of a board.
    Board {
        conditions: Conditions,
        /// The pixels, if they are kept. Without them only the light can change.
        part: Option<Arc<Part>>,
    },
    /// A photograph that was added rectified, with its view.
    Given(View),
}

/// A rectified photograph and the conditions that it was made with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rectified {
    /// `None` for a photograph that was added rectified.
    pub conditions: Option<Conditions>,
    pub observation: Observation,
}

/// A new photograph, and its effect on the earlier ones.
pub struct Taken {
    pub rectified: Rectified,
    /// `None` for a photograph that was added rectified.
    pub pose: Option<BoardPose>,
    /// Instructions for the earlier photographs.
    pub earlier: Vec<Wanted>,
    /// Whether the sample has moved too far in them for the current maps to be a start.
    pub restart: bool,
}

fn write_part<S: Serializer>(part: &Option<Arc<Part>>, to: S) -> Result<S::Ok, S::Error> {
    part.as_deref().serialize(to)
}

fn read_part<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Arc<Part>>, D::Error> {
    Ok(Option::deserialize(from)?.map(Arc::new))
}

/// Data to remove a veil from a part of a photograph: the surround of the whole photograph, and the position
/// of the part's first pixel in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Veiled<'a> {
    pub surround: &'a Surround,
    pub corner: [u32; 2],
}

impl Photograph {
    /// Instructions to rectify it.
    pub fn wanted(&self) -> Wanted {
        Wanted::Board { conditions: self.conditions, part: self.part.clone() }
    }
}

impl Rectified {
    /// Rectifies a photograph that `camera` took, or a part of one.
    ///
    /// # Errors
    /// As [`rectification::rectify_raised`].
    pub(super) fn new(
        conditions: Conditions,
        photo: &Photo,
        veiled: Veiled,
        camera: &Camera,
        sample_mm: [f32; 2],
        [width, height]: [usize; 2],
    ) -> Result<Self, Rejection> {
        let Conditions { pose, radiometry, elevation_mm, edge_px, .. } = &conditions;
        let (height_mm, edge_px) = (*elevation_mm as f32, *edge_px);
        let top = TopView { sample_mm, height_mm, width, height, edge_px };
        let clear = (radiometry.veil > 0.0)
            .then(|| photo.without_veil(radiometry.veil as f32, veiled.surround, veiled.corner));
        let photo = clear.as_ref().unwrap_or(photo);
        let observation = rectification::rectify_raised(photo, camera, pose, radiometry, top)?;
        Ok(Self { conditions: Some(conditions), observation })
    }

    /// Rectifies a photograph from the part that is kept.
    ///
    /// # Errors
    /// As [`Rectified::new`].
    pub fn of_part(
        conditions: Conditions,
        part: &Part,
        sample_mm: [f32; 2],
        size: [usize; 2],
    ) -> Result<Self, Rejection> {
        let veiled = Veiled { surround: &part.surround, corner: part.corner };
        let camera = part.camera(&conditions.camera);
        Self::new(conditions, &part.photo, veiled, &camera, sample_mm, size)
    }

    /// Rectifies it as `wanted`: from the pixels if the geometry or the response has changed or `from_pixels` is
    /// set, otherwise by scaling with the change of the light. Returns whether anything changed.
    ///
    /// # Errors
    /// The rejection of the photograph under the new conditions; nothing has changed then.
    pub fn remake(&mut self, wanted: &Wanted, from_pixels: bool) -> Result<bool, Rejection> {
        let (wanted, part, made) = match (wanted, &self.conditions) {
            (Wanted::Board { conditions, part: Some(part) }, Some(made)) => {
                (*conditions, Some(part), *made)
            }
            (Wanted::Board { conditions, part: None }, Some(made)) => {
                (Conditions { radiometry: conditions.radiometry, ..*made }, None, *made)
            }
            (Wanted::Given(view), _) => {
                let old = std::mem::replace(&mut self.observation.view, *view);
                return Ok(old != *view);
            }
            // A photograph of a board has conditions.
            (Wanted::Board { .. }, None) => return Ok(false),
        };
        if made == wanted {
            return Ok(false);
        }
        let otherwise = made.radiometry.reads_otherwise(&wanted.radiometry);
        match part {
            Some(part) if from_pixels || otherwise || !made.same_geometry(&wanted) => {
                let size = [self.observation.width(), self.observation.height()];
                *self = Self::of_part(wanted, part, self.observation.view.sample_mm, size)?;
            }
            _ => {
                let Conditions { camera, pose, radiometry, elevation_mm, .. } = &made;
                let (to, height_mm) = (&mut self.observation, *elevation_mm as f32);
                let new = &wanted.radiometry;
                rectification::update_radiometry(to, camera, pose, height_mm, radiometry, new);
                self.conditions = Some(wanted);
            }
        }
        Ok(true)
    }
}

/// Centre and corners of the sample at a height, board frame, mm.
fn marks(sample_mm: [f32; 2], height_mm: f64) -> [DVec3; 5] {
    [(0.0, 0.0), (-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)].map(|(x, y)| {
        DVec3::new(x * f64::from(sample_mm[0]), y * f64::from(sample_mm[1]), height_mm)
    })
}

/// Largest displacement of a point of the sample in the board's plane per unit of height.
pub(super) fn steepest(pose: &Pose, sample_mm: [f32; 2]) -> f64 {
    let eye = pose.camera_centre();
    let slope = |p: DVec3| (eye - p).truncate().length() / eye.z;
    marks(sample_mm, 0.0).into_iter().map(slope).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    use crate::calibration::photometry::tests::{camera, photograph, pose};
    use crate::calibration::photometry::{Lobe, Vignetting};
    use crate::photo::ToneCurve;
    use crate::rectification::elevation;

    const SAMPLE_MM: [f32; 2] = [100.0, 80.0];

    fn radiometry(gain: f64) -> Radiometry {
        Radiometry {
            gain: [gain; 3],
            tone: ToneCurve::default(),
            veil: 0.0,
            vignetting: Vignetting { exponent: 2.0, curvature: 0.5 },
            lobe: Lobe { exponent: 1.5, pattern: [-0.2, 0.1] },
            flash_offset_mm: DVec3::new(5.0, 2.0, 0.0),
            power_mm2: [2e5; 3],
            ambient: [0.0; 3],
            log_sigma: 0.0,
        }
    }

    fn conditions(camera: Camera, gain: f64) -> Conditions {
        let (pose, radiometry) = (pose(0.4, 0.1, -0.2, 300.0), radiometry(gain));
        Conditions { camera, pose, radiometry, elevation_mm: 0.0, edge_px: 0.0 }
    }

    fn picture() -> Photo {
        let (camera, pose) = (camera(), pose(0.4, 0.1, -0.2, 300.0));
        let texture = |p: DVec2, _| [0.5 + 0.3 * (p.x * 0.2).sin(), 0.5, 0.4 + 0.2 * p.y.cos()];
        let rgb = photograph(&camera, &pose, 2, texture);
        Photo::from_linear(camera.width, camera.height, rgb, 1.0, 10.0).unwrap()
    }

    fn made(conditions: Conditions) -> Result<Rectified, Rejection> {
        let (photo, camera) = (picture(), conditions.camera);
        let veiled = Veiled { surround: &Surround::of(&photo), corner: [0; 2] };
        Rectified::new(conditions, &photo, veiled, &camera, SAMPLE_MM, [64; 2])
    }

    /// A photograph accepted with these conditions, its part kept.
    fn accepted(conditions: Conditions) -> (Photograph, Rectified) {
        let Conditions { camera, pose, .. } = &conditions;
        let part = Part::new(&picture(), camera, pose, SAMPLE_MM, elevation::RANGE_MM);
        let squares = Squares {
            squares: Vec::new(),
            gray: None,
            patches: None,
            exposure: 1.0,
            clipped_share: 0.0,
            void_share: 0.0,
            uneven: Vec::new(),
            clipped: Vec::new(),
        };
        let prior = CameraPrior::around(*camera);
        let measured = Measured { corners: Vec::new(), prior, squares };
        let (part, pose, rms_px, details) = (Some(Arc::new(part)), *pose, 0.1, None);
        let photograph = Photograph { measured, pose, rms_px, part, details, conditions };
        (photograph, made(conditions).unwrap())
    }

    /// Applies better conditions to a photograph: whether they change the rectified one, or the rejection.
    fn improve(
        (photograph, rectified): &mut (Photograph, Rectified),
        latest: &Conditions,
    ) -> Result<bool, Rejection> {
        photograph.conditions = photograph.conditions.improved(latest, true, SAMPLE_MM);
        rectified.remake(&photograph.wanted(), false)
    }

    /// Compares with a rectification of the whole photograph.
    fn assert_rectified(rectified: &Rectified, conditions: &Conditions) {
        assert_eq!(rectified.conditions.as_ref(), Some(conditions));
        let whole = made(*conditions);
        assert_close(&rectified.observation, &whole.unwrap().observation);
    }

    fn assert_close(a: &Observation, b: &Observation) {
        assert_eq!(a.view, b.view);
        let ((a, a_weight), (b, b_weight)) = (a.planes(), b.planes());
        assert_eq!(a_weight, b_weight);
        for (a, b) in a.iter().zip(&b) {
            // Tables of the response have other steps, positions other roundings: 1e-4 px times
            // the texture's slope; and half floats', 0.1 % each.
            assert!((a - b).abs() < 2e-4 + a.abs() / 500.0, "{a} {b}");
        }
    }

    /// The kept part gives the same as the whole photograph with the new camera and pose.
    #[test]
    fn the_part_kept_is_rectified_like_the_whole() {
        // The first guess is a little off.
        let guess = Camera { fx: 480.0, fy: 480.0, distortion: [0.0; 5], ..camera() };
        let mut both = accepted(conditions(guess, 1.0));
        let pixels = |photo: &Photo| f64::from(photo.width() * photo.height());
        let share = pixels(&both.0.part.as_ref().unwrap().photo) / pixels(&picture());
        assert!(share < 0.35, "{share}");
        let better = conditions(camera(), 1.3);
        assert_eq!(improve(&mut both, &better), Ok(true));
        assert_rectified(&both.1, &better);
        assert_eq!(improve(&mut both, &better), Ok(false), "nothing is left to do");
        // Without the part only the light can change.
        let elsewhere = Conditions { pose: pose(0.3, 0.1, -0.2, 300.0), ..conditions(guess, 1.5) };
        let wanted = Wanted::Board { conditions: elsewhere, part: None };
        assert_eq!(both.1.remake(&wanted, false), Ok(true));
        assert_rectified(&both.1, &Conditions { radiometry: elsewhere.radiometry, ..better });
    }

    /// Conditions and observation change together or not at all: a change after a rejection starts from the
    /// conditions of the observation.
    #[test]
    fn a_photograph_that_cannot_be_rectified_anew_stays_as_it_was() {
        let before = conditions(camera(), 1.0);
        let mut both = accepted(before);
        let unchanged = both.1.clone();
        // The kept part does not contain the sample from there.
        let aside = DVec3::new(400.0, 0.0, 0.0);
        let elsewhere = Pose { translation: before.pose.translation + aside, ..before.pose };
        let refused = Conditions { pose: elsewhere, radiometry: radiometry(5.0), ..before };
        let refusal = improve(&mut both, &refused);
        assert!(matches!(refusal, Err(Rejection::SampleOutside { .. })), "{refusal:?}");
        assert_eq!(both.1, unchanged);
        // A better light then scales the observation by the ratio to its own light.
        let lit = conditions(camera(), 1.3);
        assert_eq!(improve(&mut both, &lit), Ok(true));
        assert_rectified(&both.1, &lit);
    }

    #[test]
    fn small_changes_leave_the_rectified_photograph() {
        let used = Conditions { elevation_mm: 1.0, ..conditions(camera(), 1.0) };
        let (camera, pose) = (used.camera, used.pose);
        let seen = |c: &Camera, p: &Pose| {
            used.moves(&Conditions { camera: *c, pose: *p, ..used }, [100.0, 100.0])
        };
        assert!(!seen(&camera, &pose));
        assert!(!seen(&Camera { cx: camera.cx + 0.02, ..camera }, &pose));
        assert!(seen(&Camera { cx: camera.cx + 0.05, ..camera }, &pose));
        // Further away with a longer lens: the pixels hardly change, the view does.
        let far = Pose { translation: pose.translation * 1.001, ..pose };
        assert!(seen(&Camera { fx: camera.fx * 1.001, fy: camera.fy * 1.001, ..camera }, &far));
        // A higher sample; 0.01 mm of height are less than 0.01 px.
        let raised = |mm| used.moves(&Conditions { elevation_mm: mm, ..used }, [100.0, 100.0]);
        assert!(raised(1.2) && !raised(1.01));
        // A better light alone keeps the geometry.
        let lit = Conditions { radiometry: radiometry(1.3), ..used };
        assert_eq!(used.improved(&Conditions { elevation_mm: 1.01, ..lit }, true, SAMPLE_MM), lit);
        let raised = Conditions { elevation_mm: 1.2, ..lit };
        assert_eq!(used.improved(&raised, true, SAMPLE_MM), raised);
        assert_eq!(used.improved(&raised, false, SAMPLE_MM), lit);
    }
}
