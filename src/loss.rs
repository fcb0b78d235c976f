//! Distance between renderings and photographs: the log-L1 loss of the paper (section 3),
//! `|ln(x + 0.01) - ln(y + 0.01)|`, one-sided for saturated measurements.
//!
//! A measurement is coded as in [`Observation::radiance`](crate::observation::Observation): `v >= 0`
//! is a value, `-v < 0` says "at least `v`". A rendering above a saturated measurement explains it,
//! so it costs nothing and has no derivative.

use crate::simd::Lanes;

/// Offset inside the logarithm: differences below it (in radiance) count little.
pub const EPSILON: f32 = 0.01;

/// Signed log residual `ln(rendered + 0.01) - ln(|observed| + 0.01)`, at most zero where the
/// measurement is saturated.
pub fn log_residual(rendered: f64, observed: f64) -> f64 {
    let epsilon = EPSILON as f64;
    let residual = ((rendered + epsilon) / (observed.abs() + epsilon)).ln();
    if observed < 0.0 { residual.min(0.0) } else { residual }
}

/// The loss of one value.
pub fn log_l1(rendered: f64, observed: f64) -> f64 {
    log_residual(rendered, observed).abs()
}

/// Derivative of [`log_l1`] by the rendering; 0 where both agree or the rendering explains a
/// saturated measurement.
#[cfg(test)]
pub(crate) fn log_l1_derivative(rendered: f64, observed: f64) -> f64 {
    let residual = log_residual(rendered, observed);
    if residual == 0.0 { 0.0 } else { residual.signum() / (rendered + EPSILON as f64) }
}

/// Huber's function, `r² / (2 threshold)` near zero and `|r| - threshold / 2` beyond: L1 with a
/// rounded corner, so that second-order methods converge.
#[cfg(test)]
pub(crate) fn huber(residual: f64, threshold: f64) -> f64 {
    let a = residual.abs();
    if a > threshold { a - 0.5 * threshold } else { 0.5 * a * a / threshold }
}

/// Weight of a squared residual in iteratively reweighted least squares that minimises [`huber`].
#[cfg(test)]
pub(crate) fn huber_weight(residual: f64, threshold: f64) -> f64 {
    residual.abs().max(threshold).recip()
}

/// A rendering and a measurement, both offset by [`EPSILON`].
#[derive(Clone, Copy)]
pub(crate) struct OffsetPair<V> {
    /// Rendering, lowered to the measurement where it explains a saturated one.
    pub rendered: V,
    /// Absolute value of the measurement.
    pub observed: V,
}

impl<V: Lanes> OffsetPair<V> {
    /// `offset_rendered` includes [`EPSILON`].
    #[inline(always)]
    pub fn new(offset_rendered: V, observed: V) -> Self {
        let offset = observed.abs() + V::splat(EPSILON);
        let explained = offset_rendered.min(offset);
        let rendered = V::splat(0.0).if_greater(observed, explained, offset_rendered);
        Self { rendered, observed: offset }
    }

    /// Sign of the residual: -1, 0 or 1; 0 for a measurement that is not a number.
    #[inline(always)]
    pub fn sign(self) -> V {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let negative = self.observed.if_greater(self.rendered, -one, zero);
        self.rendered.if_greater(self.observed, one, negative)
    }

    /// [`log_residual`].
    #[inline(always)]
    pub fn log_residual(self) -> V {
        (self.rendered / self.observed).ln()
    }

    /// Sum of [`log_l1`] over three channels with one logarithm. The products stay within the range
    /// of `f32` for radiances up to 1e10.
    #[inline(always)]
    pub fn log_l1_of_three(pairs: [Self; 3]) -> V {
        let (mut numerator, mut denominator) = (V::splat(1.0), V::splat(1.0));
        for p in pairs {
            numerator = numerator * p.rendered.max(p.observed);
            denominator = denominator * p.rendered.min(p.observed);
        }
        (numerator / denominator).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Kernel, LANES, dispatch};

    #[test]
    fn derivative_matches_finite_differences_off_the_corner() {
        for rendered in [0.0, 0.003, 0.2, 0.9, 3.0] {
            for observed in [0.1, 0.5, 2.0, -0.1, -0.5, -2.0] {
                let h = 1e-6;
                let numeric =
                    (log_l1(rendered + h, observed) - log_l1(rendered - h, observed)) / (2.0 * h);
                // Error of central differences: h² times the third derivative, here at most 2 /
                // 0.01³, plus rounding of 1e-16 / h.
                let error = (numeric - log_l1_derivative(rendered, observed)).abs();
                assert!(error < 1e-5, "{rendered} {observed}");
            }
        }
    }

    #[test]
    fn a_rendering_above_a_saturated_measurement_is_free() {
        assert_eq!(log_l1(1.3, -1.0), 0.0);
        assert_eq!(log_l1_derivative(1.3, -1.0), 0.0);
        assert!(log_l1(0.7, -1.0) > 0.3);
        assert!(log_l1_derivative(0.7, -1.0) < 0.0);
    }

    #[test]
    fn huber_meets_l1_and_its_weight_is_its_slope() {
        for r in [-2.0, -0.3, -0.01, 0.02, 0.5] {
            let h = 1e-6;
            let slope = (huber(r + h, 0.05) - huber(r - h, 0.05)) / (2.0 * h);
            assert!((slope - r * huber_weight(r, 0.05)).abs() < 1e-8);
        }
        assert!((huber(3.0, 1e-9) - 3.0).abs() < 1e-8);
    }

    struct InLanes([f32; LANES], [f32; LANES]);

    impl Kernel for InLanes {
        type Output = [[f32; LANES]; 3];
        #[inline(always)]
        fn run<V: Lanes>(self) -> Self::Output {
            let rendered = V::from_array(self.0) + V::splat(EPSILON);
            let pair = OffsetPair::new(rendered, V::from_array(self.1));
            let three = OffsetPair::log_l1_of_three([pair, pair, pair]);
            [pair.sign() / rendered, pair.log_residual(), three].map(V::to_array)
        }
    }

    #[test]
    fn lanes_agree_with_scalars() {
        let rendered = [0.0, 0.2, 0.5, 0.7, 1.5, 0.3, 30.0, 0.9];
        let observed = [0.1, 0.2, 0.1, -1.0, -1.0, 0.9, 0.0, -0.9];
        let [derivative, residual, three] = dispatch(InLanes(rendered, observed));
        for i in 0..LANES {
            let (r, o) = (rendered[i] as f64, observed[i] as f64);
            // Single precision: a few units in the last place of numbers up to 100.
            let close = |a: f32, b: f64| (a as f64 - b).abs() < 1e-6 * b.abs().max(1.0);
            assert!(close(derivative[i], log_l1_derivative(r, o)), "lane {i}");
            assert!(close(residual[i], log_residual(r, o)), "lane {i}");
            assert!(close(three[i], 3.0 * log_l1(r, o)), "lane {i}");
        }
    }
}
