//! Photographs of a board: calibration and rectification, and what later photographs change about
//! earlier ones.

mod frame;
mod reasons;
pub(super) mod replay;
mod update;

use std::sync::Arc;

use glam::DVec3;

use super::feedback;
use super::reports::BoardPose;
use super::sight::{Known, why_no_board};
use super::taken::Taken;
use crate::calibration::photometry::{FlashOffset, PhotometricCalibrator, Photometry, Squares};
use crate::calibration::{
    self, CameraEstimate, CameraPrior, Corner, Detection, LumaImage, Paper, PaperEstimate,
    PoseEstimate, Target,
};
use crate::frame::Photo;
use crate::geometry::{Camera, Pose};
use crate::rectification;
use crate::rectification::elevation::{self, Detail, ElevationEstimate};
use crate::{Error, Rejection, Result};
pub(super) use frame::Frame;
use frame::Seen;
use reasons::{Softness, other_camera, same_lens};
pub(super) use update::{Kept, Update, Used};
use update::{moves, steepest, texel_mm};

/// Where the flash of an unknown camera may be, mm: in the plane of its lens.
const FLASH_SIGMA_MM: DVec3 = DVec3::new(30.0, 30.0, 0.0);
/// Another height that moves the sample by less than this, texels, is not taken over.
const MOVED_TEXELS: f64 = 0.1;
/// Maps of a sample that is moved by more than this are no start any more, texels.
const RESTART_TEXELS: f64 = 1.0;
/// How well a sample's edge is known to lie where it is said to, px.
const PLACED_PX: f64 = 0.5;
/// A given camera's photographs after which paper and sample are taken as known, at the earliest
/// and at the latest.
const SETTLING_PHOTOS: std::ops::RangeInclusive<usize> = 4..=8;

/// Where intrinsics come from.
#[derive(Debug, Clone)]
enum Intrinsics {
    Given(Camera),
    Estimated(Option<Box<CameraEstimate>>),
}

/// Takes photographs of a board in, one at a time.
#[derive(Clone)]
pub(super) struct BoardIntake {
    target: Target,
    intrinsics: Intrinsics,
    paper: PaperEstimate,
    /// Whether the caller has said how high the sample lies.
    stated: bool,
    elevation: ElevationEstimate,
    photometry: PhotometricCalibrator,
    frames: Vec<Frame>,
}

/// Camera and poses with a new photograph.
struct Solved {
    camera: Camera,
    estimate: Option<CameraEstimate>,
    paper: PaperEstimate,
    new: PoseEstimate,
    /// Poses of the earlier photographs, where camera or paper changed.
    earlier: Option<Vec<(Pose, f64)>>,
}

/// What a new photograph changes, computed before anything is changed.
struct Plan {
    corners: Vec<Corner>,
    prior: CameraPrior,
    solved: Solved,
    photometry: PhotometricCalibrator,
    /// What the new photograph is rectified with.
    used: Used,
    kept: Option<Arc<Kept>>,
    /// Details of all photographs, where the sample's height was measured.
    seen: Vec<Arc<Seen>>,
    elevation: ElevationEstimate,
}

impl BoardIntake {
    /// Checks the scene.
    pub(super) fn new(
        target: Target,
        camera: Option<Camera>,
        flash_offset_mm: Option<DVec3>,
        elevation_mm: Option<f64>,
    ) -> Result<Self> {
        if let Some((field, expected)) = target.fault() {
            return Err(Error::argument("board", format!("{field}: expected {expected}")));
        }
        if let Some((field, expected)) = camera.and_then(|c| c.fault()) {
            return Err(Error::argument("camera", format!("{field}: expected {expected}")));
        }
        let flash = match flash_offset_mm {
            Some(offset) if !offset.is_finite() => {
                return Err(Error::argument("flash", "offset_mm: expected finite numbers"));
            }
            Some(offset) => FlashOffset::Known(offset),
            None => FlashOffset::Estimated { prior_mm: DVec3::ZERO, sigma_mm: FLASH_SIGMA_MM },
        };
        if let Some(mm) = elevation_mm
            && !(elevation::RANGE_MM[0]..=elevation::RANGE_MM[1]).contains(&mm)
        {
            let [low, high] = elevation::RANGE_MM;
            let expected = format!("{mm} given; {low} to {high} mm expected");
            return Err(Error::argument("elevation_mm", expected));
        }
        let stated = elevation_mm.is_some();
        let elevation = match elevation_mm {
            Some(mm) => ElevationEstimate { mm, sigma_mm: 0.0 },
            None => ElevationEstimate::default(),
        };
        let photometry = PhotometricCalibrator::new(target.clone(), flash);
        let intrinsics = camera.map_or(Intrinsics::Estimated(None), Intrinsics::Given);
        let paper = PaperEstimate::default();
        let frames = Vec::new();
        Ok(Self { target, intrinsics, paper, stated, elevation, photometry, frames })
    }

