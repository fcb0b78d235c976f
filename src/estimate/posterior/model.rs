//! Data and prior of a texel's posterior.

use crate::estimate::noise::Noise;
use std::ops::Range;

use crate::estimate::coordinates::from_coordinates;
use crate::estimate::prior::Prior;
use crate::reflectance::Material;
use crate::render::{self, Prepared};
use crate::simd::Lanes;
use crate::svbrdf::{CHANNELS, Svbrdf};

/// The posterior of a texel, apart from its prior mean.
pub(in crate::estimate) struct Posterior<'a> {
    pub observations: &'a [Prepared<'a>],
    pub noise: Noise,
    /// 1 / sigma².
    pub precision: [f32; CHANNELS],
    /// Maps with the texels' optional lobes, which are fixed.
    pub lobes: &'a Svbrdf,
}

impl<'a> Posterior<'a> {
    pub fn new(
        observations: &'a [Prepared<'a>],
        noise: Noise,
        prior: &Prior,
        lobes: &'a Svbrdf,
    ) -> Self {
        Self { observations, noise, precision: prior.precision(), lobes }
    }

    /// The material of at most eight texels at coordinates `x`.
    #[inline(always)]
    pub fn material<V: Lanes>(&self, x: &[V; CHANNELS], texels: &Range<usize>) -> Material<V> {
        let lobes = render::load_lobes(self.lobes, texels.start, texels.end);
        Material::new(&from_coordinates(x), lobes)
    }
}
