//! Hyperbolic tangent in plain arithmetic, so that loops over it vectorise.

/// Hyperbolic tangent to within 4e-7: the rational approximation of degree 13 over 6 that Eigen
/// uses, on the range outside which `f32` rounds the result to ±1.
#[inline]
pub(super) fn tanh(x: f32) -> f32 {
    const LIMIT: f32 = 7.905_311;
    let x = x.clamp(-LIMIT, LIMIT);
    let x2 = x * x;
    let mut p = -2.760_768_5e-16;
    for c in
        [2.000_188e-13, -8.604_672e-11, 5.122_297e-8, 1.485_722_4e-5, 6.372_619e-4, 4.893_524_6e-3]
    {
        p = p * x2 + c;
    }
    let mut q = 1.198_258_4e-6;
    for c in [1.185_347_1e-4, 2.268_434_6e-3, 4.893_525e-3] {
        q = q * x2 + c;
    }
    x * p / q
}

#[cfg(test)]
mod tests {
    #[test]
    fn tanh_is_close_everywhere() {
        for i in -120_000..=120_000 {
            let x = i as f32 * 1e-4;
            let d = f64::from(super::tanh(x)) - f64::from(x).tanh();
            assert!(d.abs() < 4e-7, "{x}: {d}");
        }
        assert!((super::tanh(f32::MAX) - 1.0).abs() < 4e-7);
    }
}
