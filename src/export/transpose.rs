//! Transposes planes.

use crate::parallel;

/// Side of the blocks copied at once, which fit the caches.
const BLOCK: usize = 16;

/// Writes the columns of a plane of width `width` as rows.
pub(super) fn transpose<T: Copy + Send + Sync>(values: &[T], width: usize, out: &mut [T]) {
    let height = values.len() / width;
    parallel::parts(out.chunks_mut(BLOCK * height), |band, out| {
        for y0 in (0..height).step_by(BLOCK) {
            for (x, column) in out.chunks_exact_mut(height).enumerate() {
                for y in y0..(y0 + BLOCK).min(height) {
                    column[y] = values[y * width + band * BLOCK + x];
                }
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_become_rows() {
        for (w, h) in [(1, 1), (5, 1), (1, 7), (16, 33), (40, 17)] {
            let values: Vec<usize> = (0..w * h).collect();
            let mut found = vec![0; w * h];
            transpose(&values, w, &mut found);
            assert!((0..w * h).all(|i| found[i] == i % h * w + i / h), "{w} x {h}");
        }
    }
}
