//! The numbers of the estimator's model, nested by phase: widths, noise, what is compared.
//!
//! A comment names each number's unit and origin: *derived* follows from something else that it
//! names, *paper* is Gao et al. 2019, *tuned* was chosen on training materials and on captures
//! simulated from them, unless it names another set. Numbers of the numerics (damping, longest steps,
//! samples, iterations, the schedule's steps), what is part of a trained network's input, and guards
//! against rounding are constants beside the code they belong to.

mod latent;
mod lights;
mod structured;
mod updates;

use serde::{Deserialize, Serialize};

use super::prior::Prior;
pub use latent::LatentOptions;
pub use lights::LightOptions;
pub use structured::{StructuredOptions, Widths};
pub use updates::{ClassOptions, PoolingOptions, WidthOptions};

/// All options; the default is what ships.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimateOptions {
    /// Numbers of photographs and texels.
    pub schedule: ScheduleOptions,
    /// Widths of the prior of a texel.
    pub prior: Prior,
    /// Noise of the log residuals.
    pub noise: NoiseOptions,
    /// Fit of the latent code.
    pub latent: LatentOptions,
    /// Structured prior.
    pub structured: StructuredOptions,
    /// Lights, ambient light and what texels are off as a whole.
    pub lights: LightOptions,
    /// Groups of texels of like colour, and pooling of gloss within them.
    pub pooling: PoolingOptions,
    /// Material classes.
    pub classes: ClassOptions,
    /// Widths of the prior from the material.
    pub widths: WidthOptions,
}

/// Options of the schedule: numbers of photographs from which on phases run, and of what they see.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScheduleOptions {
    /// Photographs from which on lights, classes of gloss and the variation of roughness are found, and
    /// photographs are left out. Derived: with two, a texel's nine parameters explain six values.
    pub determined_from: usize,
    /// Photographs from which on lights turn: with fewer they follow what noise and model leave.
    /// Tuned.
    pub turns_from: usize,
    /// Photographs that a step sees, at most, except the last ones, of the maps. Tuned.
    pub photographs: usize,
    /// Texels along the longer side that phases work at, at most. Tuned.
    pub texels: usize,
    /// Change of the lights, in units of their expected errors, by which the latent fit was misled: it is done again.
    /// Tuned.
    pub misled_by: f64,
    /// Radiance of ambient light, white paper under the flash being 1, from which on a smooth sample
    /// shows that a room is not uniform. Tuned.
    pub min_surround: f32,
}

impl Default for ScheduleOptions {
    fn default() -> Self {
        Self {
            determined_from: 3,
            turns_from: 8,
            photographs: 12,
            texels: 256,
            misled_by: 0.4,
            min_surround: 0.01,
        }
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
    /// Without a board: mean residual of texels that share their gloss, up to which this is so. Tuned.
    pub texels: f32,
    /// Power of either with which the expected scale grows beyond. Tuned.
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
            texels: 0.01,
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
        let text = r#"{ "pooling": { "reach": 0.2 }, "prior": { "sigma": [1,1,1,1,1,1,1,1,1] } }"#;
        let options: EstimateOptions = serde_json::from_str(text).unwrap();
        assert_eq!(options.pooling.reach, 0.2);
        assert_eq!(options.pooling.deviation, PoolingOptions::default().deviation);
        assert_eq!(options.noise, NoiseOptions::default());
        let all = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<EstimateOptions>(&all).unwrap(), options);
        assert!(
            serde_json::from_str::<EstimateOptions>(r#"{ "pooling": { "typo": 1 } }"#).is_err()
        );
    }
}
