//! Where a patch over the left and right borders of a [`Stack`] comes from, and where it begins and
//! ends: places and paths at which it differs least from what lies below.

use super::stack::Stack;
use crate::parallel;
use crate::svbrdf::CHANNELS;

/// Longer side at which places for the patch are tried first, texels.
const SEARCH_SIDE: usize = 96;

/// Weight of differences of values beside those of slopes.
const VALUES: f32 = 0.3;

/// How much finer each search is than the one before.
const REFINEMENT: usize = 4;

/// Columns that a patch may cover of each border, sixteenths of the width: wider ones leave the cuts
/// more choice, narrower ones have more places to come from.
const WIDTHS: [usize; 2] = [2, 3];

/// A patch over the left and right borders, and what it covers.
#[derive(Debug)]
pub(super) struct Cuts {
    /// Column and row of the source that come to lie at column 0, row 0.
    pub source: [usize; 2],
    /// Columns that the patch may cover of each border.
    pub half: usize,
    /// First patched column of each row at the right.
    pub begin: Vec<usize>,
    /// First column of each row behind the patch at the left.
    pub end: Vec<usize>,
}

impl Cuts {
    /// The patch whose cuts cost least. `closed`: rows are periodic.
    pub fn cheapest(stack: &Stack, closed: bool) -> Self {
        let places = WIDTHS.map(|sixteenths| Search { sixteenths, closed }.place(stack));
        let [narrow, wide] = places;
        let (_, source, half) = if wide.0 < narrow.0 { wide } else { narrow };
        let weights = stack.weights();
        let [begin, end] = [false, true].map(|right| {
            let costs = errors(stack, &weights, half, source, right);
            if closed { least_closed_path(&costs, half) } else { least_path(&costs, half, None).1 }
        });
        let first = stack.width - half;
        Self {
            source,
            half,
            begin: begin.into_iter().map(|x| first + x).collect(),
            // At least one column of the patch on either side of the border.
            end: end.into_iter().map(|x| x.max(1)).collect(),
        }
    }
}

/// A search for the place that a patch of some width comes from.
struct Search {
    sixteenths: usize,
    /// Whether rows are periodic.
    closed: bool,
}

impl Search {
    fn half(&self, stack: &Stack) -> usize {
        (self.sixteenths * stack.width / 16).max(2)
    }

    /// Cost, source and half width, see [`Cuts`]: the best of all places of a small copy, then of
    /// those around it in larger ones.
    fn place(&self, stack: &Stack) -> (f32, [usize; 2], usize) {
        let mut factor = stack.width.max(stack.height).div_ceil(SEARCH_SIDE);
        let small = stack.reduced(factor);
        let half = self.half(&small);
        // Differences across a cut need one column more of the source on either side.
        let columns = half + 1..small.width - half;
        let rows = if self.closed { small.height } else { 1 };
        let places: Vec<_> = columns.flat_map(|x| (0..rows).map(move |y| [x, y])).collect();
        let (mut cost, mut at) = self.cheapest(&small, &places);
        while factor > 1 {
            let finer = factor.div_ceil(REFINEMENT);
            let copy = stack.reduced(finer);
            let (half, reach) = (self.half(&copy), factor.div_ceil(finer) as isize);
            at = at.map(|v| v * factor / finer);
            let column = |d| at[0].saturating_add_signed(d).clamp(half + 1, copy.width - half - 1);
            let columns: Vec<_> =
                (-reach..=reach).map(|d| [column(d), at[1] % copy.height]).collect();
            (cost, at) = self.cheapest(&copy, &columns);
            if self.closed {
                let row = |d: isize| (at[1] as isize + d).rem_euclid(copy.height as isize) as usize;
                let rows: Vec<_> = (-reach..=reach).map(|d| [at[0], row(d)]).collect();
                (cost, at) = self.cheapest(&copy, &rows);
            }
            factor = finer;
        }
        (cost, at, self.half(stack))
    }

    /// The place whose two cuts cost least, and what they cost.
    fn cheapest(&self, stack: &Stack, places: &[[usize; 2]]) -> (f32, [usize; 2]) {
        let (half, weights) = (self.half(stack), stack.weights());
        let costs = parallel::map(places.len(), |i| {
            let cost =
                |right| least_path(&errors(stack, &weights, half, places[i], right), half, None).0;
            (cost(false) + cost(true), places[i])
        });
        let best = costs.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        best.unwrap_or((f32::MAX, [half + 1, 0]))
    }
}

/// How much the material and the patch differ over `half` columns at the left or right end of the
/// patch, row by row: squared differences of their slopes, and some of their values, which are
/// brought together later on.
fn errors(
    stack: &Stack,
    weights: &[f32; CHANNELS],
    half: usize,
    [sx, sy]: [usize; 2],
    right: bool,
) -> Vec<f32> {
    let (w, h) = (stack.width, stack.height);
    let (own, from) = if right { (0, sx) } else { (w - half, sx - half) };
    let cost =
        |value: f32, along: f32, down: f32| VALUES * value * value + along * along + down * down;
    let mut out = vec![0.0; half * h];
    let (mut here, mut above) = (vec![0.0; half], vec![0.0; half]);
    for (plane, weight) in stack.planes.iter().zip(weights) {
        for (y, out) in out.chunks_exact_mut(half).enumerate() {
            let there = &plane[(y + sy) % h * w + from..][..half];
            let pairs = plane[y * w + own..][..half].iter().zip(there);
            here.iter_mut().zip(pairs).for_each(|(d, (a, b))| *d = a - b);
            if y == 0 {
                above.copy_from_slice(&here);
            }
            out[0] += weight * cost(here[0], 0.0, here[0] - above[0]);
            let pairs = here.windows(2).zip(&above[1..]);
            for (e, (d, above)) in out[1..].iter_mut().zip(pairs) {
                *e += weight * cost(d[1], d[1] - d[0], d[1] - above);
            }
            std::mem::swap(&mut here, &mut above);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Against all paths of a small grid, enumerated.
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
        let (cost, path) = least_path(&costs, width, None);
        assert!((cost - best[0]).abs() < 1e-6 && (sum(&path) - cost).abs() < 1e-6);
        let closed = least_closed_path(&costs, width);
        assert!((sum(&closed) - best[1]).abs() < 1e-6);
        assert!(closed[0].abs_diff(closed[rows - 1]) <= 1);
    }
}
