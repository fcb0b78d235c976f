//! Judges a photograph of a board, or an image of a camera's preview, on a reduced version.

use glam::{DVec2, DVec3};

use super::capture::Board;
use super::reports::{BoardPose, Probe, ProbedLight, ProbedView};
use super::survey::NextView;
use crate::calibration::photometry::Squares;
use crate::calibration::reasons::why_no_board;
use crate::calibration::{self, CameraPrior, Corner, LumaImage, Sighting};
use crate::geometry::{Camera, Pose};
use crate::photo::Photo;
use crate::statistics::median;
use crate::{Rejection, rectification};

/// Least long side of a reduced image, px: at the first attempt, and at the second if too little of the board was
/// found.
const LONG_SIDES_PX: [u32; 2] = [640, 1280];
/// Relative uncertainty of the focal length scaled to a preview, whose crop is unknown.
const PREVIEW_FOCAL_SIGMA: f64 = 0.1;
/// Points of the sample along each side.
const POINTS: u32 = 32;

/// The board's pose in a reduced image.
struct Placed {
    camera: Camera,
    pose: Pose,
    rms_px: f64,
    rejection: Option<Rejection>,
}

impl Board {
    /// Judges a photograph. `lit` says that it has the light of the flash, which is then judged too. `next` is the
    /// proposed view.
    pub(super) fn judge(&self, photo: &Photo, lit: bool, next: Option<NextView>) -> Probe {
        let corners_expected = self.target.corners().len();
        let mut probe = Probe { corners_expected, ..Probe::default() };
        if !photo.is_finite() {
            probe.refuse(Some(Rejection::NotFinite));
            return probe;
        }
        let (step, small, seen) = self.seek(photo);
        let seen = match seen {
            Ok(seen) => seen,
            Err(rejection) => {
                let hidden = rejection == Rejection::BoardNotFound;
                probe.refuse(Some(if hidden { why_no_board(&small) } else { rejection }));
                return probe;
            }
        };
        probe.refuse(seen.rejection.map(|rejection| at_full_size(rejection, step)));
        probe.corners_in_view = seen.in_view;
        let whole = |c: &Corner| Corner { px: enlarged(c.px, step), ..*c };
        probe.corners = seen.corners.iter().map(whole).collect();
        if let Some(blur) = seen.blur {
            probe.blur_px = Some(blur.px as f32 * step as f32);
            probe.blur_direction_deg = blur.direction_deg.map(|d| d as f32);
        }
        let Some(placed) = self.place(photo, &small, step, &seen) else {
            probe.refuse(Some(Rejection::PoseUncertain { rms_px: f32::INFINITY }));
            return probe;
        };
        let Placed { camera, pose, rms_px, rejection } = placed;
        probe.pose = Some(BoardPose { pose, reprojection_rms_px: rms_px * f64::from(step) });
        probe.refuse(rejection.map(|rejection| at_full_size(rejection, step)));
        let mut squares = None;
        if lit {
            let blur_px = seen.blur.map_or(0.0, |blur| blur.px);
            let measured = Squares::measure(&small, &self.target, &camera, &pose, blur_px);
            let (light, rejection) = self.light(&small, &pose, &measured);
            probe.light = light;
            probe.refuse(rejection);
            squares = measured.ok();
        }
        let view = self.view(&small, &camera, &pose, step, next);
        let (seen, clipped) = (view.sample_seen, view.sample_clipped);
        // The limits of rectification.
        if seen < rectification::MIN_SEEN {
            probe.refuse(Some(Rejection::SampleOutside { share: seen }));
        } else if clipped > rectification::MAX_CLIPPED {
            probe.refuse(Some(Rejection::Clipped { share: clipped }));
        }
        probe.view = Some(view);
        probe.hints = self.hints(&pose, squares.as_ref());
        probe
    }

    /// Detects the board in a small version of an image, then in a larger one. Returns the reduction and the version.
    fn seek(&self, photo: &Photo) -> (u32, Photo, Result<Sighting, Rejection>) {
        let look = |step: u32| {
            let small = photo.reduced(step);
            let luma = LumaImage::on_this_thread(&small);
            (step, small, calibration::sight(&luma, &self.target))
        };
        // Side of a block of pixels that becomes one.
        let (w, h) = (photo.width(), photo.height());
        let [coarse, fine] = LONG_SIDES_PX.map(|px| (w.max(h) / px).clamp(1, w.min(h)));
        let found = look(coarse);
        let enough = match &found.2 {
            Ok(seen) => matches!(seen.rejection, None | Some(Rejection::Blurred { .. })),
            Err(_) => false,
        };
        if enough || fine == coarse { found } else { look(fine) }
    }

    /// Camera and pose, with the session's camera at the image's size or, if that does not fit, one estimated from
    /// this image.
    fn place(&self, photo: &Photo, small: &Photo, step: u32, seen: &Sighting) -> Option<Placed> {
        let (target, paper, corners) = (&self.target, &self.paper.paper, &seen.corners);
        let (known, size) = (self.camera(), (photo.width(), photo.height()));
        let same = known.is_some_and(|c| (c.width, c.height) == size);
        let scaled = known.and_then(|c| c.of_size(size.0, size.1)).map(|c| c.reduced(step));
        let pose_of =
            |camera: &Camera| calibration::estimate_pose_on_paper(camera, target, paper, corners);
        let uncertain =
            |found: &Result<_, Rejection>| matches!(found, Err(Rejection::PoseUncertain { .. }));
        let (camera, found) = match scaled.map(|camera| (camera, pose_of(&camera))) {
            Some((camera, found)) if same || !uncertain(&found) => (camera, found),
            _ => {
                let (prior, views) = (self.prior(small), [corners.as_slice()]);
                let own = calibration::estimate_camera_and_paper(target, &views, &prior, None);
                let camera = own.ok().map(|own| own.camera).or(scaled)?;
                (camera, pose_of(&camera))
            }
        };
        let (pose, rms_px) = match &found {
            Ok(found) => (found.pose, found.rms_px),
            Err(_) => calibration::likeliest_pose(&camera, target, paper, corners)?,
        };
        Some(Placed { camera, pose, rms_px, rejection: found.err() })
    }

