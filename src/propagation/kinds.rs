//! Kinds of gloss that compete for every texel.
//!
//! Few stuffs make a material, so a texel that no highlight has swept has most likely one of the
//! glosses that highlights have shown elsewhere (as the basis of Lensch et al., *Image-based
//! reconstruction of spatial appearance and geometric detail*, 2003). A white tile beside the
//! highlight looks the same to the photographs with a wide bright lobe or with a sharp one that no
//! camera has met; a step downhill does not lead from one to the other. Each kind is tried on the
//! whole material, all else refined with it, and a mixture model weighs what the photographs then
//! say of each texel by how common the kind is among texels of the same colour (expectation
//! maximisation). The texel's own gloss is one of the kinds, and so are two matt dielectrics, which
//! no highlight would show.

use super::colours::{GROUPS, Membership};
use super::{Gloss, gloss_evidence};
use crate::observation::Observation;
use crate::parallel;
use crate::refinement::{self, Prior, evidence, refine};
use crate::render::check_observations;
use crate::svbrdf::{channel, halved};
use crate::{Result, Svbrdf};
use std::ops::ControlFlow;

/// Kinds that highlights have shown.
const KINDS: usize = 4;
/// Roughness of dielectrics (specular albedo 0.04) that compete as well: matt ones have no highlight
/// that would show them.
const MATT: [f32; 2] = [0.6, 0.85];
/// A texel's own, and the others.
const ALL: usize = KINDS + MATT.len() + 1;
/// Texels along the longer side that are looked at, at most.
const TEXELS: usize = 128;
/// Texels that found the kinds.
const SAMPLES: usize = 8192;
/// Precision, in those of the fit where nothing was seen, at which a texel's gloss is half trusted
/// to be a kind.
const TRUST: f32 = 10.0;
/// Steps of the refinement of each kind.
const STEPS: usize = 6;
/// Scale of log residuals that model and noise leave.
const NOISE: f32 = 0.1;
/// Residuals of a texel that count as independent, for each photograph: half of what there are, for
/// the refinement has been free to explain some.
const INDEPENDENT: f32 = 1.5;
/// Cost that is expected of a texel without any misfit.
const EXPECTED: f32 = 1.0;
/// Expected deviation of roots of diffuse albedos from the mean when the gloss changes.
const FREE_DIFFUSE: f32 = 0.25;
/// Rounds of k-means, and of expectation maximisation.
const ROUNDS: usize = 10;
const EXPECTATIONS: usize = 20;

/// Roughness and roots of specular albedo.
type Kind = [f32; 4];

/// Gives texels of a refinement's mean, and of what was refined from there, the gloss that
/// explains the photographs best among their own and those that highlights have shown; `go_on` is
/// asked between trials. Answers whether all was done; if not, nothing has changed.
///
/// # Errors
/// When sizes differ.
pub fn choose_glosses(
    mean: &mut Svbrdf,
    refined: &mut Svbrdf,
    observations: &[Observation],
    go_on: &mut dyn FnMut() -> bool,
) -> Result<bool> {
    check_observations(mean, observations)?;
    check_observations(refined, observations)?;
    let coarse = Coarse::new(mean, refined, observations);
    let mut kinds = find_kinds(&coarse);
    if kinds.is_empty() {
        return Ok(true);
    }
    kinds.extend(MATT.map(|roughness| [roughness, 0.2, 0.2, 0.2]));
    let members = Membership::new(&coarse.refined);
    let mut costs = vec![coarse.cost(None, &members)?];
    for kind in &kinds {
        if !go_on() {
            return Ok(false);
        }
        costs.push(coarse.cost(Some(kind), &members)?);
    }
    let shares = shares(&members, &costs, coarse.observations.len());
    Told::new(&coarse.refined, &kinds, &shares).tell([mean, refined]);
    Ok(true)
}

/// The material at a resolution that is enough to tell kinds apart.
struct Coarse {
    mean: Svbrdf,
    refined: Svbrdf,
    observations: Vec<Observation>,
}

impl Coarse {
    fn new(mean: &Svbrdf, refined: &Svbrdf, observations: &[Observation]) -> Self {
        let (width, height) = (refined.width(), refined.height());
        let mut halvings = 0;
        while width.max(height) >> halvings > TEXELS
            && (width >> halvings).is_multiple_of(2)
            && (height >> halvings).is_multiple_of(2)
        {
            halvings += 1;
        }
        Self {
            mean: halved(mean, halvings, Svbrdf::downsampled),
            refined: halved(refined, halvings, Svbrdf::downsampled),
            observations: observations
                .iter()
                .map(|o| halved(o, halvings, Observation::downsampled))
                .collect(),
        }
    }

