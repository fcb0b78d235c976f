//! What cameras do to values beyond their encoding, undone.

use serde::{Deserialize, Serialize};

/// Exponent of the encoded value in which curves are smooth: about that of sRGB.
const ENCODED: f64 = 1.0 / 2.2;
/// Encoded value that a curve leaves where it is: of white paper in an ordinary exposure.
const ANCHOR: f64 = 0.75;
/// Logarithms of stored values between which the curve is tabulated: the least covers the lowest
/// 8-bit value of sRGB.
const LOG_LEAST: f64 = -9.0;
const STEPS: usize = 576;
/// Steps of a table over the square roots of values.
const TABLE_STEPS: usize = 4096;

/// A camera's tone curve, as what undoes it: from stored linear values (decoded, 1 = full scale) to
/// values proportional to radiance.
///
/// Over logarithms its slope is `exp(a (1 - e)² + 2 b e (1 - e) + c e²)` at the encoded value
/// `e = stored^(1 / 2.2)`: always positive, so that the curve rises whatever the parameters; with
/// `a = b = c` it is a power law, and zeros leave everything as it is. Beyond full scale the slope
/// stays. The stored value 0.53 (an encoded 0.75) is its own radiance; scale is the photometry's.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ToneCurve {
    /// Logarithms of the slope in shadows (`a`), at middle values (`b`) and in highlights (`c`).
    pub log_slopes: [f64; 3],
    /// Stored values from which on the curve is not known: they count as saturated. 0: none.
    pub unknown_from: f32,
}

/// Weights of the three parameters at an encoded value.
fn weights(encoded: f64) -> [f64; 3] {
    let e = encoded.min(1.0);
    [(1.0 - e) * (1.0 - e), 2.0 * e * (1.0 - e), e * e]
}

impl ToneCurve {
    /// Largest logarithm of a slope, either way, that is looked for and believed.
    pub const MAX_LOG_SLOPE: f64 = 2.0;

    /// Whether a camera may have such a curve.
    pub(crate) fn is_plausible(&self) -> bool {
        self.log_slopes.iter().all(|s| s.abs() <= Self::MAX_LOG_SLOPE)
            && (0.0..=f32::MAX).contains(&self.unknown_from)
    }

    /// Values proportional to radiance of stored ones.
    pub fn undone(&self, stored: [f32; 3]) -> [f32; 3] {
        ToneTable::new(self).map_or(stored, |table| stored.map(|v| table.undo(v)))
    }

    /// Ratio of the stored values of two surfaces under the same light, the brighter one at the
    /// anchor.
    pub(crate) fn stored_ratio(&self, radiances: f32) -> f32 {
        let anchor = ANCHOR.powf(1.0 / ENCODED) as f32;
        ToneTable::new(self).map_or(radiances, |table| table.put_on(anchor * radiances) / anchor)
    }

    /// Whether values stay as they are.
    pub fn is_identity(&self) -> bool {
        self.log_slopes == [0.0; 3]
    }

    /// Logarithm of the slope over logarithms at the logarithm of a stored value.
    fn log_slope(&self, log_stored: f64) -> f64 {
        let w = weights((log_stored * ENCODED).exp());
        (0..3).map(|k| w[k] * self.log_slopes[k]).sum()
    }
}

/// Where a curve takes the logarithm of a value, and how.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lift {
    /// What is added to the logarithm of a stored value.
    pub log_gain: f64,
    /// Derivative of the logarithm of the radiance with respect to that of the stored value.
    pub slope: f64,
    /// Derivatives of `log_gain` with respect to the parameters.
    pub by_parameters: [f64; 3],
}

/// A curve with its integrals, for logarithms of values.
pub(crate) struct LogCurve {
    curve: ToneCurve,
    /// Integrals of slope less 1 and of the slope times each weight, from the anchor on.
    nodes: Vec<[f64; 4]>,
}

impl LogCurve {
    const STEP: f64 = -LOG_LEAST / STEPS as f64;

    pub fn new(curve: ToneCurve) -> Self {
        let rates = |log_stored: f64| {
            let slope = curve.log_slope(log_stored).exp();
            let [a, b, c] = weights((log_stored * ENCODED).exp()).map(|w| w * slope);
            [slope - 1.0, a, b, c]
        };
        let mut sum = [0.0; 4];
        let mut nodes = vec![sum];
        for i in 0..STEPS {
            let at = |part: f64| rates(LOG_LEAST + (i as f64 + part) * Self::STEP);
            let (low, middle, high) = (at(0.0), at(0.5), at(1.0));
            for k in 0..4 {
                // Simpson's rule
                sum[k] += Self::STEP / 6.0 * (low[k] + 4.0 * middle[k] + high[k]);
            }
            nodes.push(sum);
        }
        let mut made = Self { curve, nodes };
        let anchor = made.read(ANCHOR.ln() / ENCODED);
        for node in &mut made.nodes {
            (0..4).for_each(|k| node[k] -= anchor[k]);
        }
        made
    }

    /// Integrals up to a logarithm, between the nodes linear.
    fn read(&self, log_stored: f64) -> [f64; 4] {
        let at = (log_stored - LOG_LEAST) / Self::STEP;
        let low = at.floor().clamp(0.0, (STEPS - 1) as f64) as usize;
        let part = at - low as f64;
        let (from, to) = (self.nodes[low], self.nodes[low + 1]);
        std::array::from_fn(|k| from[k] + part * (to[k] - from[k]))
    }

    pub fn at(&self, log_stored: f64) -> Lift {
        let [log_gain, by_parameters @ ..] = self.read(log_stored);
        let slope = self.curve.log_slope(log_stored.max(LOG_LEAST)).exp();
        Lift { log_gain, slope, by_parameters }
    }
}

