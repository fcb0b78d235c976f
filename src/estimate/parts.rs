//! Outlier regions of photographs, masked in the fit.

use serde::{Deserialize, Serialize};

use crate::observation::Observation;
use crate::svbrdf::MAX_SAVED_SIDE;
use crate::{Error, Result};

/// Share of cells above which the whole photograph is the outlier.
const PART_MAX: f32 = 0.6;

/// An outlier region: a part of a photograph that contradicts the others.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Share of the sample, 0 to 1.
    pub share: f32,
    /// Its centre, as fractions of the sample's width from the left and of its height from the top.
    pub centre: [f32; 2],
    /// Ratio of the measured radiance to the prediction from the other photographs.
    pub ratio: f32,
    /// Share of the highlight in that prediction, 0 to 1.
    pub highlight: f32,
}

/// Outlier regions of a photograph.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Contradiction {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Whether each cell is an outlier, row by row.
    pub cells: Vec<bool>,
    /// The largest region.
    pub part: Part,
}

impl Contradiction {
    /// No outlier.
    pub fn none(size: [usize; 2]) -> Self {
        let part = Part { share: 0.0, centre: [0.5; 2], ratio: 1.0, highlight: 0.0 };
        Self { size, cells: vec![false; size[0] * size[1]], part }
    }

    /// The whole photograph.
    pub fn whole(size: [usize; 2]) -> Self {
        Self { cells: vec![true; size[0] * size[1]], ..Self::none(size) }
    }

    /// Adds regions.
    pub fn add(&mut self, other: &Self) {
        for (cell, added) in self.cells.iter_mut().zip(&other.cells) {
            *cell |= added;
        }
        if other.part.share > self.part.share {
            self.part = other.part;
        }
    }

    /// The largest region, unless most of the photograph is an outlier.
    pub fn largest_part(&self) -> Option<Part> {
        let cells = self.cells.iter().filter(|cell| **cell).count() as f32;
        (cells <= PART_MAX * self.cells.len() as f32).then_some(self.part)
    }

    /// The photograph with weight 0 in these cells.
    pub fn taken_from(&self, photograph: &Observation) -> Observation {
        let ([columns, rows], width, height) = (self.size, photograph.width(), photograph.height());
        photograph.without(|x, y| self.cells[y * rows / height * columns + x * columns / width])
    }

    /// Checks the ranges of values that were read.
    pub fn check(&self) -> Result<()> {
        let Self { size: [columns, rows], cells, part } = self;
        let [x, y] = part.centre;
        let numbers = [part.share, x, y, part.ratio, part.highlight];
        let is_possible = (1..=MAX_SAVED_SIDE).contains(columns)
            && (1..=MAX_SAVED_SIDE).contains(rows)
            && cells.len() == columns * rows
            && numbers.iter().all(|v| v.is_finite() && *v >= 0.0);
        let fault = || Error::argument("estimate", "contradicting parts are out of range");
        if is_possible { Ok(()) } else { Err(fault()) }
    }
}
