//! Photographs of a board: calibration, rectification, and the effect of later photographs on earlier ones.

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::photograph::{
    Conditions, Details, Measured, Photograph, Rectified, Taken, Veiled, Wanted, steepest,
};
use super::printed::{self, Printed};
use crate::calibration::photometry::{
    FlashOffset, PhotometricCalibrator, Photometry, Radiometry, Squares,
};
use crate::calibration::reasons::{
    Softness, other_camera, same_lens, too_soft_to_find, why_no_board,
};
use crate::calibration::{
    self, CameraEstimate, CameraPrior, Corner, Detection, LumaImage, Paper, PaperEstimate,
    PoseEstimate, Target,
};
use crate::geometry::{Camera, Pose};
use crate::photo::{Photo, Surround};
use crate::rectification::Part;
use crate::rectification::elevation::{self, Detail, ElevationEstimate};
use crate::session::advice;
use crate::session::hint::Hint;
use crate::session::reports::BoardPose;
use crate::session::survey::{self, Candidate, NextView};
use crate::{BoardDifference, Error, Rejection};

/// Prior of the flash position of an unknown camera: in the plane of its lens, mm.
const FLASH_SIGMA_MM: DVec3 = DVec3::new(30.0, 30.0, 0.0);
/// A new height is ignored if it moves the sample by no more than this, texels.
const MOVED_TEXELS: f64 = 0.1;
/// The fit restarts if a new height moves the sample by more than this, texels.
const RESTART_TEXELS: f64 = 1.0;
/// Uncertainty of the stated position of the sample's edge, px.
const PLACED_PX: f64 = 0.5;
/// Numbers of photographs, with a given camera, after which paper and height count as known: at the earliest,
/// and at the latest.
const SETTLING_PHOTOS: std::ops::RangeInclusive<usize> = 4..=8;

/// A board, its photographs, and the estimates of their camera and light. Fields that are not saved follow from
/// the scene, the settings and the photographs.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Board {
    #[serde(skip)]
    described: Target,
    /// Difference of the print from the description.
    printed: Printed,
    /// The board as printed.
    #[serde(skip)]
    pub target: Target,
    #[serde(skip)]
    flash_offset_mm: Option<DVec3>,
    /// Intrinsics that the caller has stated.
    #[serde(skip)]
    given: Option<Camera>,
    /// Whether the caller has stated the height of the sample.
    #[serde(skip)]
    stated: bool,
    #[serde(skip)]
    pub sample_mm: [f32; 2],
    /// Texels along each side of a rectified photograph.
    #[serde(skip)]
    resolution: usize,
    /// Intrinsics estimated from the photographs, if none are stated.
    pub estimate: Option<Box<CameraEstimate>>,
    pub paper: PaperEstimate,
    pub elevation: ElevationEstimate,
    pub photographs: Vec<Photograph>,
    #[serde(skip)]
    pub photometry: Option<Photometry>,
}

