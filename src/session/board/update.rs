//! What later photographs change about earlier ones: their rectified views are made anew, or scaled.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use crate::calibration::photometry::Radiometry;
use crate::estimate::Change;
use crate::frame::Photo;
use crate::geometry::{Camera, Pose};
use crate::observation::Observation;
use crate::rectification::{self, TopView};

/// A camera estimated better moves the sample by less than this: the rectified photograph stays.
const MOVED_PX: f64 = 0.03;
/// The same for the camera's position, relative to its distance.
const MOVED_SHARE: f64 = 3e-4;
/// Room kept round the sample in a photograph, part of its extent and px: later poses differ a
/// little.
const CROP_SHARE: f64 = 0.05;
const CROP_PX: f64 = 24.0;

/// What an observation was made with.
#[derive(Debug, Clone, Copy)]
pub(in crate::session) struct Used {
    pub(in crate::session) camera: Camera,
    pub(in crate::session) pose: Pose,
    pub(in crate::session) radiometry: Radiometry,
    pub(in crate::session) elevation_mm: f64,
    /// Reach of the sample's surroundings, see [`TopView::edge_px`].
    pub(in crate::session) edge_px: f32,
}

impl Used {
    /// The rectangle to be seen from the top, of so many texels a side.
    pub(super) fn top(&self, sample_mm: [f32; 2], [width, height]: [usize; 2]) -> TopView {
        let height_mm = self.elevation_mm as f32;
        TopView { sample_mm, height_mm, width, height, edge_px: self.edge_px }
    }
}

/// What is known better of an earlier photograph.
#[derive(Debug, Clone)]
pub(in crate::session) enum Update {
    /// Light and response.
    Radiometry { index: usize, used: Used, new: Radiometry },
    /// Camera, pose, height and light.
    Geometry { index: usize, kept: Arc<Kept>, used: Used },
}

impl Change for Update {
    fn index(&self) -> usize {
        match self {
            Self::Radiometry { index, .. } | Self::Geometry { index, .. } => *index,
        }
    }

    fn apply(&self, observation: &mut Observation) {
        match self {
            Self::Radiometry { used, new, .. } => {
                let Used { camera, pose, radiometry, elevation_mm, .. } = used;
                let height_mm = *elevation_mm as f32;
                rectification::update_radiometry(
                    observation,
                    camera,
                    pose,
                    height_mm,
                    radiometry,
                    new,
                );
            }
            Self::Geometry { kept, used, .. } => {
                let size = [observation.width(), observation.height()];
                let again = rectification::rectify_raised(
                    &kept.photo,
                    &kept.camera(&used.camera),
                    &used.pose,
                    &used.radiometry,
                    used.top(observation.view.sample_mm, size),
                );
                // An accepted photograph that a better camera no longer accepts stays as it was.
                if let Ok(again) = again {
                    *observation = again;
                }
            }
        }
    }
}

/// The part of a photograph that shows the sample.
#[derive(Debug)]
pub(in crate::session) struct Kept {
    pub(in crate::session) photo: Photo,
    /// Its first pixel in the whole photograph.
    pub(in crate::session) corner: [u32; 2],
}

impl Kept {
    /// The sample is somewhere within `heights_mm` above the board's plane.
    pub(super) fn new(
        photo: &Photo,
        camera: &Camera,
        pose: &Pose,
        sample_mm: [f32; 2],
        heights_mm: [f64; 2],
    ) -> Self {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        // Distortion bends edges: points along them.
        for i in 0..9 * 9 {
            let (x, y) = (f64::from(i % 9) / 8.0 - 0.5, f64::from(i / 9) / 8.0 - 0.5);
            for z in heights_mm {
                let p = DVec3::new(x * f64::from(sample_mm[0]), y * f64::from(sample_mm[1]), z);
                if let Some(px) = camera.project(pose.transform(p)) {
                    (low, high) = (low.min(px), high.max(px));
                }
            }
        }
        let size = DVec2::new(photo.width().into(), photo.height().into());
        let margin = CROP_SHARE * (high - low) + CROP_PX;
        let low = (low - margin).floor().clamp(DVec2::ZERO, size - 1.0);
        let high = (high + margin).ceil().clamp(low + 1.0, size);
        let (corner, extent) = (low.as_uvec2(), (high - low).as_uvec2());
        let photo = photo.cropped(corner.x, corner.y, extent.x, extent.y);
        Self { photo, corner: corner.to_array() }
    }

    /// The camera that took this part.
    pub(super) fn camera(&self, whole: &Camera) -> Camera {
        Camera {
            width: self.photo.width(),
            height: self.photo.height(),
            cx: whole.cx - f64::from(self.corner[0]),
            cy: whole.cy - f64::from(self.corner[1]),
            ..*whole
        }
    }
}

/// Middle and corners of the sample at a height, board frame.
fn marks(sample_mm: [f32; 2], height_mm: f64) -> [DVec3; 5] {
    [(0.0, 0.0), (-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)].map(|(x, y)| {
        DVec3::new(x * f64::from(sample_mm[0]), y * f64::from(sample_mm[1]), height_mm)
    })
}

