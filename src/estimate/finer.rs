//! Maps of strided photographs at full resolution.
//!
//! Within a small window, albedos and roughness are nearly linear in colour. A linear model of each window of
//! the coarse maps, applied to the colours of all texels, restores detail between the coarse texels (He and
//! Sun, *Fast guided filter*, 2015). Slopes do not correlate with colour and are interpolated.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::bundle::colours;
use super::clusters::Feature;
use super::coordinates::{coordinates, from_coordinate};
use super::photographs::Photographs;
use crate::Svbrdf;
use crate::interpolation::{between, bilinear};
use crate::parallel;
use crate::svbrdf::{CHANNELS, channel, strided};

/// Variance of the noise of colours, as roots of albedos.
const RIDGE: f32 = 1e-4;
/// Coordinates that correlate with colour.
const GUIDED: Range<usize> = channel::DIFFUSE..CHANNELS;
const COUNT: usize = GUIDED.end - GUIDED.start;

/// Coefficients of a window for each guided coordinate: three colours and a constant.
type Model = [[f32; 4]; COUNT];

/// Colours of all texels, see [`colours`].
pub(super) fn full_colours(photographs: &Photographs) -> Vec<Feature> {
    let (full, given) = (photographs.full(), photographs.given());
    let Some(first) = full.first() else { return Vec::new() };
    let (width, height) = (first.width(), first.height());
    let place = |t: usize| given[0].texel_mm(width, height, t % width, t / width).map(f64::from);
    let seen = |i: usize, t: usize| {
        (full[i].weight(t) > 0.0).then(|| [0, 1, 2].map(|c| full[i].radiance(c, t)))
    };
    colours(given, width * height, place, seen)
}

/// Maps interpolated to `2^times` as many texels along each side.
pub(super) fn interpolated(coarse: &Svbrdf, times: u32) -> Svbrdf {
    let grid = Grid { columns: coarse.width(), rows: coarse.height(), times };
    let mut fine = Svbrdf::new(coarse.width() << times, coarse.height() << times);
    (0..CHANNELS).for_each(|c| grid.interpolate(coarse.plane(c), fine.plane_mut(c)));
    fine
}

/// Colours at two resolutions that guide the refinement of maps.
pub(super) struct Guide {
    grid: Grid,
    /// Radius of a window, texels.
    radius: usize,
    fine: Vec<Feature>,
    coarse: Vec<Feature>,
}

impl Guide {
    /// The colours of strided photographs, and windows of this radius.
    pub fn new(photographs: &Photographs, radius: usize) -> Self {
        let (fine, times) = (full_colours(photographs), photographs.stride_log2());
        let first = photographs.full().first();
        let [width, height] = first.map_or([1, 1], |o| [o.width(), o.height()]);
        let coarse = strided(&fine, width, times);
        let grid = Grid { columns: width >> times, rows: height >> times, times };
        Self { grid, radius, fine, coarse }
    }

    /// Maps of the strided texels at full resolution.
    pub fn refined(&self, coarse: &Svbrdf) -> Svbrdf {
        let Grid { columns, rows, times } = self.grid;
        let mut fine = Svbrdf::new(columns << times, rows << times);
        for c in [channel::SLOPE_X, channel::SLOPE_Y] {
            self.grid.interpolate(coarse.plane(c), fine.plane_mut(c));
        }
        let values = coordinates(coarse);
        let models = parallel::values(columns * rows, |t| self.model(&values, t));
        for (k, c) in GUIDED.enumerate() {
            self.grid.fill(fine.plane_mut(c), |fine, [nw, ne, sw, se], [x, y]| {
                let colour = &self.fine[fine];
                let at = |t: usize| {
                    let [r, g, b, constant] = models[t][k];
                    r * colour[0] + g * colour[1] + b * colour[2] + constant
                };
                from_coordinate(c, bilinear([nw, ne, sw, se].map(at), [x, y]))
            });
        }
        fine.clamp();
        fine
    }

