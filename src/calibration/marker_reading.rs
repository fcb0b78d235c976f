//! Placement by the markers of a charuco ring. Markers name their squares, so a few corners of a
//! cropped board suffice.

use super::board_model::BoardModel;
use super::lattice::Node;
use super::layout::{Labelling, Layout};
use super::luma::LumaImage;
use super::markers::{Dictionary, Placed};
use super::target::{Target, TargetKind};
use super::turns::board_of_lattice;
use crate::BoardDifference;
use glam::{DVec2, IVec2};
use std::collections::HashMap;

/// Modules along the side of the largest markers.
const MODULES_MAX: usize = 9;
/// White minus black relative to white, on the square-root scale.
const CONTRAST_MIN: f32 = 0.25;
/// Border modules that may be misread, and samples of the quiet zone.
const BORDER_WRONG_MAX: usize = 1;
const QUIET_WRONG_MAX: usize = 3;
/// Side of a square that is legible, px.
const SQUARE_PX: f64 = 48.0;
/// Pieces of lattice tried.
const PIECES_TRIED: usize = 60;
/// Markers that must agree on a placement.
pub(super) const VOTES_MIN: usize = 2;
/// Markers that establish a contradiction: known ids of the board, and unknown ones.
const CONTRADICTING_MIN: u32 = 4;
const UNKNOWN_MIN: u32 = 8;
/// Depths of a square relative to its width to try for a single row of corners, which fixes only
/// the direction.
const DEPTHS: [f64; 19] = [
    0.3, 0.34, 0.38, 0.43, 0.48, 0.54, 0.61, 0.69, 0.77, 0.87, 0.98, 1.1, 1.24, 1.4, 1.57, 1.77,
    2.0, 2.24, 2.52,
];

/// The pyramid level (full size first) for reading squares that have `square_px` px at `level`.
pub(super) fn reading_level(square_px: f64, level: usize) -> usize {
    (0..=level).rev().find(|k| square_px * f64::from(1 << (level - k)) >= SQUARE_PX).unwrap_or(0)
}

/// Number of visible markers that agree with the labelling, and that clearly contradict it: markers
/// of other squares, or markers where none is printed (a board of another size).
pub(super) fn agreement(
    layout: &Layout,
    image: &LumaImage,
    labelling: &Labelling,
) -> (usize, usize) {
    let (mut agree, mut differ) = (0, 0);
    let Some(print) = Print::of(layout.target) else { return (0, 0) };
    for placed in &layout.markers {
        let corner = placed.square.as_dvec2();
        let at = |p: DVec2| labelling.model.project(corner + p);
        match read(image, at, &print) {
            Some(bits) if placed.marker.is(bits) => agree += 1,
            Some(bits) if named(layout, bits, 0).is_some() => differ += 1,
            _ => {}
        }
    }
    for square in &layout.unprinted {
        let at = |p: DVec2| labelling.model.project(square.as_dvec2() + p);
        let known = |bits: u64| print.dictionary.contains(bits);
        differ += usize::from(read(image, at, &print).is_some_and(known));
    }
    (agree, differ)
}

/// Contradiction of the description: most markers belong to other squares, are turned, mirrored or
/// of another dictionary.
pub(super) fn contradiction(
    layout: &Layout,
    image: &LumaImage,
    labelling: &Labelling,
) -> Option<BoardDifference> {
    let print = Print::of(layout.target)?;
    let (mut agree, mut elsewhere, mut mirrored, mut unknown) = (0, 0, 0, 0);
    for placed in &layout.markers {
        let corner = placed.square.as_dvec2();
        let at = |p: DVec2| labelling.model.project(corner + p);
        let Some(bits) = read(image, at, &print) else { continue };
        let is_named = |bits| (0..4).any(|turn| named(layout, bits, turn).is_some());
        let count = if placed.marker.is(bits) {
            &mut agree
        } else if is_named(bits) {
            &mut elsewhere
        } else if is_named(print.mirrored(bits)) {
            &mut mirrored
        } else {
            &mut unknown
        };
        *count += 1;
    }
    let clear = |count: u32, needed: u32| count >= needed && count > 2 * agree;
    if clear(mirrored, CONTRADICTING_MIN) && mirrored > elsewhere {
        Some(BoardDifference::MarkersMirrored { count: mirrored })
    } else if clear(elsewhere, CONTRADICTING_MIN) {
        Some(BoardDifference::MarkersElsewhere { count: elsewhere })
    } else if clear(unknown, UNKNOWN_MIN) {
        Some(BoardDifference::MarkersUnknown { count: unknown })
    } else {
        None
    }
}