/// Whether the sample lies elsewhere in the photograph, or is seen from elsewhere.
pub(super) fn moves(old: &Used, new: &Used, sample_mm: [f32; 2]) -> bool {
    let (from, to) = (old.pose.camera_centre(), new.pose.camera_centre());
    if from.distance(to) > MOVED_SHARE * to.length() {
        return true;
    }
    let (then, now) = (marks(sample_mm, old.elevation_mm), marks(sample_mm, new.elevation_mm));
    then.into_iter().zip(now).any(|(then, now)| {
        let then = old.camera.project(old.pose.transform(then));
        let now = new.camera.project(new.pose.transform(now));
        !matches!((then, now), (Some(a), Some(b)) if a.distance(b) <= MOVED_PX)
    })
}

/// How far a point of the sample moves in the board's plane per height of the sample, at most.
pub(super) fn steepest(pose: &Pose, sample_mm: [f32; 2]) -> f64 {
    let eye = pose.camera_centre();
    let slope = |p: DVec3| (eye - p).truncate().length() / eye.z;
    marks(sample_mm, 0.0).into_iter().map(slope).fold(0.0, f64::max)
}

/// Shorter side of a texel, mm.
pub(super) fn texel_mm(sample_mm: [f32; 2], resolution: usize) -> f64 {
    f64::from(sample_mm[0].min(sample_mm[1])) / resolution as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::photometry::tests::{camera, photograph, pose};
    use crate::calibration::photometry::{Lobe, Vignetting};
    use crate::frame::ToneCurve;
    use crate::rectification::elevation;

    fn radiometry(gain: f64) -> Radiometry {
        Radiometry {
            gain: [gain; 3],
            tone: ToneCurve::default(),
            vignetting: Vignetting { exponent: 2.0, curvature: 0.5 },
            lobe: Lobe { exponent: 1.5, pattern: [-0.2, 0.1] },
            flash_offset_mm: DVec3::new(5.0, 2.0, 0.0),
            power_mm2: [2e5; 3],
            ambient: [0.0; 3],
            log_sigma: 0.0,
        }
    }

    /// An earlier photograph brought up to date is what the whole photograph gives with the new
    /// camera and pose.
    #[test]
    fn the_part_kept_is_rectified_like_the_whole() {
        let sample_mm = [100.0, 80.0];
        let (camera, pose) = (camera(), pose(0.4, 0.1, -0.2, 300.0));
        let texture = |p: DVec2, _| [0.5 + 0.3 * (p.x * 0.2).sin(), 0.5, 0.4 + 0.2 * p.y.cos()];
        let photo = photograph(&camera, &pose, 2, texture);
        let photo = Photo::from_linear(camera.width, camera.height, photo, 1.0, 10.0).unwrap();
        // The first guess is a little off.
        let guess = Camera { fx: 480.0, fy: 480.0, distortion: [0.0; 5], ..camera };
        let kept = Kept::new(&photo, &guess, &pose, sample_mm, elevation::RANGE_MM);
        let share = f64::from(kept.photo.width() * kept.photo.height())
            / f64::from(photo.width() * photo.height());
        assert!(share < 0.35, "{share}");
        let at = |camera: &Camera, radiometry: &Radiometry| {
            rectification::rectify(&photo, camera, &pose, radiometry, sample_mm, 64, 64).unwrap()
        };
        let mut observation = at(&guess, &radiometry(1.0));
        let radiometry_after = radiometry(1.3);
        let used =
            Used { camera, pose, radiometry: radiometry_after, elevation_mm: 0.0, edge_px: 0.0 };
        let update = Update::Geometry { index: 3, kept: Arc::new(kept), used };
        assert_eq!(update.index(), 3);
        update.apply(&mut observation);
        let fresh = at(&camera, &radiometry(1.3));
        assert_eq!(observation.view, fresh.view);
        let ((updated, weight), (fresh, fresh_weight)) = (observation.planes(), fresh.planes());
        assert_eq!(weight, fresh_weight);
        for (a, b) in updated.iter().zip(&fresh) {
            // Tables of the response have other steps, positions other roundings: 1e-4 px times
            // the texture's slope; and half floats', 0.1 % each.
            assert!((a - b).abs() < 2e-4 + a.abs() / 500.0, "{a} {b}");
        }
    }

    #[test]
    fn small_changes_leave_the_rectified_photograph() {
        let (camera, pose) = (camera(), pose(0.4, 0.1, -0.2, 300.0));
        let radiometry = radiometry(1.0);
        let used = Used { camera, pose, radiometry, elevation_mm: 1.0, edge_px: 0.0 };
        let seen = |c: &Camera, p: &Pose| {
            moves(&used, &Used { camera: *c, pose: *p, ..used }, [100.0, 100.0])
        };
        assert!(!seen(&camera, &pose));
        assert!(!seen(&Camera { cx: camera.cx + 0.02, ..camera }, &pose));
        assert!(seen(&Camera { cx: camera.cx + 0.05, ..camera }, &pose));
        // Further away with a longer lens: the picture hardly changes, the view does.
        let far = Pose { translation: pose.translation * 1.001, ..pose };
        assert!(seen(&Camera { fx: camera.fx * 1.001, fy: camera.fy * 1.001, ..camera }, &far));
        // A higher sample; 0.01 mm of height are less than 0.01 px.
        let raised = |mm| moves(&used, &Used { elevation_mm: mm, ..used }, [100.0, 100.0]);
        assert!(raised(1.2) && !raised(1.01));
    }
}
