//! What a photograph of a board would be good for: a preview of it, judged on a reduced version without any
//! of the session's locks or threads.

use glam::{DVec2, DVec3};

use super::advice::{self, NextView};
use super::reports::{BoardPose, Probe, ProbedLight, ProbedView};
use crate::Rejection;
use crate::calibration::photometry::{PhotometricCalibrator, Photometry, Squares};
use crate::calibration::{
    self, CameraPrior, Corner, LumaImage, Paper, PoseEstimate, Sighting, Target,
};
use crate::frame::Photo;
use crate::geometry::{Camera, Pose};
use crate::rectification;

/// Pictures are reduced as long as their long side keeps this, px; where too little of the board is
/// found, to the second.
const LONG_SIDES_PX: [u32; 2] = [640, 1280];
/// A given camera scaled to a preview is right to a few per cent: what previews are cut to differs.
const PREVIEW_FOCAL_SIGMA: f64 = 0.1;
/// Points of the sample along each side.
const POINTS: u32 = 32;

/// What previews are judged with, a copy of what the session knows: judging waits for nothing.
#[derive(Clone)]
pub(super) struct Preview {
    pub(super) target: Target,
    pub(super) camera: Option<Camera>,
    pub(super) paper: Paper,
    pub(super) elevation_mm: f64,
    pub(super) poses: Vec<Pose>,
    pub(super) photometry: Option<Photometry>,
    /// Without photographs.
    pub(super) calibrator: PhotometricCalibrator,
    pub(super) sample_mm: [f32; 2],
    pub(super) next: Option<NextView>,
}

/// The board's place in a reduced picture.
struct Placed {
    camera: Camera,
    pose: Pose,
    rms_px: f64,
    rejection: Option<Rejection>,
}

impl Preview {
    /// Judges a photograph. `lit`: by the light it is to be taken with; otherwise its light says
    /// nothing.
    pub(super) fn judge(&self, photo: &Photo, lit: bool) -> Probe {
        if !photo.is_finite() {
            return Probe::rejected(self.expected(), Rejection::NotFinite);
        }
        let (step, small, seen) = self.seek(photo);
        let seen = match seen {
            Ok(seen) => seen,
            Err(Rejection::BoardNotFound) => {
                return Probe::rejected(self.expected(), why_no_board(&small));
            }
            Err(rejection) => return Probe::rejected(self.expected(), rejection),
        };
        let mut probe = Probe::rejected(self.expected(), Rejection::BoardNotFound);
        probe.rejection = seen.rejection.map(|r| at_full_size(r, step));
        probe.corners_in_view = seen.in_view;
        probe.corners = seen.corners.iter().map(|c| enlarged(c, step)).collect();
        if let Some(blur) = seen.blur {
            probe.blur_px = Some(blur.px as f32 * step as f32);
            probe.blur_direction_deg = blur.direction_deg.map(|d| d as f32);
        }
        let Some(placed) = self.place(photo, &small, step, &seen) else {
            let uncertain = Rejection::PoseUncertain { rms_px: f32::INFINITY };
            probe.rejection = probe.rejection.or(Some(uncertain));
            return probe;
        };
        let rms_px = placed.rms_px * f64::from(step);
        probe.pose = Some(BoardPose { pose: placed.pose, reprojection_rms_px: rms_px });
        probe.rejection = probe.rejection.or(placed.rejection.map(|r| at_full_size(r, step)));
        if lit {
            let (light, rejection) = self.light(&small, &placed);
            probe.light = light;
            probe.rejection = probe.rejection.or(rejection);
        }
        let view = self.view(&small, &placed, step);
        probe.rejection = probe.rejection.or(unseen(&view));
        probe.view = Some(view);
        probe.hints.extend(advice::nothing_new(&self.poses, &placed.pose));
        if lit && let Some(known) = &self.photometry {
            let Placed { camera, pose, .. } = &placed;
            probe.hints.extend(advice::linearity(&small, &self.target, camera, pose, known));
        }
        probe
    }

