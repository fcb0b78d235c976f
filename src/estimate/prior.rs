//! Sigmas of the prior of a texel's coordinates, before the joint solve chooses its own.

use serde::{Deserialize, Serialize};

use crate::svbrdf::CHANNELS;
use crate::{Error, Result, Svbrdf};

/// Expected deviations of the coordinates from the prior's mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// Positive standard deviations in the order of [`channel`](crate::svbrdf::channel): slopes, square roots of albedos, roughness.
    pub sigma: [f32; CHANNELS],
}

impl Default for Prior {
    /// Errors of a fair estimate from a few photographs, as round numbers.
    fn default() -> Self {
        Self { sigma: [0.1, 0.1, 0.08, 0.08, 0.08, 0.1, 0.1, 0.1, 0.12] }
    }
}

impl Prior {
    /// 1 / sigma².
    pub(super) fn precision(&self) -> [f32; CHANNELS] {
        self.sigma.map(|s| (s * s).recip())
    }

    pub(super) fn check(&self) -> Result<()> {
        if self.sigma.iter().all(|s| s.is_finite() && *s > 0.0) {
            return Ok(());
        }
        Err(Error::argument("prior.sigma", "nine positive numbers are expected"))
    }
}

/// An error if the sizes of two maps differ.
pub(super) fn same_size(argument: &'static str, a: &Svbrdf, b: &Svbrdf) -> Result<()> {
    if (a.width(), a.height()) == (b.width(), b.height()) {
        return Ok(());
    }
    let message =
        format!("{}x{} texels, expected {}x{}", b.width(), b.height(), a.width(), a.height());
    Err(Error::argument(argument, message))
}
