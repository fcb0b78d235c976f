//! Every tuned number of the estimator, nested by phase.
//!
//! A comment names each number's unit and origin: *derived* follows from something else that it
//! names, *paper* is Gao et al. 2019, *tuned* was chosen on training materials and on captures
//! simulated from them, unless it names another set. What is part of a trained network's input, and
//! guards against rounding, are constants beside the code they belong to.

use serde::{Deserialize, Serialize};

use super::prior::Prior;

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
}

/// Options of the [schedule](super::schedule): photographs from which on a phase runs, rounds, and
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
    /// Photographs from which on residuals are pooled: those of fewer are too uncertain. Tuned.
    pub residuals_from: usize,
    /// How often residuals are pooled. Tuned.
    pub residual_rounds: usize,
    /// Steps after each. Tuned.
    pub steps_after_residuals: usize,
    /// Steps after the learned prior, the last ones. Tuned.
    pub steps_after_network: usize,
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
            residuals_from: 5,
            residual_rounds: 2,
            steps_after_residuals: 4,
            steps_after_network: 4,
            light_tolerance: 0.02,
            misled_by: 0.4,
            min_surround: 0.01,
            latent_fraction: 0.5,
        }
    }
}

/// Options of the [noise](super::noise) of log residuals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseOptions {
    /// Expected scale, mean of absolute log residuals, that noise and model leave: where the
    /// estimate of the scale begins. Positive. Tuned.
    pub expected: f32,
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
            huber: 0.02,
            huber_by_noise: 3.0,
            parameters: 6.0,
            min_belief: 0.5,
            max: 2.0,
        }
    }
}

/// Options of the [solver](super::solver) of texels.
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

/// Options of the [fit of the latent code](super::latent).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LatentOptions {
    /// Steps of the coarsest level after the first photograph: with more, one photograph's highlights
    /// and shading are explained by gloss and bumps that are not there. Tuned.
    pub first_steps: usize,
    /// Steps of the coarsest level after each further photograph. Tuned.
    pub steps: usize,
    /// Steps of each finer level after each photograph. Tuned.
    pub fine_steps: usize,
    /// Photographs that came before the fit had settled and add their steps, at most. Tuned.
    pub max_pending: usize,
    /// Length of the first steps, in units of the code (whose variance is 1); falls to zero over
    /// the steps of a level as half a cosine. Tuned.
    pub learning_rate: f32,
    /// The same for the finer levels. Tuned.
    pub fine_learning_rate: f32,
    /// Decay of Adam's moments. Tuned.
    pub betas: [f32; 2],
    /// Weight of the prior on the slopes beside the mean log-L1, divided by the squared number of
    /// photographs: mean over the texels of `sum ((slope - start) / deviation)² / 2`. Tuned.
    pub prior_weight: f32,
    /// Least deviation in that, in encoded units; otherwise it is the root mean square of the
    /// start's slopes: what looks flat mostly is, and on a polished surface small slopes show most.
    /// Tuned.
    pub min_deviation: f32,
    /// Smallest derivative of an albedo by its encoded value that a step assumes: black texels would
    /// otherwise stay black for ever. Tuned.
    pub min_derivative: f32,
    /// Whether each photograph begins with gains of the maps as a whole.
    pub gains: bool,
    /// Whether what the decoder cannot express of the start is kept.
    pub keep_detail: bool,
    /// Longest side up to which the coarsest level goes, texels. Paper.
    pub coarsest_texels: usize,
    /// Longest side that is fitted, texels; finer maps are interpolated from there. Tuned.
    pub finest_texels: usize,
}

impl Default for LatentOptions {
    fn default() -> Self {
        Self {
            first_steps: 8,
            steps: 30,
            fine_steps: 15,
            max_pending: 8,
            learning_rate: 0.03,
            fine_learning_rate: 0.01,
            betas: [0.9, 0.99],
            prior_weight: 0.05,
            min_deviation: 0.01,
            min_derivative: 0.02,
            gains: true,
            keep_detail: true,
            coarsest_texels: 256,
            finest_texels: 512,
        }
    }
}

/// Options of the [gains](super::latent) of maps as a whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GainOptions {
    /// Expected size of logarithms of the gains of diffuse and specular albedo (three each), of the
    /// shift of the logit of roughness, of the logarithm of the gain of slopes. Tuned.
    pub sigma: [f64; 8],
    /// Weight of their prior beside the mean loss, divided by the number of photographs. Tuned.
    pub prior_weight: f64,
    /// Shifts of roughness from which the search begins: the loss has several minima in it. Tuned.
    pub starts: Vec<f64>,
    /// Steps from each start. Tuned.
    pub first_steps: usize,
    /// Further steps from the best. Tuned.
    pub further_steps: usize,
    /// Longest step. Tuned.
    pub max_step: f64,
    /// Loss relative to the best so far that a further start must reach. Tuned.
    pub better_start: f64,
    /// Loss relative to that without gains that is worth them. Tuned.
    pub better_maps: f64,
    /// Roughness is moved below this: its logit has no end at 1.
    pub max_roughness: f32,
}