/// Places pieces of lattice found at pyramid level `level` by the markers between their corners.
pub(super) fn place(
    layout: &Layout,
    levels: &[&LumaImage],
    level: usize,
    pieces: &[Vec<Node>],
) -> Option<Labelling> {
    let print = Print::of(layout.target)?;
    let image = levels[level];
    let size = (image.width, image.height);
    let mut px = vec![None; layout.corners.len()];
    let mut votes = 0;
    for piece in pieces.iter().take(PIECES_TRIED) {
        let Some((turn, shift, agree)) = placement_of(layout, levels, level, piece, &print) else {
            continue;
        };
        votes += agree;
        for node in piece {
            let at = board_of_lattice(node.at, turn, shift).max(IVec2::ZERO).as_uvec2();
            if let Ok(i) = layout.corners.binary_search(&(at.y, at.x)) {
                px[i].get_or_insert(node.px);
            }
        }
    }
    let labelled: Vec<(DVec2, DVec2)> =
        px.iter().enumerate().filter_map(|(i, p)| Some((layout.grid(i), (*p)?))).collect();
    if votes < VOTES_MIN || labelled.len() < 4 {
        return None;
    }
    let (grid, at): (Vec<_>, Vec<_>) = labelled.into_iter().unzip();
    Some(Labelling { px, model: BoardModel::fit(size, &grid, &at)? })
}

/// Rotation and shift that the markers of a piece agree on, and their number.
fn placement_of(
    layout: &Layout,
    levels: &[&LumaImage],
    level: usize,
    piece: &[Node],
    print: &Print,
) -> Option<(usize, IVec2, usize)> {
    let size = (levels[level].width, levels[level].height);
    let flat = |axis: fn(&Node) -> i32| piece.iter().all(|n| axis(n) == axis(&piece[0]));
    let row_only = flat(|n| n.at.x) || flat(|n| n.at.y);
    let model = if row_only {
        None
    } else {
        let lattice: Vec<DVec2> = piece.iter().map(|n| n.at.as_dvec2()).collect();
        let px: Vec<DVec2> = piece.iter().map(|n| n.px).collect();
        BoardModel::fit(size, &lattice, &px)
    };
    // A row with a false corner beside it also has a plane, but a wrong one.
    let by_plane = model.and_then(|m| tally_of(layout, levels, level, piece, print, Some(&m)));
    by_plane.or_else(|| tally_of(layout, levels, level, piece, print, None))
}

/// Votes of a piece's markers. Squares come from a model of the piece's plane or from links alone.
fn tally_of(
    layout: &Layout,
    levels: &[&LumaImage],
    level: usize,
    piece: &[Node],
    print: &Print,
    model: Option<&BoardModel>,
) -> Option<(usize, IVec2, usize)> {
    let nodes: HashMap<[i32; 2], &Node> = piece.iter().map(|n| (n.at.to_array(), n)).collect();
    let mut tally: Vec<(usize, IVec2, usize)> = Vec::new();
    let mut seen: Vec<IVec2> = Vec::new();
    for node in piece {
        for (quadrant, step) in [(1, 1), (-1, 1), (-1, -1), (1, -1)].into_iter().enumerate() {
            let step = IVec2::from(step);
            let square = node.at.min(node.at + step);
            let bright = node.bright == quadrant.is_multiple_of(2);
            if !bright || seen.contains(&square) {
                continue;
            }
            let named = match model {
                Some(model) => {
                    let corner = square.as_dvec2();
                    read_square(levels, level, layout, print, |p| model.project(corner + p))
                }
                None => along_row(levels, level, layout, print, &nodes, node, step),
            };
            let Some((turn, on_board)) = named else { continue };
            seen.push(square);
            // The square's first corner on the board is the smallest of its turned corners.
            let a = board_of_lattice(square, turn, IVec2::ZERO);
            let b = board_of_lattice(square + IVec2::ONE, turn, IVec2::ZERO);
            let shift = on_board - a.min(b);
            match tally.iter_mut().find(|t| (t.0, t.1) == (turn, shift)) {
                Some(t) => t.2 += 1,
                None => tally.push((turn, shift, 1)),
            }
        }
    }
    tally.sort_by_key(|t| std::cmp::Reverse(t.2));
    let best = *tally.first()?;
    // Require a clear majority of the piece's markers.
    let others: usize = tally[1..].iter().map(|t| t.2).sum();
    (best.2 > 2 * others).then_some(best)
}

