//! Matrix product on slices: the only unsafe code of this module.

#[cfg(not(target_feature = "relaxed-simd"))]
use gemm_common::Parallelism;
#[cfg(not(target_feature = "relaxed-simd"))]
use gemm_f32::gemm::f32::get_gemm_fn;

#[cfg(target_feature = "relaxed-simd")]
use super::tiles::Product;
#[cfg(target_feature = "relaxed-simd")]
use crate::simd::dispatch;

/// Sizes and strides of `c = a b` or `c += a b`, all row-major.
///
/// Row `i` of `a` starts at element `i * a_stride` and has `k` elements. Rows may overlap, so that
/// a convolution multiplies its shifted windows without copies. `b` is `k x n` without gaps; row
/// `i` of `c` starts at `i * c_stride`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    pub m: usize,
    pub n: usize,
    pub k: usize,
    pub a_stride: usize,
    pub c_stride: usize,
}

/// Writes `a b` to `c`, or adds it, on the calling thread.
///
/// # Panics
/// If a slice is too short for `shape`, or rows of `c` would overlap.
#[allow(unsafe_code)]
pub(super) fn multiply(shape: Shape, a: &[f32], b: &[f32], c: &mut [f32], accumulate: bool) {
    let Shape { m, n, k, a_stride, c_stride } = shape;
    if m == 0 || n == 0 {
        return;
    }
    // Real networks stay far below these limits, within which no product overflows.
    assert!(m.max(n).max(k).max(a_stride).max(c_stride) < 1 << 31, "matrix too large");
    assert!(k > 0 && c_stride >= n, "rows of the result overlap");
    assert!((m - 1) * a_stride + k <= a.len(), "left matrix too short");
    assert!(k * n <= b.len(), "right matrix too short");
    assert!((m - 1) * c_stride + n <= c.len(), "result too short");
    // `gemm` has no fused multiply-add for WebAssembly.
    #[cfg(target_feature = "relaxed-simd")]
    dispatch(Product { m, n, k, a_stride, c_stride, a, b, c, accumulate });
    // SAFETY: the asserts above keep every element that the kernel reads or writes inside its slice:
    // a[i * a_stride + l], b[l * n + j], c[i * c_stride + j] for i < m, l < k, j < n. Rows of `c`
    // do not overlap, and `c` is borrowed exclusively, so it aliases neither `a` nor `b`.
    #[cfg(not(target_feature = "relaxed-simd"))]
    unsafe {
        // The kernels write column-major results, so compute the transposed product c' = b' a'.
        get_gemm_fn()(
            n,
            m,
            k,
            c.as_mut_ptr(),
            c_stride as isize,
            1,
            accumulate,
            b.as_ptr(),
            n as isize,
            1,
            a.as_ptr(),
            a_stride as isize,
            1,
            1.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlapping_rows_multiply_as_by_hand() {
        // Small integers are exact in f32, so equality holds in any order.
        for (m, n, k, a_stride, c_stride) in
            [(1, 1, 1, 1, 1), (5, 3, 7, 2, 4), (33, 36, 24, 8, 48), (70, 17, 9, 3, 17)]
        {
            let a: Vec<f32> = (0..(m - 1) * a_stride + k).map(|i| (i % 7) as f32 - 3.0).collect();
            let b: Vec<f32> = (0..k * n).map(|i| (i % 5) as f32 - 2.0).collect();
            let mut c = vec![9.0; (m - 1) * c_stride + n];
            let shape = Shape { m, n, k, a_stride, c_stride };
            multiply(shape, &a, &b, &mut c, false);
            multiply(shape, &a, &b, &mut c, true);
            for i in 0..m {
                for j in 0..c_stride.min(c.len() - i * c_stride) {
                    let twice: f32 =
                        (0..k).map(|l| 2.0 * a[i * a_stride + l] * b[l * n + j % n]).sum();
                    // Gaps between rows are unchanged.
                    assert_eq!(c[i * c_stride + j], if j < n { twice } else { 9.0 });
                }
            }
        }
    }

    /// `cargo test --release --lib gemm -- --ignored --nocapture`: reference for the decoder's
    /// speed (`examples/decoder_speed.rs`).
    #[test]
    #[ignore = "a measurement"]
    fn speed_of_a_large_product() {
        let n = 1024;
        let (a, b, mut c) = (vec![0.5; n * n], vec![0.25; n * n], vec![0.0; n * n]);
        let shape = Shape { m: n, n, k: n, a_stride: n, c_stride: n };
        let mut least = f64::MAX;
        for _ in 0..20 {
            let start = std::time::Instant::now();
            multiply(shape, &a, &b, &mut c, false);
            least = least.min(start.elapsed().as_secs_f64());
        }
        assert!(c.iter().all(|&v| v == 128.0));
        println!("{n} cubed, one thread: {:.0} GFLOP/s", 2e-9 * (n as f64).powi(3) / least);
    }

    #[test]
    #[should_panic(expected = "left matrix too short")]
    fn a_short_slice_is_refused() {
        let shape = Shape { m: 4, n: 2, k: 3, a_stride: 2, c_stride: 2 };
        multiply(shape, &[0.0; 8], &[0.0; 6], &mut [0.0; 8], false);
    }
}
