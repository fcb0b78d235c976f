//! What an estimate is asked for, and why it ended.

use serde::{Deserialize, Serialize};

/// How maps are found from photographs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Method {
    /// Latent code of the auto-encoder, then the posterior of every texel.
    #[default]
    Deep,
    /// Inverse rendering directly on the maps from the same start: the baseline.
    Classic,
}

/// What an estimate is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Task {
    pub method: Method,
    /// Whether maps are refined after the latent fit.
    pub refine: bool,
    /// Whether lights are only roughly known: they and ambient light are corrected.
    pub free_lights: bool,
}

/// Why an estimate ended early.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Cut {
    /// Time or steps were used up.
    Budget,
    /// What was left could not be seen.
    Invisible,
}
