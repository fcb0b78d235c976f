//! Chooses source and outline of a patch over the left and right borders of a [`Stack`]: the
//! position and the cuts with the least difference to the material below.

use std::borrow::Cow;
use std::ops::Range;

use super::stack::Stack;
use crate::parallel;

/// Longer side of the smallest copy for the position search, texels.
const SEARCH_SIDE: usize = 96;

/// Weight of differences of values beside those of slopes.
const VALUES: f32 = 0.3;

/// Ratio of the resolutions of successive searches.
const REFINEMENT: usize = 4;

/// Largest number of columns covered at each border, in sixteenths of the width: wide patches leave
/// more choice of cuts, narrow ones more source positions.
const WIDTHS: [usize; 2] = [2, 3];

/// A patch over the left and right borders, and its outline.
#[derive(Debug)]
pub(super) struct Cuts {
    /// Column and row of the source at column 0, row 0.
    pub source: [usize; 2],
    /// Largest number of columns covered at each border.
    pub half: usize,
    /// First patched column of each row on the right.
    pub begin: Vec<usize>,
    /// First column of each row after the patch on the left.
    pub end: Vec<usize>,
}

impl Cuts {
    /// The patch with the cheapest cuts. With `closed`, rows are periodic.
    pub fn cheapest(stack: &Stack, closed: bool) -> Self {
        let levels = Levels::of(stack);
        let places = WIDTHS.map(|sixteenths| Search { sixteenths, closed }.place(&levels));
        let [narrow, wide] = places;
        let (_, source, half) = if wide.0 < narrow.0 { wide } else { narrow };
        let [begin, end] = [false, true].map(|right| {
            let costs = Strip { level: levels.finest(), half, source, right }.all_errors();
            if closed { least_closed_path(&costs, half) } else { least_path(&costs, half, None) }
        });
        let first = stack.width - half;
        Self {
            source,
            half,
            begin: begin.into_iter().map(|x| first + x).collect(),
            // At least one column of the patch lies on either side of the border.
            end: end.into_iter().map(|x| x.max(1)).collect(),
        }
    }
}

/// The maps, or a smaller copy of them.
struct Level<'a> {
    stack: Cow<'a, Stack>,
    weights: Vec<f32>,
    /// Texels per texel of the copy, along each side.
    factor: usize,
}

impl<'a> Level<'a> {
    fn new(stack: &'a Stack, factor: usize) -> Self {
        let stack = match factor {
            1 => Cow::Borrowed(stack),
            _ => Cow::Owned(stack.reduced(factor)),
        };
        Self { weights: stack.weights(), stack, factor }
    }
}

/// Resolutions of the search; the last are the maps themselves.
struct Levels<'a> {
    coarsest: Level<'a>,
    finer: Vec<Level<'a>>,
}

impl<'a> Levels<'a> {
    fn of(stack: &'a Stack) -> Self {
        let mut factor = stack.width.max(stack.height).div_ceil(SEARCH_SIDE);
        let coarsest = Level::new(stack, factor);
        let mut finer = Vec::new();
        while factor > 1 {
            factor = factor.div_ceil(REFINEMENT);
            finer.push(Level::new(stack, factor));
        }
        Self { coarsest, finer }
    }

    fn finest(&self) -> &Level<'a> {
        self.finer.last().unwrap_or(&self.coarsest)
    }
}

/// A search for the source position of a patch of some width.
struct Search {
    sixteenths: usize,
    /// Whether rows are periodic.
    closed: bool,
}

impl Search {
    fn half(&self, stack: &Stack) -> usize {
        (self.sixteenths * stack.width / 16).max(2)
    }

