//! Regions of neighbouring cells that deviate.

use super::left_out::{Deviation, Deviations};
use crate::estimate::Part;

/// Least deviations (logarithm, standard deviations) of a clear cell, and of cells that are joined to it.
const CLEAR: (f32, f32) = (0.15, 4.0);
const BESIDE: (f32, f32) = (0.05, 1.7);
/// Least logarithm of a deviation of one standard deviation: colours may differ without brightness.
const BY_SIGMAS: f32 = 0.02;
/// Least shares of the sample: of clear cells, and with the cells joined to them.
const SHARE_MIN: (f32, f32) = (0.01, 0.03);
/// Another photograph may be the outlier if its deviation exceeds this share of the clearest one's.
const RIVAL: f32 = 1.0 / 1.5;
/// Largest median deviation of agreeing photographs in a region, in standard deviations.
const AGREE: f32 = 2.5;

/// Neighbouring cells that deviate in one photograph.
#[derive(Debug, Clone)]
pub(super) struct Region {
    /// Cells to mask: the region with a border of cells that may deviate in part.
    pub cells: Vec<bool>,
    /// Cells that deviate clearly.
    clear: Vec<usize>,
    pub part: Part,
}

/// The region with the largest deviation, summed over its cells, and its photograph.
pub(super) fn clearest(deviations: &Deviations, size: [usize; 2]) -> Option<(usize, Region)> {
    let all = &deviations.photographs;
    let mut best: Option<(f32, usize, Region)> = None;
    for (index, cells) in all.iter().enumerate() {
        for region in regions(cells, size) {
            let score = off(cells, &region);
            if best.as_ref().is_none_or(|(most, ..)| score > *most) {
                best = Some((score, index, region));
            }
        }
    }
    best.map(|(_, index, region)| (index, region))
}

/// Other photographs that may be the outlier in a region.
pub(super) fn rivals<'a>(
    deviations: &'a Deviations,
    region: &'a Region,
    index: usize,
) -> impl Iterator<Item = usize> + 'a {
    let all = &deviations.photographs;
    let limit = RIVAL * off(&all[index], region);
    (0..all.len()).filter(move |&i| i != index && off(&all[i], region) > limit)
}

/// Whether the photographs agree in a region once photograph `index` is masked there.
pub(super) fn agree(without: &Deviations, region: &Region, index: usize) -> bool {
    let usual = |cells: &[Option<Deviation>]| {
        let mut off: Vec<f32> =
            region.clear.iter().filter_map(|&cell| Some(cells[cell]?.sigmas)).collect();
        median(&mut off).unwrap_or(0.0)
    };
    let others = without.photographs.iter().enumerate().filter(|(i, _)| *i != index);
    others.map(|(_, cells)| usual(cells)).all(|off| off < AGREE)
}

/// Deviation of a photograph in a region, summed over its clear cells.
fn off(cells: &[Option<Deviation>], region: &Region) -> f32 {
    region.clear.iter().filter_map(|&cell| cells[cell].as_ref()).map(|d| d.sigmas).sum()
}

fn regions(cells: &[Option<Deviation>], size: [usize; 2]) -> Vec<Region> {
    let beyond = |cell: usize, (log, sigmas): (f32, f32)| {
        cells[cell]
            .is_some_and(|d| d.sigmas > sigmas && d.log.abs().max(BY_SIGMAS * d.sigmas) > log)
    };
    let mut seen = vec![false; cells.len()];
    let mut out = Vec::new();
    for start in 0..cells.len() {
        if seen[start] || !beyond(start, CLEAR) {
            continue;
        }
        let (mut members, mut next) = (vec![false; cells.len()], vec![start]);
        (members[start], seen[start]) = (true, true);
        while let Some(cell) = next.pop() {
            for other in neighbours(cell, size) {
                if !members[other] && beyond(other, BESIDE) {
                    (members[other], seen[other]) = (true, true);
                    next.push(other);
                }
            }
        }
        let clear: Vec<usize> =
            (0..cells.len()).filter(|&c| members[c] && beyond(c, CLEAR)).collect();
        let count = members.iter().filter(|member| **member).count() as f32;
        let all = cells.len() as f32;
        if clear.len() as f32 >= SHARE_MIN.0 * all && count >= SHARE_MIN.1 * all {
            out.push(region(cells, &members, clear, size));
        }
    }
    out
}

fn region(
    cells: &[Option<Deviation>],
    members: &[bool],
    clear: Vec<usize>,
    size: [usize; 2],
) -> Region {
    let with_border = |cell: usize| {
        members[cell] || neighbours(cell, size).into_iter().any(|other| members[other])
    };
    let inside: Vec<usize> = (0..cells.len()).filter(|&cell| members[cell]).collect();
    let count = inside.len() as f32;
    let place = |k: usize| {
        let at = |cell: usize| if k == 0 { cell % size[0] } else { cell / size[0] };
        inside.iter().map(|&cell| at(cell) as f32 + 0.5).sum::<f32>() / (count * size[k] as f32)
    };
    let usual = |of: fn(Deviation) -> f32| {
        let mut all: Vec<f32> = clear.iter().filter_map(|&cell| cells[cell].map(of)).collect();
        median(&mut all).unwrap_or(0.0)
    };
    let share = count / cells.len() as f32;
    let (ratio, highlight) = (usual(|d| d.log).exp(), usual(|d| d.highlight));
    let part = Part { share, centre: [place(0), place(1)], ratio, highlight };
    Region { cells: (0..cells.len()).map(with_border).collect(), clear, part }
}

fn neighbours(cell: usize, [columns, rows]: [usize; 2]) -> Vec<usize> {
    let (x, y) = (cell % columns, cell / columns);
    let around = (y.saturating_sub(1)..=(y + 1).min(rows - 1)).flat_map(|v| {
        (x.saturating_sub(1)..=(x + 1).min(columns - 1)).map(move |u| v * columns + u)
    });
    around.filter(|&other| other != cell).collect()
}

fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}
