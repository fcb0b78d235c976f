//! Texels alike by colour: soft material classes.

use crate::estimate::clusters::{self, Feature};

/// Rounds of k-means: it has converged.
const ROUNDS: usize = 25;
/// Texels that find the classes, at most.
const SAMPLES: usize = 4096;

/// Centres of classes and how softly texels belong to them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Classes {
    centres: Vec<Feature>,
    /// Mean squared distance of texels from the nearest centre.
    spread: f32,
}

impl Classes {
    /// At most `count` classes of texels.
    pub fn find(features: &[Feature], count: usize) -> Self {
        let stride = (features.len() / SAMPLES).max(1) | 1;
        let samples: Vec<Feature> = features.iter().step_by(stride).copied().collect();
        let centres = clusters::centres(&samples, count, 0.0, ROUNDS);
        let total: f64 = samples.iter().map(|s| f64::from(clusters::nearest(&centres, s).1)).sum();
        let spread = (total / samples.len().max(1) as f64) as f32 + 1e-6;
        Self { centres, spread }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// Shares of a texel in each class; they sum to 1.
    pub fn shares(&self, feature: &Feature, out: &mut [f32]) {
        clusters::shares(&self.centres, self.spread, feature, out);
    }
}
