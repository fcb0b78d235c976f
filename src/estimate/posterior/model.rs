//! What the posterior of a texel is made of.

use crate::estimate::noise::Noise;
use crate::estimate::prior::Prior;
use crate::render::Prepared;
use crate::svbrdf::CHANNELS;

/// The posterior of a texel, apart from its prior mean.
pub(in crate::estimate) struct Posterior<'a> {
    pub observations: &'a [Prepared<'a>],
    /// Of each colour.
    pub noise: [Noise; 3],
    /// 1 / sigma².
    pub precision: [f32; CHANNELS],
}

impl<'a> Posterior<'a> {
    pub fn new(observations: &'a [Prepared<'a>], noise: [Noise; 3], prior: &Prior) -> Self {
        Self { observations, noise, precision: prior.precision() }
    }
}
