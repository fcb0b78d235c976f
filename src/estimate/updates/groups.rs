//! Groups of texels of like diffuse colour.

use crate::Svbrdf;
use crate::estimate::clusters::{Clusters, Feature};
use crate::estimate::options::PoolingOptions;
use crate::parallel;
use crate::svbrdf::channel;

/// Groups at most.
pub(super) const GROUPS: usize = 8;
/// Variance of the mean of a group that no texel tells, and the texels that halve it.
const DOUBT: f32 = 0.04;
const DOUBT_TEXELS: f32 = 20.0;
/// Texels summed at a time.
const CHUNK: usize = 8192;

/// How much each texel belongs to each group: soft clusters of root diffuse albedo.
pub(super) struct Membership {
    /// A texel's shares, those of the groups that there are sum to 1.
    pub shares: Vec<[f32; GROUPS]>,
    pub groups: usize,
    options: PoolingOptions,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    pub mean: f32,
    pub precision: f32,
}

impl Membership {
    /// Groups of like root diffuse albedo.
    pub fn new(maps: &Svbrdf, options: &PoolingOptions) -> Self {
        let n = maps.texels();
        let roots = parallel::values(n, |t| -> Feature {
            std::array::from_fn(|c| maps.plane(channel::DIFFUSE + c)[t].max(0.0).sqrt())
        });
        let clusters = Clusters::find(&roots, GROUPS, Some(options.reach));
        let shares = parallel::values(n, |t| {
            let mut row = [0.0; GROUPS];
            clusters.shares(&roots[t], &mut row[..clusters.len()]);
            row
        });
        Self { shares, groups: clusters.len(), options: *options }
    }

    /// Precision and precision times mean of what a texel's groups say.
    pub fn pooled(&self, texel: usize, groups: &[Group]) -> [f32; 2] {
        let (mut precision, mut sum) = (0.0, 0.0);
        for (share, group) in self.shares[texel].iter().zip(groups) {
            let share = share * group.precision;
            precision += share;
            sum += share * group.mean;
        }
        [precision, sum]
    }

    /// Mean and precision of a plane in each group, texels weighing as `trust` (0 to 1) says.
    pub fn statistics(&self, values: &[f32], trust: impl Fn(usize) -> f32 + Sync) -> Vec<Group> {
        // Weight, first and second moment of each group, the same for any number of threads.
        let chunks = self.shares.chunks(CHUNK).zip(values.chunks(CHUNK));
        let parts: Vec<[[f64; 3]; GROUPS]> =
            parallel::map_parts(chunks, |chunk, (shares, values)| {
                let mut sums = [[0.0; 3]; GROUPS];
                for (i, (shares, &value)) in shares.iter().zip(values).enumerate() {
                    let trust = trust(chunk * CHUNK + i).powi(2);
                    let moments = [1.0, f64::from(value), f64::from(value * value)];
                    for (sums, share) in sums.iter_mut().zip(shares) {
                        let weight = f64::from(share * trust);
                        sums.iter_mut().zip(moments).for_each(|(s, m)| *s += weight * m);
                    }
                }
                sums
            });
        let total = |k: usize, moment: usize| parts.iter().map(|p| p[k][moment]).sum::<f64>();
        (0..self.groups)
            .map(|k| {
                let weight = total(k, 0);
                if weight < 1e-6 {
                    return Group { mean: 0.0, precision: 0.0 };
                }
                let mean = total(k, 1) / weight;
                let spread = (total(k, 2) / weight - mean * mean).max(0.0) as f32;
                // Few texels seen: the mean itself is uncertain.
                let doubt = DOUBT / (1.0 + weight as f32 / DOUBT_TEXELS);
                let variance = spread + self.options.min_spread.powi(2) + doubt;
                Group { mean: mean as f32, precision: variance.recip() }
            })
            .collect()
    }
}