    /// Looks for the board in a small version of a picture, then in a larger one.
    fn seek(&self, photo: &Photo) -> (u32, Photo, Result<Sighting, Rejection>) {
        let look = |step: u32| {
            let small = photo.reduced(step);
            let luma = LumaImage::on_this_thread(&small);
            (step, small, calibration::sight(&luma, &self.target))
        };
        let [coarse, fine] = LONG_SIDES_PX.map(|px| reduction(photo, px));
        let found = look(coarse);
        let enough = match &found.2 {
            Ok(seen) => matches!(seen.rejection, None | Some(Rejection::Blurred { .. })),
            Err(_) => false,
        };
        if enough || fine == coarse { found } else { look(fine) }
    }

    fn expected(&self) -> usize {
        self.target.corners().len()
    }

    /// Camera and pose: of the session's camera at the picture's size, or where that does not fit, of
    /// one estimated from this picture.
    fn place(&self, photo: &Photo, small: &Photo, step: u32, seen: &Sighting) -> Option<Placed> {
        let (width, height) = (photo.width(), photo.height());
        let same = self.camera.filter(|c| (c.width, c.height) == (width, height));
        let scaled = self.camera.and_then(|c| c.of_size(width, height));
        let scaled = scaled.map(|camera| camera.reduced(step));
        let paper = &self.paper;
        let estimate = |camera: &Camera| {
            calibration::estimate_pose_on_paper(camera, &self.target, paper, &seen.corners)
        };
        let (camera, found) = match scaled.map(|camera| (camera, estimate(&camera))) {
            Some((camera, found)) if same.is_some() || is_settled(&found) => (camera, found),
            _ => {
                let prior = self.prior(small);
                let camera = self.estimated(&prior, seen).or(scaled)?;
                (camera, estimate(&camera))
            }
        };
        match found {
            Ok(PoseEstimate { pose, rms_px, .. }) => {
                Some(Placed { camera, pose, rms_px, rejection: None })
            }
            Err(rejection) => {
                let corners = &seen.corners;
                let (pose, rms_px) =
                    calibration::likeliest_pose(&camera, &self.target, paper, corners)?;
                Some(Placed { camera, pose, rms_px, rejection: Some(rejection) })
            }
        }
    }

    /// What is expected of the camera of a picture that is not the session's.
    fn prior(&self, small: &Photo) -> CameraPrior {
        let prior = CameraPrior::of_photo(small);
        match &self.camera {
            None => prior,
            Some(camera) => {
                let long = |a: u32, b: u32| f64::from(a.max(b));
                let scale = long(small.width(), small.height()) / long(camera.width, camera.height);
                prior.with_focal(0.5 * scale * (camera.fx + camera.fy), PREVIEW_FOCAL_SIGMA)
            }
        }
    }

    fn estimated(&self, prior: &CameraPrior, seen: &Sighting) -> Option<Camera> {
        let corners: [&[Corner]; 1] = [&seen.corners];
        let estimate = calibration::estimate_camera_and_paper(&self.target, &corners, prior, None);
        estimate.ok().map(|e| e.camera)
    }

    /// How the board is lit, and what speaks against it.
    fn light(&self, small: &Photo, placed: &Placed) -> (Option<ProbedLight>, Option<Rejection>) {
        let Placed { camera, pose, .. } = placed;
        let full = if small.saturation().is_finite() { small.saturation() } else { 1.0 };
        let squares = match Squares::measure(small, &self.target, camera, pose) {
            Ok(squares) => squares,
            Err(rejection) => {
                let light = match rejection {
                    Rejection::TooDark { level } => {
                        Some(ProbedLight { white_level: level, clipped_share: 0.0 })
                    }
                    Rejection::Clipped { share } => {
                        Some(ProbedLight { white_level: 1.0, clipped_share: share })
                    }
                    _ => None,
                };
                return (light, Some(rejection));
            }
        };
        // A channel that is clipped has no value.
        let level = |value: [Option<f32>; 3]| {
            let of = |v: Option<f32>| v.map_or(1.0, |v| v * squares.exposure / full);
            value.map(of).into_iter().fold(0.0, f32::max)
        };
        let whites = squares.squares.iter().filter(|s| s.white);
        let mut levels: Vec<f32> = whites.map(|s| level(s.value)).collect();
        levels.sort_by(f32::total_cmp);
        let light = levels
            .get(levels.len() / 2)
            .map(|&white_level| ProbedLight { white_level, clipped_share: squares.clipped_share });
        let lit = self.calibrator.is_lit(&squares, pose);
        (light, (!lit).then_some(Rejection::LightNotVisible))
    }

