//! Photographs of a board: calibration and rectification, and what later photographs change about
//! earlier ones.

use std::sync::Arc;

use glam::DVec3;

use super::photograph::{
    Conditions, Details, Measured, Part, Photograph, Remade, Remake, steepest,
};
use super::reasons::{Softness, other_camera, same_lens};
use crate::calibration::photometry::{FlashOffset, PhotometricCalibrator, Photometry, Squares};
use crate::calibration::{
    self, CameraEstimate, CameraPrior, Corner, Detection, LumaImage, Paper, PaperEstimate,
    PoseEstimate, Target,
};
use crate::frame::Photo;
use crate::geometry::{Camera, Pose};
use crate::observation::Observation;
use crate::rectification::elevation::{self, Detail, ElevationEstimate};
use crate::session::advice::{self, Hint};
use crate::session::preview::{Preview, why_no_board};
use crate::session::reports::BoardPose;
use crate::{Error, Rejection};

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
pub(super) enum Intrinsics {
    Given(Camera),
    Estimated(Option<Box<CameraEstimate>>),
}

/// All that is known of a board, its photographs, and their camera and light.
#[derive(Debug, Clone)]
pub(in crate::session) struct Board {
    pub(super) target: Target,
    pub(super) flash: FlashOffset,
    pub(super) sample_mm: [f32; 2],
    /// Texels along each side of a rectified photograph.
    pub(super) resolution: usize,
    pub(super) intrinsics: Intrinsics,
    pub(super) paper: PaperEstimate,
    /// Whether the caller has said how high the sample lies.
    pub(super) stated: bool,
    pub(super) elevation: ElevationEstimate,
    pub(super) photometry: Option<Photometry>,
    pub(super) photographs: Vec<Photograph>,
    /// Those that could not be rectified as they should be, of which nobody has been told yet.
    pub(super) refused: Vec<(usize, Rejection)>,
}

/// Camera and poses with a new photograph.
pub(super) struct Solved {
    camera: Camera,
    estimate: Option<CameraEstimate>,
    paper: PaperEstimate,
    pub(super) new: PoseEstimate,
    /// Poses of the earlier photographs, where camera or paper changed.
    earlier: Option<Vec<(Pose, f64)>>,
}

/// What a new photograph tells, computed before anything is changed.
pub(super) struct Plan {
    solved: Solved,
    /// All photographs' squares.
    calibrator: PhotometricCalibrator,
    /// What the new photograph is rectified with.
    pub(super) conditions: Conditions,
    /// Details of all photographs, where the sample's height was measured.
    details: Vec<Arc<Details>>,
    elevation: ElevationEstimate,
}

/// A photograph taken in.
pub(super) struct WithPhotograph {
    pub(super) board: Board,
    pub(super) observation: Observation,
    /// Earlier ones to be rectified better.
    pub(super) remakes: Vec<Remake>,
    pub(super) restart: bool,
    pub(super) pose: BoardPose,
    pub(super) hints: Vec<Hint>,
}