    pub(super) fn camera(&self) -> Option<Camera> {
        match &self.intrinsics {
            Intrinsics::Given(camera) => Some(*camera),
            Intrinsics::Estimated(estimate) => estimate.as_ref().map(|e| e.camera),
        }
    }

    pub(super) fn camera_sigma(&self) -> Option<[f64; 9]> {
        match &self.intrinsics {
            Intrinsics::Given(_) => None,
            Intrinsics::Estimated(estimate) => estimate.as_ref().map(|e| e.sigma()),
        }
    }

    pub(super) fn paper(&self) -> PaperEstimate {
        self.paper
    }

    pub(super) fn elevation(&self) -> ElevationEstimate {
        self.elevation
    }

    pub(super) fn poses(&self) -> Vec<BoardPose> {
        let known = |f: &Frame| BoardPose { pose: f.pose, reprojection_rms_px: f.rms_px };
        self.frames.iter().map(known).collect()
    }

    pub(super) fn photometry(&self) -> Option<&Photometry> {
        self.photometry.photometry()
    }

    /// What probes look with.
    pub(super) fn known(&self, sample_mm: [f32; 2]) -> Known {
        let poses: Vec<Pose> = self.frames.iter().map(|f| f.pose).collect();
        let flash_mm = self.photometry().map_or(DVec3::ZERO, |p| p.flash_offset_mm);
        Known {
            target: self.target.clone(),
            camera: self.camera(),
            paper: self.paper.paper,
            elevation_mm: self.elevation.mm,
            next: feedback::next_view(&poses, flash_mm, sample_mm),
            poses,
            photometry: self.photometry().cloned(),
            calibrator: self.photometry.emptied(),
            sample_mm,
        }
    }

    /// The camera's estimate, where it is estimated and a photograph tells.
    pub(super) fn estimate(&self) -> Option<&CameraEstimate> {
        match &self.intrinsics {
            Intrinsics::Given(_) => None,
            Intrinsics::Estimated(estimate) => estimate.as_deref(),
        }
    }

    /// Accepted photographs and what the photometry has of them.
    pub(super) fn frames_and_squares(&self) -> impl Iterator<Item = (&Frame, &Squares)> {
        self.frames.iter().zip(self.photometry.squares())
    }

    /// Takes over the photographs of an earlier session with the same scene.
    pub(super) fn resume(
        &mut self,
        estimate: Option<CameraEstimate>,
        paper: PaperEstimate,
        elevation: ElevationEstimate,
        frames: Vec<(Frame, Squares)>,
    ) {
        if let Some(estimate) = estimate {
            self.intrinsics = Intrinsics::Estimated(Some(Box::new(estimate)));
        }
        let (frames, squares): (Vec<Frame>, Vec<Squares>) = frames.into_iter().unzip();
        self.photometry.resume(frames.iter().map(|f| f.pose).zip(squares));
        self.frames = frames;
        self.paper = paper;
        if !self.stated {
            self.elevation = elevation;
        }
    }

    /// Bytes of the parts of photographs kept and of their details.
    pub(super) fn kept_bytes(&self) -> u64 {
        let kept = self.frames.iter().filter_map(|f| f.kept.as_ref());
        let seen = self.frames.iter().filter_map(|f| f.seen.as_ref()?.detail.as_ref());
        kept.map(|k| k.photo.stored_bytes() as u64).sum::<u64>()
            + seen.map(Detail::bytes).sum::<u64>()
    }

