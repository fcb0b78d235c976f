//! Joins X-corners to pieces of a square lattice.
//!
//! A link leads from a corner along one of its edges to the nearest corner that points back and has the
//! opposite colour order. The edge between them must be dark on one side and bright on the other throughout.
//! Links need no two-dimensional neighbourhood, so single rows of corners grow as well as planes.

use super::corners::Saddle;
use super::luma::LumaImage;
use glam::{DVec2, IVec2};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashSet};

/// Sine of the largest angle between a link and the edge's direction at its start.
const LINK_SINE_MAX: f64 = 0.25;
/// Side of a bucket of the spatial index, px.
const BUCKET_PX: f64 = 16.0;
/// Corners considered for the links of one corner.
const LOOKED_AT_MAX: usize = 250;
/// Least contrast across a link relative to that of the corners.
const EDGE_CONTRAST_MIN: f32 = 0.3;

/// Largest ratio of lengths of a corner's links, caused by foreshortening.
const ASPECT_MAX: f64 = 4.5;
/// Largest ratio of a link to the longest one of its direction in the piece so far.
const STRETCH_MAX: f64 = 2.0;

/// Lattice directions of ports in ascending angle: right, down, left, up as displayed.
const DIRECTIONS: [IVec2; 4] = [IVec2::X, IVec2::Y, IVec2::NEG_X, IVec2::NEG_Y];

/// A corner and its place in a piece of lattice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    /// Lattice position. Origin and quarter turns are arbitrary; handedness is not.
    pub at: IVec2,
    /// Position, px of the level.
    pub px: DVec2,
    /// Whether the square between lattice directions +x and +y is bright.
    pub bright: bool,
    /// Unit directions in the picture of the edges towards lattice +x, +y, -x, -y.
    ports: [DVec2; 4],
}

impl Node {
    /// Direction in the picture of the edge towards a neighbour.
    pub fn port(&self, to: IVec2) -> DVec2 {
        DIRECTIONS.iter().position(|d| *d == to).map_or(DVec2::ZERO, |k| self.ports[k])
    }
}

/// Connected pieces of lattice, largest first, without single corners.
///
/// Pieces grow by the relatively shortest link. A false link across the hole, where the sample's
/// outline may lie on the lattice, thus finds its ends already placed.
pub(super) fn grow(level: &LumaImage, saddles: &[Saddle]) -> Vec<Vec<Node>> {
    let links = mutual_links(level, saddles);
    let length = |a: usize, b: usize| saddles[a].px.distance(saddles[b].px);
    let shortest: Vec<f64> = (0..saddles.len())
        .map(|a| links[a].iter().flatten().map(|l| length(a, l.0)).fold(f64::INFINITY, f64::min))
        .collect();
    let mut placed = vec![false; saddles.len()];
    let mut pieces = Vec::new();
    for seed in 0..saddles.len() {
        if placed[seed] || links[seed].iter().all(Option::is_none) {
            continue;
        }
        let mut piece = Vec::new();
        let mut taken = HashSet::new();
        // Longest link so far and count, along x and along y.
        let mut extent = [(0.0f64, 0); 2];
        let mut queue = BinaryHeap::new();
        queue.push(Reverse(Step { rank: 0, to: seed, at: IVec2::ZERO, turn: 0, link: None }));
        while let Some(Reverse(step)) = queue.pop() {
            if placed[step.to] || taken.contains(&step.at.to_array()) {
                continue;
            }
            if let Some((length, axis)) = step.link {
                let (longest, count) = &mut extent[axis];
                if *count >= 3 && length > STRETCH_MAX * *longest {
                    continue;
                }
                *longest = longest.max(length);
                *count += 1;
            }
            let a = step.to;
            placed[a] = true;
            taken.insert(step.at.to_array());
            let bright = saddles[a].is_bright((4 - step.turn) % 4);
            let ports = std::array::from_fn(|k| saddles[a].ports[(k + 4 - step.turn) % 4]);
            piece.push(Node { at: step.at, px: saddles[a].px, bright, ports });
            for (port, link) in links[a].iter().enumerate() {
                let Some((b, back)) = *link else { continue };
                let relative = length(a, b) / shortest[a].min(shortest[b]);
                if placed[b] || relative > ASPECT_MAX {
                    continue;
                }
                let direction = (port + step.turn) % 4;
                queue.push(Reverse(Step {
                    // Positive floats sort like their bits.
                    rank: relative.to_bits(),
                    to: b,
                    at: step.at + DIRECTIONS[direction],
                    turn: (direction + 6 - back) % 4,
                    link: Some((length(a, b), direction % 2)),
                }));
            }
        }
        if piece.len() > 1 {
            pieces.push(piece);
        }
    }
    pieces.sort_by_key(|p| Reverse(p.len()));
    pieces
}