impl Board {
    /// Checks the scene.
    pub(super) fn new(
        target: Target,
        camera: Option<Camera>,
        flash_offset_mm: Option<DVec3>,
        elevation_mm: Option<f64>,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> crate::Result<Self> {
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
            && !elevation::is_possible(mm)
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
        Ok(Self {
            target,
            flash,
            sample_mm,
            resolution,
            intrinsics: camera.map_or(Intrinsics::Estimated(None), Intrinsics::Given),
            paper: PaperEstimate::default(),
            stated,
            elevation,
            photometry: None,
            photographs: Vec::new(),
            refused: Vec::new(),
        })
    }

    pub(in crate::session) fn camera(&self) -> Option<Camera> {
        match &self.intrinsics {
            Intrinsics::Given(camera) => Some(*camera),
            Intrinsics::Estimated(estimate) => estimate.as_ref().map(|e| e.camera),
        }
    }

    /// The camera's estimate, where it is estimated and a photograph tells.
    pub(in crate::session) fn estimate(&self) -> Option<&CameraEstimate> {
        match &self.intrinsics {
            Intrinsics::Given(_) => None,
            Intrinsics::Estimated(estimate) => estimate.as_deref(),
        }
    }

    pub(in crate::session) fn paper(&self) -> PaperEstimate {
        self.paper
    }

    pub(in crate::session) fn elevation(&self) -> ElevationEstimate {
        self.elevation
    }

    pub(in crate::session) fn photometry(&self) -> Option<&Photometry> {
        self.photometry.as_ref()
    }

    /// Accepted photographs, in their order.
    pub(in crate::session) fn photographs(&self) -> &[Photograph] {
        &self.photographs
    }

    /// What previews are judged with.
    pub(super) fn preview(&self) -> Preview {
        let poses: Vec<Pose> = self.photographs.iter().map(|p| p.pose).collect();
        let flash_mm = self.photometry.as_ref().map_or(DVec3::ZERO, |p| p.flash_offset_mm);
        Preview {
            target: self.target.clone(),
            camera: self.camera(),
            paper: self.paper.paper,
            elevation_mm: self.elevation.mm,
            next: advice::next_view(&poses, flash_mm, self.sample_mm),
            poses,
            photometry: self.photometry.clone(),
            calibrator: PhotometricCalibrator::new(self.target.clone(), self.flash),
            sample_mm: self.sample_mm,
        }
    }

    /// Takes over what was known at another time of the same scene.
    pub(in crate::session) fn resume(
        &mut self,
        estimate: Option<CameraEstimate>,
        paper: PaperEstimate,
        elevation: ElevationEstimate,
        photographs: Vec<Photograph>,
    ) {
        if let Some(estimate) = estimate {
            self.intrinsics = Intrinsics::Estimated(Some(Box::new(estimate)));
        }
        self.photographs = photographs;
        self.photometry = self.calibrator(None).estimated();
        self.paper = paper;
        if !self.stated {
            self.elevation = elevation;
        }
    }

    /// With the squares of all photographs, at other poses where there are any.
    fn calibrator(&self, poses: Option<&[(Pose, f64)]>) -> PhotometricCalibrator {
        let pose = |i: usize, p: &Photograph| poses.map_or(p.pose, |poses| poses[i].0);
        let photos = self.photographs.iter().enumerate();
        let photos = photos.map(|(i, p)| (pose(i, p), p.measured.squares.clone()));
        PhotometricCalibrator::new(self.target.clone(), self.flash).with_photos(photos)
    }

    /// Bytes of the parts of photographs kept and of their details.
    pub(super) fn kept_bytes(&self) -> u64 {
        let parts = self.photographs.iter().filter_map(|p| p.part.as_ref());
        let details = self.photographs.iter().filter_map(|p| p.details.as_ref()?.detail.as_ref());
        parts.map(|part| part.photo.stored_bytes() as u64).sum::<u64>()
            + details.map(Detail::bytes).sum::<u64>()
    }

    /// Takes over what became of photographs that were to be rectified better.
    pub(super) fn adopt(&mut self, remade: Vec<Remade>) {
        for Remade { index, rectified, refusal } in remade {
            self.photographs[index].adopt(rectified);
            self.refused.extend(refusal.map(|rejection| (index, rejection)));
        }
    }

    /// The board with another photograph, calibrated and rectified.
    pub(super) fn with(&self, photo: &Photo) -> Result<WithPhotograph, Rejection> {
        let Detection { corners, blur_px } = self.detect(photo)?;
        let blur = Softness::new(&corners, blur_px)?;
        let prior = CameraPrior::of_photo(photo);
        same_lens(self.photographs.first().map(|p| &p.measured.prior), &prior)?;
        let solved = self.solve(&prior, &corners).map_err(|rejection| {
            let known = self.camera();
            known
                .and_then(|known| other_camera(&self.target, &known, &corners, rejection))
                .unwrap_or(rejection)
        })?;
        let (camera, sample_mm) = (solved.camera, self.sample_mm);
        let PoseEstimate { pose, rms_px, .. } = solved.new;
        let squares = Squares::measure(photo, &self.target, &camera, &pose)
            .map_err(|rejection| blur.explained(rejection))?;
        let heights_mm = if self.stated { [self.elevation.mm; 2] } else { elevation::RANGE_MM };
        let keep = || Arc::new(Part::new(photo, &camera, &pose, sample_mm, heights_mm));
        let part = self.may_move().then(keep);
        let edge_px = blur_px.hypot(rms_px).hypot(PLACED_PX) as f32;
        let measured = Measured { corners, prior, squares };
        let plan = self
            .plan(&measured, solved, part.as_deref(), edge_px)
            .map_err(|rejection| blur.explained(rejection))?;
        let (photograph, observation) = Photograph::new(
            photo,
            measured,
            rms_px,
            part,
            plan.conditions,
            sample_mm,
            self.resolution,
        )?;
        let poses: Vec<Pose> = self.photographs.iter().map(|p| p.pose).collect();
        let refused =
            self.refused.iter().map(|&(index, rejection)| Hint::NotRemade { index, rejection });
        let mut hints: Vec<Hint> = advice::nothing_new(&poses, &pose).into_iter().collect();
        if let Some(known) = plan.calibrator.photometry() {
            hints.extend(advice::linearity(photo, &self.target, &camera, &pose, known));
        }
        hints.extend(refused);
        let mut board = self.clone();
        board.refused.clear();
        let restart = board.commit(plan, photograph);
        let earlier = board.photographs[..self.photographs.len()].iter_mut().enumerate();
        let remakes = earlier.filter_map(|(index, earlier)| earlier.remake(index)).collect();
        board.settle();
        let pose = BoardPose { pose, reprojection_rms_px: rms_px };
        Ok(WithPhotograph { board, observation, remakes, restart, pose, hints })
    }

    /// What a photograph tells that was measured.
    pub(super) fn plan(
        &self,
        measured: &Measured,
        solved: Solved,
        part: Option<&Part>,
        edge_px: f32,
    ) -> Result<Plan, Rejection> {
        let mut calibrator = self.calibrator(solved.earlier.as_deref());
        let radiometry = calibrator.push_squares(measured.squares.clone(), &solved.new.pose)?;
        let (details, elevation) = match part {
            // one photograph tells nothing, and its maps are waited for
            Some(part) if !self.stated && !self.photographs.is_empty() => {
                self.measure(part, &solved)
            }
            _ => (Vec::new(), self.elevation),
        };
        let (camera, pose, elevation_mm) = (solved.camera, solved.new.pose, elevation.mm);
        let conditions = Conditions { camera, pose, radiometry, elevation_mm, edge_px };
        Ok(Plan { solved, calibrator, conditions, details, elevation })
    }

    /// Takes over what a photograph tells. What earlier ones should be rectified with is known then, and not
    /// done yet. Returns whether the sample lies so far elsewhere that maps so far are no start any more.
    pub(super) fn commit(&mut self, plan: Plan, photograph: Photograph) -> bool {
        let Plan { solved, calibrator, details, elevation, .. } = plan;
        let Solved { camera, estimate, paper, earlier, .. } = solved;
        for (photograph, (pose, rms_px)) in
            self.photographs.iter_mut().zip(earlier.into_iter().flatten())
        {
            (photograph.pose, photograph.rms_px) = (pose, rms_px);
        }
        for (index, earlier) in self.photographs.iter_mut().enumerate() {
            let Some(radiometry) = calibrator.radiometry(index) else { continue };
            let (pose, elevation_mm) = (earlier.pose, elevation.mm);
            let wanted = earlier.wanted;
            let latest = Conditions { camera, pose, radiometry, elevation_mm, ..wanted };
            let kept = earlier.part.is_some();
            earlier.wanted = wanted.improved(&latest, kept, self.sample_mm);
        }
        self.photographs.push(photograph);
        for (photograph, details) in self.photographs.iter_mut().zip(details) {
            photograph.details = Some(details);
        }
        let change = self.steepest() * (elevation.mm - self.elevation.mm).abs() / self.texel_mm();
        self.elevation = elevation;
        if let Some(estimate) = estimate {
            self.intrinsics = Intrinsics::Estimated(Some(Box::new(estimate)));
        }
        self.photometry = calibrator.photometry().cloned();
        self.paper = paper;
        change > RESTART_TEXELS
    }

    /// The board in a photograph of the size that is known.
    fn detect(&self, photo: &Photo) -> Result<Detection, Rejection> {
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
    fn measure(&self, part: &Part, solved: &Solved) -> (Vec<Arc<Details>>, ElevationEstimate) {
        let (camera, sample_mm) = (solved.camera, self.sample_mm);
        let mut all: Vec<Arc<Details>> = Vec::with_capacity(self.photographs.len() + 1);
        for (i, photograph) in self.photographs.iter().enumerate() {
            let Some(part) = &photograph.part else { return (Vec::new(), self.elevation) };
            // As long as the observation stays, so do its details.
            let pose = solved.earlier.as_ref().map_or(photograph.pose, |e| e[i].0);
            let known = photograph.wanted;
            let latest = Conditions { camera, pose, ..known };
            let Conditions { camera, pose, .. } =
                if known.moves(&latest, sample_mm) { latest } else { known };
            all.push(match &photograph.details {
                Some(details) if (details.camera, details.pose) == (camera, pose) => {
                    details.clone()
                }
                _ => part.details(camera, pose, sample_mm),
            });
        }
        all.push(part.details(camera, solved.new.pose, sample_mm));
        let details: Vec<&Detail> = all.iter().filter_map(|d| d.detail.as_ref()).collect();
        let mut estimate = elevation::estimate(&details, self.elevation);
        let slope = all.iter().map(|d| steepest(&d.pose, sample_mm)).fold(0.0, f64::max);
        let change = slope * (estimate.mm - self.elevation.mm).abs();
        if change <= MOVED_TEXELS * self.texel_mm() {
            estimate.mm = self.elevation.mm;
        }
        (all, estimate)
    }

    /// Camera and poses from all photographs so far and a new one.
    pub(super) fn solve(
        &self,
        prior: &CameraPrior,
        corners: &[Corner],
    ) -> Result<Solved, Rejection> {
        let earlier = match &self.intrinsics {
            Intrinsics::Given(camera) => return self.solve_given(camera, corners),
            Intrinsics::Estimated(estimate) => estimate.as_deref(),
        };
        let mut all: Vec<&[Corner]> =
            self.photographs.iter().map(|p| p.measured.corners.as_slice()).collect();
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
    fn solve_given(&self, camera: &Camera, corners: &[Corner]) -> Result<Solved, Rejection> {
        let known = self.paper;
        let new = self.pose_of(camera, &known.paper, corners)?;
        let as_known = Solved { camera: *camera, estimate: None, paper: known, new, earlier: None };
        if self.photographs.is_empty() || !self.may_move() {
            return Ok(as_known);
        }
        let mut views: Vec<(&[Corner], Pose)> =
            self.photographs.iter().map(|p| (p.measured.corners.as_slice(), p.pose)).collect();
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
    ) -> Result<PoseEstimate, Rejection> {
        calibration::estimate_pose_on_paper(camera, &self.target, paper, corners)
    }

    /// Poses of the earlier photographs and what they leave, px.
    fn earlier_poses(&self, camera: &Camera, paper: &Paper) -> Vec<(Pose, f64)> {
        let pose = |p: &Photograph| match self.pose_of(camera, paper, &p.measured.corners) {
            Ok(pose) => (pose.pose, pose.rms_px),
            Err(_) => (p.pose, p.rms_px),
        };
        self.photographs.iter().map(pose).collect()
    }

    /// Whether later photographs may change camera, paper and poses.
    pub(super) fn may_move(&self) -> bool {
        matches!(self.intrinsics, Intrinsics::Estimated(_))
            || self.photographs.iter().all(|p| p.part.is_some())
    }

    /// How far points of the sample move in the board's plane per height, in photographs so far, at most.
    fn steepest(&self) -> f64 {
        self.photographs.iter().map(|p| steepest(&p.pose, self.sample_mm)).fold(0.0, f64::max)
    }

    /// Shorter side of a texel, mm.
    fn texel_mm(&self) -> f64 {
        f64::from(self.sample_mm[0].min(self.sample_mm[1])) / self.resolution as f64
    }

    /// Lets go of the photographs of a given camera once paper and sample are known.
    pub(super) fn settle(&mut self) {
        let count = self.photographs.len();
        let well = MOVED_TEXELS * self.texel_mm() / self.steepest().max(0.1);
        let enough = count >= *SETTLING_PHOTOS.start()
            && self.paper.is_settled()
            && self.elevation.sigma_mm < well;
        if matches!(self.intrinsics, Intrinsics::Given(_))
            && (enough || count >= *SETTLING_PHOTOS.end())
        {
            for photograph in &mut self.photographs {
                (photograph.part, photograph.details) = (None, None);
            }
        }
    }
}
