//! Options of the latent code.

use serde::{Deserialize, Serialize};

/// Options of the fit of the latent code.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LatentOptions {
    /// Steps after the first photograph: with more, one photograph's highlights
    /// and shading are explained by gloss and bumps that are not there. Tuned.
    pub first_steps: usize,
    /// Steps after each further photograph. Tuned.
    pub steps: usize,
    /// Photographs up to which each has so many steps, and with which the code begins anew, from the mean
    /// of their first maps. The more there are, the less one of them moves the code: of more, its steps
    /// fall with their number. Tuned.
    pub all_steps_to: usize,
    /// Length of the first steps, in units of the code (whose variance is 1); falls to zero over
    /// the steps as half a cosine. Tuned.
    pub learning_rate: f32,
    /// Weight of the prior on the slopes beside the mean log-L1, divided by the squared number of
    /// photographs: mean over the texels of `sum ((slope - start) / deviation)² / 2`. Tuned.
    pub prior_weight: f32,
    /// Whether each photograph begins with gains of the maps as a whole.
    pub gains: bool,
}

impl Default for LatentOptions {
    fn default() -> Self {
        Self {
            first_steps: 8,
            steps: 30,
            all_steps_to: 3,
            learning_rate: 0.03,
            prior_weight: 0.05,
            gains: true,
        }
    }
}
