//! Seamless maps: a patch from inside laid over each border, with one cut for all maps, joined in
//! the gradient domain.
//!
//! Along each axis the two borders are brought together and covered by a patch of the material
//! itself, placed where its edges fit best. Where the patch begins and ends is the path of least
//! difference over all maps at once (Kwatra et al., *Graphcut Textures*, 2003; a path is the cut of
//! least cost here, and is found by dynamic programming). Differences between neighbours, those
//! across a cut being the mean of either side's, are then integrated with periodic borders (Pérez
//! et al., *Poisson Image Editing*, 2003), so that no step is left. The size in texels and mm stays.

use super::poisson::{Border, Differences, Grid};
use super::stack::Stack;
use crate::svbrdf::CHANNELS;
use crate::{Error, Result, Svbrdf, parallel};

/// Fewest texels along a side.
const MIN_SIDE: usize = 16;

/// Longer side at which places for the patch are tried first, texels.
const SEARCH_SIDE: usize = 96;

/// Seamless maps.
#[derive(Debug)]
pub(super) struct Tiled {
    pub maps: Svbrdf,
    /// Mean difference of neighbours where tiles meet against that inside, of the map for which it
    /// is greatest; 1: the border is like the inside.
    pub seam: f32,
    /// How much the two sides of the cuts disagree about the difference of neighbours, in the same
    /// unit; independent textures would be at about 1.4.
    pub cuts: f32,
}

/// Makes maps seamless.
///
/// # Errors
/// [`Error::Argument`] where a side has fewer than 16 texels.
pub(super) fn seamless(maps: &Svbrdf) -> Result<Tiled> {
    let (w, h) = (maps.width(), maps.height());
    if w.min(h) < MIN_SIDE {
        let message =
            format!("{w} x {h} texels given, at least {MIN_SIDE} x {MIN_SIDE} can become seamless");
        return Err(Error::argument("maps", message));
    }
    let (across, first) = joined(&Stack::of(maps), false);
    let (both, second) = joined(&across.transposed(), true);
    let tile = both.transposed().with_quiet_borders();
    Ok(Tiled { seam: tile.border(), cuts: first.max(second), maps: tile.into_maps() })
}

/// A patch over the left and right borders.
struct Patch<'a> {
    stack: &'a Stack,
    /// Columns that it covers of each border at most.
    half: usize,
    /// Column and row of the source that come to lie at column 0, row 0.
    source: [usize; 2],
    /// First patched column of each row, counted from `width - half`.
    begin: Vec<usize>,
    /// First column of each row behind the patch.
    end: Vec<usize>,
}

/// Makes columns periodic, and tells how much the sides of the cuts disagree. `closed`: rows are
/// periodic already.
fn joined(stack: &Stack, closed: bool) -> (Stack, f32) {
    let source = place(stack, closed);
    let patch = Patch::cut(stack, source, closed);
    let borders = [Border::Periodic, if closed { Border::Periodic } else { Border::Free }];
    let grid = Grid { width: stack.width, height: stack.height, borders, spacing: [1.0; 2] };
    let planes = parallel::map(CHANNELS, |c| {
        let mut plane = grid.integrate(&patch.differences(c));
        // Integration leaves the mean open.
        let n = plane.len();
        let mean = (0..n).map(|i| patch.value(c, i % stack.width, i / stack.width)).sum::<f32>();
        plane.iter_mut().for_each(|v| *v += mean / n as f32);
        plane
    });
    (Stack { width: stack.width, height: stack.height, planes }, patch.disagreement(closed))
}

/// Columns that a patch covers of each border.
fn half_width(stack: &Stack) -> usize {
    (stack.width / 8).max(2)
}