/// Reads the square beside a link of a single row, whose depth is unknown.
fn along_row(
    levels: &[&LumaImage],
    level: usize,
    layout: &Layout,
    print: &Print,
    nodes: &HashMap<[i32; 2], &Node>,
    node: &Node,
    step: IVec2,
) -> Option<(usize, IVec2)> {
    let along = [step.with_y(0), step.with_x(0)];
    let other = along.iter().find_map(|d| Some((*d, *nodes.get(&(node.at + *d).to_array())?)));
    let (link, next) = other?;
    let across = step - link;
    let port = |n: &Node| n.port(across);
    let edge = next.px - node.px;
    let depth = 0.5 * (port(node) + port(next)).normalize_or_zero() * 2.0 * edge.length();
    let square = node.at.min(node.at + step).as_dvec2();
    let origin = node.at.as_dvec2();
    DEPTHS.iter().find_map(|&scale| {
        read_square(levels, level, layout, print, |p| {
            let d = square + p - origin;
            let (u, v) = (d.dot(link.as_dvec2()), d.dot(across.as_dvec2()));
            node.px + u * edge + v * scale * depth
        })
    })
}

/// Turn and board square of the marker in a square; `at` gives pixels at `level`.
fn read_square(
    levels: &[&LumaImage],
    level: usize,
    layout: &Layout,
    print: &Print,
    at: impl Fn(DVec2) -> DVec2,
) -> Option<(usize, IVec2)> {
    let side =
        (at(DVec2::X) - at(DVec2::ZERO)).length().min((at(DVec2::Y) - at(DVec2::ZERO)).length());
    let fine = reading_level(side, level);
    let scale = f64::from(1 << (level - fine));
    let bits = read(levels[fine], |p| scale * (at(p) + 0.5) - 0.5, print)?;
    (0..4).find_map(|turn| Some((turn, named(layout, bits, turn)?)))
}

/// The printed marker that equals `bits` on a board turned clockwise `turn` times.
fn named(layout: &Layout, bits: u64, turn: usize) -> Option<IVec2> {
    let alike = |placed: &&Placed| {
        (0..turn).fold(placed.marker, |marker, _| marker.quarter_turn()).is(bits)
    };
    layout.markers.iter().find(alike).map(|m| m.square)
}

struct Print {
    dictionary: Dictionary,
    /// Side of a marker relative to its square.
    share: f64,
}

impl Print {
    /// `None` for boards without known markers.
    fn of(target: &Target) -> Option<Self> {
        let TargetKind::CharucoRing { dictionary, marker_mm } = &target.kind else { return None };
        let dictionary = Dictionary::named(dictionary);
        let share = marker_mm / target.square_mm;
        (dictionary.inner > 0).then_some(Self { dictionary, share })
    }

    /// Modules of the mirrored marker.
    fn mirrored(&self, bits: u64) -> u64 {
        let n = self.dictionary.inner;
        let at = |row: u32, col: u32| bits >> (n * n - 1 - (row * n + col)) & 1;
        (0..n * n).fold(0, |mirrored, i| mirrored << 1 | at(i / n, n - 1 - i % n))
    }
}

/// Markers in the white squares of a board whose corners are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MarkersRead {
    /// Id of the marker that is the first of a board counted from 0, if most markers agree.
    pub first: Option<i32>,
    /// Modules along a side without the border; 0 if none was read.
    pub inner: u32,
    /// Markers read.
    pub count: usize,
}

/// Marker sides relative to their squares, to try for unknown boards.
const SHARES: [f64; 5] = [0.5, 0.6, 0.7, 0.75, 0.8];
/// Dictionaries to try, the largest of each size.
const DICTIONARIES: [&str; 4] = ["DICT_4X4_250", "DICT_5X5_250", "DICT_6X6_250", "DICT_7X7_250"];

