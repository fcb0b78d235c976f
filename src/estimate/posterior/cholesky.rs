//! Cholesky factors of the normal equations of eight texels.

use crate::simd::Lanes;
use crate::svbrdf::CHANNELS;

/// Entries of a triangle.
pub(in crate::estimate) const PAIRS: usize = CHANNELS * (CHANNELS + 1) / 2;

/// Index of an entry of a lower triangle, by rows.
pub(in crate::estimate) const fn at(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

/// The lower triangle `L` of `A = L Lᵀ`, by rows, with the reciprocals of its diagonal; 0 where a pivot is not
/// positive, so that the coordinate does not move.
#[derive(Clone, Copy)]
pub(in crate::estimate) struct Cholesky<V>(pub [V; PAIRS]);

// Loops, because closures may stay calls without a kernel's target features.
impl<V: Lanes> Cholesky<V> {
    /// Factors a matrix, given as its lower triangle.
    #[inline(always)]
    pub fn new(matrix: &[V; PAIRS]) -> Self {
        let zero = V::splat(0.0);
        let mut factor = *matrix;
        for i in 0..CHANNELS {
            for j in 0..i {
                let mut sum = factor[at(i, j)];
                for k in 0..j {
                    sum = (-factor[at(i, k)]).mul_add(factor[at(j, k)], sum);
                }
                factor[at(i, j)] = sum * factor[at(j, j)];
            }
            let mut pivot = factor[at(i, i)];
            for k in 0..i {
                pivot = (-factor[at(i, k)]).mul_add(factor[at(i, k)], pivot);
            }
            factor[at(i, i)] = pivot.if_greater(zero, pivot.reciprocal_sqrt(), zero);
        }
        Self(factor)
    }

    /// `L⁻¹` times a column.
    #[inline(always)]
    pub fn forward(&self, column: &[V; CHANNELS]) -> [V; CHANNELS] {
        let mut out = *column;
        for i in 0..CHANNELS {
            for k in 0..i {
                out[i] = (-self.0[at(i, k)]).mul_add(out[k], out[i]);
            }
            out[i] = out[i] * self.0[at(i, i)];
        }
        out
    }

    /// `-L⁻ᵀ` times a column. `-A⁻¹` is this after [`Self::forward`].
    #[inline(always)]
    pub fn backward(&self, column: &[V; CHANNELS]) -> [V; CHANNELS] {
        let mut out = *column;
        for i in (0..CHANNELS).rev() {
            for k in i + 1..CHANNELS {
                out[i] = (-self.0[at(k, i)]).mul_add(out[k], out[i]);
            }
            out[i] = out[i] * self.0[at(i, i)];
        }
        for value in &mut out {
            *value = -*value;
        }
        out
    }

    /// An entry of the diagonal of `A⁻¹`.
    #[inline(always)]
    pub fn variance(&self, i: usize) -> V {
        let column = self.inverted(i);
        dot(&column, &column, i)
    }

    /// `A⁻¹`: the upper triangle, by rows.
    #[inline(always)]
    pub fn inverse(&self) -> [V; PAIRS] {
        let mut columns = [[V::splat(0.0); CHANNELS]; CHANNELS];
        for (i, column) in columns.iter_mut().enumerate() {
            *column = self.inverted(i);
        }
        let mut out = [V::splat(0.0); PAIRS];
        let mut k = 0;
        for i in 0..CHANNELS {
            for j in i..CHANNELS {
                out[k] = dot(&columns[i], &columns[j], j);
                k += 1;
            }
        }
        out
    }

    /// A column of `L⁻¹`.
    #[inline(always)]
    fn inverted(&self, i: usize) -> [V; CHANNELS] {
        let mut unit = [V::splat(0.0); CHANNELS];
        unit[i] = V::splat(1.0);
        self.forward(&unit)
    }
}

/// The product of two columns from row `from` on.
#[inline(always)]
fn dot<V: Lanes>(a: &[V; CHANNELS], b: &[V; CHANNELS], from: usize) -> V {
    let mut sum = V::splat(0.0);
    for k in from..CHANNELS {
        sum = a[k].mul_add(b[k], sum);
    }
    sum
}
