//! Maps as planes in which differences mean about the same to the eye, for [`tile`](super::tile).

use crate::Svbrdf;
use crate::parallel;
use crate::svbrdf::{CHANNELS, channel};

/// Channels of the normal, diffuse, specular and roughness maps.
const MAPS: [std::ops::Range<usize>; 4] = [
    channel::SLOPE_X..channel::DIFFUSE,
    channel::DIFFUSE..channel::SPECULAR,
    channel::SPECULAR..channel::ROUGHNESS,
    channel::ROUGHNESS..CHANNELS,
];

/// Smallest mean difference of neighbours that is told from none.
const LEAST_DIFFERENCE: f32 = 1e-4;

/// Mean difference of neighbours across seams against that of all neighbours in the same direction,
/// of the map for which it is greatest; 1: seams are like the inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seam {
    /// Where tiles meet.
    pub border: f32,
    /// Along the cuts inside.
    pub cuts: f32,
}

impl Seam {
    /// The greater of the two.
    pub fn measure(&self) -> f32 {
        self.border.max(self.cuts)
    }
}

/// Slopes, square roots of albedos, roughness.
#[derive(Debug, Clone)]
pub(super) struct Stack {
    pub width: usize,
    pub height: usize,
    pub planes: Vec<Vec<f32>>,
    /// Whether a cut runs between a texel and its right, its lower neighbour.
    pub cuts: [Vec<bool>; 2],
}

impl Stack {
    pub fn of(maps: &Svbrdf) -> Self {
        let root = |c: usize| (channel::DIFFUSE..channel::ROUGHNESS).contains(&c);
        let encode = |c: usize, v: f32| if root(c) { v.max(0.0).sqrt() } else { v };
        let planes = (0..CHANNELS).map(|c| maps.plane(c).iter().map(|&v| encode(c, v)).collect());
        let none = vec![false; maps.texels()];
        Self {
            width: maps.width(),
            height: maps.height(),
            planes: planes.collect(),
            cuts: [none.clone(), none],
        }
    }

    /// The maps, within their physical range, and how much seams stand out.
    pub fn into_maps(self) -> (Svbrdf, Seam) {
        let seam = self.seam();
        let mut data: Vec<f32> = self.planes.concat();
        let n = self.width * self.height;
        for v in &mut data[channel::DIFFUSE * n..channel::ROUGHNESS * n] {
            *v = v.max(0.0) * *v;
        }
        let mut maps = Svbrdf::from_planes(self.width, self.height, data).expect("nine planes");
        maps.clamp();
        (maps, seam)
    }

    /// Columns become rows.
    pub fn transposed(&self) -> Self {
        let (w, h) = (self.width, self.height);
        let [right, down] = &self.cuts;
        Self {
            width: h,
            height: w,
            planes: self.planes.iter().map(|plane| swapped(plane, w, h)).collect(),
            cuts: [swapped(down, w, h), swapped(right, w, h)],
        }
    }

    /// Means of blocks of `factor` by `factor` texels; what is left over at the end is dropped.
    pub fn reduced(&self, factor: usize) -> Self {
        let (w, h) = (self.width / factor, self.height / factor);
        let area = (factor * factor) as f32;
        let mean = |plane: &[f32], i: usize| {
            let (x0, y0) = (i % w * factor, i / w * factor);
            let row = |y: usize| plane[(y0 + y) * self.width + x0..][..factor].iter().sum::<f32>();
            (0..factor).map(row).sum::<f32>() / area
        };
        let planes = self.planes.iter().map(|p| (0..w * h).map(|i| mean(p, i)).collect());
        let none = vec![false; w * h];
        Self { width: w, height: h, planes: planes.collect(), cuts: [none.clone(), none] }
    }

    /// Weight of each channel's squared differences: neighbours inside differ by 1 in the mean.
    pub fn weights(&self) -> [f32; CHANNELS] {
        std::array::from_fn(|c| {
            let plane = &self.planes[c];
            let (mut sum, mut count) = (0.0f64, 0.0f64);
            for row in plane.chunks_exact(self.width) {
                for pair in row.windows(2) {
                    sum += f64::from(pair[1] - pair[0]).powi(2);
                    count += 1.0;
                }
            }
            let mean = (sum / count) as f32;
            mean.max(LEAST_DIFFERENCE * LEAST_DIFFERENCE).recip()
        })
    }