    /// Cost of each texel with a kind of gloss, or its own, after a refinement.
    fn cost(&self, kind: Option<&Kind>, members: &Membership) -> Result<Vec<f32>> {
        let (mut maps, mut mean) = (self.refined.clone(), self.mean.clone());
        if let Some(kind) = kind {
            for (gloss, &value) in Gloss::all().into_iter().zip(kind) {
                gloss.write(&mut maps, |_| value);
                gloss.write(&mut mean, |_| value);
            }
        }
        let options = refinement::Options { steps: STEPS, ..Default::default() };
        let mut prior = Prior::default();
        // What is diffuse was found with another gloss.
        prior.sigma[channel::DIFFUSE..channel::SPECULAR].fill(FREE_DIFFUSE);
        refine(&mut maps, &mean, &prior, &self.observations, &options, &mut |_, _| {
            ControlFlow::Continue(())
        })?;
        let options = refinement::Options { noise: NOISE, ..options };
        let evidence = evidence(&maps, &mean, &prior, &self.observations, &options);
        Ok(smoothed(evidence.cost(), maps.width(), members))
    }
}

/// Means of 3x3 texels, those of other colours left out.
fn smoothed(values: &[f32], width: usize, members: &Membership) -> Vec<f32> {
    let height = values.len() / width;
    let near = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
    parallel::values(values.len(), |t| {
        let (mut sum, mut total) = (0.0, 0.0);
        for y in near(t / width, height) {
            for x in near(t % width, width) {
                let u = y * width + x;
                let pairs = members.shares[t].iter().zip(&members.shares[u]);
                let alike: f32 = pairs.map(|(a, b)| a * b).sum();
                sum += alike * values[u];
                total += alike;
            }
        }
        sum / total
    })
}

/// The glosses that the photographs are sure of: k-means, from quantiles of roughness.
fn find_kinds(coarse: &Coarse) -> Vec<Kind> {
    let maps = &coarse.refined;
    let evidence = gloss_evidence(maps, &coarse.observations);
    let precision = evidence.precision();
    let glosses = Gloss::all();
    let values = glosses.map(|gloss| gloss.read(maps));
    // Steps that share no factor with the width visit all columns.
    let stride = (maps.texels() / SAMPLES).max(1) | 1;
    let mut samples: Vec<(Kind, f32)> = (0..maps.texels())
        .step_by(stride)
        .map(|t| {
            // Roughness and green count.
            let trust = |i: usize| precision[i][t] / (precision[i][t] + TRUST * glosses[i].own());
            (std::array::from_fn(|i| values[i][t]), trust(0) * trust(2))
        })
        .collect();
    samples.sort_by(|(a, _), (b, _)| a[0].total_cmp(&b[0]));
    let total: f32 = samples.iter().map(|(_, weight)| weight).sum();
    let mut kinds: Vec<Kind> = Vec::with_capacity(KINDS);
    let mut sum = 0.0;
    for (value, weight) in &samples {
        sum += weight;
        let next = (kinds.len() as f32 + 0.5) / KINDS as f32;
        if kinds.len() < KINDS && *weight > 0.0 && sum >= next * total {
            kinds.push(*value);
        }
    }
    for _ in 0..ROUNDS {
        let mut sums = [[0.0; 5]; KINDS];
        for (value, weight) in &samples {
            let distance =
                |kind: &Kind| -> f32 { kind.iter().zip(value).map(|(a, b)| (a - b).powi(2)).sum() };
            let nearest = kinds
                .iter()
                .zip(&mut sums)
                .min_by(|(a, _), (b, _)| distance(a).total_cmp(&distance(b)));
            if let Some((_, sums)) = nearest {
                sums.iter_mut().zip(value.iter().chain(&[1.0])).for_each(|(s, v)| *s += weight * v);
            }
        }
        for (kind, [sums @ .., total]) in kinds.iter_mut().zip(sums) {
            if total > 0.0 {
                *kind = sums.map(|sum| sum / total);
            }
        }
    }
    kinds
}

