//! Gloss pooled among texels of like colour (partial pooling, empirical Bayes).
//!
//! Roughness and specular albedo show only where a photograph looks into the lobe. Texels of the
//! same diffuse colour are mostly the same stuff, so the gloss of those that were seen is a better
//! guess for the others than what the fit started from. Each texel's value and its group's are
//! averaged by their precisions: what the photographs tell of the texel whatever its other
//! parameters are (a matt lobe may as well be diffuse albedo) and a broad belief in the fit, against
//! the spread within the group.

use super::groups::Membership;
use crate::estimate::belief::Belief;
use crate::estimate::noise::Noise;
use crate::estimate::options::{EstimateOptions, PoolingOptions};
use crate::estimate::photographs::Photographs;
use crate::estimate::posterior::{At, GLOSS, GlossInformation, gloss_information};
use crate::estimate::prior::Prior;
use crate::observation::Observation;
use crate::parallel;
use crate::svbrdf::channel;
use crate::{Result, Svbrdf};

/// How gloss is pooled.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pooling {
    pub pooling: PoolingOptions,
    /// Widths of all but gloss.
    pub prior: Prior,
    /// As expected of the photographs.
    pub noise: Noise,
}

impl Pooling {
    pub fn new(options: &EstimateOptions) -> Self {
        let noise = Noise::of_model(options.noise.expected);
        Self { pooling: options.pooling, prior: options.prior, noise }
    }

    /// Pools the gloss of the base, where maps and mean begin anew. As many photographs as a step of the
    /// maps sees say how well gloss is known.
    ///
    /// # Errors
    /// When sizes differ.
    pub fn pool(&self, photographs: &Photographs, belief: &mut Belief) -> Result<()> {
        self.pool_values(&mut belief.base, &photographs.some(&photographs.drawn(0)))?;
        belief.mean.clone_from(&belief.base);
        belief.maps.clone_from(&belief.base);
        Ok(())
    }

    /// Moves roughness and specular albedo of texels that the photographs say little of towards those
    /// of texels of like diffuse albedo of which they say more.
    ///
    /// # Errors
    /// When sizes differ.
    fn pool_values(&self, maps: &mut Svbrdf, observations: &[Observation]) -> Result<()> {
        crate::render::check_observations(maps, observations)?;
        let information = self.information(maps, observations);
        let members = Membership::new(maps, &self.pooling);
        for (gloss, seen) in self.glosses().into_iter().zip(information.precision()) {
            let own = gloss.precision();
            let values = gloss.read(maps);
            let groups = members.statistics(&values, |t| seen[t] / (seen[t] + own));
            gloss.write(maps, |t| {
                let [precision, sum] = members.pooled(t, &groups);
                let trusted = seen[t] + own;
                (sum + trusted * values[t]) / (precision + trusted)
            });
        }
        maps.clamp();
        Ok(())
    }

    /// What the photographs tell of each [`Gloss`] of every texel.
    pub fn information(&self, maps: &Svbrdf, observations: &[Observation]) -> GlossInformation {
        let mut prior = self.prior;
        for gloss in self.glosses() {
            prior.sigma[gloss.plane] = gloss.deviation;
        }
        gloss_information(At { maps, mean: maps, prior: &prior, noise: self.noise }, observations)
    }

    /// The planes of gloss.
    pub fn glosses(&self) -> [Gloss; GLOSS.len()] {
        let [roughness, root] = self.pooling.deviation;
        GLOSS.map(|plane| Gloss {
            plane,
            deviation: if plane == channel::ROUGHNESS { roughness } else { root },
        })
    }
}

/// A plane of gloss: roughness, or the root of a specular albedo.
#[derive(Debug, Clone, Copy)]
pub(in crate::estimate) struct Gloss {
    plane: usize,
    /// How far it may be off where nothing was seen.
    deviation: f32,
}

impl Gloss {
    /// The same as a precision.
    pub fn precision(self) -> f32 {
        self.deviation.powi(-2)
    }

    pub fn read(self, maps: &Svbrdf) -> Vec<f32> {
        let plane = maps.plane(self.plane).iter();
        if self.plane == channel::ROUGHNESS {
            plane.copied().collect()
        } else {
            plane.map(|v| v.max(0.0).sqrt()).collect()
        }
    }

    pub fn write(self, maps: &mut Svbrdf, value: impl Fn(usize) -> f32 + Sync) {
        let width = maps.width();
        parallel::parts(maps.plane_mut(self.plane).chunks_mut(width), |y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let value = value(y * width + x).max(0.0);
                *out = if self.plane == channel::ROUGHNESS { value } else { value * value };
            }
        });
    }

    /// Writes what is a natural value already.
    pub fn plane(self) -> usize {
        self.plane
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::test_support::{self, view_from};

    const SIDE: usize = 64;

    fn pooling() -> Pooling {
        Pooling::new(&EstimateOptions::default())
    }

    /// Stripes of two colours, each with its own gloss.
    fn truth() -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        for t in 0..SIDE * SIDE {
            let red = (t % SIDE / 8).is_multiple_of(2);
            maps.plane_mut(channel::ROUGHNESS)[t] = if red { 0.2 } else { 0.45 };
            for c in 0..3 {
                maps.plane_mut(channel::DIFFUSE + c)[t] =
                    if red { [0.4, 0.1, 0.1][c] } else { [0.1, 0.2, 0.4][c] };
            }
        }
        maps
    }

    /// A photograph of known maps, camera and light 100 mm above `at`.
    pub(crate) fn photograph(truth: &Svbrdf, [x, y]: [f32; 2]) -> Observation {
        test_support::photograph(truth, view_from([x, y, 100.0]))
    }

    fn observation(truth: &Svbrdf) -> Observation {
        photograph(truth, [-30.0, 0.0])
    }

    #[test]
    fn gloss_spreads_within_a_colour_and_no_further() {
        let truth = truth();
        let mut maps = truth.clone();
        // right where the highlight is, unknown elsewhere
        for (t, v) in maps.plane_mut(channel::ROUGHNESS).iter_mut().enumerate() {
            if t % SIDE > 3 * SIDE / 4 {
                *v = 0.8;
            }
        }
        pooling().pool_values(&mut maps, &[observation(&truth)]).unwrap();
        for (t, (v, r)) in
            maps.plane(channel::ROUGHNESS).iter().zip(truth.plane(channel::ROUGHNESS)).enumerate()
        {
            assert!((v - r).abs() < 0.12, "{t}: {v} {r}");
        }
    }

    #[test]
    fn nothing_seen_nothing_moved() {
        let mut maps = truth();
        let before = maps.clone();
        let observation = observation(&maps).changed(|_, weight| weight.fill(0.0));
        pooling().pool_values(&mut maps, &[observation]).unwrap();
        let most = |(a, b): (&f32, &f32)| (a - b).abs();
        let difference = maps.planes().iter().zip(before.planes()).map(most).fold(0.0f32, f32::max);
        assert!(difference < 1e-5, "{difference}");
    }
}