    /// The same tiles, cut where neighbours differ little: where a tile begins is arbitrary.
    pub fn with_quiet_borders(&self) -> Self {
        let (w, h) = (self.width, self.height);
        let lines = self.lines();
        let [dx, dy] = [0, 1].map(|axis| {
            let loudness = |line: usize| greatest(lines.iter().map(|map| map[axis].ratio(line)));
            let count = [w, h][axis];
            let least = (0..count).min_by(|&a, &b| loudness(a).total_cmp(&loudness(b)));
            (least.unwrap_or(0) + 1) % count
        });
        let from = |i: usize| (i / w + dy) % h * w + (i % w + dx) % w;
        Self {
            width: w,
            height: h,
            planes: self.planes.iter().map(|p| (0..w * h).map(|i| p[from(i)]).collect()).collect(),
            cuts: [0, 1].map(|a| (0..w * h).map(|i| self.cuts[a][from(i)]).collect()),
        }
    }

    /// How much seams stand out, borders being periodic.
    pub fn seam(&self) -> Seam {
        let ends = [self.width - 1, self.height - 1];
        let border = |lines: &[Lines; 2]| greatest([0, 1].map(|a| lines[a].ratio(ends[a])));
        let cuts = |lines: &[Lines; 2]| {
            let [cut, usual] = [0, 1]
                .map(|which| lines.iter().map(|l| [l.cut, l.cuts * l.mean()][which]).sum::<f64>());
            if usual > 0.0 { (cut / usual) as f32 } else { 0.0 }
        };
        let lines = self.lines();
        Seam { border: greatest(lines.iter().map(border)), cuts: greatest(lines.iter().map(cuts)) }
    }

    /// Differences between neighbours of each map, to the right and below.
    fn lines(&self) -> Vec<[Lines; 2]> {
        parallel::map(MAPS.len(), |map| [0, 1].map(|axis| self.lines_of(MAPS[map].clone(), axis)))
    }

    fn lines_of(&self, channels: std::ops::Range<usize>, axis: usize) -> Lines {
        let (w, h) = (self.width, self.height);
        let [lines, across] = [[w, h], [h, w]].map(|sides| sides[axis]);
        let mut out = Lines { sums: vec![0.0; lines], across, cut: 0.0, cuts: 0.0 };
        for i in 0..w * h {
            let (x, y) = (i % w, i / w);
            let to = if axis == 0 { y * w + (x + 1) % w } else { (y + 1) % h * w + x };
            let planes = &self.planes[channels.clone()];
            let difference: f32 = planes.iter().map(|p| (p[to] - p[i]).abs()).sum();
            out.sums[[x, y][axis]] += f64::from(difference);
            if self.cuts[axis][i] {
                out.cut += f64::from(difference);
                out.cuts += 1.0;
            }
        }
        out
    }
}

fn greatest(values: impl IntoIterator<Item = f32>) -> f32 {
    values.into_iter().fold(0.0, f32::max)
}

/// Differences of one map between neighbours in one direction.
struct Lines {
    /// Between each line and the next, the last and the first.
    sums: Vec<f64>,
    /// Pairs of neighbours between two lines.
    across: usize,
    /// Across cuts, and the number of such pairs.
    cut: f64,
    cuts: f64,
}

impl Lines {
    /// Mean of all pairs.
    fn mean(&self) -> f64 {
        let mean = self.sums.iter().sum::<f64>() / (self.sums.len() * self.across) as f64;
        mean.max(LEAST_DIFFERENCE.into())
    }

    /// Of the pairs between a line and the next against all.
    fn ratio(&self, line: usize) -> f32 {
        (self.sums[line] / self.across as f64 / self.mean()) as f32
    }
}

fn swapped<T: Copy>(values: &[T], width: usize, height: usize) -> Vec<T> {
    (0..width * height).map(|i| values[i % height * width + i / height]).collect()
}
