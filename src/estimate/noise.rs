//! The noise of log residuals: a scale for each colour, and where the loss turns from quadratic to
//! linear.

use super::options::NoiseOptions;
use crate::{Error, Result};

/// How far log residuals of a colour are expected to be off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Noise {
    /// Mean of absolute values.
    pub scale: f32,
    /// Residual below which the loss is quadratic.
    pub huber: f32,
}

impl Noise {
    /// Before the photographs have told.
    pub fn expected(options: &NoiseOptions) -> Self {
        Self { scale: options.expected, huber: options.huber }
    }

    /// A scale that stands for noise and errors of the model together, quadratic below it.
    pub fn of_model(scale: f32) -> Self {
        Self { scale, huber: scale }
    }

    /// From the mean log-L1 `loss` that a fit leaves. Texels' parameters have taken their part of
    /// it; of few photographs there are hardly more residuals than parameters, and the expected
    /// scale counts. `photographs` is their mean number per texel.
    pub fn found(options: &NoiseOptions, loss: f64, photographs: f64) -> Self {
        let residuals = 3.0 * photographs;
        let excess = (residuals - options.parameters).max(0.0);
        let belief = (options.parameters - excess).max(options.min_belief);
        let estimate = (belief * options.expected as f64 + residuals * loss) / (belief + excess);
        let scale = estimate as f32;
        Self { scale, huber: (options.huber_by_noise * scale).min(options.huber) }
    }
}

impl NoiseOptions {
    /// What is expected where the board's squares are off their model by `log_sigma`: the model of light
    /// and lens is seen to fail there, and the model of the material fails with it.
    pub(super) fn calibrated(&self, log_sigma: f32) -> Self {
        let grown = self.expected * (log_sigma / self.squares).max(1.0).powf(self.growth);
        Self { expected: grown.min(self.most_expected.max(self.expected)), ..*self }
    }

    pub(super) fn check(&self) -> Result<()> {
        let positive = |x: f32| x.is_finite() && x > 0.0;
        if positive(self.expected) && positive(self.huber) {
            return Ok(());
        }
        Err(Error::argument("noise", "expected and huber must be positive numbers"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_off_their_model_ask_for_caution() {
        let options = NoiseOptions::default();
        let expected = |log_sigma: f32| options.calibrated(log_sigma).expected;
        // Without squares, and of exact ones, nothing changes.
        assert_eq!(options.calibrated(0.0), options);
        assert_eq!(expected(options.squares), options.expected);
        // The third power beyond, up to the most.
        assert!((expected(0.003) / options.expected - 8.0).abs() < 1e-3);
        assert_eq!(expected(0.1), options.most_expected);
        let rising = (0..60).map(|i| expected(0.0001 * i as f32)).collect::<Vec<_>>();
        assert!(rising.is_sorted());
    }
}
