//! What highlights tell of some texels, told to those that no highlight has swept.
//!
//! Roughness and specular albedo show only where a photograph looks into the lobe. Texels of the
//! same diffuse colour are mostly the same stuff, so the gloss of those that were seen is a better
//! guess for the others than what the fit started from. Each texel's value and its group's are
//! averaged by their precisions: information from the photographs and a broad belief in the fit
//! against the spread within the group.

use std::ops::Range;

use rayon::prelude::*;

use crate::loss::EPSILON;
use crate::observation::Observation;
use crate::render::render;
use crate::svbrdf::{CHANNELS, channel};
use crate::{Result, Svbrdf};

/// Groups of like colour.
const GROUPS: usize = 8;
/// Texels that found the groups.
const SAMPLES: usize = 2048;
/// Distance of root albedos at which a texel belongs to two groups alike.
const REACH: f32 = 0.06;
/// Log residual that one photograph's model error and noise leave.
const NOISE: f32 = 0.1;
/// How far the fit may be off where nothing was seen: roughness, root of specular albedo.
const DEVIATION: [f32; 2] = [0.25, 0.15];
/// Spread that a group has at least.
const LEAST_SPREAD: f32 = 0.04;
/// Step of the numerical derivatives.
const STEP: f32 = 0.02;
/// Rows rendered at a time.
const STRIP_ROWS: usize = 64;
/// Texels summed at a time.
const CHUNK: usize = 8192;

/// Moves roughness and specular albedo of texels that the photographs say little of towards those
/// of texels of like diffuse albedo of which they say more.
///
/// # Errors
/// When sizes differ.
pub fn propagate(maps: &mut Svbrdf, observations: &[Observation]) -> Result<()> {
    crate::render::check_observations(maps, observations)?;
    let information = information(maps, observations);
    let members = Membership::new(maps);
    for gloss in Gloss::all() {
        let (seen, own) = (&information[gloss.kind], gloss.own());
        let values = gloss.read(maps);
        let groups = members.statistics(&values, |t| seen[t] / (seen[t] + own));
        gloss.write(maps, |t| {
            let [precision, sum] = members.told(t, &groups);
            let trusted = seen[t] + own;
            (sum + trusted * values[t]) / (precision + trusted)
        });
    }
    maps.clamp();
    Ok(())
}

/// Moves roughness and specular albedo of an estimate by what a refinement from there has found
/// of texels of like diffuse albedo, as far as the photographs told it: the mean for another
/// refinement. Where a highlight has shown that the estimate is too smooth, it is too smooth beside
/// the highlight as well.
///
/// # Errors
/// When sizes differ.
pub fn propagate_corrections(
    estimate: &mut Svbrdf,
    refined: &Svbrdf,
    observations: &[Observation],
) -> Result<()> {
    crate::render::check_observations(estimate, observations)?;
    crate::render::check_observations(refined, observations)?;
    let information = information(refined, observations);
    let members = Membership::new(refined);
    for gloss in Gloss::all() {
        let (seen, own) = (&information[gloss.kind], gloss.own());
        let values = gloss.read(estimate);
        let mut corrections = gloss.read(refined);
        corrections.iter_mut().zip(&values).for_each(|(v, before)| *v -= before);
        let groups = members.statistics(&corrections, |t| seen[t] / (seen[t] + own));
        gloss.write(estimate, |t| {
            let [precision, sum] = members.told(t, &groups);
            values[t] + sum / (precision + own)
        });
    }
    estimate.clamp();
    Ok(())
}

/// A plane of what highlights tell: roughness, or the root of a specular albedo.
#[derive(Clone, Copy)]
struct Gloss {
    plane: usize,
    /// Of [`DEVIATION`] and of [`information`].
    kind: usize,
}

impl Gloss {
    fn all() -> [Self; 4] {
        let specular = |c: usize| Self { plane: channel::SPECULAR + c, kind: 1 };
        [Self { plane: channel::ROUGHNESS, kind: 0 }, specular(0), specular(1), specular(2)]
    }

    /// Precision of the fit where nothing was seen.
    fn own(self) -> f32 {
        DEVIATION[self.kind].powi(-2)
    }

    fn read(self, maps: &Svbrdf) -> Vec<f32> {
        let plane = maps.plane(self.plane).iter();
        if self.kind == 0 {
            plane.copied().collect()
        } else {
            plane.map(|v| v.max(0.0).sqrt()).collect()
        }
    }

    fn write(self, maps: &mut Svbrdf, value: impl Fn(usize) -> f32 + Sync) {
        maps.plane_mut(self.plane).par_iter_mut().enumerate().for_each(|(t, out)| {
            let value = value(t).max(0.0);
            *out = if self.kind == 0 { value } else { value * value };
        });
    }
}

