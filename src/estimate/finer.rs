//! Strided photographs and maps at full resolution.

use super::bundle::colours;
use super::clusters::Feature;
use super::photographs::Photographs;
use crate::Svbrdf;
use crate::interpolation::{between, bilinear};
use crate::parallel;
use crate::svbrdf::CHANNELS;

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

/// Maps interpolated to `2^times` as many texels along each side. Each coarse texel is the middle one of `2^times` fine
/// texels.
pub(super) fn interpolated(coarse: &Svbrdf, times: u32) -> Svbrdf {
    let (columns, rows, step) = (coarse.width(), coarse.height(), 1usize << times);
    let near = |i: usize, n: usize| between((i as f32 - (step / 2) as f32) / step as f32, n);
    let mut fine = Svbrdf::new(columns * step, rows * step);
    for c in 0..CHANNELS {
        let from = coarse.plane(c);
        parallel::parts(fine.plane_mut(c).chunks_mut(columns * step), |row, out| {
            let (north, south, y) = near(row, rows);
            for (column, out) in out.iter_mut().enumerate() {
                let (west, east, x) = near(column, columns);
                let at = |row: usize, column: usize| from[row * columns + column];
                let around = [at(north, west), at(north, east), at(south, west), at(south, east)];
                *out = bilinear(around, [x, y]);
            }
        });
    }
    fine
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::two_tones;

    const SIDE: usize = 64;

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