/// Probability of each kind for each texel: from its cost and from how common it is in the texel's
/// groups, which follows from these probabilities.
///
/// How far residuals scatter is not known (in a crevice they all do): with a Laplacian's scale
/// integrated out, the likelihood is a power of the sum of residuals.
fn shares(members: &Membership, costs: &[Vec<f32>], photographs: usize) -> Vec<[f32; ALL]> {
    let texels = members.shares.len();
    let power = INDEPENDENT * photographs as f32;
    let likelihoods: Vec<[f32; ALL]> = (0..texels)
        .map(|t| {
            let least = costs.iter().map(|cost| cost[t]).fold(f32::MAX, f32::min);
            let mut out = [0.0; ALL];
            out.iter_mut().zip(costs).for_each(|(out, cost)| {
                *out = ((EXPECTED + least) / (EXPECTED + cost[t])).powf(power);
            });
            out
        })
        .collect();
    let mut common = [[1.0 / costs.len() as f32; ALL]; GROUPS];
    let mut out = vec![[0.0; ALL]; texels];
    for _ in 0..EXPECTATIONS {
        // As if one texel of each kind had been seen before.
        let mut sums = [[1.0_f64; ALL]; GROUPS];
        for ((out, groups), likelihood) in out.iter_mut().zip(&members.shares).zip(&likelihoods) {
            let mut probability = [0.0; ALL];
            for (share, common) in groups.iter().zip(&common) {
                probability.iter_mut().zip(common).for_each(|(p, common)| *p += share * common);
            }
            probability.iter_mut().zip(likelihood).for_each(|(p, likelihood)| *p *= likelihood);
            let total: f32 = probability.iter().sum();
            *out = probability.map(|p| p / total);
            for (sums, share) in sums.iter_mut().zip(groups) {
                sums.iter_mut().zip(&*out).for_each(|(sum, p)| *sum += f64::from(share * p));
            }
        }
        for (common, sums) in common.iter_mut().zip(&sums) {
            let total: f64 = sums.iter().sum();
            common.iter_mut().zip(sums).for_each(|(common, sum)| *common = (sum / total) as f32);
        }
    }
    out
}

/// What the kinds say at the coarse resolution: share of the texel's own gloss, then the others'
/// roughness and specular albedo times their shares.
struct Told {
    width: usize,
    height: usize,
    planes: [Vec<f32>; 5],
}

impl Told {
    fn new(coarse: &Svbrdf, kinds: &[Kind], shares: &[[f32; ALL]]) -> Self {
        let others = |plane: usize| {
            let natural = |kind: &Kind| if plane == 0 { kind[0] } else { kind[plane].powi(2) };
            let values: Vec<f32> = kinds.iter().map(natural).collect();
            let told = |[_, shares @ ..]: &[f32; ALL]| {
                shares.iter().zip(&values).map(|(share, value)| share * value).sum()
            };
            shares.iter().map(told).collect()
        };
        let own = shares.iter().map(|shares| shares[0]).collect();
        let planes = [own, others(0), others(1), others(2), others(3)];
        Self { width: coarse.width(), height: coarse.height(), planes }
    }

    /// Tells maps of a higher resolution, texels between interpolated.
    fn tell(&self, maps: [&mut Svbrdf; 2]) {
        for maps in maps {
            let (width, height) = (maps.width(), maps.height());
            let [own, others @ ..] = &self.planes;
            for (gloss, others) in Gloss::all().into_iter().zip(others) {
                parallel::parts(maps.plane_mut(gloss.plane).chunks_mut(width), |y, row| {
                    let y = nearest(y, height, self.height);
                    for (x, out) in row.iter_mut().enumerate() {
                        let x = nearest(x, width, self.width);
                        let at = |plane: &[f32]| interpolate(plane, self.width, x, y);
                        *out = at(own).mul_add(*out, at(others));
                    }
                });
            }
            maps.clamp();
        }
    }
}

/// Coarse texels either side of a fine one's centre, and the second's part.
fn nearest(fine: usize, fine_size: usize, coarse_size: usize) -> (usize, usize, f32) {
    let at = (fine as f32 + 0.5) * coarse_size as f32 / fine_size as f32 - 0.5;
    let at = at.clamp(0.0, (coarse_size - 1) as f32);
    let first = at as usize;
    (first, (first + 1).min(coarse_size - 1), at - first as f32)
}