    /// Where the camera is and how much of the sample it sees.
    fn view(&self, small: &Photo, placed: &Placed, step: u32) -> ProbedView {
        let Placed { camera, pose, .. } = placed;
        let eye = pose.camera_centre() - DVec3::Z * self.elevation_mm;
        let direction = eye.normalize();
        let [width, height] = self.sample_mm.map(f64::from);
        let pixel = |x: f64, y: f64| {
            let p = DVec3::new(x * width, y * height, self.elevation_mm);
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
        let whole = |p: DVec2| {
            let (step, middle) = (f64::from(step), 0.5 * (f64::from(step) - 1.0));
            (p * step + middle).as_vec2().to_array()
        };
        // Clockwise from the sample's upper left corner.
        let corners = [(-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)];
        let outline = corners.map(|(x, y)| pixel(x, y));
        let outline = outline
            .iter()
            .all(Option::is_some)
            .then(|| outline.map(|p| whole(p.unwrap_or_default())));
        let area = outline.map_or(0.0, |p: [[f32; 2]; 4]| {
            let cross = |a: [f32; 2], b: [f32; 2]| a[0] * b[1] - a[1] * b[0];
            (0..4).map(|i| cross(p[i], p[(i + 1) % 4])).sum::<f32>().abs() / 2.0
        });
        ProbedView {
            direction: direction.as_vec3().to_array(),
            distance_mm: eye.length() as f32,
            tilt_deg: direction.z.clamp(-1.0, 1.0).acos().to_degrees() as f32,
            azimuth_deg: direction.y.atan2(direction.x).to_degrees().rem_euclid(360.0) as f32,
            off_next_deg: self.next.map(|next| {
                let next = DVec3::from_array(next.direction.map(f64::from));
                direction.angle_between(next).to_degrees() as f32
            }),
            sample_seen: seen as f32 / (POINTS * POINTS) as f32,
            sample_clipped: clipped as f32 / seen.max(1) as f32,
            sample_px: outline,
            px_per_mm: (area / (self.sample_mm[0] * self.sample_mm[1])).sqrt(),
        }
    }
}

/// Whether a scaled camera has told the pose, or that there is none worth having.
fn is_settled(found: &Result<PoseEstimate, Rejection>) -> bool {
    !matches!(found, Err(Rejection::PoseUncertain { .. }))
}

/// Pixels along each side of a block that becomes one.
fn reduction(photo: &Photo, long_side_px: u32) -> u32 {
    let short = photo.width().min(photo.height());
    (photo.width().max(photo.height()) / long_side_px).clamp(1, short)
}

fn enlarged(corner: &Corner, step: u32) -> Corner {
    let middle = 0.5 * (f64::from(step) - 1.0);
    Corner { px: corner.px * f64::from(step) + middle, ..*corner }
}

/// Figures in px of the picture as it came.
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

/// What rectification would refuse.
fn unseen(view: &ProbedView) -> Option<Rejection> {
    if view.sample_seen < rectification::MIN_SEEN {
        Some(Rejection::SampleOutside { share: view.sample_seen })
    } else if view.sample_clipped > rectification::MAX_CLIPPED {
        Some(Rejection::Clipped { share: view.sample_clipped })
    } else {
        None
    }
}

/// What hides the board, if the exposure does: nearly everything black, or most of it saturated.
pub(super) fn why_no_board(photo: &Photo) -> Rejection {
    const SAMPLES: u32 = 128;
    let (w, h) = (photo.width(), photo.height());
    let full = if photo.saturation().is_finite() { photo.saturation() } else { 1.0 };
    let across =
        |n: u32| (0..SAMPLES).map(move |i| ((2 * i + 1) * n.div_ceil(2) / SAMPLES).min(n - 1));
    let mut levels: Vec<f32> = across(h)
        .flat_map(|y| across(w).map(move |x| (x, y)))
        .map(|(x, y)| photo.pixel(x, y).into_iter().fold(0.0, f32::max) / full)
        .collect();
    levels.sort_by(f32::total_cmp);
    let share = levels.iter().filter(|&&v| v >= 1.0).count() as f32 / levels.len() as f32;
    let level = levels[levels.len() * 99 / 100];
    if share > 0.5 {
        Rejection::Clipped { share }
    } else if level < 0.02 {
        Rejection::TooDark { level }
    } else {
        Rejection::BoardNotFound
    }
}