/// Precision that the photographs give roughness and root specular albedo of every texel, by
/// themselves. Strip by strip, so that the renderings stay small.
fn information(maps: &Svbrdf, observations: &[Observation]) -> [Vec<f32>; 2] {
    let (width, n) = (maps.width(), maps.texels());
    let mut sums = [vec![0.0; n], vec![0.0; n]];
    let [first, second] = &mut sums;
    let length = STRIP_ROWS * width;
    first.par_chunks_mut(length).zip(second.par_chunks_mut(length)).enumerate().for_each(
        |(strip, (first, second))| {
            let start = strip * STRIP_ROWS;
            let rows = start..start + first.len() / width;
            strip_information(maps, observations, &rows, [first, second]);
        },
    );
    sums
}

fn strip_information(
    maps: &Svbrdf,
    observations: &[Observation],
    rows: &Range<usize>,
    mut sums: [&mut [f32]; 2],
) {
    let (width, height) = (maps.width(), maps.height());
    let texels = rows.start * width..rows.end * width;
    let mut base = Svbrdf::new(width, rows.len());
    for c in 0..CHANNELS {
        base.plane_mut(c).copy_from_slice(&maps.plane(c)[texels.clone()]);
    }
    let mut rougher = base.clone();
    rougher.plane_mut(channel::ROUGHNESS).iter_mut().for_each(|v| {
        *v += if *v < 0.5 { STEP } else { -STEP };
    });
    let mut brighter = base.clone();
    for c in 0..3 {
        brighter.plane_mut(channel::SPECULAR + c).iter_mut().for_each(|v| {
            *v = (v.max(0.0).sqrt() + STEP).powi(2);
        });
    }
    let m = texels.len();
    let mut images = [vec![0.0; 3 * m], vec![0.0; 3 * m], vec![0.0; 3 * m]];
    let (mut measured, mut weight) = (vec![0.0; 3 * m], vec![0.0; m]);
    for observation in observations {
        let view = observation.view.of_rows(rows, height);
        for (maps, image) in [&base, &rougher, &brighter].into_iter().zip(&mut images) {
            render(maps, &view, image);
        }
        observation.read(&texels, &mut measured, &mut weight);
        let [base, moved @ ..] = &images;
        for (sum, moved) in sums.iter_mut().zip(moved) {
            for c in 0..3 {
                let channel = c * m..(c + 1) * m;
                let rendered = base[channel.clone()].iter().zip(&moved[channel.clone()]);
                let photograph = measured[channel].iter().zip(&weight);
                for ((sum, (a, b)), (measured, weight)) in
                    sum.iter_mut().zip(rendered).zip(photograph)
                {
                    // half the difference of the logarithms, to second order
                    let change = (b - a) / (a + b + 2.0 * EPSILON);
                    // Saturated pixels tell too little to count.
                    let weight = if *measured >= 0.0 { *weight } else { 0.0 };
                    *sum += weight * change * change;
                }
            }
        }
    }
    let scale = 4.0 / (3.0 * NOISE * NOISE * STEP * STEP);
    sums.iter_mut().for_each(|sum| sum.iter_mut().for_each(|v| *v *= scale));
}

/// How much each texel belongs to each group.
struct Membership {
    /// A texel's shares, those of the groups that there are sum to 1.
    shares: Vec<[f32; GROUPS]>,
    groups: usize,
}

#[derive(Debug, Clone, Copy)]
struct Group {
    mean: f32,
    precision: f32,
}

impl Membership {
    /// Groups of like root diffuse albedo: k-means from seeds far apart.
    fn new(maps: &Svbrdf) -> Self {
        let n = maps.texels();
        let root = |t: usize| -> [f32; 3] {
            std::array::from_fn(|c| maps.plane(channel::DIFFUSE + c)[t].max(0.0).sqrt())
        };
        // Steps that share no factor with the width visit all columns.
        let stride = (n / SAMPLES).max(1) | 1;
        let samples: Vec<[f32; 3]> = (0..n).step_by(stride).map(root).collect();
        let centres = cluster(&samples);
        let shares = (0..n)
            .into_par_iter()
            .map(|t| {
                let feature = root(t);
                let mut row = [0.0; GROUPS];
                let nearest =
                    centres.iter().map(|c| distance(c, &feature)).fold(f32::MAX, f32::min);
                let mut sum = 0.0;
                for (share, centre) in row.iter_mut().zip(&centres) {
                    let beyond = distance(centre, &feature) - nearest;
                    *share = (-0.5 * beyond / (REACH * REACH)).exp();
                    sum += *share;
                }
                row.map(|share| share / sum)
            })
            .collect();
        Self { shares, groups: centres.len() }
    }

    /// Precision and precision times mean of what a texel's groups say.
    fn told(&self, texel: usize, groups: &[Group]) -> [f32; 2] {
        let (mut precision, mut sum) = (0.0, 0.0);
        for (share, group) in self.shares[texel].iter().zip(groups) {
            let share = share * group.precision;
            precision += share;
            sum += share * group.mean;
        }
        [precision, sum]
    }

