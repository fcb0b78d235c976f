//! Maps in perceptually comparable units, for [`tile`](super::tile).

use super::transpose::transpose;
use crate::Svbrdf;
use crate::parallel;
use crate::svbrdf::{CHANNELS, LOBES, channel, lobe};

/// Channels of the normal, diffuse, specular and roughness maps, and of the optional lobes.
const MAPS: [std::ops::Range<usize>; 7] = [
    channel::SLOPE_X..channel::DIFFUSE,
    channel::DIFFUSE..channel::SPECULAR,
    channel::SPECULAR..channel::ROUGHNESS,
    channel::ROUGHNESS..CHANNELS,
    CHANNELS + lobe::ANISOTROPY_X..CHANNELS + lobe::COAT,
    CHANNELS + lobe::COAT..CHANNELS + lobe::SHEEN,
    CHANNELS + lobe::SHEEN..CHANNELS + LOBES,
];

/// Lower limit of the mean difference of neighbours.
const LEAST_DIFFERENCE: f32 = 1e-4;

/// Slopes, square roots of albedos, roughness; parameters of lobes if present.
#[derive(Debug, Clone)]
pub(super) struct Stack {
    pub width: usize,
    pub height: usize,
    pub planes: Vec<Vec<f32>>,
}

impl Stack {
    pub fn of(maps: &Svbrdf) -> Self {
        let root = |c: usize| (channel::DIFFUSE..channel::ROUGHNESS).contains(&c);
        let sources: Vec<&[f32]> = [maps.planes(), maps.lobes()]
            .iter()
            .flat_map(|all| all.chunks_exact(maps.texels()))
            .collect();
        let planes = parallel::map(sources.len(), |c| {
            let mut plane = sources[c].to_vec();
            if root(c) {
                plane.iter_mut().for_each(|v| *v = v.max(0.0).sqrt());
            }
            plane
        });
        Self { width: maps.width(), height: maps.height(), planes }
    }

    /// Converts back to maps within their physical range.
    pub fn into_maps(self) -> Svbrdf {
        let mut data: Vec<f32> = self.planes.concat();
        let n = self.width * self.height;
        for v in &mut data[channel::DIFFUSE * n..channel::ROUGHNESS * n] {
            *v *= v.max(0.0);
        }
        let lobes = data.split_off(CHANNELS * n);
        let mut maps = Svbrdf::from_planes(self.width, self.height, data).expect("nine planes");
        maps.set_lobes(lobes).expect("as many planes as before");
        maps.clamp();
        maps
    }

    /// Columns become rows.
    pub fn transposed(&self) -> Self {
        let planes = parallel::map(self.planes.len(), |c| {
            let mut columns = vec![0.0; self.planes[c].len()];
            transpose(&self.planes[c], self.width, &mut columns);
            columns
        });
        Self { width: self.height, height: self.width, planes }
    }

    /// Means of blocks of `factor` by `factor` texels, without incomplete blocks.
    pub fn reduced(&self, factor: usize) -> Self {
        let (w, h) = (self.width / factor, self.height / factor);
        let area = (factor * factor) as f32;
        let mean = |plane: &[f32], i: usize| {
            let (x0, y0) = (i % w * factor, i / w * factor);
            let row = |y: usize| plane[(y0 + y) * self.width + x0..][..factor].iter().sum::<f32>();
            (0..factor).map(row).sum::<f32>() / area
        };
        let planes = parallel::map(self.planes.len(), |c| {
            let plane = &self.planes[c];
            (0..w * h).map(|i| mean(plane, i)).collect()
        });
        Self { width: w, height: h, planes }
    }

    /// Weights of each channel's squared differences that make the mean difference of neighbours 1.
    pub fn weights(&self) -> Vec<f32> {
        parallel::map(self.planes.len(), |c| {
            let rows = self.planes[c].chunks_exact(self.width);
            let square = |a: f32, b: f32| (b - a) * (b - a);
            let row = |row: &[f32]| f64::from(sum_of(&row[..row.len() - 1], &row[1..], square));
            let count = (self.width - 1) * self.height;
            let mean = (rows.map(row).sum::<f64>() / count as f64) as f32;
            mean.max(LEAST_DIFFERENCE * LEAST_DIFFERENCE).recip()
        })
    }

