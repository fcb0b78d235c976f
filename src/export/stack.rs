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

/// Slopes, square roots of albedos, roughness.
#[derive(Debug, Clone)]
pub(super) struct Stack {
    pub width: usize,
    pub height: usize,
    pub planes: Vec<Vec<f32>>,
}

impl Stack {
    pub fn of(maps: &Svbrdf) -> Self {
        let root = |c: usize| (channel::DIFFUSE..channel::ROUGHNESS).contains(&c);
        let encode = |c: usize, v: f32| if root(c) { v.max(0.0).sqrt() } else { v };
        let planes = (0..CHANNELS).map(|c| maps.plane(c).iter().map(|&v| encode(c, v)).collect());
        Self { width: maps.width(), height: maps.height(), planes: planes.collect() }
    }

    /// The maps, within their physical range.
    pub fn into_maps(self) -> Svbrdf {
        let mut data: Vec<f32> = self.planes.concat();
        let n = self.width * self.height;
        for v in &mut data[channel::DIFFUSE * n..channel::ROUGHNESS * n] {
            *v *= v.max(0.0);
        }
        let mut maps = Svbrdf::from_planes(self.width, self.height, data).expect("nine planes");
        maps.clamp();
        maps
    }

    /// Columns become rows.
    pub fn transposed(&self) -> Self {
        let (w, h) = (self.width, self.height);
        let swapped = |plane: &Vec<f32>| (0..w * h).map(|i| plane[i % h * w + i / h]).collect();
        Self { width: h, height: w, planes: self.planes.iter().map(swapped).collect() }
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
        Self { width: w, height: h, planes: planes.collect() }
    }

    /// Weight of each channel's squared differences: neighbours inside differ by 1 in the mean.
    pub fn weights(&self) -> [f32; CHANNELS] {
        let weights = parallel::map(CHANNELS, |c| {
            let rows = self.planes[c].chunks_exact(self.width);
            let square = |pair: &[f32]| (pair[1] - pair[0]) * (pair[1] - pair[0]);
            let row = |row: &[f32]| f64::from(row.windows(2).map(square).sum::<f32>());
            let count = (self.width - 1) * self.height;
            let mean = (rows.map(row).sum::<f64>() / count as f64) as f32;
            mean.max(LEAST_DIFFERENCE * LEAST_DIFFERENCE).recip()
        });
        std::array::from_fn(|c| weights[c])
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
        }
    }

    /// Mean difference of neighbours across the border against that of all neighbours in the same
    /// direction, of the map and axis for which it is greatest.
    pub fn border(&self) -> f32 {
        let ends = [self.width - 1, self.height - 1];
        let lines = self.lines();
        greatest(lines.iter().flat_map(|map| [0, 1].map(|axis| map[axis].ratio(ends[axis]))))
    }

    /// Mean of what `difference` gives for channels of pairs of neighbours against the mean
    /// difference of all neighbours in the same direction (`axis`: 0 to the right, 1 below), of the
    /// map for which it is greatest; 0 without pairs.
    pub fn relative<P: Sync>(
        &self,
        pairs: &[P],
        axis: impl Fn(&P) -> usize + Sync,
        difference: impl Fn(usize, &P) -> f32 + Sync,
    ) -> f32 {
        let lines = self.lines();
        let ratios = parallel::map(MAPS.len(), |map| {
            let (mut sum, mut usual) = (0.0f64, 0.0f64);
            let means = [0, 1].map(|axis| lines[map][axis].mean());
            for pair in pairs {
                sum += MAPS[map].clone().map(|c| f64::from(difference(c, pair))).sum::<f64>();
                usual += means[axis(pair)];
            }
            if usual > 0.0 { (sum / usual) as f32 } else { 0.0 }
        });
        greatest(ratios)
    }

    /// Differences between neighbours of each map, to the right and below.
    fn lines(&self) -> Vec<[Lines; 2]> {
        parallel::map(MAPS.len(), |map| [0, 1].map(|axis| self.lines_of(MAPS[map].clone(), axis)))
    }

    fn lines_of(&self, channels: std::ops::Range<usize>, axis: usize) -> Lines {
        let (w, h) = (self.width, self.height);
        let [lines, across] = [[w, h], [h, w]].map(|sides| sides[axis]);
        let mut sums = vec![0.0; lines];
        for plane in &self.planes[channels] {
            let row = |y: usize| &plane[y * w..][..w];
            for y in 0..h {
                if axis == 0 {
                    let next = row(y)[1..].iter().chain(&row(y)[..1]);
                    for (sum, (a, b)) in sums.iter_mut().zip(row(y).iter().zip(next)) {
                        *sum += f64::from((b - a).abs());
                    }
                } else {
                    let pairs = row(y).iter().zip(row((y + 1) % h));
                    sums[y] += f64::from(pairs.map(|(a, b)| (b - a).abs()).sum::<f32>());
                }
            }
        }
        Lines { sums, across }
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
