//! Inverse of the tone curves of cameras.

use serde::{Deserialize, Serialize};

/// Exponent of the encoded value in which curves are smooth, about that of sRGB.
const ENCODED: f64 = 1.0 / 2.2;
/// Encoded value that a curve leaves unchanged: white paper in an ordinary exposure.
const ANCHOR: f64 = 0.75;
/// Range of log stored values in the table; the lower end covers the smallest 8-bit value of sRGB.
const LOG_LEAST: f64 = -9.0;
const STEPS: usize = 576;
/// Steps of a table over square roots of values.
const TABLE_STEPS: usize = 4096;

/// Inverse of a camera's tone curve: from stored linear values (decoded, 1 = full scale) to values
/// proportional to radiance.
///
/// In log-log space its slope is `exp(a (1 - e)² + 2 b e (1 - e) + c e²)` at the encoded value `e =
/// stored^(1 / 2.2)`, so the curve rises for all parameters. `a = b = c` gives a power law, zeros
/// give the identity. Beyond full scale the slope is constant. The stored value 0.53 (encoded 0.75)
/// is a fixed point; the photometry determines the scale.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ToneCurve {
    /// Log slopes in shadows (`a`), midtones (`b`) and highlights (`c`).
    pub log_slopes: [f64; 3],
    /// Stored values from here on are undetermined and count as saturated. 0: none.
    pub unknown_from: f32,
}

/// Weights of the three parameters at an encoded value.
fn weights(encoded: f64) -> [f64; 3] {
    let e = encoded.min(1.0);
    [(1.0 - e) * (1.0 - e), 2.0 * e * (1.0 - e), e * e]
}

impl ToneCurve {
    /// Largest magnitude of a log slope.
    pub const MAX_LOG_SLOPE: f64 = 2.0;

    /// Whether the values are possible (for saved data).
    pub(crate) fn is_plausible(&self) -> bool {
        self.log_slopes.iter().all(|s| s.abs() <= Self::MAX_LOG_SLOPE)
            && (0.0..=f32::MAX).contains(&self.unknown_from)
    }

    /// Radiance-proportional values of stored ones.
    pub fn undone(&self, stored: [f32; 3]) -> [f32; 3] {
        ToneTable::new(self).map_or(stored, |table| stored.map(|v| table.undo(v)))
    }

    /// Ratio of the stored values of two surfaces under the same light, the brighter one at the fixed point.
    pub(crate) fn stored_ratio(&self, radiances: f32) -> f32 {
        let anchor = ANCHOR.powf(1.0 / ENCODED) as f32;
        ToneTable::new(self).map_or(radiances, |table| table.put_on(anchor * radiances) / anchor)
    }

    /// Whether the curve changes nothing.
    pub fn is_identity(&self) -> bool {
        self.log_slopes == [0.0; 3]
    }

    /// Log of the log-log slope at a log stored value.
    fn log_slope(&self, log_stored: f64) -> f64 {
        let w = weights((log_stored * ENCODED).exp());
        (0..3).map(|k| w[k] * self.log_slopes[k]).sum()
    }
}

/// A curve at one log stored value.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lift {
    /// Increment of the log from stored value to radiance.
    pub log_gain: f64,
    /// Derivative of the log radiance by the log stored value.
    pub slope: f64,
    /// Derivatives of `log_gain` by the parameters.
    pub by_parameters: [f64; 3],
}

/// A curve with tabulated integrals over log values.
pub(crate) struct LogCurve {
    curve: ToneCurve,
    /// Integrals from the fixed point of the slope minus 1, and of the slope times each weight.
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

    /// Integrals up to a log value, linear between nodes.
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

/// Tables of a curve for many values.
pub(crate) struct ToneTable {
    /// Radiances at equal steps of the square root of the stored value, 0 to 1.
    radiance: Vec<f32>,
    /// Log-log slope beyond full scale.
    slope: f32,
}

impl ToneTable {
    /// `None` for the identity.
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

    /// Radiance-proportional value of a stored one, extended as an odd function.
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

    /// Inverse of [`Self::undo`].
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
    fn zero_parameters_are_the_identity_and_equal_ones_a_power_law() {
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
            // Table steps: 1e-4 relative at the lowest values.
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
                // single precision, steep inverse
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
                // Second order in steps of 1/64 of the log.
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
