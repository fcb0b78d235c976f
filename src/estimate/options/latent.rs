//! Options of the latent code, of gains, and of the baseline.

use serde::{Deserialize, Serialize};

/// Options of the fit of the latent code.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LatentOptions {
    /// Steps after the first photograph: with more, one photograph's highlights
    /// and shading are explained by gloss and bumps that are not there. Tuned.
    pub first_steps: usize,
    /// Steps after each further photograph. Tuned.
    pub steps: usize,
    /// Photographs up to which each has so many steps. The more there are, the less one of them moves
    /// the code: of more, its steps fall with their number. Tuned.
    pub all_steps_to: usize,
    /// Photographs that came before the fit had settled and add their steps, at most. Tuned.
    pub max_pending: usize,
    /// Length of the first steps, in units of the code (whose variance is 1); falls to zero over
    /// the steps as half a cosine. Tuned.
    pub learning_rate: f32,
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
}

impl Default for LatentOptions {
    fn default() -> Self {
        Self {
            first_steps: 8,
            steps: 30,
            all_steps_to: 3,
            max_pending: 8,
            learning_rate: 0.03,
            betas: [0.9, 0.99],
            prior_weight: 0.05,
            min_deviation: 0.01,
            min_derivative: 0.02,
            gains: true,
            keep_detail: true,
        }
    }
}

/// Options of the gains of maps as a whole.
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

/// Options of the baseline: the best of a search over rates, decays and lengths
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
