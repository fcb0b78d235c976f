//! The noise of log residuals: their scale, and the residual at which the loss turns from quadratic to linear.

use super::options::NoiseOptions;
use crate::{Error, Result};

/// Expected size of log residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Noise {
    /// Mean of absolute values.
    pub scale: f32,
    /// Residual below which the loss is quadratic.
    pub huber: f32,
}

impl Noise {
    /// The scale before any residuals.
    pub fn expected(options: &NoiseOptions) -> Self {
        Self { scale: options.expected, huber: options.huber }
    }

    /// A scale for noise and errors of the model together, quadratic below it.
    pub fn of_model(scale: f32) -> Self {
        Self { scale, huber: scale }
    }

    pub(super) fn check(&self) -> Result<()> {
        let positive = |x: f32| x.is_finite() && x > 0.0;
        if positive(self.scale) && positive(self.huber) {
            return Ok(());
        }
        Err(Error::argument("noise", "scale and huber must be positive numbers"))
    }
}

impl NoiseOptions {
    /// Options for a board whose squares deviate from their model by `log_sigma`: the model of light and lens
    /// fails there, and the model of the material with it.
    pub(super) fn calibrated(&self, log_sigma: f32) -> Self {
        let grown = self.expected * (log_sigma / self.squares).max(1.0).powf(self.growth);
        Self { expected: grown.min(self.most_expected.max(self.expected)), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviating_squares_raise_the_expected_noise() {
        let options = NoiseOptions::default();
        let expected = |log_sigma: f32| options.calibrated(log_sigma).expected;
        // Absent or exact squares change nothing.
        assert_eq!(options.calibrated(0.0), options);
        assert_eq!(expected(options.squares), options.expected);
        // The scale grows with the third power, up to a limit.
        assert!((expected(0.003) / options.expected - 8.0).abs() < 1e-3);
        assert_eq!(expected(0.1), options.most_expected);
        let rising = (0..60).map(|i| expected(0.0001 * i as f32)).collect::<Vec<_>>();
        assert!(rising.is_sorted());
    }
}
