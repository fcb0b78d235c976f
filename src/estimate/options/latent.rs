//! Options of the latent code.

use serde::{Deserialize, Serialize};

/// Options of the fit of the latent code.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LatentOptions {
    /// Steps after the first photograph. With more, gloss and bumps that do not exist explain its highlights
    /// and shading. Tuned.
    pub first_steps: usize,
    /// Steps after each further photograph. Tuned.
    pub steps: usize,
    /// Up to this many photographs, each gets `steps` steps; with exactly this many the code restarts from
    /// the mean of their first maps. Beyond it, the number of steps and their length fall as 1/N. Tuned.
    pub all_steps_to: usize,
    /// Length of the first steps, in units of the code (whose variance is 1). Lengths fall to zero along a
    /// half cosine. Tuned.
    pub learning_rate: f32,
    /// Weight of the prior of slopes relative to the mean log-L1, divided by the squared number of
    /// photographs: mean over the texels of `sum ((slope - start) / deviation)² / 2`. Tuned.
    pub prior_weight: f32,
}

impl Default for LatentOptions {
    fn default() -> Self {
        Self { first_steps: 8, steps: 30, all_steps_to: 3, learning_rate: 0.03, prior_weight: 0.05 }
    }
}
