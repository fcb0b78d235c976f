//! Every tuned number of the estimator, nested by phase.
//!
//! A comment names each number's unit and origin: *derived* follows from something else that it
//! names, *paper* is Gao et al. 2019, *tuned* was chosen on training materials and on captures
//! simulated from them, unless it names another set. What is part of a trained network's input, and
//! guards against rounding, are constants beside the code they belong to.

mod bundle;
mod confidence;
mod latent;
mod lights;
mod outlook;
mod structured;
mod updates;

use serde::{Deserialize, Serialize};

use super::prior::Prior;
pub use bundle::BundleOptions;
pub use confidence::{CONFIDENCE_TERMS, ConfidenceOptions};
pub use latent::{BaselineOptions, GainOptions, LatentOptions};
pub use lights::LightOptions;
pub use outlook::OutlookOptions;
pub use structured::{StructuredOptions, Widths};
pub use updates::{
    ClassOptions, GroupOptions, NetworkOptions, PoolingOptions, SlopeOptions, WidthOptions,
};

/// All options; the default is what ships.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimateOptions {
    /// Which phase runs from how many photographs on, and for how long.
    pub schedule: ScheduleOptions,
    /// Widths of the prior of a texel.
    pub prior: Prior,
    /// Noise of the log residuals.
    pub noise: NoiseOptions,
    /// Levenberg-Marquardt steps of texels.
    pub solver: SolverOptions,
    /// Fit of the latent code.
    pub latent: LatentOptions,
    /// Gains of the maps as a whole.
    pub gains: GainOptions,
    /// Descent of texels together with what they share.
    pub bundle: BundleOptions,
    /// Structured prior.
    pub structured: StructuredOptions,
    /// Lights, ambient light and what texels are off as a whole.
    pub lights: LightOptions,
    /// Groups of texels of like colour.
    pub groups: GroupOptions,
    /// Pooling of gloss within groups.
    pub pooling: PoolingOptions,
    /// Material classes.
    pub classes: ClassOptions,
    /// Regression of slopes.
    pub slopes: SlopeOptions,
    /// Widths of the prior from the material.
    pub widths: WidthOptions,
    /// Learned prior.
    pub network: NetworkOptions,
    /// Baseline without a prior.
    pub baseline: BaselineOptions,
    /// Calibration of the stated deviations of the maps.
    pub confidence: ConfidenceOptions,
    /// Choice of the next view.
    pub outlook: OutlookOptions,
}

/// Options of the schedule: photographs from which on a phase runs, rounds, and
/// steps of the solver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScheduleOptions {
    /// Steps for one photograph, which are the last ones. Tuned.
    pub single_steps: usize,
    /// Photographs from which on lights and maps can be told apart. Derived: with two, a texel's
    /// nine parameters explain six values.
    pub lights_from: usize,
    /// Photographs from which on lights turn: with fewer they follow what noise and model leave.
    /// Tuned.
    pub turns_from: usize,
    /// Rounds of lights that are held, where they are only roughly known. Tuned.
    pub ambient_rounds: usize,
    /// The same where a board tells them, and the sample mirrors a room. Tuned.
    pub surround_rounds: usize,
    /// Rounds of lights that turn. Tuned.
    pub turn_rounds: usize,
    /// Steps before each round of lights. Tuned.
    pub steps_before_lights: usize,
    /// Photographs from which on slopes are regressed: in one, a slope looks like a darker colour.
    /// Tuned.
    pub slopes_from: usize,
    /// Steps before that. Tuned.
    pub steps_before_slopes: usize,
    /// Steps after that, where classes are not inferred. Tuned.
    pub steps_after_slopes: usize,
    /// Photographs from which on material classes are inferred: fewer do not tell them apart. Tuned.
    pub classes_from: usize,
    /// Steps after that. Tuned.
    pub steps_after_classes: usize,
    /// Steps after the learned prior, the last ones. Tuned.
    pub steps_after_network: usize,
    /// Photographs that a step sees, at most, except the last ones, of the maps. Tuned.
    pub photographs: usize,
    /// Texels along the longer side that phases work at, at most. Tuned.
    pub texels: usize,
    /// Last steps, at full size, of larger maps. Tuned.
    pub full_size_steps: usize,
    /// Texels to each side of the middle of the windows in which albedos and roughness go with colour,
    /// where maps are brought to full size. Tuned.
    pub guide_radius: usize,
    /// Change of the lights, in units of their expected errors, that is worth another round.
    pub light_tolerance: f64,
    /// Change of the lights, in the same units, by which the latent fit was misled: it is done again.
    /// Tuned.
    pub misled_by: f64,
    /// Radiance of ambient light, white paper under the flash being 1, from which on a smooth sample
    /// shows that a room is not uniform. Tuned.
    pub min_surround: f32,
    /// Fraction of a budget that the latent code may take: a step of the solver gains more. Tuned.
    pub latent_fraction: f32,
}

impl Default for ScheduleOptions {
    fn default() -> Self {
        Self {
            single_steps: 8,
            lights_from: 3,
            turns_from: 8,
            ambient_rounds: 4,
            surround_rounds: 2,
            turn_rounds: 4,
            steps_before_lights: 4,
            slopes_from: 2,
            steps_before_slopes: 6,
            steps_after_slopes: 4,
            classes_from: 3,
            steps_after_classes: 2,
            steps_after_network: 4,
            photographs: 12,
            texels: 256,
            full_size_steps: 6,
            guide_radius: 2,
            light_tolerance: 0.02,
            misled_by: 0.4,
            min_surround: 0.01,
            latent_fraction: 0.5,
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
    /// Largest scale assumed, in units of the expected one. Tuned.
    pub max: f32,
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
            max: 2.0,
        }
    }
}

/// Options of the solver of texels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolverOptions {
    /// Damping of the first step, relative to the diagonal. Tuned.
    pub first_damping: f32,
    /// What the damping is multiplied by after a step that helps. Tuned.
    pub ease: f32,
    /// The same after one that does not. Tuned.
    pub raise: f32,
    /// Longest step of a coordinate. Tuned.
    pub max_step: f32,
    /// How much wider than the prior's the deviations of slopes may be assumed. Tuned.
    pub max_widening: f32,
}

impl Default for SolverOptions {
    fn default() -> Self {
        Self { first_damping: 0.01, ease: 0.2, raise: 8.0, max_step: 0.3, max_widening: 4.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_names_what_differs_only() {
        let text =
            r#"{ "solver": { "max_step": 0.2 }, "prior": { "sigma": [1,1,1,1,1,1,1,1,1] } }"#;
        let options: EstimateOptions = serde_json::from_str(text).unwrap();
        assert_eq!(options.solver.max_step, 0.2);
        assert_eq!(options.solver.ease, SolverOptions::default().ease);
        assert_eq!(options.noise, NoiseOptions::default());
        let all = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<EstimateOptions>(&all).unwrap(), options);
        assert!(serde_json::from_str::<EstimateOptions>(r#"{ "solver": { "typo": 1 } }"#).is_err());
    }
}