    /// The same tiles, shifted so that their borders lie where neighbours differ least. Also
    /// returns the mean difference across the border over that of all neighbours in the same
    /// direction, for the worst map and axis.
    pub fn with_quiet_borders(&self) -> (Self, f32) {
        let (w, h) = (self.width, self.height);
        let lines = self.lines();
        let [(dx, across), (dy, down)] = [(0, w), (1, h)].map(|(axis, count)| {
            let loudness = |line: usize| greatest(lines.iter().map(|map| map[axis].ratio(line)));
            let louder = |a: &(usize, f32), b: &(usize, f32)| a.1.total_cmp(&b.1);
            let least = (0..count).map(|line| (line, loudness(line))).min_by(louder);
            least.map_or((0, 0.0), |(line, loudness)| ((line + 1) % count, loudness))
        });
        let planes = parallel::map(self.planes.len(), |c| {
            let mut plane = self.planes[c].clone();
            plane.rotate_left(dy * w);
            plane.chunks_exact_mut(w).for_each(|row| row.rotate_left(dx));
            plane
        });
        (Self { width: w, height: h, planes }, across.max(down))
    }

    /// Mean of `difference` over the channels of pairs of neighbours, relative to the mean difference of all
    /// neighbours in the same direction (`axis`: 0 right, 1 below), for the worst map; 0 without pairs.
    pub fn relative<P: Sync>(
        &self,
        pairs: &[P],
        axis: impl Fn(&P) -> usize + Sync,
        difference: impl Fn(usize, &P) -> f32 + Sync,
    ) -> f32 {
        let lines = self.lines();
        let ratios = parallel::map(lines.len(), |map| {
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

    /// Differences between neighbours of each map, right and below.
    fn lines(&self) -> Vec<[Lines; 2]> {
        let maps = MAPS.iter().filter(|map| map.end <= self.planes.len()).count();
        parallel::map(maps, |map| [0, 1].map(|axis| self.lines_of(MAPS[map].clone(), axis)))
    }

    fn lines_of(&self, channels: std::ops::Range<usize>, axis: usize) -> Lines {
        let (w, h) = (self.width, self.height);
        let [lines, across] = [[w, h], [h, w]].map(|sides| sides[axis]);
        let mut sums = vec![0.0; lines];
        for plane in &self.planes[channels] {
            let row = |y: usize| &plane[y * w..][..w];
            for y in 0..h {
                if axis == 0 {
                    let pairs = row(y).iter().zip(&row(y)[1..]);
                    for (sum, (a, b)) in sums.iter_mut().zip(pairs) {
                        *sum += f64::from((b - a).abs());
                    }
                    sums[w - 1] += f64::from((row(y)[0] - row(y)[w - 1]).abs());
                } else {
                    sums[y] += f64::from(sum_of(row(y), row((y + 1) % h), |a, b| (b - a).abs()));
                }
            }
        }
        Lines { sums, across }
    }
}

/// Sum of `f` over pairs of values, in an order that vectorises.
fn sum_of(first: &[f32], second: &[f32], f: impl Fn(f32, f32) -> f32) -> f32 {
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let (first, first_rest) = first.as_chunks::<LANES>();
    let (second, second_rest) = second.as_chunks::<LANES>();
    for (a, b) in first.iter().zip(second) {
        for i in 0..LANES {
            sums[i] += f(a[i], b[i]);
        }
    }
    let rest = first_rest.iter().zip(second_rest).map(|(a, b)| f(*a, *b));
    sums.iter().sum::<f32>() + rest.sum::<f32>()
}

fn greatest(values: impl IntoIterator<Item = f32>) -> f32 {
    values.into_iter().fold(0.0, f32::max)
}

/// Differences of one map between neighbours in one direction.
struct Lines {
    /// Sum between each line and the next; the last entry between the last and the first.
    sums: Vec<f64>,
    /// Pairs of neighbours between two lines.
    across: usize,
}

impl Lines {
    fn mean(&self) -> f64 {
        let mean = self.sums.iter().sum::<f64>() / (self.sums.len() * self.across) as f64;
        mean.max(LEAST_DIFFERENCE.into())
    }

    /// Mean difference between a line and the next, relative to that of all.
    fn ratio(&self, line: usize) -> f32 {
        (self.sums[line] / self.across as f64 / self.mean()) as f32
    }
}