impl Board {
    /// A board without photographs.
    ///
    /// # Errors
    /// When a value is out of range.
    pub fn new(
        target: Target,
        given: Option<Camera>,
        flash_offset_mm: Option<DVec3>,
        elevation_mm: Option<f64>,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> crate::Result<Self> {
        if let Some((field, expected)) = target.fault() {
            return Err(Error::argument("board", format!("{field}: expected {expected}")));
        }
        if let Some((field, expected)) = given.and_then(|camera| camera.fault()) {
            return Err(Error::argument("camera", format!("{field}: expected {expected}")));
        }
        if flash_offset_mm.is_some_and(|offset| !offset.is_finite()) {
            return Err(Error::argument("flash", "offset_mm: expected finite numbers"));
        }
        if let Some(mm) = elevation_mm.filter(|mm| !elevation::is_possible(*mm)) {
            let [low, high] = elevation::RANGE_MM;
            let expected = format!("{mm} given; {low} to {high} mm expected");
            return Err(Error::argument("elevation_mm", expected));
        }
        let stated = elevation_mm.is_some();
        let elevation = elevation_mm.map(|mm| ElevationEstimate { mm, sigma_mm: 0.0 });
        let elevation = elevation.unwrap_or_default();
        let described = target.clone();
        let fixed = Self { described, target, flash_offset_mm, given, stated, ..Self::default() };
        Ok(Self { sample_mm, resolution, elevation, ..fixed })
    }

    /// This board with the photographs and estimates of a saved one of the same scene.
    pub fn resumed(self, saved: Self) -> Self {
        let Self { printed, estimate, paper, photographs, .. } = saved;
        let target = printed.target(&self.described);
        let elevation = if self.stated { self.elevation } else { saved.elevation };
        let mut board = Self { printed, target, estimate, paper, elevation, photographs, ..self };
        board.photometry = board.calibrator().estimated();
        board
    }

    /// The camera in use: stated or estimated.
    pub fn camera(&self) -> Option<Camera> {
        self.given.or(self.estimate.as_ref().map(|estimate| estimate.camera))
    }

    /// The latest poses.
    pub fn poses(&self) -> Vec<Pose> {
        self.photographs.iter().map(|photograph| photograph.pose).collect()
    }

    /// Flash position in the camera frame in use, mm.
    pub fn flash_offset_mm(&self) -> DVec3 {
        self.photometry.as_ref().map_or(DVec3::ZERO, |known| known.flash_offset_mm)
    }

    /// Views that may be proposed; `None` before the first photograph.
    pub fn candidates(&self) -> Option<Vec<Candidate>> {
        survey::candidates(&self.poses(), self.flash_offset_mm())
    }

    /// The most informative view for the next photograph, judged by the poses so far.
    pub fn next_view(&self) -> Option<NextView> {
        survey::next_view(&self.poses(), self.flash_offset_mm(), self.sample_mm)
    }

    /// A photometric calibrator without photographs.
    pub fn photometer(&self) -> PhotometricCalibrator {
        let flash = match self.flash_offset_mm {
            Some(offset) => FlashOffset::Known(offset),
            None => FlashOffset::Estimated { prior_mm: DVec3::ZERO, sigma_mm: FLASH_SIGMA_MM },
        };
        PhotometricCalibrator::new(self.target.clone(), flash)
    }

    /// A photometric calibrator with the squares of all photographs.
    fn calibrator(&self) -> PhotometricCalibrator {
        let photos = self.photographs.iter().map(|p| (p.pose, p.measured.squares.clone()));
        self.photometer().with_photos(photos)
    }

    /// Bytes of the kept parts of photographs and of their details.
    pub fn kept_bytes(&self) -> u64 {
        let parts = self.photographs.iter().filter_map(|p| p.part.as_ref());
        let details = self.photographs.iter().filter_map(|p| p.details.as_ref()?.detail.as_ref());
        parts.map(|part| part.photo.stored_bytes() as u64).sum::<u64>()
            + details.map(Detail::bytes).sum::<u64>()
    }

    /// Instructions to rectify the photographs.
    pub fn wanted(&self) -> Vec<Wanted> {
        self.photographs.iter().map(Photograph::wanted).collect()
    }

    /// The board with another photograph, calibrated and rectified.
    pub fn with(&self, photo: &Photo) -> Result<(Self, Taken), Rejection> {
        let fitting = self.of_known_size(photo);
        let photo = fitting.as_ref().unwrap_or(photo);
        let (printed, Detection { corners, blur_px }) = self.detect(photo)?;
        let blur = Softness::new(&corners, blur_px)?;
        let prior = CameraPrior::of_photo(photo);
        same_lens(self.photographs.first().map(|p| &p.measured.prior), &prior)?;
        let target = printed.target(&self.described);
        let mut board = Self { printed, target, ..self.clone() };
        let target = board.target.clone();
        let (camera, place) = board.locate(&prior, &corners).map_err(|rejection| {
            let other = |known| other_camera(&target, &known, &corners, rejection);
            self.camera().and_then(other).unwrap_or(rejection)
        })?;
        let PoseEstimate { pose, rms_px, .. } = place;
        let measured = Squares::measure(photo, &target, &camera, &pose, blur_px);
        let lit = measured.and_then(|squares| Ok((board.lit(&squares, &pose)?, squares)));
        let (light, squares) = lit.map_err(|rejection| blur.explained(rejection))?;
        let measured = Measured { corners, prior, squares };
        let heights_mm = if self.stated { [self.elevation.mm; 2] } else { elevation::RANGE_MM };
        let keep = || Arc::new(Part::new(photo, &camera, &pose, self.sample_mm, heights_mm));
        let part = self.may_move().then(keep);
        let edge_px = blur_px.hypot(rms_px).hypot(PLACED_PX) as f32;
        let (photograph, restart) = board.add(measured, camera, place, part, edge_px, light);
        let size = [self.resolution; 2];
        let veiled = Veiled { surround: &Surround::of(photo), corner: [0; 2] };
        let conditions = photograph.conditions;
        let rectified = Rectified::new(conditions, photo, veiled, &camera, self.sample_mm, size)?;
        // Before `settle` drops the parts that these need.
        let earlier = board.wanted();
        board.photographs.push(photograph);
        board.settle();
        let pose = Some(BoardPose { pose, reprojection_rms_px: rms_px });
        Ok((board, Taken { rectified, pose, earlier, restart }))
    }

    /// Hints about a photograph that is not added. Those about its light need `squares`.
    pub fn hints(&self, pose: &Pose, squares: Option<&Squares>) -> Vec<Hint> {
        let light = self.photometry.as_ref().zip(squares);
        let linearity =
            light.and_then(|(light, squares)| advice::linearity(squares, &self.target, light));
        advice::nothing_new(&self.poses(), pose).into_iter().chain(linearity).collect()
    }

    /// Whether the caller has stated the height of the sample.
    pub fn is_height_stated(&self) -> bool {
        self.stated
    }

    /// Relative standard deviation of the sample's brightness due to the uncertainty of its height: light falls off
    /// with the square of the distance.
    pub fn height_brightness(&self) -> f64 {
        let nearer = |p: &Photograph| 2.0 / p.pose.camera_centre().z.max(1.0);
        let count = self.photographs.len().max(1) as f64;
        self.elevation.sigma_mm * self.photographs.iter().map(nearer).sum::<f64>() / count
    }

    /// The board without a photograph, and instructions to rectify the others. The others are added again in order,
    /// from their measurements and kept parts.
    ///
    /// If a part has been dropped, paper and height are settled and stay; only the light is estimated again. Squares
    /// stay as they were measured, with the pose at that time.
    ///
    /// # Errors
    /// The first photograph that would have been rejected without that one, and its rejection.
    pub fn without(&self, index: usize) -> Result<(Self, Vec<Wanted>), (usize, Rejection)> {
        let left = || self.photographs.iter().enumerate().filter(move |(i, _)| *i != index);
        let settled = left().any(|(_, photograph)| photograph.part.is_none());
        let mut board = self.clone();
        (board.estimate, board.photometry) = (None, None);
        board.photographs = Vec::new();
        if !settled {
            board.paper = PaperEstimate::default();
        }
        if !settled && !self.stated {
            board.elevation = ElevationEstimate::default();
        }
        for (i, old) in left() {
            board.again(old, settled).map_err(|rejection| (i, rejection))?;
        }
        // With the old parts: the new board may have dropped them.
        let wanted = board.photographs.iter().zip(left()).map(|(new, (_, old))| {
            let part = old.part.clone().filter(|_| !settled);
            Wanted::Board { conditions: new.conditions, part }
        });
        let wanted = wanted.collect();
        Ok((board, wanted))
    }

    /// Adds a photograph of another board from its measurements.
    fn again(&mut self, old: &Photograph, settled: bool) -> Result<(), Rejection> {
        let measured = old.measured.clone();
        let (camera, place) = self.locate(&measured.prior, &measured.corners)?;
        let light = self.lit(&measured.squares, &place.pose)?;
        let part = old.part.clone().filter(|_| !settled && self.may_move());
        let edge_px = old.conditions.edge_px;
        let (photograph, _) = self.add(measured, camera, place, part, edge_px, light);
        self.photographs.push(photograph);
        self.settle();
        Ok(())
    }

    /// Calibrates the light with a new photograph: the calibrator, and the new photograph's radiometry.
    fn lit(
        &self,
        squares: &Squares,
        pose: &Pose,
    ) -> Result<(PhotometricCalibrator, Radiometry), Rejection> {
        let mut calibrator = self.calibrator();
        let radiometry = calibrator.push_squares(squares.clone(), pose)?;
        Ok((calibrator, radiometry))
    }

    /// Estimates height and light with a new photograph and updates the conditions of the earlier ones. Returns the
    /// photograph, and whether the sample has moved too far for the current maps to be a start.
    fn add(
        &mut self,
        measured: Measured,
        camera: Camera,
        PoseEstimate { pose, rms_px, .. }: PoseEstimate,
        part: Option<Arc<Part>>,
        edge_px: f32,
        (calibrator, radiometry): (PhotometricCalibrator, Radiometry),
    ) -> (Photograph, bool) {
        let known_mm = self.elevation.mm;
        let details = match &part {
            // A single photograph does not determine the height, and its caller waits for maps.
            Some(part) if !self.stated && !self.photographs.is_empty() => {
                self.measure(part, camera, pose)
            }
            _ => None,
        };
        let elevation_mm = self.elevation.mm;
        let conditions = Conditions { camera, pose, radiometry, elevation_mm, edge_px };
        for (index, earlier) in self.photographs.iter_mut().enumerate() {
            let Some(radiometry) = calibrator.radiometry(index) else { continue };
            let (pose, edge_px) = (earlier.pose, earlier.conditions.edge_px);
            let latest = Conditions { pose, radiometry, edge_px, ..conditions };
            let kept = earlier.part.is_some();
            earlier.conditions = earlier.conditions.improved(&latest, kept, self.sample_mm);
        }
        self.photometry = calibrator.photometry().cloned();
        let slope = self.steepest().max(steepest(&pose, self.sample_mm));
        let change = slope * (elevation_mm - known_mm).abs() / self.texel_mm();
        let photograph = Photograph { measured, pose, rms_px, part, details, conditions };
        (photograph, change > RESTART_TEXELS)
    }

    /// Detects the board in a photograph, which must have the camera's size once that is known.
    fn detect(&self, photo: &Photo) -> Result<(Printed, Detection), Rejection> {
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
        calibration::detect(&luma, &self.target).map(|found| (self.printed, found)).or_else(|why| {
            let other = (self.photographs.is_empty() && printed::may_explain(&why))
                .then(|| printed::look(&luma, &self.described));
            other.flatten().ok_or_else(|| match too_soft_to_find(&luma, &why) {
                Some(blurred) => blurred,
                None if why == Rejection::BoardNotFound => why_no_board(photo),
                None => why,
            })
        })
    }

    /// The photograph reduced to the known camera's size, if its size is a multiple of that: the full resolution of
    /// the same sensor.
    fn of_known_size(&self, photo: &Photo) -> Option<Photo> {
        let camera = self.camera()?;
        let step = photo.width() / camera.width;
        let fits = (photo.width(), photo.height()) == (step * camera.width, step * camera.height);
        (fits && step > 1).then(|| photo.reduced(step))
    }

    /// Difference of the print from the description.
    pub fn difference(&self) -> Option<BoardDifference> {
        self.printed.difference(&self.described)
    }

    /// Estimates the height of the sample from the details of all photographs. Returns those of the new one.
    fn measure(&mut self, part: &Part, camera: Camera, pose: Pose) -> Option<Arc<Details>> {
        let sample_mm = self.sample_mm;
        if self.photographs.iter().any(|photograph| photograph.part.is_none()) {
            return None;
        }
        for photograph in &mut self.photographs {
            // Details stay valid as long as the observation does.
            let known = photograph.conditions;
            let latest = Conditions { camera, pose: photograph.pose, ..known };
            let used = if known.moves(&latest, sample_mm) { latest } else { known };
            let found =
                photograph.details.take_if(|d| (d.camera, d.pose) == (used.camera, used.pose));
            let make = |part: &Arc<Part>| Details::new(part, used.camera, used.pose, sample_mm);
            photograph.details = found.or_else(|| photograph.part.as_ref().map(make));
        }
        let new = Details::new(part, camera, pose, sample_mm);
        let earlier = self.photographs.iter().filter_map(|p| p.details.as_deref());
        let all: Vec<&Details> = earlier.chain([&*new]).collect();
        let details: Vec<&Detail> = all.iter().filter_map(|d| d.detail.as_ref()).collect();
        let mut estimate = elevation::estimate(&details, self.elevation);
        let slope = all.iter().map(|d| steepest(&d.pose, sample_mm)).fold(0.0, f64::max);
        let change = slope * (estimate.mm - self.elevation.mm).abs();
        if change <= MOVED_TEXELS * self.texel_mm() {
            estimate.mm = self.elevation.mm;
        }
        self.elevation = estimate;
        Some(new)
    }

    /// Camera and pose of a new photograph. Updates camera, paper and the earlier poses.
    fn locate(
        &mut self,
        prior: &CameraPrior,
        corners: &[Corner],
    ) -> Result<(Camera, PoseEstimate), Rejection> {
        if let Some(camera) = self.given {
            return Ok((camera, self.locate_given(&camera, corners)?));
        }
        let earlier = self.photographs.iter().map(|p| p.measured.corners.as_slice());
        let all: Vec<&[Corner]> = earlier.chain([corners]).collect();
        let start = self.estimate.as_ref().map(|estimate| &estimate.camera);
        let estimate = calibration::estimate_camera_and_paper(&self.target, &all, prior, start)?;
        let (camera, paper) = (estimate.camera, estimate.paper);
        let new = self.pose_of(&camera, &paper.paper, corners)?;
        // A new photograph that contradicts most of the others is rejected.
        let lost = estimate.views.iter().filter(|v| !v.used).count();
        if 2 * lost >= estimate.views.len() || estimate.views.last().is_some_and(|v| !v.used) {
            return Err(Rejection::PoseUncertain { rms_px: new.rms_px as f32 });
        }
        (self.estimate, self.paper) = (Some(Box::new(estimate)), paper);
        self.locate_earlier(&camera);
        Ok((camera, new))
    }

    fn locate_given(
        &mut self,
        camera: &Camera,
        corners: &[Corner],
    ) -> Result<PoseEstimate, Rejection> {
        let new = self.pose_of(camera, &self.paper.paper, corners)?;
        if self.photographs.is_empty() || !self.may_move() {
            return Ok(new);
        }
        let earlier = self.photographs.iter().map(|p| (p.measured.corners.as_slice(), p.pose));
        let views: Vec<(&[Corner], Pose)> = earlier.chain([(corners, new.pose)]).collect();
        let paper = calibration::estimate_paper(camera, &self.target, &views);
        let Ok(better) = self.pose_of(camera, &paper.paper, corners) else { return Ok(new) };
        let other = paper.paper != self.paper.paper;
        self.paper = paper;
        if other {
            self.locate_earlier(camera);
        }
        Ok(if other { better } else { new })
    }

    /// Estimates the poses of the earlier photographs with the current camera and paper.
    fn locate_earlier(&mut self, camera: &Camera) {
        let (target, paper) = (&self.target, &self.paper.paper);
        for p in &mut self.photographs {
            let corners = &p.measured.corners;
            if let Ok(new) = calibration::estimate_pose_on_paper(camera, target, paper, corners) {
                (p.pose, p.rms_px) = (new.pose, new.rms_px);
            }
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

    /// Whether later photographs may change camera, paper and poses.
    fn may_move(&self) -> bool {
        self.given.is_none() || self.photographs.iter().all(|p| p.part.is_some())
    }

    /// Largest displacement of points of the sample per unit of height in the photographs so far, see [`steepest`].
    fn steepest(&self) -> f64 {
        self.photographs.iter().map(|p| steepest(&p.pose, self.sample_mm)).fold(0.0, f64::max)
    }

    /// Shorter side of a texel, mm.
    fn texel_mm(&self) -> f64 {
        f64::from(self.sample_mm[0].min(self.sample_mm[1])) / self.resolution as f64
    }

    /// Drops the kept pixels once paper and height are known. With an estimated camera they are always kept.
    fn settle(&mut self) {
        let count = self.photographs.len();
        let well = MOVED_TEXELS * self.texel_mm() / self.steepest().max(0.1);
        let enough = count >= *SETTLING_PHOTOS.start()
            && self.paper.is_settled()
            && self.elevation.sigma_mm < well;
        if self.given.is_some() && (enough || count >= *SETTLING_PHOTOS.end()) {
            for photograph in &mut self.photographs {
                (photograph.part, photograph.details) = (None, None);
            }
        }
    }
}
