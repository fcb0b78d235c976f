//! The posterior of a texel: what is maximised, its quadratic model, and what photographs tell.
//!
//! Negative logarithm, apart from a constant:
//!
//! ```text
//! sum over photographs, colours of weight * huber(log residual) / noise
//! + sum over coordinates of (x - m)² / (2 sigma²)
//! ```
//!
//! Once poses and lights are known, texels do not depend on each other: nine unknowns against three
//! log residuals a photograph.

mod information;
mod normal_equations;

pub(super) use information::{
    At, Covariance, GLOSS, GlossInformation, covariance, gloss_information, slope_precision,
};
pub(super) use normal_equations::{NormalEquations, cost};

use super::noise::Noise;
use super::prior::Prior;
use crate::render::Prepared;
use crate::svbrdf::CHANNELS;

/// The posterior of a texel, apart from its prior mean.
pub(super) struct Posterior<'a> {
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
