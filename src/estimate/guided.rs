//! Maps at a finer resolution, guided by the colours of the photographs.
//!
//! In a small window albedos and roughness are close to linear in colour; a linear model of each
//! window of the coarse maps, applied to fine colours, has detail that the coarse maps have lost
//! (He and Sun, *Fast guided filter*, 2015). Slopes do not go with colour and are interpolated.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::bundle::colours;
use super::clusters::Feature;
use super::photographs::Photographs;
use super::prior::{coordinates, from_coordinate};
use crate::Svbrdf;
use crate::parallel;
use crate::svbrdf::{CHANNELS, channel, thinned};

/// Texels of a window to each side of its middle.
const RADIUS: usize = 2;
/// Coordinates that go with colour.
const GUIDED: Range<usize> = channel::DIFFUSE..CHANNELS;

/// Coefficients of a window: of three colours, and a constant, for each guided coordinate.
type Model = [[f32; 4]; GUIDED.end - GUIDED.start];

/// Colours at two resolutions.
pub(super) struct Guide {
    width: usize,
    height: usize,
    fine: Vec<Feature>,
    coarse: Vec<Feature>,
    times: u32,
    ridge: f32,
}

impl Guide {
    /// For maps of the photographs' size, thinned so often. `ridge` is the variance of colour, as
    /// roots of albedos, that explains nothing.
    pub fn new(photographs: &Photographs, times: u32, ridge: f32) -> Self {
        let fine = full_colours(photographs);
        let first = photographs.full().first();
        let (width, height) = first.map_or((1, 1), |o| (o.width(), o.height()));
        let coarse = thinned(&fine, width, times);
        Self { width, height, fine, coarse, times, ridge }
    }

    /// Writes albedos and roughness of coarse maps to fine ones.
    pub fn write(&self, coarse: &Svbrdf, fine: &mut Svbrdf) {
        let (columns, rows) = (coarse.width(), coarse.height());
        let coordinates = coordinates(coarse);
        let models = parallel::values(columns * rows, |t| {
            self.model(&coordinates, columns, rows, [t % columns, t / columns])
        });
        let step = 1 << self.times;
        let near = |i: usize, n: usize| {
            let at = i.saturating_sub(step / 2) as f32 / step as f32;
            let at = at.min((n - 1) as f32);
            let low = (at as usize).min(n.saturating_sub(2));
            (low, (low + 1).min(n - 1), at - low as f32)
        };
        for (k, c) in GUIDED.enumerate() {
            let plane = fine.plane_mut(c);
            parallel::parts(plane.chunks_mut(self.width), |y, out| {
                let (above, below, v) = near(y, rows);
                for (x, out) in out.iter_mut().enumerate() {
                    let (left, right, u) = near(x, columns);
                    let colour = &self.fine[y * self.width + x];
                    let at = |row: usize, column: usize| {
                        let [a, b, c, constant] = models[row * columns + column][k];
                        a * colour[0] + b * colour[1] + c * colour[2] + constant
                    };
                    let mix = |row| at(row, left) + u * (at(row, right) - at(row, left));
                    let value = mix(above) + v * (mix(below) - mix(above));
                    *out = from_coordinate(c, value);
                }
            });
        }
        debug_assert_eq!(fine.height(), self.height);
        fine.clamp();
    }

    /// The linear model of a texel's window.
    fn model(&self, values: &[f32], columns: usize, rows: usize, [x, y]: [usize; 2]) -> Model {
        let texels = columns * rows;
        let near = |i: usize, n: usize| i.saturating_sub(RADIUS)..(i + RADIUS + 1).min(n);
        let (mut count, mut mean, mut square) = (0.0, Vector3::zeros(), Matrix3::zeros());
        let mut means = [0.0; GUIDED.end - GUIDED.start];
        let mut products = [Vector3::zeros(); GUIDED.end - GUIDED.start];
        for row in near(y, rows) {
            for column in near(x, columns) {
                let t = row * columns + column;
                let colour = Vector3::from(self.coarse[t]);
                count += 1.0;
                mean += colour;
                square += colour * colour.transpose();
                for (k, c) in GUIDED.enumerate() {
                    let value = values[c * texels + t];
                    means[k] += value;
                    products[k] += value * colour;
                }
            }
        }
        mean /= count;
        let covariance = square / count - mean * mean.transpose() + Matrix3::identity() * self.ridge;
        let inverse = covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        std::array::from_fn(|k| {
            let value = means[k] / count;
            let a = inverse * (products[k] / count - mean * value);
            [a[0], a[1], a[2], value - a.dot(&mean)]
        })
    }
}

/// Colours of all texels as the photographs show them, see [`colours`].
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