    /// Cost, source and half width, see [`Cuts`]: the best position of the smallest copy, refined
    /// in larger ones.
    fn place(&self, levels: &Levels) -> (f32, [usize; 2], usize) {
        let (small, mut factor) = (&levels.coarsest.stack, levels.coarsest.factor);
        let half = self.half(small);
        // Differences across a cut need one more source column on either side.
        let columns = half + 1..small.width - half;
        let rows = if self.closed { small.height } else { 1 };
        let places: Vec<_> = columns.flat_map(|x| (0..rows).map(move |y| [x, y])).collect();
        let (mut cost, mut at) = self.cheapest(&levels.coarsest, &places);
        for level in &levels.finer {
            let (copy, finer) = (&level.stack, level.factor);
            let (half, reach) = (self.half(copy), factor.div_ceil(finer) as isize);
            at = at.map(|v| v * factor / finer);
            let column = |d| at[0].saturating_add_signed(d).clamp(half + 1, copy.width - half - 1);
            let columns: Vec<_> =
                (-reach..=reach).map(|d| [column(d), at[1] % copy.height]).collect();
            (cost, at) = self.cheapest(level, &columns);
            if self.closed {
                let row = |d: isize| (at[1] as isize + d).rem_euclid(copy.height as isize) as usize;
                let rows: Vec<_> = (-reach..=reach).map(|d| [at[0], row(d)]).collect();
                (cost, at) = self.cheapest(level, &rows);
            }
            factor = finer;
        }
        (cost, at, self.half(&levels.finest().stack))
    }

    /// The position with the cheapest cuts, and their cost.
    fn cheapest(&self, level: &Level, places: &[[usize; 2]]) -> (f32, [usize; 2]) {
        /// Positions evaluated together, row by row, to share reads.
        const TOGETHER: usize = 4;
        let half = self.half(&level.stack);
        let groups: Vec<_> = places.chunks(TOGETHER).collect();
        // One cost for the left and one for the right cut of each group.
        let costs = parallel::map(2 * groups.len(), |i| {
            let right = i % 2 == 1;
            let strip = |&source| Strip { level, half, source, right };
            least_costs(&groups[i / 2].iter().map(strip).collect::<Vec<_>>())
        });
        let sums = costs.chunks_exact(2).flat_map(|c| c[0].iter().zip(&c[1]).map(|(a, b)| a + b));
        let best = sums.zip(places.iter().copied()).min_by(|a, b| a.0.total_cmp(&b.0));
        best.unwrap_or((f32::MAX, [half + 1, 0]))
    }
}

/// The columns at the left or right end of a patch that may contain the cut.
struct Strip<'a> {
    level: &'a Level<'a>,
    half: usize,
    /// As in [`Cuts`].
    source: [usize; 2],
    right: bool,
}

impl Strip<'_> {
    /// Differences between material and patch in a row: squared differences of slopes, plus
    /// weighted squared differences of values, which are blended later. `above` holds the
    /// difference of each channel in the row before, and afterwards in this one.
    fn errors(&self, y: usize, above: &mut [f32], errors: &mut [f32]) {
        let (stack, half, [sx, sy]) = (&self.level.stack, self.half, self.source);
        let (w, h) = (stack.width, stack.height);
        let (own, from) = if self.right { (0, sx) } else { (w - half, sx - half) };
        let cost = |value: f32, along: f32, down: f32| {
            VALUES * value * value + along * along + down * down
        };
        errors.fill(0.0);
        let weights = &self.level.weights;
        let channels = stack.planes.iter().zip(weights).zip(above.chunks_exact_mut(half));
        for ((plane, weight), above) in channels {
            let here = &plane[y * w + own..][..half];
            let there = &plane[(y + sy) % h * w + from..][..half];
            if y == 0 {
                let pairs = here.iter().zip(there);
                above.iter_mut().zip(pairs).for_each(|(d, (a, b))| *d = a - b);
            }
            let first = here[0] - there[0];
            errors[0] += weight * cost(first, 0.0, first - above[0]);
            above[0] = first;
            // Equal slice lengths allow vectorisation.
            let n = half - 1;
            let (before, here) = (&here[..n], &here[1..]);
            let (there_before, there) = (&there[..n], &there[1..]);
            let (above, errors) = (&mut above[1..], &mut errors[1..]);
            for x in 0..n {
                let d = here[x] - there[x];
                let along = d - (before[x] - there_before[x]);
                errors[x] += weight * cost(d, along, d - above[x]);
                above[x] = d;
            }
        }
    }

    fn all_errors(&self) -> Vec<f32> {
        let mut errors = vec![0.0; self.half * self.level.stack.height];
        let mut above = vec![0.0; self.half * self.level.stack.planes.len()];
        for (y, row) in errors.chunks_exact_mut(self.half).enumerate() {
            self.errors(y, &mut above, row);
        }
        errors
    }
}