    /// The prior of an image's camera that is not the session's.
    fn prior(&self, small: &Photo) -> CameraPrior {
        let prior = CameraPrior::of_photo(small);
        let Some(camera) = self.camera() else { return prior };
        let long = |a: u32, b: u32| f64::from(a.max(b));
        let scale = long(small.width(), small.height()) / long(camera.width, camera.height);
        prior.with_focal(0.5 * scale * (camera.fx + camera.fy), PREVIEW_FOCAL_SIGMA)
    }

    /// The light on the board, and the rejection that follows from it.
    fn light(
        &self,
        small: &Photo,
        pose: &Pose,
        squares: &Result<Squares, Rejection>,
    ) -> (Option<ProbedLight>, Option<Rejection>) {
        let light = |white_level, clipped_share| Some(ProbedLight { white_level, clipped_share });
        let squares = match squares {
            Ok(squares) => squares,
            Err(rejection) => {
                let light = match *rejection {
                    Rejection::TooDark { level } => light(level, 0.0),
                    Rejection::Clipped { share } => light(1.0, share),
                    _ => None,
                };
                return (light, Some(*rejection));
            }
        };
        let full = if small.saturation().is_finite() { small.saturation() } else { 1.0 };
        // A channel that is clipped has no value.
        let level = |value: [Option<f32>; 3]| {
            let of = |v: Option<f32>| v.map_or(1.0, |v| v * squares.exposure / full);
            value.map(of).into_iter().fold(0.0, f32::max)
        };
        let whites = squares.squares.iter().filter(|s| s.white);
        let middle = median(whites.map(|s| level(s.value)));
        let rejection = self.photometer().fault(squares, pose);
        (middle.and_then(|middle| light(middle, squares.clipped_share)), rejection)
    }

    /// Position of the camera, and the share of the sample in view.
    fn view(
        &self,
        small: &Photo,
        camera: &Camera,
        pose: &Pose,
        step: u32,
        next: Option<NextView>,
    ) -> ProbedView {
        let elevation_mm = self.elevation.mm;
        let eye = pose.camera_centre() - DVec3::Z * elevation_mm;
        let direction = eye.normalize();
        let [width, height] = self.sample_mm.map(f64::from);
        let pixel = |x: f64, y: f64| {
            let p = DVec3::new(x * width, y * height, elevation_mm);
            camera.project(pose.transform(p))
        };
        let size = DVec2::new(small.width().into(), small.height().into());
        let (mut seen, mut clipped) = (0, 0);
        for i in 0..POINTS * POINTS {
            let at = |k: u32| (f64::from(k) + 0.5) / f64::from(POINTS) - 0.5;
            let Some(px) = pixel(at(i % POINTS), at(i / POINTS)).map(DVec2::round) else {
                continue;
            };
            if px.cmpge(DVec2::ZERO).all() && px.cmplt(size).all() {
                seen += 1;
                let values = small.pixel(px.x as u32, px.y as u32);
                clipped += u32::from(values.iter().all(|v| *v >= small.saturation()));
            }
        }
        // Clockwise from the sample's upper left corner.
        let outline =
            [(-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)].map(|(x, y)| pixel(x, y));
        let outline = outline.map(|px| px.map(|px| enlarged(px, step).as_vec2().to_array()));
        let sample_px = match outline {
            [Some(a), Some(b), Some(c), Some(d)] => Some([a, b, c, d]),
            _ => None,
        };
        let area = sample_px.map_or(0.0, |p| {
            let cross = |a: [f32; 2], b: [f32; 2]| a[0] * b[1] - a[1] * b[0];
            (0..4).map(|i| cross(p[i], p[(i + 1) % 4])).sum::<f32>().abs() / 2.0
        });
        ProbedView {
            direction: direction.as_vec3().to_array(),
            distance_mm: eye.length() as f32,
            tilt_deg: direction.z.clamp(-1.0, 1.0).acos().to_degrees() as f32,
            azimuth_deg: direction.y.atan2(direction.x).to_degrees().rem_euclid(360.0) as f32,
            off_next_deg: next.map(|next| {
                let next = DVec3::from_array(next.direction.map(f64::from));
                direction.angle_between(next).to_degrees() as f32
            }),
            sample_seen: seen as f32 / (POINTS * POINTS) as f32,
            sample_clipped: clipped as f32 / seen.max(1) as f32,
            sample_px,
            px_per_mm: (area / (self.sample_mm[0] * self.sample_mm[1])).sqrt(),
        }
    }
}

/// A position of a reduced image in the image as given.
fn enlarged(px: DVec2, step: u32) -> DVec2 {
    px * f64::from(step) + 0.5 * (f64::from(step) - 1.0)
}

/// A rejection with figures in px of the image as given.
fn at_full_size(rejection: Rejection, step: u32) -> Rejection {
    let step = step as f32;
    match rejection {
        Rejection::Blurred { blur_px, direction_deg } => {
            Rejection::Blurred { blur_px: blur_px * step, direction_deg }
        }
        Rejection::PoseUncertain { rms_px } => Rejection::PoseUncertain { rms_px: rms_px * step },
        other => other,
    }
}
