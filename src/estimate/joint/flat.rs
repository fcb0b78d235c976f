//! Removal of the sheet's shape from the slopes.

use crate::Svbrdf;
use crate::parallel;
use crate::svbrdf::channel;

/// Lowest cosines along each side, from the mean on, that count as shape.
const COSINES: usize = 3;

/// Maps with a share of the slopes, without the slopes' lowest cosines.
pub(in crate::estimate) fn flattened(maps: &Svbrdf, share: f32) -> Svbrdf {
    let mut maps = maps.clone();
    let (width, height) = (maps.width(), maps.height());
    let [across, down] =
        [width, height].map(|n| (0..COSINES).map(|k| cosine(k, n)).collect::<Vec<_>>());
    for c in [channel::SLOPE_X, channel::SLOPE_Y] {
        let plane = maps.plane_mut(c);
        // Coefficients of each row, then of the plane: [down][across].
        let rows = parallel::values(height, |y| {
            let row = &plane[y * width..][..width];
            std::array::from_fn::<f64, COSINES, _>(|i| {
                row.iter().zip(&across[i]).map(|(v, b)| f64::from(v * b)).sum::<f64>()
                    / width as f64
            })
        });
        let coefficients: [[f32; COSINES]; COSINES] = std::array::from_fn(|j| {
            std::array::from_fn(|i| {
                let sum: f64 = rows.iter().zip(&down[j]).map(|(r, b)| r[i] * f64::from(*b)).sum();
                (sum / height as f64) as f32
            })
        });
        parallel::parts(plane.chunks_mut(width), |y, row| {
            let along: [f32; COSINES] = std::array::from_fn(|i| {
                (0..COSINES).map(|j| coefficients[j][i] * down[j][y]).sum()
            });
            for (x, v) in row.iter_mut().enumerate() {
                let low: f32 = along.iter().zip(&across).map(|(a, b)| a * b[x]).sum();
                *v = share * (*v - low);
            }
        });
    }
    maps
}

/// The orthonormal cosine of order `k` at `n` places: its mean square is 1.
fn cosine(k: usize, n: usize) -> Vec<f32> {
    let scale = if k == 0 { 1.0 } else { std::f32::consts::SQRT_2 };
    let phase = std::f32::consts::PI * k as f32 / n as f32;
    (0..n).map(|i| scale * (phase * (i as f32 + 0.5)).cos()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Removes tilt and bow of a sheet and keeps its relief.
    #[test]
    fn flattening_removes_shape_and_keeps_relief() {
        let (width, height) = (96, 64);
        let mut maps = Svbrdf::new(width, height);
        let relief = |x: usize, y: usize| 0.1 * (0.9 * x as f32).sin() * (1.3 * y as f32).cos();
        for (t, v) in maps.plane_mut(channel::SLOPE_X).iter_mut().enumerate() {
            let (x, y) = (t % width, t / width);
            *v = 0.3 + 0.2 * cosine(1, width)[x] - 0.1 * cosine(2, height)[y] + relief(x, y);
        }
        let flat = flattened(&maps, 1.0);
        // The relief itself has hardly any low cosine.
        for (t, v) in flat.plane(channel::SLOPE_X).iter().enumerate() {
            assert!((v - relief(t % width, t / width)).abs() < 5e-3, "{t}: {v}");
        }
        let half = flattened(&maps, 0.5);
        for (a, b) in half.plane(channel::SLOPE_X).iter().zip(flat.plane(channel::SLOPE_X)) {
            assert!((2.0 * a - b).abs() < 1e-6);
        }
        assert_eq!(flat.plane(channel::ROUGHNESS), maps.plane(channel::ROUGHNESS));
    }
}