fn interpolate(plane: &[f32], width: usize, x: (usize, usize, f32), y: (usize, usize, f32)) -> f32 {
    let row = |y: usize| {
        let row = &plane[y * width..][..width];
        row[x.0] + x.2 * (row[x.1] - row[x.0])
    };
    let (above, below) = (row(y.0), row(y.1));
    above + y.2 * (below - above)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::propagation::tests::photograph;

    const SIDE: usize = 64;

    /// Two colours in turn, of two kinds of gloss.
    fn truth() -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        for t in 0..SIDE * SIDE {
            let white = is_white(t);
            maps.plane_mut(channel::ROUGHNESS)[t] = if white { 0.2 } else { 0.6 };
            for c in 0..3 {
                maps.plane_mut(channel::SPECULAR + c)[t] = 0.05;
                maps.plane_mut(channel::DIFFUSE + c)[t] =
                    if white { 0.5 } else { [0.3, 0.1, 0.05][c] };
            }
        }
        maps
    }

    fn is_white(t: usize) -> bool {
        (t % SIDE / 8 + t / SIDE / 8).is_multiple_of(2)
    }

    /// Photographs whose highlights sweep the left half.
    fn observations(truth: &Svbrdf) -> Vec<Observation> {
        (0..8)
            .map(|i| [-40.0 + 25.0 * (i % 2) as f32, 24.0 * (i / 2) as f32 - 36.0])
            .map(|at| photograph(truth, at))
            .collect()
    }

    /// The white is matt, and the more specular for it, but for the first columns.
    fn estimate(truth: &Svbrdf, right: usize) -> Svbrdf {
        let mut maps = truth.clone();
        for t in (0..SIDE * SIDE).filter(|&t| is_white(t) && t % SIDE >= right) {
            maps.plane_mut(channel::ROUGHNESS)[t] = 0.8;
            for c in 0..3 {
                maps.plane_mut(channel::SPECULAR + c)[t] = 0.1;
                maps.plane_mut(channel::DIFFUSE + c)[t] = 0.46;
            }
        }
        maps
    }

    #[test]
    fn what_the_photographs_cannot_tell_takes_the_kind_of_its_colour() {
        let truth = truth();
        let observations = observations(&truth);
        // refined is what the highlights have swept
        let (mut mean, mut refined) = (estimate(&truth, 0), estimate(&truth, SIDE / 2));
        assert!(choose_glosses(&mut mean, &mut refined, &observations, &mut || true).unwrap());
        for maps in [&mean, &refined] {
            for white in [true, false] {
                let pairs = maps.plane(channel::ROUGHNESS).iter().zip(truth.plane(8)).enumerate();
                let errors = pairs.filter(|(t, _)| is_white(*t) == white);
                let (sum, count) = errors
                    .fold((0.0, 0), |(sum, count), (_, (v, r))| (sum + (v - r).abs(), count + 1));
                // 0.3 of the white in the refined maps before; borders of tiles are mixed
                assert!(sum / (count as f32) < 0.06, "{white} {}", sum / count as f32);
            }
        }
    }

    #[test]
    fn matt_stuff_is_found_though_nothing_like_it_is_certain() {
        let mut truth = truth();
        let mut estimate = truth.clone();
        for t in (0..SIDE * SIDE).filter(|&t| is_white(t)) {
            truth.plane_mut(channel::ROUGHNESS)[t] = 0.85;
            for c in 0..3 {
                truth.plane_mut(channel::SPECULAR + c)[t] = 0.04;
                // what the wide lobe adds, seen from where the light is
                estimate.plane_mut(channel::DIFFUSE + c)[t] = 0.52;
            }
        }
        let observations = observations(&truth);
        let mut refined = estimate.clone();
        choose_glosses(&mut estimate, &mut refined, &observations, &mut || true).unwrap();
        let roughness = refined.plane(channel::ROUGHNESS);
        let white: Vec<f32> =
            (0..SIDE * SIDE).filter(|&t| is_white(t)).map(|t| roughness[t]).collect();
        let mean = white.iter().sum::<f32>() / white.len() as f32;
        // 0.2 before, 0.85 in truth, and borders of tiles are mixed
        assert!(mean > 0.6, "{mean}");
    }

    #[test]
    fn an_end_by_the_caller_changes_nothing() {
        let truth = truth();
        let observations = observations(&truth);
        let before = estimate(&truth, 0);
        let (mut mean, mut refined) = (before.clone(), before.clone());
        let mut left = 2;
        let mut go_on = || {
            left -= 1;
            left > 0
        };
        assert!(!choose_glosses(&mut mean, &mut refined, &observations, &mut go_on).unwrap());
        assert_eq!((&mean, &refined), (&before, &before));
    }

    #[test]
    fn coarse_values_are_interpolated_with_centres_aligned() {
        let corners: Vec<_> = (0..8).map(|x| nearest(x, 8, 2)).collect();
        assert_eq!(corners[0], (0, 1, 0.0));
        assert_eq!(corners[1], (0, 1, 0.0));
        assert_eq!(corners[3], (0, 1, 0.375));
        assert_eq!(corners[7], (1, 1, 0.0));
        let plane = [0.0, 1.0, 2.0, 3.0];
        assert_eq!(interpolate(&plane, 2, (0, 1, 0.25), (0, 1, 0.5)), 1.25);
    }
}
