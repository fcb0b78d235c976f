//! The task of an estimate.

use serde::{Deserialize, Serialize};

/// Method of an estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Method {
    /// Latent code of the auto-encoder, then the posterior of every texel.
    #[default]
    Deep,
    /// Inverse rendering directly on the maps from the same start: the baseline.
    Classic,
}

/// The task of an estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Task {
    pub method: Method,
    /// Whether later phases refine the maps of the latent code.
    pub refine: bool,
    /// Whether lights are only roughly known, so that they and ambient light are corrected.
    pub free_lights: bool,
}

/// Reason of an early stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum EarlyStop {
    /// The budget was spent.
    Budget,
    /// Further changes would be invisible.
    Invisible,
}
