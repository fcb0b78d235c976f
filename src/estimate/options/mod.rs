//! The numbers of the estimator's model, nested by phase: widths, noise, what is compared.
//!
//! A comment names each number's unit and origin: *derived* follows from something else that it
//! names, *paper* is Gao et al. 2019, *tuned* was chosen on training materials and on captures
//! simulated from them, unless it names another set. Numbers of the numerics (damping, longest steps,
//! samples, iterations, the schedule's steps), what is part of a trained network's input, and guards
//! against rounding are constants beside the code they belong to.

mod joint;
mod latent;

use serde::{Deserialize, Serialize};

use super::prior::Prior;
pub use joint::{JointOptions, JointPrior, SharedOptions};
pub use latent::LatentOptions;

/// All options; the default is what ships.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimateOptions {
    /// Numbers of photographs and texels.
    pub schedule: ScheduleOptions,
    /// Sigmas of a texel round the latent maps, before the joint solve.
    pub prior: Prior,
    /// Noise of the log residuals.
    pub noise: NoiseOptions,
    /// Fit of the latent code.
    pub latent: LatentOptions,
    /// Joint solve.
    pub joint: JointOptions,
}

/// Numbers of photographs from which on phases run, and of what they see.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScheduleOptions {
    /// Photographs from which on photographs are left out. Derived: with two, a texel's nine parameters
    /// explain six values.
    pub determined_from: usize,
    /// Photographs that a step sees, at most, except the last ones, of the maps. Tuned.
    pub photographs: usize,
    /// Texels along the longer side that phases work at, at most. Tuned.
    pub texels: usize,
}

impl Default for ScheduleOptions {
    fn default() -> Self {
        Self { determined_from: 3, photographs: 12, texels: 256 }
    }
}

/// Options of the noise of log residuals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseOptions {
    /// Expected scale, mean of absolute log residuals, that noise and model leave: where the
    /// estimate of the scale begins. Positive. Tuned.
    pub expected: f32,
    /// Standard deviation of the logarithm of a board's squares up to which this is so. Tuned.
    pub squares: f32,
    /// Power with which the expected scale grows beyond. Tuned.
    pub growth: f32,
    /// Largest expected scale. Tuned.
    pub most_expected: f32,
    /// Log residual below which the loss is quadratic, at most. Positive. Tuned.
    pub huber: f32,
    /// The same relative to the noise that was found. Tuned.
    pub huber_by_noise: f32,
    /// Residuals of a texel that its nine parameters take up: the prior leaves about six of them to
    /// the photographs. Tuned.
    pub parameters: f64,
    /// Residuals of a texel that the expected scale counts as at least. Tuned.
    pub min_belief: f64,
}

impl Default for NoiseOptions {
    fn default() -> Self {
        Self {
            expected: 0.05,
            squares: 0.0015,
            growth: 3.0,
            most_expected: 1.5,
            huber: 0.02,
            huber_by_noise: 3.0,
            parameters: 6.0,
            min_belief: 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_names_what_differs_only() {
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
