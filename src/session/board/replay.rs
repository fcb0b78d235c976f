//! An intake as if one of its photographs had never come.

use super::update::{Kept, Update, Used};
use super::{BoardIntake, Frame, Intrinsics};
use crate::Rejection;
use crate::calibration::photometry::Squares;
use crate::calibration::{CameraPrior, PaperEstimate};
use crate::rectification::elevation::ElevationEstimate;
use std::sync::Arc;

/// An intake and what its photographs' rectified views need to go with it: one entry each.
pub(in crate::session) struct Replayed {
    pub(in crate::session) intake: BoardIntake,
    pub(in crate::session) updates: Vec<Option<Update>>,
}

impl BoardIntake {
    /// Takes all photographs but one in again, in their order, from their corners, squares and the parts
    /// kept.
    ///
    /// Where some are not kept any more, paper and height are settled and stay as they are: only the
    /// light is estimated anew. Squares are those measured when a photograph came, with its pose
    /// of then.
    ///
    /// # Errors
    /// The first photograph that would have been rejected without that one, and why.
    pub(in crate::session) fn without(
        &self,
        index: usize,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> Result<Replayed, (usize, Rejection)> {
        let left = || {
            let frames = self.frames.iter().zip(self.photometry.squares()).enumerate();
            frames.filter(move |(i, _)| *i != index)
        };
        let settled = left().any(|(_, (frame, _))| frame.kept.is_none());
        let mut intake = self.emptied(settled);
        for (i, (frame, squares)) in left() {
            intake.again(frame, squares, settled, sample_mm, resolution).map_err(|r| (i, r))?;
        }
        let mut updates = Vec::with_capacity(intake.frames.len());
        for (new, (frame, (_, (old, _)))) in intake.frames.iter_mut().zip(left()).enumerate() {
            updates.push(match (&old.kept, settled) {
                (Some(kept), false) => anew(new, kept, &old.used, &frame.used),
                _ => {
                    let radiometry = frame.used.radiometry;
                    frame.used = Used { radiometry, ..old.used };
                    let changed = radiometry != old.used.radiometry;
                    changed.then_some(Update::Radiometry {
                        index: new,
                        used: old.used,
                        new: radiometry,
                    })
                }
            });
        }
        Ok(Replayed { intake, updates })
    }

    /// The same without photographs.
    fn emptied(&self, settled: bool) -> Self {
        let intrinsics = match &self.intrinsics {
            Intrinsics::Given(camera) => Intrinsics::Given(*camera),
            Intrinsics::Estimated(_) => Intrinsics::Estimated(None),
        };
        let as_stated = self.stated || settled;
        Self {
            target: self.target.clone(),
            intrinsics,
            paper: if settled { self.paper } else { PaperEstimate::default() },
            stated: self.stated,
            elevation: if as_stated { self.elevation } else { ElevationEstimate::default() },
            photometry: self.photometry.emptied(),
            frames: Vec::new(),
        }
    }

    /// Takes a photograph in again.
    fn again(
        &mut self,
        old: &Frame,
        squares: &Squares,
        settled: bool,
        sample_mm: [f32; 2],
        resolution: usize,
    ) -> Result<(), Rejection> {
        let (width, height) = old.picture_size();
        let prior = old.prior.unwrap_or_else(|| CameraPrior::ordinary(width, height));
        let solved = self.solve(&prior, &old.corners)?;
        let kept = old.kept.clone().filter(|_| !settled && self.may_move());
        let (corners, squares) = (old.corners.clone(), squares.clone());
        let edge_px = old.used.edge_px;
        let plan =
            self.plan(corners, prior, solved, squares, kept, edge_px, sample_mm, resolution)?;
        self.commit(plan, sample_mm, resolution);
        Ok(())
    }
}

/// A rectified view made anew where anything of it changes.
fn anew(index: usize, kept: &Arc<Kept>, old: &Used, new: &Used) -> Option<Update> {
    let same = (old.camera, old.pose, old.radiometry, old.elevation_mm)
        == (new.camera, new.pose, new.radiometry, new.elevation_mm);
    (!same).then(|| Update::Geometry { index, kept: kept.clone(), used: *new })
}