/// Where the patch comes from: all places of a small copy, then those around the best.
fn place(stack: &Stack, closed: bool) -> [usize; 2] {
    let factor = stack.width.max(stack.height).div_ceil(SEARCH_SIDE);
    let small = stack.reduced(factor);
    let half = half_width(&small);
    // Differences across a cut need one column more of the source on either side.
    let columns = half + 1..small.width - half;
    let rows = if closed { small.height } else { 1 };
    let weights = small.weights();
    let places: Vec<[usize; 2]> = columns.flat_map(|x| (0..rows).map(move |y| [x, y])).collect();
    let best = cheapest(&small, &weights, &places);
    if factor == 1 {
        return best;
    }
    let half = half_width(stack);
    let weights = stack.weights();
    let mut at = [
        (best[0] * factor).clamp(half + 1, stack.width - half - 1),
        if closed { best[1] * factor % stack.height } else { 0 },
    ];
    let around = |v: usize, low: usize, high: usize| {
        (v + 1).saturating_sub(factor).max(low)..(v + factor).min(high)
    };
    let places: Vec<_> = around(at[0], half + 1, stack.width - half).map(|x| [x, at[1]]).collect();
    at = cheapest(stack, &weights, &places);
    if closed {
        let places: Vec<_> = around(at[1], 0, stack.height).map(|y| [at[0], y]).collect();
        at = cheapest(stack, &weights, &places);
    }
    at
}

/// The place whose two cuts cost least.
fn cheapest(stack: &Stack, weights: &[f32; CHANNELS], places: &[[usize; 2]]) -> [usize; 2] {
    let half = half_width(stack);
    let costs = parallel::map(places.len(), |i| {
        [false, true]
            .map(|right| {
                let errors = errors(stack, weights, half, places[i], right);
                least_path(&errors, half, None).0
            })
            .iter()
            .sum::<f32>()
    });
    let best = costs.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
    best.map_or([half + 1, 0], |(i, _)| places[i])
}

/// Squared differences between the material and the patch over `half` columns at the left or right
/// end of the patch, row by row.
fn errors(
    stack: &Stack,
    weights: &[f32; CHANNELS],
    half: usize,
    [sx, sy]: [usize; 2],
    right: bool,
) -> Vec<f32> {
    let (w, h) = (stack.width, stack.height);
    let (own, from) = if right { (0, sx) } else { (w - half, sx - half) };
    let mut out = vec![0.0; half * h];
    for (plane, weight) in stack.planes.iter().zip(weights) {
        for (y, out) in out.chunks_exact_mut(half).enumerate() {
            let own = &plane[y * w + own..][..half];
            let patch = &plane[(y + sy) % h * w + from..];
            for ((e, a), b) in out.iter_mut().zip(own).zip(patch) {
                *e += weight * (a - b) * (a - b);
            }
        }
    }
    out
}

/// The path of least cost from the first to the last row, a column to either side at most from row
/// to row: its cost and columns. With `start`, it begins there and ends so that it can go on there.
fn least_path(costs: &[f32], width: usize, start: Option<usize>) -> (f32, Vec<usize>) {
    let rows = costs.len() / width;
    let mut total: Vec<f32> = match start {
        None => costs[..width].to_vec(),
        Some(at) => (0..width).map(|x| if x == at { costs[x] } else { f32::MAX }).collect(),
    };
    let mut from = vec![0i8; costs.len()];
    let mut next = vec![0.0; width];
    for y in 1..rows {
        for x in 0..width {
            let (mut best, mut step) = (total[x], 0);
            if x > 0 && total[x - 1] < best {
                (best, step) = (total[x - 1], -1);
            }
            if x + 1 < width && total[x + 1] < best {
                (best, step) = (total[x + 1], 1);
            }
            next[x] = if best == f32::MAX { best } else { best + costs[y * width + x] };
            from[y * width + x] = step;
        }
        std::mem::swap(&mut total, &mut next);
    }
    let allowed = |x: &usize| start.is_none_or(|s| x.abs_diff(s) <= 1);
    let ends = (0..width).filter(allowed).min_by(|&a, &b| total[a].total_cmp(&total[b]));
    let mut x = ends.unwrap_or(0);
    let cost = total[x];
    let mut path = vec![x; rows];
    for y in (1..rows).rev() {
        x = x.strict_add_signed(from[y * width + x].into());
        path[y - 1] = x;
    }
    (cost, path)
}

