//! Seamless maps: a patch from inside laid over each border, with one cut for all maps, joined in
//! the gradient domain.
//!
//! Along each axis, the two borders are brought together and covered by a patch of the material, from the
//! position that fits best. The cuts around the patch are paths of least difference over all maps (Kwatra et
//! al., *Graphcut Textures*, 2003); a path is a minimal cut here, found by dynamic programming. Remaining
//! steps across the cuts are spread over their surroundings so that each difference becomes the mean of both
//! sides', by least squares with a penalty on changes (Bhat et al., *Fourier Analysis of the 2D Screened
//! Poisson Equation*, 2008). The size in texels and mm is unchanged.

use super::cut::Cuts;
use super::poisson::{Border, Spread, Step};
use super::stack::Stack;
use crate::{Error, Result, Svbrdf};

/// Fewest texels along a side.
const MIN_SIDE: usize = 16;

/// Seamless maps.
#[derive(Debug)]
pub(super) struct Tiled {
    pub maps: Svbrdf,
    /// Mean difference of neighbours across the tile's border relative to the inside, for the worst
    /// map; 1 is no visible border.
    pub seam: f32,
    /// The same across the cuts.
    pub joins: f32,
    /// Disagreement of the two sides of the cuts about the difference of neighbours, in the same
    /// unit; independent textures have about 1.4.
    pub cuts: f32,
}

/// Makes maps seamless.
///
/// # Errors
/// [`Error::Argument`] if a side has fewer than 16 texels.
pub(super) fn seamless(maps: &Svbrdf) -> Result<Tiled> {
    let (w, h) = (maps.width(), maps.height());
    if w.min(h) < MIN_SIDE {
        let message =
            format!("{w} x {h} texels given, at least {MIN_SIDE} x {MIN_SIDE} can become seamless");
        return Err(Error::argument("maps", message));
    }
    let across = Joined::new(&Stack::of(maps), false);
    let both = Joined::new(&across.stack.transposed(), true);
    let (tile, seam) = both.stack.transposed().with_quiet_borders();
    Ok(Tiled {
        seam,
        joins: across.joins.max(both.joins),
        cuts: across.cuts.max(both.cuts),
        maps: tile.into_maps(),
    })
}

/// A stack with periodic columns and the quality of its joins, see [`Tiled`].
struct Joined {
    stack: Stack,
    joins: f32,
    cuts: f32,
}

impl Joined {
    /// `closed`: rows are already periodic.
    fn new(stack: &Stack, closed: bool) -> Self {
        let (w, h) = (stack.width, stack.height);
        let patch = Patch { stack, cuts: Cuts::cheapest(stack, closed) };
        let pairs = patch.pairs(closed);
        let borders = [Border::Periodic, if closed { Border::Periodic } else { Border::Free }];
        // Spread steps inside the patch, not over the whole sample.
        let mut spread = Spread::new(w, h, borders, 0.5 * patch.cuts.half as f64);
        let planes = (0..stack.planes.len()).map(|c| {
            let mut plane = patch.plane(c);
            let change = spread.spread(patch.steps(c, &plane, &pairs));
            plane.iter_mut().zip(change).for_each(|(v, change)| *v += *change as f32);
            plane
        });
        let planes = planes.collect();
        let joined = Stack { width: w, height: h, planes };
        let across = |c: usize, pair: &Pair| {
            (joined.planes[c][pair.to.index(w)] - joined.planes[c][pair.from.index(w)]).abs()
        };
        let disagreement = |c: usize, pair: &Pair| {
            let [own, patch] = patch.differences(c, pair);
            (own - patch).abs()
        };
        Self {
            joins: joined.relative(&pairs, |pair| pair.axis, across),
            cuts: stack.relative(&pairs, |pair| pair.axis, disagreement),
            stack: joined,
        }
    }
}

/// A column and a row.
#[derive(Debug, Clone, Copy)]
struct Texel(usize, usize);

impl Texel {
    fn index(self, width: usize) -> usize {
        self.1 * width + self.0
    }
}

/// Neighbours across a cut, side by side (axis 0) or one above the other (axis 1).
struct Pair {
    from: Texel,
    to: Texel,
    axis: usize,
}

/// A patch over the left and right borders.
struct Patch<'a> {
    stack: &'a Stack,
    cuts: Cuts,
}

impl Patch<'_> {
    /// The material covered by the patch.
    fn plane(&self, c: usize) -> Vec<f32> {
        let (w, own) = (self.stack.width, &self.stack.planes[c]);
        let mut plane = own.clone();
        for (y, row) in plane.chunks_exact_mut(w).enumerate() {
            let (end, begin) = (self.cuts.end[y], self.cuts.begin[y]);
            let origin = |x| self.origin(Texel(x, y));
            row[..end].copy_from_slice(&own[origin(0)..][..end]);
            row[begin..].copy_from_slice(&own[origin(begin)..][..w - begin]);
        }
        plane
    }

    /// Source texel of a texel of the patch.
    fn origin(&self, Texel(x, y): Texel) -> usize {
        let (w, h) = (self.stack.width, self.stack.height);
        let [sx, sy] = self.cuts.source;
        let column = if x < w / 2 { sx + x } else { sx + x - w };
        (y + sy) % h * w + column
    }

    /// All pairs of neighbours with exactly one texel in the patch.
    fn pairs(&self, closed: bool) -> Vec<Pair> {
        let (w, h) = (self.stack.width, self.stack.height);
        let mut pairs = Vec::new();
        for y in 0..h {
            for x in [self.cuts.end[y], self.cuts.begin[y]] {
                pairs.push(Pair { from: Texel(x - 1, y), to: Texel(x % w, y), axis: 0 });
            }
            if y + 1 == h && !closed {
                continue;
            }
            let below = (y + 1) % h;
            for cut in [&self.cuts.end, &self.cuts.begin] {
                let (a, b) = (cut[y], cut[below]);
                let columns = a.min(b)..a.max(b);
                let pair = |x| Pair { from: Texel(x, y), to: Texel(x, below), axis: 1 };
                pairs.extend(columns.map(pair));
            }
        }
        pairs
    }

    /// Difference of a pair in the material and in the patch's source.
    fn differences(&self, c: usize, pair: &Pair) -> [f32; 2] {
        let (plane, w) = (&self.stack.planes[c], self.stack.width);
        [
            plane[pair.to.index(w)] - plane[pair.from.index(w)],
            plane[self.origin(pair.to)] - plane[self.origin(pair.from)],
        ]
    }

    /// Changes of the differences across the cuts to the mean of both sides'.
    fn steps(&self, c: usize, plane: &[f32], pairs: &[Pair]) -> Vec<Step> {
        let w = self.stack.width;
        let step = |pair: &Pair| {
            let [own, patch] = self.differences(c, pair);
            let (from, to) = (pair.from.index(w), pair.to.index(w));
            Step { from, to, by: 0.5 * (own + patch) - (plane[to] - plane[from]) }
        };
        pairs.iter().map(step).collect()
    }
}

#[cfg(test)]
#[path = "tile_tests.rs"]
mod tests;
