//! A board as if one of its photographs had never come.

use super::board::{Board, Intrinsics};
use super::photograph::{Conditions, Measured, Photograph};
use crate::Rejection;
use crate::calibration::PaperEstimate;
use crate::rectification::elevation::ElevationEstimate;

impl Board {
    /// The board as if a photograph had never come: all others are taken in again, in their order, from
    /// what was measured in them and the parts kept.
    ///
    /// Where some are not kept any more, paper and height are settled and stay as they are: only the
    /// light is estimated anew. Squares are those measured when a photograph came, with its pose
    /// of then.
    ///
    /// # Errors
    /// The first photograph that would have been rejected without that one, and why.
    pub(super) fn without(&self, index: usize) -> Result<Self, (usize, Rejection)> {
        let left = || self.photographs.iter().enumerate().filter(move |(i, _)| *i != index);
        let settled = left().any(|(_, photograph)| photograph.part.is_none());
        let mut board = self.emptied(settled);
        for (i, old) in left() {
            board.again(old, settled).map_err(|rejection| (i, rejection))?;
        }
        for (new, (i, old)) in board.photographs.iter_mut().zip(left()) {
            let Some(mut rectified) = old.rectified.clone() else { continue };
            // Parts that the new board has let go of are those that views are made from.
            let part = old.part.as_deref().filter(|_| !settled);
            if part.is_none() {
                let radiometry = new.wanted.radiometry;
                new.wanted = Conditions { radiometry, ..*rectified.conditions() };
            }
            let remade = rectified.remake(&new.wanted, part, true);
            remade.map_err(|rejection| (i, rejection))?;
            new.adopt(rectified);
        }
        Ok(board)
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
            elevation: if as_stated { self.elevation } else { ElevationEstimate::default() },
            photometry: None,
            photographs: Vec::new(),
            refused: Vec::new(),
            ..*self
        }
    }

    /// Takes a photograph in again, its observation as it is for the moment.
    fn again(&mut self, old: &Photograph, settled: bool) -> Result<(), Rejection> {
        let Measured { prior, corners, .. } = &old.measured;
        let solved = self.solve(prior, corners)?;
        let rms_px = solved.new.rms_px;
        let part = old.part.clone().filter(|_| !settled && self.may_move());
        let edge_px = old.wanted.edge_px;
        let plan = self.plan(&old.measured, solved, part.as_deref(), edge_px)?;
        let (pose, wanted) = (plan.conditions.pose, plan.conditions);
        let mut photograph = old.clone();
        (photograph.pose, photograph.rms_px, photograph.wanted) = (pose, rms_px, wanted);
        (photograph.part, photograph.details) = (part, None);
        self.commit(plan, photograph);
        self.settle();
        Ok(())
    }
}
