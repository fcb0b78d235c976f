//! The matrix product for WebAssembly with fused multiply-add: tiles of the result in registers. In the shapes of the
//! decoder it is 1.5 to 1.7 times as fast as that of `gemm` without (V8, x86-64); without it, `gemm`'s is faster.

use std::array;

use crate::simd::{Kernel, LANES, Lanes};

/// Rows of a tile. Its sums, and the numbers to multiply, fill 14 of the 16 registers of x86-64; five rows and more
/// take half the speed.
const ROWS: usize = 4;

/// `c = a b`, or `c += a b`, with the sizes and strides of [`super::gemm::Shape`].
pub(super) struct Product<'a> {
    pub m: usize,
    pub n: usize,
    pub k: usize,
    pub a_stride: usize,
    pub c_stride: usize,
    pub a: &'a [f32],
    pub b: &'a [f32],
    pub c: &'a mut [f32],
    pub accumulate: bool,
}

impl Kernel for Product<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes>(self) {
        // Columns of `b` that make a vector, one row after the other.
        let mut panel = vec![[0.0; LANES]; self.k];
        for column in (0..self.n).step_by(LANES) {
            let width = LANES.min(self.n - column);
            for (to, from) in panel.iter_mut().zip(self.b.chunks_exact(self.n)) {
                to[..width].copy_from_slice(&from[column..][..width]);
            }
            for row in (0..self.m).step_by(ROWS) {
                let tile = Tile {
                    panel: &panel,
                    a: &self.a[row * self.a_stride..],
                    a_stride: self.a_stride,
                    c: &mut self.c[row * self.c_stride + column..],
                    c_stride: self.c_stride,
                    width,
                    accumulate: self.accumulate,
                };
                match self.m - row {
                    1 => tile.fill::<V, 1>(),
                    2 => tile.fill::<V, 2>(),
                    3 => tile.fill::<V, 3>(),
                    _ => tile.fill::<V, ROWS>(),
                }
            }
        }
    }
}

/// A few rows of the result, of `width` columns.
struct Tile<'a> {
    panel: &'a [[f32; LANES]],
    a: &'a [f32],
    a_stride: usize,
    c: &'a mut [f32],
    c_stride: usize,
    width: usize,
    accumulate: bool,
}

impl Tile<'_> {
    #[inline(always)]
    fn fill<V: Lanes, const R: usize>(self) {
        let k = self.panel.len();
        let rows: [&[f32]; R] = array::from_fn(|i| &self.a[i * self.a_stride..][..k]);
        let mut sums = [V::splat(0.0); R];
        for l in 0..k {
            let b = V::from_array(self.panel[l]);
            for i in 0..R {
                sums[i] = V::splat(rows[i][l]).mul_add(b, sums[i]);
            }
        }
        for (i, sum) in sums.into_iter().enumerate() {
            let out = &mut self.c[i * self.c_stride..];
            // Apart from parts of a vector, whose copies would be calls.
            if let (LANES, Some(full)) = (self.width, out.first_chunk_mut()) {
                let sum = if self.accumulate { V::from_array(*full) + sum } else { sum };
                *full = sum.to_array();
                continue;
            }
            for (out, sum) in out[..self.width].iter_mut().zip(sum.to_array()) {
                *out = if self.accumulate { *out + sum } else { sum };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::dispatch;

    #[test]
    fn overlapping_rows_multiply_as_by_hand() {
        // Small integers are exact in f32. Rows in all remainders of a tile, columns in none and some of a vector.
        for m in [1, 2, 3, 4, 5, 33] {
            for (n, k, a_stride, c_stride) in [(1, 1, 1, 1), (8, 7, 2, 8), (19, 24, 8, 30)] {
                let a: Vec<f32> =
                    (0..(m - 1) * a_stride + k).map(|i| (i % 7) as f32 - 3.0).collect();
                let b: Vec<f32> = (0..k * n).map(|i| (i % 5) as f32 - 2.0).collect();
                let mut c = vec![9.0; (m - 1) * c_stride + n];
                for accumulate in [false, true] {
                    let (a, b, c) = (&a, &b, &mut c);
                    dispatch(Product { m, n, k, a_stride, c_stride, a, b, c, accumulate });
                }
                for (at, &found) in c.iter().enumerate() {
                    let (i, j) = (at / c_stride, at % c_stride);
                    let twice: f32 =
                        (0..k).map(|l| 2.0 * a[i * a_stride + l] * b[l * n + j % n]).sum();
                    // Gaps between rows are unchanged.
                    assert_eq!(found, if j < n { twice } else { 9.0 }, "{m} {n} {k}: {i}, {j}");
                }
            }
        }
    }
}
