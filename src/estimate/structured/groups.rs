//! Texels alike by colour: soft material classes.

/// A feature of a texel: root of a colour.
pub(super) type Feature = [f32; 3];

/// Rounds of k-means.
const ROUNDS: usize = 25;
/// Texels that find the centres, at most.
const SAMPLES: usize = 4096;

/// Centres of classes and how softly texels belong to them.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::estimate) struct Classes {
    centres: Vec<Feature>,
    /// Mean squared distance of texels from the nearest centre.
    spread: f32,
}

impl Classes {
    /// At most `count` classes of texels: k-means from seeds far apart.
    pub(super) fn find(features: &[Feature], count: usize) -> Self {
        let stride = (features.len() / SAMPLES).max(1) | 1;
        let samples: Vec<Feature> = features.iter().step_by(stride).copied().collect();
        let mut centres: Vec<Feature> = vec![mean(&samples)];
        if count > 1 {
            let first = farthest(&samples, &centres);
            centres = vec![first];
            while centres.len() < count {
                centres.push(farthest(&samples, &centres));
            }
            for _ in 0..ROUNDS {
                let mut sums = vec![([0.0f64; 3], 0usize); centres.len()];
                for sample in &samples {
                    let (sum, number) = &mut sums[nearest(&centres, sample).0];
                    sum.iter_mut().zip(sample).for_each(|(s, v)| *s += f64::from(*v));
                    *number += 1;
                }
                for (centre, (sum, number)) in centres.iter_mut().zip(sums) {
                    if number > 0 {
                        *centre = sum.map(|s| (s / number as f64) as f32);
                    }
                }
            }
        }
        let total: f64 = samples.iter().map(|s| f64::from(nearest(&centres, s).1)).sum();
        let spread = (total / samples.len().max(1) as f64) as f32 + 1e-6;
        Self { centres, spread }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// Shares of a texel in each class; they sum to 1.
    pub(super) fn shares(&self, feature: &Feature, out: &mut [f32]) {
        let least = nearest(&self.centres, feature).1;
        let mut sum = 0.0;
        for (share, centre) in out.iter_mut().zip(&self.centres) {
            *share = (-(distance(centre, feature) - least) / self.spread).exp();
            sum += *share;
        }
        out.iter_mut().for_each(|share| *share /= sum);
    }
}

fn mean(samples: &[Feature]) -> Feature {
    let count = samples.len().max(1) as f32;
    std::array::from_fn(|c| samples.iter().map(|s| s[c]).sum::<f32>() / count)
}

/// The sample farthest from all centres.
fn farthest(samples: &[Feature], centres: &[Feature]) -> Feature {
    let far = |s: &&Feature| nearest(centres, s).1;
    let best = samples.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
    best.copied().unwrap_or_default()
}

/// The nearest centre and its squared distance.
fn nearest(centres: &[Feature], feature: &Feature) -> (usize, f32) {
    let distances = centres.iter().map(|c| distance(c, feature)).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
}

fn distance(a: &Feature, b: &Feature) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}