/// A curve and its inverse for many values.
pub(crate) struct ToneTable {
    /// At equal steps of the square root of the stored value, 0 to 1.
    radiance: Vec<f32>,
    /// Logarithmic slope beyond full scale.
    slope: f32,
}

impl ToneTable {
    /// `None` for a curve that leaves values as they are.
    pub fn new(curve: &ToneCurve) -> Option<Self> {
        if curve.is_identity() {
            return None;
        }
        let log = LogCurve::new(*curve);
        let value = |i: usize| {
            let log_stored = 2.0 * (i as f64 / TABLE_STEPS as f64).ln();
            (log_stored + log.at(log_stored).log_gain).exp() as f32
        };
        let radiance =
            std::iter::once(0.0).chain((1..=TABLE_STEPS).map(value)).collect::<Vec<f32>>();
        Some(Self { radiance, slope: curve.log_slopes[2].exp() as f32 })
    }

    fn full(&self) -> f32 {
        self.radiance[TABLE_STEPS]
    }

    /// Value proportional to radiance of a stored one; odd below 0.
    #[inline]
    pub fn undo(&self, stored: f32) -> f32 {
        let size = stored.abs();
        if size >= 1.0 || size.is_nan() {
            return (self.full() * size.powf(self.slope)).copysign(stored);
        }
        let at = size.sqrt() * TABLE_STEPS as f32;
        let (low, part) = (at as usize, at.fract());
        let (from, to) = (self.radiance[low], self.radiance[low + 1]);
        (from + part * (to - from)).copysign(stored)
    }

    /// The stored value that [`Self::undo`] makes this one of.
    pub fn put_on(&self, radiance: f32) -> f32 {
        let size = radiance.abs();
        if size >= self.full() || size.is_nan() {
            return (size / self.full()).powf(1.0 / self.slope).copysign(radiance);
        }
        let high = self.radiance.partition_point(|v| *v <= size).min(TABLE_STEPS);
        let low = high - 1;
        let (from, to) = (self.radiance[low], self.radiance[high]);
        let root = (low as f32 + (size - from) / (to - from)) / TABLE_STEPS as f32;
        (root * root).copysign(radiance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CURVES: [[f64; 3]; 4] =
        [[0.2, 0.2, 0.2], [-0.3, 0.1, 1.2], [0.5, -0.4, 0.8], [-0.8, -0.8, -0.8]];

    fn curve(log_slopes: [f64; 3]) -> ToneCurve {
        ToneCurve { log_slopes, ..ToneCurve::default() }
    }

    #[test]
    fn no_parameters_change_nothing_and_equal_ones_are_a_power_law() {
        assert!(ToneTable::new(&ToneCurve::default()).is_none());
        let none = LogCurve::new(ToneCurve::default());
        for log in [-20.0, -8.3, -3.0, -0.2, 0.0, 1.0] {
            let lift = none.at(log);
            assert_eq!((lift.log_gain, lift.slope), (0.0, 1.0), "{log}");
        }
        let (power, anchor) = (1.4_f64, ANCHOR.powf(2.2));
        let table = ToneTable::new(&curve([power.ln(); 3])).unwrap();
        for stored in [1e-4, 0.003, 0.1, 0.5, 0.97, 1.0, 3.0] {
            let expected = anchor * (stored / anchor).powf(power);
            let found = f64::from(table.undo(stored as f32));
            // Steps of the table: a part of 1e-4 at the lowest of these values.
            assert!((found / expected - 1.0).abs() < 3e-4, "{stored}: {found} {expected}");
        }
    }

    #[test]
    fn every_curve_rises_and_is_undone() {
        for log_slopes in CURVES {
            let table = ToneTable::new(&curve(log_slopes)).unwrap();
            let stored: Vec<f32> = (0..=500).map(|i| (i as f32 / 400.0).powi(3)).collect();
            let values: Vec<f32> = stored.iter().map(|v| table.undo(*v)).collect();
            assert!(values.windows(2).all(|w| w[1] > w[0]), "{log_slopes:?}");
            for (s, v) in stored.iter().zip(&values) {
                // single precision through a steep inverse
                assert!((table.put_on(*v) - s).abs() <= 2e-5 * s.max(0.01), "{s} {v}");
                assert_eq!(table.undo(-s), -v);
            }
            assert!(table.undo(f32::NAN).is_nan());
        }
    }

    #[test]
    fn slopes_and_derivatives_are_those_of_differences() {
        for log_slopes in CURVES {
            for log in [-6.0, -2.5, -0.7, -0.05] {
                let gain = |p: [f64; 3], log: f64| LogCurve::new(curve(p)).at(log).log_gain;
                let lift = LogCurve::new(curve(log_slopes)).at(log);
                let h = LogCurve::STEP;
                let slope =
                    1.0 + (gain(log_slopes, log + h) - gain(log_slopes, log - h)) / (2.0 * h);
                // Steps of 1/64 of the logarithm: second order.
                assert!((slope / lift.slope - 1.0).abs() < 1e-3, "{log}: {slope} {}", lift.slope);
                for k in 0..3 {
                    let (mut more, mut less) = (log_slopes, log_slopes);
                    more[k] += 1e-5;
                    less[k] -= 1e-5;
                    let numeric = (gain(more, log) - gain(less, log)) / 2e-5;
                    let analytic = lift.by_parameters[k];
                    assert!((numeric - analytic).abs() < 1e-8, "{k}: {numeric} {analytic}");
                }
            }
        }
    }
}
