//! Parts of photographs that do not count because they contradict other photographs.

use serde::{Deserialize, Serialize};

use crate::observation::Observation;
use crate::svbrdf::MAX_SAVED_SIDE;
use crate::{Error, Result};

/// Share of the cells from which on it is no part but the photograph that contradicts the others.
const PART_MAX: f32 = 0.6;

/// A part of a photograph that contradicts the others.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Share of the sample, 0 to 1.
    pub share: f32,
    /// Its middle: parts of the sample's width from the left and of its height from the top.
    pub centre: [f32; 2],
    /// Measured over what the other photographs show.
    pub ratio: f32,
}

/// Cells of a photograph that contradict the others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Contradiction {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Whether each contradicts them, row by row.
    pub cells: Vec<bool>,
    /// The largest part.
    pub part: Part,
}

impl Contradiction {
    /// Nothing of a photograph.
    pub fn none(size: [usize; 2]) -> Self {
        let part = Part { share: 0.0, centre: [0.5; 2], ratio: 1.0 };
        Self { size, cells: vec![false; size[0] * size[1]], part }
    }

    /// All of a photograph.
    pub fn whole(size: [usize; 2]) -> Self {
        Self { cells: vec![true; size[0] * size[1]], ..Self::none(size) }
    }

    /// With one more region.
    pub fn add(&mut self, other: &Self) {
        for (cell, added) in self.cells.iter_mut().zip(&other.cells) {
            *cell |= added;
        }
        if other.part.share > self.part.share {
            self.part = other.part;
        }
    }

    /// The largest part, unless most of the photograph contradicts the others.
    pub fn largest_part(&self) -> Option<Part> {
        let cells = self.cells.iter().filter(|cell| **cell).count() as f32;
        (cells <= PART_MAX * self.cells.len() as f32).then_some(self.part)
    }

    /// A photograph without these cells.
    pub fn taken_from(&self, photograph: &Observation) -> Observation {
        let ([columns, rows], width, height) = (self.size, photograph.width(), photograph.height());
        photograph.without(|x, y| self.cells[y * rows / height * columns + x * columns / width])
    }

    /// Whether it may have been found in a photograph.
    pub fn check(&self) -> Result<()> {
        let Self { size: [columns, rows], cells, part } = self;
        let numbers = [part.share, part.centre[0], part.centre[1], part.ratio];
        let is_possible = (1..=MAX_SAVED_SIDE).contains(columns)
            && (1..=MAX_SAVED_SIDE).contains(rows)
            && cells.len() == columns * rows
            && numbers.iter().all(|v| v.is_finite() && *v >= 0.0);
        let fault = || Error::argument("estimate", "contradicting parts are out of range");
        if is_possible { Ok(()) } else { Err(fault()) }
    }
}
