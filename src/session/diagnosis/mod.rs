//! Faults of a capture's photographs. Each kind of fault has a model of its own.
//!
//! The hints use all photographs and replace those given when each photograph was added.

mod cores;
mod fits;
mod geometry;
mod groups;
mod highlights;
mod light;
mod material;

use super::capture::{Board, Capture};
use super::hint::Hint;
use crate::Svbrdf;
use crate::assessment::PhotoFit;
use crate::observation::Observation;
pub(super) use cores::core_errors;
pub(super) use highlights::{LostHighlights, narrowest};

/// Hints about the latest photograph of a board, without the maps.
pub(super) fn of_latest(board: &Board) -> Vec<Hint> {
    of_board(board).pop().unwrap_or_default()
}

/// Hints about each photograph of a capture, from the board, the maps and the residuals of the fit.
pub(super) fn of_capture(
    capture: &Capture,
    photographs: &[Observation],
    maps: Option<&Svbrdf>,
    fits: &[PhotoFit],
) -> Vec<Vec<Hint>> {
    let mut all = match capture.board() {
        Some(board) => of_board(board),
        None => vec![Vec::new(); photographs.len()],
    };
    let board = capture.board();
    if board.is_some() {
        geometry::of_capture(capture, &mut all);
        drop_seeming(&mut all);
    }
    let group = board.and_then(|_| groups::find(photographs));
    let lost = maps.and_then(|maps| LostHighlights::find(maps, photographs));
    if let Some(&LostHighlights { share, .. }) = lost.as_ref() {
        all.iter_mut().for_each(|hints| hints.push(Hint::Saturated { share }));
    }
    fits::tell(board, maps, photographs, fits, group, &mut all);
    all
}

/// Drops hints about light where the geometry is wrong: squares in wrong places look brighter than they are and, as one
/// local tone mapping is estimated for all photographs, locally tone-mapped in all of them.
fn drop_seeming(all: &mut [Vec<Hint>]) {
    let is_geometric = |hint: &Hint| matches!(hint, Hint::Cropped { .. } | Hint::BoardBent { .. });
    if !all.iter().flatten().any(is_geometric) {
        return;
    }
    for hints in all {
        let wrong = hints.iter().any(is_geometric);
        hints.retain(|hint| match hint {
            Hint::LocalTone { .. } => false,
            Hint::Exposure { .. } => !wrong,
            _ => true,
        });
    }
}

fn of_board(board: &Board) -> Vec<Vec<Hint>> {
    let poses = board.poses();
    let mut all: Vec<Vec<Hint>> = (0..poses.len())
        .map(|i| super::advice::nothing_new(&poses[..i], &poses[i]).into_iter().collect())
        .collect();
    light::tell(board, &mut all);
    if let Some(difference) = board.difference() {
        all.iter_mut().for_each(|hints| hints.push(Hint::BoardDiffers(difference)));
    }
    all
}

#[cfg(test)]
mod tests;