/// The path of least cost that closes on itself: the best over all starts.
fn least_closed_path(costs: &[f32], width: usize) -> Vec<usize> {
    let paths = parallel::map(width, |start| least_path(costs, width, Some(start)));
    let best = paths.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or_else(Vec::new, |(_, path)| path)
}

impl<'a> Patch<'a> {
    fn cut(stack: &'a Stack, source: [usize; 2], closed: bool) -> Self {
        let half = half_width(stack);
        let weights = stack.weights();
        let [begin, end] = [false, true].map(|right| {
            let costs = errors(stack, &weights, half, source, right);
            if closed { least_closed_path(&costs, half) } else { least_path(&costs, half, None).1 }
        });
        // At least one column of the patch on either side of the border.
        let end = end.into_iter().map(|x| x.max(1)).collect();
        Self { stack, half, source, begin, end }
    }

    /// Whether a texel is the patch's.
    fn covers(&self, x: usize, y: usize) -> bool {
        x < self.end[y] || x >= self.stack.width - self.half + self.begin[y]
    }

    /// Where the patch's texel comes from.
    fn origin(&self, x: usize, y: usize) -> usize {
        let (w, h) = (self.stack.width, self.stack.height);
        let [sx, sy] = self.source;
        let column = if x < w / 2 { sx + x } else { sx + x - w };
        (y + sy) % h * w + column
    }

    fn value(&self, c: usize, x: usize, y: usize) -> f32 {
        let i = if self.covers(x, y) { self.origin(x, y) } else { y * self.stack.width + x };
        self.stack.planes[c][i]
    }

    /// Difference between two neighbouring texels: of the source that has both, or the mean.
    fn difference(&self, c: usize, a: [usize; 2], b: [usize; 2]) -> f32 {
        match (self.covers(a[0], a[1]), self.covers(b[0], b[1])) {
            (false, false) => self.own(c, a, b),
            (true, true) => self.patch(c, a, b),
            _ => 0.5 * (self.own(c, a, b) + self.patch(c, a, b)),
        }
    }

    fn own(&self, c: usize, a: [usize; 2], b: [usize; 2]) -> f32 {
        let (plane, w) = (&self.stack.planes[c], self.stack.width);
        plane[b[1] * w + b[0]] - plane[a[1] * w + a[0]]
    }

    fn patch(&self, c: usize, a: [usize; 2], b: [usize; 2]) -> f32 {
        let plane = &self.stack.planes[c];
        plane[self.origin(b[0], b[1])] - plane[self.origin(a[0], a[1])]
    }

    fn differences(&self, c: usize) -> Differences {
        let (w, h) = (self.stack.width, self.stack.height);
        let all = |step: fn([usize; 2], usize, usize) -> [usize; 2]| {
            (0..w * h)
                .map(|i| [i % w, i / w])
                .map(|a| self.difference(c, a, step(a, w, h)))
                .collect()
        };
        Differences {
            right: all(|[x, y], w, _| [(x + 1) % w, y]),
            down: all(|[x, y], _, h| [x, (y + 1) % h]),
        }
    }

    /// How much the two sources' differences differ along the cuts, see [`Tiled::cuts`].
    fn disagreement(&self, closed: bool) -> f32 {
        let (w, h) = (self.stack.width, self.stack.height);
        let neighbour = |i: usize, axis: usize| match axis {
            0 => [(i % w + 1) % w, i / w],
            _ => [i % w, (i / w + 1) % h],
        };
        let pairs: Vec<(usize, usize)> = (0..w * h)
            .flat_map(|i| [(i, 0), (i, 1)])
            .filter(|&(i, axis)| {
                let to = neighbour(i, axis);
                (closed || axis == 0 || i / w + 1 < h)
                    && self.covers(i % w, i / w) != self.covers(to[0], to[1])
            })
            .collect();
        self.stack.relative(&pairs, |c, i, axis| {
            let (a, b) = ([i % w, i / w], neighbour(i, axis));
            (self.own(c, a, b) - self.patch(c, a, b)).abs()
        })
    }
}

#[cfg(test)]
#[path = "tile_tests.rs"]
mod tests;