/// Cost of the cheapest path through each of several strips of one size.
fn least_costs(strips: &[Strip]) -> Vec<f32> {
    let Some(Strip { level, half, .. }) = strips.first() else { return Vec::new() };
    let mut errors = vec![0.0; *half];
    let start = || (vec![0.0; half * level.stack.planes.len()], Totals::new(vec![0.0; *half]));
    let mut states: Vec<_> = strips.iter().map(|_| start()).collect();
    for y in 0..level.stack.height {
        for (strip, (above, totals)) in strips.iter().zip(&mut states) {
            strip.errors(y, above, &mut errors);
            totals.advance(&errors);
        }
    }
    states.into_iter().map(|(_, totals)| totals.least(0..*half)).collect()
}

/// Costs of the cheapest paths to each column of a row.
struct Totals {
    /// Padded by two unreachable columns.
    row: Vec<f32>,
    next: Vec<f32>,
}

impl Totals {
    fn new(costs: Vec<f32>) -> Self {
        let beyond = [f32::INFINITY];
        let row = [&beyond, costs.as_slice(), &beyond].concat();
        Self { next: row.clone(), row }
    }

    /// Advances to the next row with the given costs.
    fn advance(&mut self, costs: &[f32]) {
        let n = costs.len();
        let (left, here, right) = (&self.row[..n], &self.row[1..][..n], &self.row[2..][..n]);
        let next = &mut self.next[1..][..n];
        let less = |a: f32, b: f32| if b < a { b } else { a };
        for x in 0..n {
            next[x] = less(less(here[x], left[x]), right[x]) + costs[x];
        }
        std::mem::swap(&mut self.row, &mut self.next);
    }

    /// The smallest cost of some columns.
    fn least(&self, columns: Range<usize>) -> f32 {
        self.row[1..][columns].iter().copied().fold(f32::INFINITY, f32::min)
    }
}

/// Columns of the cheapest path from the first to the last row, with at most one column of shift
/// per row. With `start`, the path starts there and ends next to it, so that it can continue there.
fn least_path(costs: &[f32], width: usize, start: Option<usize>) -> Vec<usize> {
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
    let mut path = vec![x; rows];
    for y in (1..rows).rev() {
        x = x.strict_add_signed(from[y * width + x].into());
        path[y - 1] = x;
    }
    path
}

/// The cheapest closed path: the best over all starts.
fn least_closed_path(costs: &[f32], width: usize) -> Vec<usize> {
    let closed = parallel::map(width, |start| {
        let only = |x: usize| if x == start { costs[x] } else { f32::INFINITY };
        let mut totals = Totals::new((0..width).map(only).collect());
        costs.chunks_exact(width).skip(1).for_each(|row| totals.advance(row));
        totals.least(start.saturating_sub(1)..(start + 2).min(width))
    });
    let best = (0..width).min_by(|&a, &b| closed[a].total_cmp(&closed[b]));
    least_path(costs, width, best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Comparison with all paths of a small grid.
    #[test]
    fn the_cheapest_path_is_found() {
        let (width, rows) = (4, 5);
        let mut random = Random::new(1);
        let costs: Vec<f32> = (0..width * rows).map(|_| random.uniform() as f32).collect();
        let mut best = [f32::MAX; 2];
        for code in 0..width * 3usize.pow(rows as u32 - 1) {
            let (start, mut steps) = (code % width, code / width);
            let (mut x, mut cost, mut inside) = (start as isize, costs[start], true);
            for y in 1..rows {
                x += (steps % 3) as isize - 1;
                steps /= 3;
                inside &= (0..width as isize).contains(&x);
                if !inside {
                    break;
                }
                cost += costs[y * width + x as usize];
            }
            if inside {
                best[0] = best[0].min(cost);
                if x.abs_diff(start as isize) <= 1 {
                    best[1] = best[1].min(cost);
                }
            }
        }
        let sum = |path: &[usize]| -> f32 {
            path.iter().enumerate().map(|(y, &x)| costs[y * width + x]).sum()
        };
        assert!((sum(&least_path(&costs, width, None)) - best[0]).abs() < 1e-6);
        let closed = least_closed_path(&costs, width);
        assert!((sum(&closed) - best[1]).abs() < 1e-6);
        assert!(closed[0].abs_diff(closed[rows - 1]) <= 1);
    }
}