/// A corner proposed for a piece by a link; the lowest rank is placed first.
struct Step {
    rank: u64,
    to: usize,
    at: IVec2,
    /// Lattice direction of the corner's port 0.
    turn: usize,
    /// Length and axis of the link.
    link: Option<(f64, usize)>,
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.rank, self.to, self.turn).cmp(&(other.rank, other.to, other.turn))
    }
}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Step {}

/// For each port of each corner, the neighbour and its port that points back, if the link is mutual.
fn mutual_links(level: &LumaImage, saddles: &[Saddle]) -> Vec<[Option<(usize, usize)>; 4]> {
    let index = Buckets::new(level, saddles);
    let one_way: Vec<_> =
        (0..saddles.len()).map(|a| links_from(level, saddles, &index, a)).collect();
    let mut links = one_way.clone();
    for (a, own) in links.iter_mut().enumerate() {
        for (port, link) in own.iter_mut().enumerate() {
            *link = link.filter(|&(b, back)| one_way[b][back] == Some((a, port)));
        }
    }
    links
}

fn links_from(
    level: &LumaImage,
    saddles: &[Saddle],
    index: &Buckets,
    a: usize,
) -> [Option<(usize, usize)>; 4] {
    let mut links = [None; 4];
    let mut near: Vec<(f64, usize)> = Vec::new();
    let mut looked_at = 0;
    for ring in 0..index.rings {
        // All corners within this distance have been gathered.
        let complete = BUCKET_PX * ring as f64;
        index.visit_ring(saddles[a].px, ring, |b| {
            near.push(((saddles[b].px - saddles[a].px).length(), b));
        });
        near.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        let ready = near.partition_point(|n| n.0 <= complete);
        for (distance, b) in near.drain(..ready) {
            if b == a || distance < 3.0 {
                continue;
            }
            looked_at += 1;
            let towards = (saddles[b].px - saddles[a].px) / distance;
            let best = |p: &DVec2| p.dot(towards);
            let port = argmax(saddles[a].ports.map(|p| best(&p)));
            if links[port].is_none()
                && saddles[a].ports[port].perp_dot(towards).abs() < LINK_SINE_MAX
                && let Some(back) = matches_back(&saddles[a], &saddles[b], port, towards)
                && edge_between(level, &saddles[a], &saddles[b], port)
            {
                links[port] = Some((b, back));
            }
        }
        if links.iter().all(Option::is_some) || looked_at > LOOKED_AT_MAX {
            break;
        }
    }
    links
}

/// The port of `b` that points back to `a`, if directions and colours agree.
fn matches_back(a: &Saddle, b: &Saddle, port: usize, towards: DVec2) -> Option<usize> {
    let back = argmax(b.ports.map(|p| -p.dot(towards)));
    let side = (back + 3) % 4;
    // Straight within about 20 degrees; the crossing edges are parallel within 30.
    let parallel =
        -b.ports[back].dot(towards) > 0.94 && a.ports[(port + 1) % 4].dot(b.ports[side]) > 0.85;
    // The square between `port` and the next port lies between `side` and `back` at `b`.
    (parallel && a.is_bright(port) == b.is_bright(side)).then_some(back)
}

/// Whether the edge from `a` to `b` is bright on the side of the next port and dark on the other
/// (or the reverse) throughout.
fn edge_between(level: &LumaImage, a: &Saddle, b: &Saddle, port: usize) -> bool {
    let along = b.px - a.px;
    let length = along.length();
    // Stay close to the edge: markers leave about a tenth of a square free.
    let offset = (0.1 * length).clamp(1.2, 4.0) * along.perp() / length;
    let sign = if a.is_bright(port) { 1.0 } else { -1.0 };
    let needed = EDGE_CONTRAST_MIN * a.contrast.min(b.contrast);
    [0.2, 0.35, 0.5, 0.65, 0.8].iter().all(|&t| {
        let p = a.px + t * along;
        sign * (level.sample(p + offset) - level.sample(p - offset)) > needed
    })
}