    /// Calibrates and rectifies a photograph. A rejected one changes nothing.
    pub(super) fn take(
        &mut self,
        photo: &Photo,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> std::result::Result<Taken, Rejection> {
        let Detection { corners, blur_px } = self.detect(photo)?;
        let blur = Softness::new(&corners, blur_px)?;
        let prior = CameraPrior::of_photo(photo);
        let first = self.frames.iter().find_map(|f| f.prior.as_ref());
        same_lens(first, &prior)?;
        let solved = self.solve(&prior, &corners).map_err(|rejection| {
            let known = self.camera();
            known
                .and_then(|known| other_camera(&self.target, &known, &corners, rejection))
                .unwrap_or(rejection)
        })?;
        let (camera, pose) = (solved.camera, solved.new.pose);
        let squares = Squares::measure(photo, &self.target, &camera, &pose)
            .map_err(|rejection| blur.explained(rejection))?;
        let heights_mm = if self.stated { [self.elevation.mm; 2] } else { elevation::RANGE_MM };
        let keep = || Arc::new(Kept::new(photo, &camera, &pose, sample_mm, heights_mm));
        let kept = self.may_move().then(keep);
        let edge_px = blur_px.hypot(solved.new.rms_px).hypot(PLACED_PX) as f32;
        let plan = self
            .plan(corners, prior, solved, squares, kept, edge_px, sample_mm, resolution)
            .map_err(|rejection| blur.explained(rejection))?;
        let Used { radiometry, .. } = &plan.used;
        let top = plan.used.top(sample_mm, [resolution; 2]);
        let observation = rectification::rectify_raised(photo, &camera, &pose, radiometry, top)?;
        let poses: Vec<Pose> = self.frames.iter().map(|f| f.pose).collect();
        let mut hints = Vec::from_iter(feedback::nothing_new(&poses, &pose));
        if let Some(known) = plan.photometry.photometry() {
            hints.extend(feedback::linearity(photo, &self.target, &camera, &pose, known));
        }
        let rms_px = Some(plan.solved.new.rms_px);
        let (updates, restart) = self.commit(plan, sample_mm, resolution);
        Ok(Taken { observation, pose: Some(pose), rms_px, updates, restart, hints })
    }

    /// What a photograph would change whose corners and squares are known.
    fn plan(
        &self,
        corners: Vec<Corner>,
        prior: CameraPrior,
        solved: Solved,
        squares: Squares,
        kept: Option<Arc<Kept>>,
        edge_px: f32,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> std::result::Result<Plan, Rejection> {
        let mut photometry = self.photometry.clone();
        if let Some(earlier) = &solved.earlier {
            let poses: Vec<Pose> = earlier.iter().map(|e| e.0).collect();
            photometry.set_poses(&poses);
        }
        let radiometry = photometry.push_squares(squares, &solved.new.pose)?;
        let (seen, elevation) = match &kept {
            // one photograph tells nothing, and its maps are waited for
            Some(kept) if !self.stated && !self.frames.is_empty() => {
                self.measure(kept, &solved, sample_mm, resolution)
            }
            _ => (Vec::new(), self.elevation),
        };
        let (camera, pose) = (solved.camera, solved.new.pose);
        let used = Used { camera, pose, radiometry, elevation_mm: elevation.mm, edge_px };
        Ok(Plan { corners, prior, solved, photometry, used, kept, seen, elevation })
    }

    /// Takes over what a photograph changes: what the fit must do, and whether its maps are no start
    /// any more.
    fn commit(
        &mut self,
        plan: Plan,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> (Vec<Update>, bool) {
        let Plan { corners, prior, solved, photometry, used, kept, elevation, .. } = plan;
        let Used { camera, pose, elevation_mm, .. } = used;
        if let Some(earlier) = &solved.earlier {
            for (frame, (pose, rms_px)) in self.frames.iter_mut().zip(earlier) {
                (frame.pose, frame.rms_px) = (*pose, *rms_px);
            }
        }
        let update = |(index, frame): (usize, &mut Frame)| {
            let radiometry = photometry.radiometry(index)?;
            let pose = frame.pose;
            let latest = Used { camera, pose, radiometry, elevation_mm, ..frame.used };
            frame.update(index, latest, sample_mm)
        };
        let updates = self.frames.iter_mut().enumerate().filter_map(update).collect();
        let rms_px = solved.new.rms_px;
        self.frames.push(Frame {
            corners,
            prior: Some(prior),
            kept,
            seen: None,
            pose,
            rms_px,
            used,
        });
        for (frame, seen) in self.frames.iter_mut().zip(plan.seen) {
            frame.seen = Some(seen);
        }
        let change = self.shift_mm(elevation.mm, sample_mm) / texel_mm(sample_mm, resolution);
        let restart = change > RESTART_TEXELS;
        self.elevation = elevation;
        if let Some(estimate) = solved.estimate {
            self.intrinsics = Intrinsics::Estimated(Some(Box::new(estimate)));
        }
        self.photometry = photometry;
        self.paper = solved.paper;
        self.settle(sample_mm, resolution);
        (updates, restart)
    }

    /// The board in a photograph of the size that is known.
    fn detect(&self, photo: &Photo) -> std::result::Result<Detection, Rejection> {
        if let Some(camera) = self.camera()
            && (photo.width(), photo.height()) != (camera.width, camera.height)
        {
            return Err(Rejection::WrongSize {
                found_width: photo.width(),
                found_height: photo.height(),
                width: camera.width,
                height: camera.height,
            });
        }
        let luma = LumaImage::from_photo(photo);
        match calibration::detect(&luma, &self.target) {
            Err(Rejection::BoardNotFound) => Err(why_no_board(photo)),
            found => found,
        }
    }

    /// Details of all photographs and of a new one, and the height of the sample that they tell.
    fn measure(
        &self,
        kept: &Kept,
        solved: &Solved,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> (Vec<Arc<Seen>>, ElevationEstimate) {
        let camera = solved.camera;
        let see = |kept: &Kept, camera: Camera, pose: Pose| {
            let detail = Detail::new(&kept.photo, &kept.camera(&camera), &pose, sample_mm);
            Arc::new(Seen { camera, pose, detail })
        };
        let mut all: Vec<Arc<Seen>> = Vec::with_capacity(self.frames.len() + 1);
        for (i, frame) in self.frames.iter().enumerate() {
            let Some(kept) = &frame.kept else { return (Vec::new(), self.elevation) };
            // As long as the observation stays, so do its details.
            let pose = solved.earlier.as_ref().map_or(frame.pose, |e| e[i].0);
            let Used { elevation_mm, .. } = frame.used;
            let latest = Used { camera, pose, elevation_mm, ..frame.used };
            let Used { camera, pose, .. } =
                if moves(&frame.used, &latest, sample_mm) { latest } else { frame.used };
            all.push(match &frame.seen {
                Some(seen) if (seen.camera, seen.pose) == (camera, pose) => seen.clone(),
                _ => see(kept, camera, pose),
            });
        }
        all.push(see(kept, camera, solved.new.pose));
        let details: Vec<&Detail> = all.iter().filter_map(|s| s.detail.as_ref()).collect();
        let mut estimate = elevation::estimate(&details, self.elevation);
        let slope = all.iter().map(|s| steepest(&s.pose, sample_mm)).fold(0.0, f64::max);
        let change = slope * (estimate.mm - self.elevation.mm).abs();
        if change <= MOVED_TEXELS * texel_mm(sample_mm, resolution) {
            estimate.mm = self.elevation.mm;
        }
        (all, estimate)
    }

    /// Camera and poses from all photographs so far and a new one.
    fn solve(
        &self,
        prior: &CameraPrior,
        corners: &[Corner],
    ) -> std::result::Result<Solved, Rejection> {
        let earlier = match &self.intrinsics {
            Intrinsics::Given(camera) => return self.solve_given(camera, corners),
            Intrinsics::Estimated(estimate) => estimate.as_deref(),
        };
        let mut all: Vec<&[Corner]> = self.frames.iter().map(|f| f.corners.as_slice()).collect();
        all.push(corners);
        let start = earlier.map(|e| &e.camera);
        let estimate = calibration::estimate_camera_and_paper(&self.target, &all, prior, start)?;
        let (camera, paper) = (estimate.camera, estimate.paper);
        let new = self.pose_of(&camera, &paper.paper, corners)?;
        // The minority goes: a new photograph that the others contradict, never most of them.
        let lost = estimate.views.iter().filter(|v| !v.used).count();
        if 2 * lost >= estimate.views.len() || estimate.views.last().is_some_and(|v| !v.used) {
            return Err(Rejection::PoseUncertain { rms_px: new.rms_px as f32 });
        }
        let earlier = Some(self.earlier_poses(&camera, &paper.paper));
        Ok(Solved { camera, estimate: Some(estimate), paper, new, earlier })
    }

    /// Pose of a new photograph, and what it changes about the paper.
    fn solve_given(
        &self,
        camera: &Camera,
        corners: &[Corner],
    ) -> std::result::Result<Solved, Rejection> {
        let known = self.paper;
        let new = self.pose_of(camera, &known.paper, corners)?;
        let as_known = Solved { camera: *camera, estimate: None, paper: known, new, earlier: None };
        if self.frames.is_empty() || !self.may_move() {
            return Ok(as_known);
        }
        let mut views: Vec<(&[Corner], Pose)> =
            self.frames.iter().map(|f| (f.corners.as_slice(), f.pose)).collect();
        views.push((corners, as_known.new.pose));
        let paper = calibration::estimate_paper(camera, &self.target, &views);
        match self.pose_of(camera, &paper.paper, corners) {
            Ok(new) if paper.paper != known.paper => {
                let earlier = Some(self.earlier_poses(camera, &paper.paper));
                Ok(Solved { paper, new, earlier, ..as_known })
            }
            Ok(_) => Ok(Solved { paper, ..as_known }),
            Err(_) => Ok(as_known),
        }
    }

    fn pose_of(
        &self,
        camera: &Camera,
        paper: &Paper,
        corners: &[Corner],
    ) -> std::result::Result<PoseEstimate, Rejection> {
        calibration::estimate_pose_on_paper(camera, &self.target, paper, corners)
    }

    /// Poses of the earlier photographs and what they leave, px.
    fn earlier_poses(&self, camera: &Camera, paper: &Paper) -> Vec<(Pose, f64)> {
        let pose = |frame: &Frame| match self.pose_of(camera, paper, &frame.corners) {
            Ok(pose) => (pose.pose, pose.rms_px),
            Err(_) => (frame.pose, frame.rms_px),
        };
        self.frames.iter().map(pose).collect()
    }

    /// Whether later photographs may change camera, paper and poses.
    fn may_move(&self) -> bool {
        matches!(self.intrinsics, Intrinsics::Estimated(_))
            || self.frames.iter().all(|frame| frame.kept.is_some())
    }

    /// How far another height moves points of the sample in photographs so far, at most, mm.
    fn shift_mm(&self, elevation_mm: f64, sample_mm: [f32; 2]) -> f64 {
        let slopes = self.frames.iter().map(|f| steepest(&f.pose, sample_mm));
        slopes.fold(0.0, f64::max) * (elevation_mm - self.elevation.mm).abs()
    }

    /// Lets go of the photographs of a given camera once paper and sample are known.
    fn settle(&mut self, sample_mm: [f32; 2], resolution: usize) {
        let photos = self.frames.len();
        let slope = self.frames.iter().map(|f| steepest(&f.pose, sample_mm)).fold(0.0, f64::max);
        let well = MOVED_TEXELS * texel_mm(sample_mm, resolution) / slope.max(0.1);
        let enough = photos >= *SETTLING_PHOTOS.start()
            && self.paper.is_settled()
            && self.elevation.sigma_mm < well;
        if matches!(self.intrinsics, Intrinsics::Given(_))
            && (enough || photos >= *SETTLING_PHOTOS.end())
        {
            for frame in &mut self.frames {
                (frame.kept, frame.seen) = (None, None);
            }
        }
    }
}