/// Reads the markers of a board whose `grid` points (column, row) lie at `px`, with the dictionary
/// that recognises most.
pub(crate) fn read_markers(
    image: &LumaImage,
    target: &Target,
    grid: &[DVec2],
    px: &[DVec2],
) -> MarkersRead {
    let none = MarkersRead { first: None, inner: 0, count: 0 };
    let Some(model) = BoardModel::fit((image.width, image.height), grid, px) else {
        return none;
    };
    let of = |name: &str, share: f64| {
        let dictionary = Dictionary::named(name);
        let print = Print { dictionary, share };
        let mut offsets: Vec<i32> = Vec::new();
        let mut id = 0;
        for row in 0..i64::from(target.rows) {
            for col in (0..i64::from(target.cols)).filter(|col| target.is_white(row, *col)) {
                let corner = DVec2::new(col as f64, row as f64);
                let found = target
                    .has_square(row, col)
                    .then(|| read(image, |p| model.project(corner + p), &print))
                    .flatten()
                    .and_then(|bits| dictionary.id(bits));
                offsets.extend(found.map(|found| found as i32 - id));
                id += 1;
            }
        }
        offsets.sort_unstable();
        let usual = offsets.get(offsets.len() / 2).copied();
        let agree = offsets.iter().filter(|o| Some(**o) == usual).count();
        let first = usual.filter(|_| 2 * agree > offsets.len());
        MarkersRead { first, inner: dictionary.inner, count: offsets.len() }
    };
    let all = DICTIONARIES.into_iter().flat_map(|name| SHARES.map(|share| of(name, share)));
    all.max_by_key(|read| read.count).filter(|read| read.count > 0).unwrap_or(none)
}

/// Bits of the marker in a square, row by row; `at` maps (0..1, 0..1) to pixels. `None` unless the
/// border is black and the quiet zone white.
fn read(image: &LumaImage, at: impl Fn(DVec2) -> DVec2, print: &Print) -> Option<u64> {
    let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(&at);
    if !corners.iter().all(|c| image.contains(*c, 0.0)) {
        return None;
    }
    let (share, modules) = (print.share, print.dictionary.inner as usize + 2);
    let module = share / modules as f64;
    let gap = 0.5 * (1.0 - share);
    let mut level = [[0.0f32; MODULES_MAX]; MODULES_MAX];
    for (row, levels) in level.iter_mut().enumerate().take(modules) {
        for (col, level) in levels.iter_mut().enumerate().take(modules) {
            let centre = DVec2::splat(gap) + module * (DVec2::new(col as f64, row as f64) + 0.5);
            let around = [(0.0, 0.0), (-0.2, 0.0), (0.2, 0.0), (0.0, -0.2), (0.0, 0.2)];
            let sum: f32 = around
                .iter()
                .map(|&(x, y)| image.sample(at(centre + module * DVec2::new(x, y))))
                .sum();
            *level = sum / around.len() as f32;
        }
    }
    let outer = |i: usize| i == 0 || i + 1 == modules;
    let border = || (0..modules * modules).filter(|i| outer(i / modules) || outer(i % modules));
    let black = border().map(|i| level[i / modules][i % modules]).sum::<f32>();
    let black = black / (4 * (modules - 1)) as f32;
    // Halfway between marker and edge.
    let mut quiet = [0.0f32; 16];
    for (i, value) in quiet.iter_mut().enumerate() {
        let t = gap + share * ((i % 4) as f64 + 0.5) / 4.0;
        let near = if i % 8 < 4 { 0.5 * gap } else { 1.0 - 0.5 * gap };
        let p = if i < 8 { DVec2::new(t, near) } else { DVec2::new(near, t) };
        *value = image.sample(at(p));
    }
    let white = quiet.iter().sum::<f32>() / 16.0;
    if white - black <= CONTRAST_MIN * white {
        return None;
    }
    let middle = 0.5 * (white + black);
    let misread = border().filter(|i| level[i / modules][i % modules] > middle).count();
    let soiled = quiet.iter().filter(|v| **v < middle).count();
    if misread > BORDER_WRONG_MAX || soiled > QUIET_WRONG_MAX {
        return None;
    }
    let inner = (1..modules - 1).flat_map(|row| (1..modules - 1).map(move |col| (row, col)));
    Some(inner.fold(0, |bits, (row, col)| bits << 1 | u64::from(level[row][col] > middle)))
}