fn argmax(values: [f64; 4]) -> usize {
    (1..4).fold(0, |best, k| if values[k] > values[best] { k } else { best })
}

/// Spatial index over corners.
struct Buckets {
    columns: usize,
    rows: usize,
    /// Rings to visit.
    rings: usize,
    members: Vec<Vec<u32>>,
}

impl Buckets {
    fn new(level: &LumaImage, saddles: &[Saddle]) -> Self {
        let count = |px: usize| (px as f64 / BUCKET_PX) as usize + 1;
        let (columns, rows) = (count(level.width), count(level.height));
        let mut members = vec![Vec::new(); columns * rows];
        for (i, s) in saddles.iter().enumerate() {
            let (x, y) = Self::bucket(s.px);
            members[y * columns + x].push(i as u32);
        }
        // A square is at most a third of a board that fills the picture.
        Self { columns, rows, rings: columns.max(rows) / 3 + 3, members }
    }

    fn bucket(p: DVec2) -> (usize, usize) {
        ((p.x / BUCKET_PX) as usize, (p.y / BUCKET_PX) as usize)
    }

    /// Calls `f` for the corners in buckets at Chebyshev distance `ring` from that of `p`.
    fn visit_ring(&self, p: DVec2, ring: usize, mut f: impl FnMut(usize)) {
        let (cx, cy) = Self::bucket(p);
        let (cx, cy, r) = (cx as isize, cy as isize, ring as isize);
        for y in (cy - r).max(0)..=(cy + r).min(self.rows as isize - 1) {
            let whole_row = (y - cy).abs() == r;
            let step = if whole_row || r == 0 { 1 } else { 2 * r };
            let mut x = cx - r;
            while x <= cx + r {
                if x >= 0 && x < self.columns as isize {
                    for &i in &self.members[y as usize * self.columns + x as usize] {
                        f(i as usize);
                    }
                }
                x += step;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::corners;
    use super::*;

    /// A checkerboard rotated by `angle`, masked by `printed` (grey elsewhere).
    fn board(angle: f64, cell: f64, printed: impl Fn(i64, i64) -> bool) -> LumaImage {
        let (width, height) = (320, 240);
        let data = (0..width * height)
            .map(|i| {
                let mut sum = 0.0;
                for k in 0..16 {
                    let sub = DVec2::new(f64::from(k % 4), f64::from(k / 4)) / 4.0 - 0.375;
                    let p = DVec2::new((i % width) as f64, (i / width) as f64) + sub;
                    let q = DVec2::from_angle(-angle).rotate(p - DVec2::new(160.0, 120.0)) / cell;
                    let (c, r) = (q.x.floor() as i64, q.y.floor() as i64);
                    sum += match printed(r, c) {
                        true if (r + c).rem_euclid(2) == 0 => 0.2,
                        true => 0.9,
                        false => 0.7,
                    };
                }
                (sum / 16.0) as f32
            })
            .collect();
        LumaImage { width, height, data }
    }

    #[test]
    fn a_single_row_of_corners_round_a_hole_is_one_piece_without_phantoms() {
        // 10 x 8 squares, ring of two: 2 * 9 + 2 * 5 corners.
        let inside = |v: i64, n: i64, w: i64| v >= w - n / 2 && v < n / 2 - w;
        for angle in [0.0, 0.3, 1.1] {
            let image = board(angle, 14.0, |r, c| {
                inside(r, 8, 0) && inside(c, 10, 0) && !(inside(r, 8, 2) && inside(c, 10, 2))
            });
            let pieces = grow(&image, &corners::find(&image));
            // The corners of the hole look like X-corners on bright paper.
            assert!((28..=32).contains(&pieces[0].len()), "angle {angle}");
            let x = pieces[0].iter().map(|n| n.at.x);
            let y = pieces[0].iter().map(|n| n.at.y);
            let mut extent = [
                x.clone().max().unwrap() - x.min().unwrap(),
                y.clone().max().unwrap() - y.min().unwrap(),
            ];
            extent.sort_unstable();
            assert_eq!(extent, [6, 8]);
            // Colours alternate over the whole piece.
            let parity = |n: &Node| n.bright == ((n.at.x + n.at.y).rem_euclid(2) == 0);
            assert!(pieces[0].iter().all(|n| parity(n) == parity(&pieces[0][0])));
        }
    }
}