    /// Mean and precision of a plane in each group, texels weighing as `trust` (0 to 1) says.
    fn statistics(&self, values: &[f32], trust: impl Fn(usize) -> f32 + Sync) -> Vec<Group> {
        // Weight, first and second moment of each group, the same for any number of threads.
        let parts: Vec<[[f64; 3]; GROUPS]> = self
            .shares
            .par_chunks(CHUNK)
            .zip(values.par_chunks(CHUNK))
            .enumerate()
            .map(|(chunk, (shares, values))| {
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
            })
            .collect();
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
                let doubt = 0.04 / (1.0 + weight as f32 / 20.0);
                let variance = spread + LEAST_SPREAD * LEAST_SPREAD + doubt;
                Group { mean: mean as f32, precision: variance.recip() }
            })
            .collect()
    }
}

fn distance(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// Up to [`GROUPS`] centres.
fn cluster(samples: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut centres: Vec<[f32; 3]> = samples.first().copied().into_iter().collect();
    let mut nearest = vec![f32::MAX; samples.len()];
    while centres.len() < GROUPS {
        let last = centres[centres.len() - 1];
        for (d, s) in nearest.iter_mut().zip(samples) {
            *d = d.min(distance(s, &last));
        }
        let farthest = (0..samples.len()).max_by(|&a, &b| nearest[a].total_cmp(&nearest[b]));
        match farthest {
            Some(i) if nearest[i] > 0.25 * REACH * REACH => centres.push(samples[i]),
            _ => break,
        }
    }
    for _ in 0..10 {
        let mut sums = vec![[0.0f32; 4]; centres.len()];
        for s in samples {
            let near = (0..centres.len())
                .min_by(|&a, &b| distance(s, &centres[a]).total_cmp(&distance(s, &centres[b])));
            if let Some(sum) = near.and_then(|i| sums.get_mut(i)) {
                for c in 0..3 {
                    sum[c] += s[c];
                }
                sum[3] += 1.0;
            }
        }
        for (centre, [r, g, b, count]) in centres.iter_mut().zip(sums) {
            if count > 0.0 {
                *centre = [r / count, g / count, b / count];
            }
        }
    }
    centres
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::{Falloff, View};

    const SIDE: usize = 64;

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

    fn observation(truth: &Svbrdf) -> Observation {
        let at = [-30.0, 0.0, 100.0];
        let falloff = Falloff::None { power: [std::f32::consts::PI; 3] };
        let view =
            View { sample_mm: [100.0; 2], camera_mm: at, light_mm: at, falloff, ambient: [0.0; 3] };
        let mut radiance = vec![0.0; 3 * SIDE * SIDE];
        render(truth, &view, &mut radiance);
        let weight = vec![1.0; SIDE * SIDE];
        Observation::new(SIDE, SIDE, view, &radiance, &weight).unwrap()
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
        propagate(&mut maps, &[observation(&truth)]).unwrap();
        for (t, (v, r)) in
            maps.plane(channel::ROUGHNESS).iter().zip(truth.plane(channel::ROUGHNESS)).enumerate()
        {
            assert!((v - r).abs() < 0.12, "{t}: {v} {r}");
        }
    }

    #[test]
    fn a_correction_under_the_highlight_reaches_its_colour() {
        let refined = truth();
        let mut estimate = truth();
        let observation = observation(&refined);
        let red = |t: usize| (t % SIDE / 8).is_multiple_of(2);
        let wrong = |t: usize| if red(t) { 0.25 } else { 0.0 };
        for (t, v) in estimate.plane_mut(channel::ROUGHNESS).iter_mut().enumerate() {
            *v += wrong(t);
        }
        // the refinement has mended what lies under the light, left of the middle
        let mut found = refined.clone();
        for (t, v) in found.plane_mut(channel::ROUGHNESS).iter_mut().enumerate() {
            *v += if t % SIDE > SIDE / 2 { wrong(t) } else { 0.0 };
        }
        propagate_corrections(&mut estimate, &found, &[observation]).unwrap();
        let pairs =
            estimate.plane(channel::ROUGHNESS).iter().zip(refined.plane(channel::ROUGHNESS));
        for (t, (v, r)) in pairs.enumerate() {
            assert!((v - r).abs() < 0.12, "{t}: {v} {r}");
        }
    }

    #[test]
    fn nothing_seen_nothing_moved() {
        let mut maps = truth();
        let before = maps.clone();
        let observation = observation(&maps).changed(|_, weight| weight.fill(0.0));
        propagate(&mut maps, &[observation]).unwrap();
        let most = |(a, b): (&f32, &f32)| (a - b).abs();
        let difference = maps.planes().iter().zip(before.planes()).map(most).fold(0.0f32, f32::max);
        assert!(difference < 1e-5, "{difference}");
    }
}