impl Default for GainOptions {
    fn default() -> Self {
        Self {
            sigma: [0.4, 0.4, 0.4, 0.8, 0.8, 0.8, 1.2, 0.5],
            prior_weight: 1e-2,
            starts: vec![0.0, -2.0, -1.0, 1.0, 2.0],
            first_steps: 4,
            further_steps: 12,
            max_step: 0.7,
            better_start: 0.98,
            better_maps: 0.99,
            max_roughness: 0.98,
        }
    }
}

/// Options of the [lights](super::lights).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightOptions {
    /// Steps of a round, at most. Tuned.
    pub steps: usize,
    /// Texels a side that are looked at, at most. Tuned.
    pub texels: usize,
    /// Texels that count as independent, to weigh the sigmas against: errors of the model are alike
    /// all over a sample. Tuned.
    pub independent_texels: f64,
    /// Expected error of a light's direction, radians, at most: lights that turn out to be nearly
    /// right are held narrowly. Tuned.
    pub direction_sigma: f64,
    /// The same at least, however little lights have turned. Tuned.
    pub min_direction_sigma: f64,
    /// Expected ambient irradiance, as a fraction of the flash's. Tuned.
    pub ambient_sigma: f64,
    /// Expected logarithm of [`View::mirrored`](crate::observation::View::mirrored): less than of
    /// rooms, as texels share what the model cannot say of lobes. Tuned.
    pub mirrored_sigma: f64,
    /// Expected mean slope of a sample's piece: at least, and relative to the slopes' deviation.
    /// Tuned on training materials.
    pub flatness: [f64; 2],
    /// Noise assumed, log residuals: least and greatest. Tuned.
    pub noise: [f64; 2],
    /// Largest residual below which the loss is quadratic. Tuned.
    pub huber: f64,
    /// Damping of texels, relative to their diagonal: the first, the least, the greatest; with more,
    /// texels hold the lights where they are. Tuned.
    pub first_damping: f64,
    /// See [`LightOptions::first_damping`].
    pub damping: [f64; 2],
    /// What a texel's damping is multiplied by after its whole step. Tuned.
    pub ease: f64,
    /// The same after less of it. Tuned.
    pub raise: f64,
    /// What every damping is multiplied by when no step descends. Tuned.
    pub refuse: f64,
    /// Fractions of a step that are tried. Tuned.
    pub lengths: [f64; 2],
    /// Longest step of a light, and longest turn, radians. Derived: the small-angle model.
    pub max_turn: [f64; 2],
    /// Largest ambient fraction. Derived: beyond it a capture is no flash capture.
    pub max_ambient: f64,
    /// Longest step of a texel's coordinate. Tuned.
    pub max_step: f64,
    /// Mean residual of turned lights relative to that of held ones that turning must reach: with
    /// less, lights follow noise and what the model cannot say. Tuned.
    pub evidence: f64,
    /// Mean residual that rounding of radiances to half floats leaves, at most. Derived.
    pub rounding: f64,
    /// Relative decrease of the cost of a step that is not worth another. Tuned.
    pub converged: f64,
    /// Changes of ambient light, of the logarithm of what is mirrored, and of the offset of the maps
    /// that are nothing. Tuned.
    pub still: [f64; 3],
    /// Steps with such changes after which held lights are found. Tuned.
    pub still_steps: usize,
}

impl Default for LightOptions {
    fn default() -> Self {
        Self {
            steps: 20,
            texels: 64,
            independent_texels: 1000.0,
            direction_sigma: 0.05,
            min_direction_sigma: 0.003,
            ambient_sigma: 0.05,
            mirrored_sigma: 0.15,
            flatness: [0.005, 0.12],
            noise: [0.001, 0.1],
            huber: 0.02,
            first_damping: 1e-4,
            damping: [1e-6, 0.01],
            ease: 0.2,
            raise: 2.0,
            refuse: 30.0,
            lengths: [1.0, 0.3],
            max_turn: [0.06, 0.3],
            max_ambient: 0.4,
            max_step: 0.2,
            evidence: 0.6,
            rounding: 2.5e-4,
            converged: 3e-4,
            still: [1e-4, 5e-3, 5e-4],
            still_steps: 2,
        }
    }
}

/// Options of the [groups](super::updates) of texels of like diffuse colour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroupOptions {
    /// Texels that found the groups. Tuned.
    pub samples: usize,
    /// Distance of root albedos at which a texel belongs to two groups alike. Tuned.
    pub reach: f32,
    /// Spread that a group has at least, roughness or root albedo. Tuned.
    pub min_spread: f32,
    /// Variance of the mean of a group that no texel tells. Tuned.
    pub doubt: f32,
    /// Texels that halve it. Tuned.
    pub doubt_texels: f32,
    /// Rounds of k-means. Converged.
    pub rounds: usize,
}

impl Default for GroupOptions {
    fn default() -> Self {
        Self {
            samples: 2048,
            reach: 0.06,
            min_spread: 0.04,
            doubt: 0.04,
            doubt_texels: 20.0,
            rounds: 10,
        }
    }
}

