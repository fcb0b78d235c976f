//! Soft clusters of texels of similar colour: k-means from seeds far apart.

/// A feature of a texel: root of a colour.
pub(super) type Feature = [f32; 3];

/// Largest number of texels in k-means.
const SAMPLES: usize = 4096;
/// Rounds of k-means, enough to converge.
const ROUNDS: usize = 20;

/// Centres and softness of clusters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Clusters {
    centres: Vec<Feature>,
    spread: f32,
}

impl Clusters {
    /// At most `count` clusters of texels, fewer if all equal their centres. Texels about as far from two centres
    /// belong to both; the mean squared distance to the nearest centre is the scale.
    pub fn find(features: &[Feature], count: usize) -> Self {
        // An odd step visits more columns than an even one.
        let step = (features.len() / SAMPLES).max(1) | 1;
        let samples: Vec<Feature> = features.iter().step_by(step).copied().collect();
        let centres = centres(&samples, count);
        let distances = samples.iter().map(|s| f64::from(nearest(&centres, s).1)).sum::<f64>();
        Self { centres, spread: (distances / samples.len().max(1) as f64) as f32 + 1e-6 }
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// The cluster with the nearest centre.
    pub fn nearest(&self, feature: &Feature) -> usize {
        nearest(&self.centres, feature).0
    }

    /// Shares of a feature in the clusters; they sum to 1: `exp(-(d² - d²_nearest) / spread)`.
    pub fn shares(&self, feature: &Feature, out: &mut [f32]) {
        let least = nearest(&self.centres, feature).1;
        let mut sum = 0.0;
        for (share, centre) in out.iter_mut().zip(&self.centres) {
            *share = (-(distance(centre, feature) - least) / self.spread).exp();
            sum += *share;
        }
        out.iter_mut().for_each(|share| *share /= sum);
    }
}

/// At most `count` centres of samples.
fn centres(samples: &[Feature], count: usize) -> Vec<Feature> {
    let mut centres = seeds(samples, count);
    for _ in 0..ROUNDS {
        let mut sums = vec![([0.0f64; 3], 0usize); centres.len()];
        for sample in samples {
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
    centres
}

/// The first sample, then repeatedly the one farthest from all seeds so far.
fn seeds(samples: &[Feature], count: usize) -> Vec<Feature> {
    let mut seeds: Vec<Feature> = samples.first().copied().into_iter().collect();
    let mut distances = vec![f32::MAX; samples.len()];
    while let Some(last) = seeds.last().filter(|_| seeds.len() < count).copied() {
        for (d, s) in distances.iter_mut().zip(samples) {
            *d = d.min(distance(s, &last));
        }
        let farthest = (0..samples.len()).max_by(|&a, &b| distances[a].total_cmp(&distances[b]));
        match farthest.filter(|i| distances[*i] > 0.0) {
            Some(i) => seeds.push(samples[i]),
            None => break,
        }
    }
    seeds
}

/// The nearest centre and its squared distance; `(0, 0.0)` without centres.
fn nearest(centres: &[Feature], feature: &Feature) -> (usize, f32) {
    let distances = centres.iter().map(|c| distance(c, feature)).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
}

fn distance(a: &Feature, b: &Feature) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_between_distant_clusters_belong_to_both() {
        let clouds = [[0.1, 0.2, 0.3], [0.8, 0.7, 0.6], [0.1, 0.9, 0.1]];
        let samples: Vec<Feature> = (0..300)
            .map(|i| clouds[i % 3].map(|v| v + 0.006 * ((i % 7) as f32 - 3.0) / 3.0))
            .collect();
        let clusters = Clusters::find(&samples, 3);
        assert_eq!(clusters.len(), 3);
        let mut all = [0.0; 3];
        let between =
            std::array::from_fn(|c| 0.5 * (clusters.centres[0][c] + clusters.centres[1][c]));
        clusters.shares(&between, &mut all);
        assert!((all[0] - 0.5).abs() < 1e-3 && (all[1] - 0.5).abs() < 1e-3, "{all:?}");
        let mut clusters = clusters.centres;
        clusters.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        for (a, b) in clusters.iter().zip([clouds[0], clouds[2], clouds[1]]) {
            assert!(distance(a, &b) < 1e-4, "{a:?} {b:?}");
        }
        assert_eq!(Clusters::find(&samples, 1).len(), 1);
        assert_eq!(Clusters::find(&[], 4).len(), 0);
    }
}
