//! The numbers of the estimator's model, nested by phase: sigmas, noise, candidates.
//!
//! A comment states the unit and origin of each number: *derived* from another one, *paper* (Gao et al.
//! 2019), *tuned* on training materials and captures simulated from them, unless it names another set, or
//! *round*: a number of the expected size that was not fitted.
//! Numerical settings (damping, longest steps, samples, iterations), inputs of trained networks and guards
//! against rounding are constants beside their code.

mod joint;
mod latent;

use serde::{Deserialize, Serialize};

use super::prior::Prior;
pub use joint::{JointOptions, JointPrior, SharedOptions};
pub use latent::LatentOptions;

/// All options; the default is the one in use.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimateOptions {
    /// Numbers of photographs and texels.
    pub schedule: ScheduleOptions,
    /// Sigmas of a texel round the latent maps, in the relief phase.
    pub prior: Prior,
    /// Noise of the log residuals.
    pub noise: NoiseOptions,
    /// Fit of the latent code.
    pub latent: LatentOptions,
    /// Joint solve.
    pub joint: JointOptions,
}

/// Numbers of photographs and texels in the phases.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScheduleOptions {
    /// Fewest photographs for leave-one-out predictions. Derived: two photographs have six values for a
    /// texel's nine parameters.
    pub determined_from: usize,
    /// Largest number of photographs in a step before the joint solve. Tuned.
    pub photographs: usize,
    /// Largest number of texels along the longer side in phases before the last. Tuned.
    pub texels: usize,
    /// Parts that are left out, to measure their contribution; none by default.
    pub without: Vec<Omission>,
}

/// An optional part of the estimator: a phase, or the lobes that the phase `choice` tries. The phase `latent` is not
/// optional, because all others start from its maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Omission {
    /// The phase `relief`.
    Relief,
    /// The phase `choice`: the joint solve has the prior for few photographs.
    Choice,
    /// All optional lobes.
    Lobes,
    /// The phase `joint`.
    Joint,
    /// The phase `texels`.
    Texels,
}

impl Omission {
    /// Its name in options; that of the phase, if it is one.
    pub fn name(self) -> &'static str {
        match self {
            Self::Relief => "relief",
            Self::Choice => "choice",
            Self::Lobes => "lobes",
            Self::Joint => "joint",
            Self::Texels => "texels",
        }
    }
}

impl Default for ScheduleOptions {
    fn default() -> Self {
        Self { determined_from: 3, photographs: 12, texels: 256, without: Vec::new() }
    }
}

/// Options of the noise of log residuals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseOptions {
    /// Expected scale, mean of absolute log residuals, of noise and errors of the model. Positive. Tuned.
    pub expected: f32,
    /// Standard deviation of the logarithm of a board's squares up to which `expected` holds. Tuned.
    pub squares: f32,
    /// Exponent of the expected scale's growth beyond `squares`. Tuned.
    pub growth: f32,
    /// Largest expected scale. Tuned.
    pub most_expected: f32,
    /// Largest log residual with a quadratic loss. Positive. Tuned.
    pub huber: f32,
}

impl Default for NoiseOptions {
    fn default() -> Self {
        Self { expected: 0.05, squares: 0.0015, growth: 3.0, most_expected: 1.5, huber: 0.02 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_needs_only_the_changed_options() {
        let text = r#"{ "joint": { "independent_texels": 20 }, "prior": { "sigma": [1,1,1,1,1,1,1,1,1] } }"#;
        let options: EstimateOptions = serde_json::from_str(text).unwrap();
        assert_eq!(options.joint.independent_texels, 20.0);
        assert_eq!(options.joint.shared, SharedOptions::default());
        assert_eq!(options.noise, NoiseOptions::default());
        let all = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<EstimateOptions>(&all).unwrap(), options);
        assert!(serde_json::from_str::<EstimateOptions>(r#"{ "joint": { "typo": 1 } }"#).is_err());
    }
}