    /// The linear model of the window round a texel.
    fn model(&self, values: &[f32], texel: usize) -> Model {
        let Grid { columns, rows, .. } = self.grid;
        let radius = self.radius;
        let near = |i: usize, n: usize| i.saturating_sub(radius)..(i + radius + 1).min(n);
        let (mut count, mut colour_sum, mut squares) = (0.0, Vector3::zeros(), Matrix3::zeros());
        let (mut sums, mut products) = ([0.0; COUNT], [Vector3::zeros(); COUNT]);
        for row in near(texel / columns, rows) {
            for column in near(texel % columns, columns) {
                let t = row * columns + column;
                let colour = Vector3::from(self.coarse[t]);
                count += 1.0;
                colour_sum += colour;
                squares += colour * colour.transpose();
                for (k, c) in GUIDED.enumerate() {
                    let value = values[c * columns * rows + t];
                    sums[k] += value;
                    products[k] += value * colour;
                }
            }
        }
        let colour = colour_sum / count;
        let covariance = squares / count - colour * colour.transpose();
        let inverse = (covariance + Matrix3::identity() * RIDGE).try_inverse();
        let inverse = inverse.unwrap_or_else(Matrix3::zeros);
        std::array::from_fn(|k| {
            let value = sums[k] / count;
            let by = inverse * (products[k] / count - colour * value);
            [by[0], by[1], by[2], value - by.dot(&colour)]
        })
    }
}

/// A coarse grid. Each of its texels is the middle one of `2^times` fine texels along each side.
#[derive(Debug, Clone, Copy)]
struct Grid {
    columns: usize,
    rows: usize,
    times: u32,
}

impl Grid {
    /// Fills a fine plane. `value` gets a texel's index, its four coarse neighbours (north-west, north-east,
    /// south-west, south-east) and its place between them, 0 to 1.
    fn fill(&self, plane: &mut [f32], value: impl Fn(usize, [usize; 4], [f32; 2]) -> f32 + Sync) {
        let step = 1usize << self.times;
        let near = |i: usize, n: usize| between((i as f32 - (step / 2) as f32) / step as f32, n);
        let width = self.columns * step;
        parallel::parts(plane.chunks_mut(width), |row, out| {
            let (north, south, y) = near(row, self.rows);
            for (column, out) in out.iter_mut().enumerate() {
                let (west, east, x) = near(column, self.columns);
                let at = |row: usize, column: usize| row * self.columns + column;
                let around = [at(north, west), at(north, east), at(south, west), at(south, east)];
                *out = value(row * width + column, around, [x, y]);
            }
        });
    }

    fn interpolate(&self, coarse: &[f32], fine: &mut [f32]) {
        self.fill(fine, |_, around, place| bilinear(around.map(|t| coarse[t]), place));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{photograph, two_tones, view_from};

    const SIDE: usize = 64;

    #[test]
    fn detail_between_coarse_texels_follows_colour() {
        let truth = two_tones(SIDE);
        let mut flat = truth.clone();
        for c in [channel::SLOPE_X, channel::SLOPE_Y] {
            flat.plane_mut(c).fill(0.0);
        }
        let mut photographs = Photographs::new().limited(usize::MAX, SIDE / 4);
        photographs.add(photograph(&flat, view_from([90.0, 0.0, 100.0]))).unwrap();
        let coarse = truth.strided(2);
        let mean_error = |maps: &Svbrdf, c: usize| {
            let pairs = maps.plane(c).iter().zip(truth.plane(c));
            pairs.map(|(a, b)| (a - b).abs()).sum::<f32>() / truth.texels() as f32
        };
        let (refined, smooth) =
            (Guide::new(&photographs, 2).refined(&coarse), interpolated(&coarse, 2));
        for c in [channel::ROUGHNESS, channel::DIFFUSE] {
            // The photograph's highlight adds to the colours and leaves an error.
            let (guided, plain) = (mean_error(&refined, c), mean_error(&smooth, c));
            assert!(guided < 0.3 * plain, "{c}: {guided} {plain}");
        }
        // Slopes do not correlate with colour.
        assert_eq!(refined.plane(channel::SLOPE_X), smooth.plane(channel::SLOPE_X));
    }

    #[test]
    fn interpolation_keeps_the_strided_texels() {
        let truth = two_tones(SIDE);
        for times in 1..4 {
            let fine = interpolated(&truth.strided(times), times);
            assert_eq!(fine.strided(times), truth.strided(times));
            assert_eq!([fine.width(), fine.height()], [SIDE; 2]);
        }
    }
}