/// Options of the [pooling](super::updates) of gloss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoolingOptions {
    /// Log residual that one photograph's model error and noise leave. Tuned.
    pub noise: f32,
    /// How far the maps may be off where nothing was seen: roughness, root of specular albedo.
    /// Tuned.
    pub deviation: [f32; 2],
}

impl Default for PoolingOptions {
    fn default() -> Self {
        Self { noise: 0.1, deviation: [0.25, 0.15] }
    }
}

/// Options of the [material classes](super::updates).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClassOptions {
    /// Roughness of dielectrics that compete as well: matt ones have no highlight that would show
    /// them. Tuned.
    pub matt: [f32; 2],
    /// Root of their specular albedo. Derived: 4 %, that of most dielectrics.
    pub matt_root: f32,
    /// Texels along the longer side that are looked at, at most. Tuned.
    pub texels: usize,
    /// Texels that found the classes. Tuned.
    pub samples: usize,
    /// Precision, in those of the maps where nothing was seen, at which a texel's gloss is half
    /// trusted to be a class. Tuned.
    pub trust: f32,
    /// Steps of the solver for each class. Tuned.
    pub steps: usize,
    /// Scale of log residuals that model and noise leave. Tuned.
    pub noise: f32,
    /// Residuals of a texel that count as independent, for each photograph: half of what there are,
    /// for the solver has been free to explain some. Tuned.
    pub independent: f32,
    /// Cost that is expected of a texel without any misfit. Tuned.
    pub expected_cost: f32,
    /// Expected deviation of roots of diffuse albedos from the mean when the gloss changes. Tuned.
    pub diffuse_sigma: f32,
    /// Rounds of k-means. Converged.
    pub rounds: usize,
    /// Rounds of expectation maximisation. Converged.
    pub expectations: usize,
}

impl Default for ClassOptions {
    fn default() -> Self {
        Self {
            matt: [0.6, 0.85],
            matt_root: 0.2,
            texels: 128,
            samples: 8192,
            trust: 10.0,
            steps: 6,
            noise: 0.1,
            independent: 1.5,
            expected_cost: 1.0,
            diffuse_sigma: 0.25,
            rounds: 10,
            expectations: 20,
        }
    }
}

/// Options of the [regression of slopes](super::updates).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SlopeOptions {
    /// Radii over which the maps' slopes are averaged, texels. Tuned.
    pub slope_radii: [usize; 3],
    /// Radii over which a colour is averaged before its gradient is taken. Tuned.
    pub colour_radii: [usize; 4],
    /// Albedo that keeps logarithms of dark colours finite. Tuned.
    pub dark: f32,
    /// Fraction of their own information by which coefficients are held at zero. Tuned.
    pub ridge: f64,
}

impl Default for SlopeOptions {
    fn default() -> Self {
        Self { slope_radii: [0, 1, 3], colour_radii: [0, 1, 2, 4], dark: 0.02, ridge: 1e-3 }
    }
}

/// Options of the [widths](super::updates) that the material shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WidthOptions {
    /// Least fraction of a sigma that is left of it. Tuned.
    pub min_fraction: f64,
    /// A sigma at least, in units of what texels have in common with their neighbours: half of it
    /// takes relief of fine weaves for noise, twice of it leaves much noise. Tuned.
    pub min_common: f64,
    /// Rounds of the search for the most probable sigma. Converged: it moves by less than 1 % in
    /// further ones.
    pub rounds: usize,
    /// What photographs must tell of a parameter to count, in units of what the prior does. Tuned.
    pub min_information: f32,
    /// Least fraction of the prior's variance that photographs leave. Derived: rounding.
    pub min_open: f32,
    /// Photographs from which on they tell how much roughness varies: fewer take it for specular
    /// albedo. Tuned.
    pub roughness_from: usize,
}

impl Default for WidthOptions {
    fn default() -> Self {
        Self {
            min_fraction: 0.05,
            min_common: 2.0,
            rounds: 12,
            min_information: 1e-3,
            min_open: 1e-3,
            roughness_from: 3,
        }
    }
}

/// Options of the [learned prior](super::updates).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NetworkOptions {
    /// Texels along the longer side that the network sees, at most: what it was trained on.
    pub texels: usize,
    /// Bounds of a material's scales, sigmas. Training.
    pub scale: [f32; 2],
    /// Least steepness of a material. Training.
    pub min_slope: f32,
}

impl Default for NetworkOptions {
    fn default() -> Self {
        Self { texels: 256, scale: [0.02, 2.0], min_slope: 0.01 }
    }
}

/// Options of the [baseline](super::baseline): the best of a search over rates, decays and lengths
/// on synthetic texels; longer or faster runs fit the noise, not the material.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BaselineOptions {
    /// Iterations.
    pub steps: usize,
    /// First step size, in encoded units.
    pub learning_rate: f32,
    /// Step size of the last iteration, as a fraction of the first.
    pub final_fraction: f32,
    /// Decay of the mean gradient. Paper.
    pub beta1: f32,
    /// Decay of the mean squared gradient.
    pub beta2: f32,
}

impl Default for BaselineOptions {
    fn default() -> Self {
        Self { steps: 800, learning_rate: 0.01, final_fraction: 0.01, beta1: 0.5, beta2: 0.999 }
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
