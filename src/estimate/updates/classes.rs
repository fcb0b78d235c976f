//! Material classes that compete for every texel.
//!
//! Few stuffs make a material, so a texel that no highlight has swept has most likely one of the
//! glosses that highlights have shown elsewhere (as the basis of Lensch et al., *Image-based
//! reconstruction of spatial appearance and geometric detail*, 2003). A white tile beside the
//! highlight looks the same to the photographs with a wide bright lobe or with a sharp one that no
//! camera has met; a step downhill does not lead from one to the other. Each class is tried on the
//! whole material, all else solved with it, and a mixture model weighs what the photographs then
//! say of each texel by how common the class is among texels of the same colour (expectation
//! maximisation). The texel's own gloss is one of the classes, and so are two matt dielectrics, which
//! no highlight would show.

use super::groups::{GROUPS, Membership};
use super::pooling::Pooling;
use crate::estimate::belief::Belief;
use crate::estimate::clusters::every;
use crate::estimate::noise::Noise;
use crate::estimate::options::{ClassOptions, EstimateOptions};
use crate::estimate::photographs::{Photographs, chosen};
use crate::estimate::posterior::{At, gloss_information};
use crate::estimate::solver::solve;
use crate::interpolation::{between, bilinear};
use crate::observation::Observation;
use crate::parallel;
use crate::svbrdf::{channel, halved};
use crate::{Result, Svbrdf};

/// Texels along the longer side that are looked at, at most.
pub(in crate::estimate) const TEXELS: usize = 128;
/// Steps of the solver for each class.
const STEPS: usize = 6;
/// Rounds of k-means, and of expectation maximisation: both have converged.
const ROUNDS: usize = 20;
const EXPECTATIONS: usize = 20;
/// Cost that is expected of a texel without any misfit.
const EXPECTED_COST: f32 = 1.0;
/// Root of the specular albedo of matt classes: 4 %, that of most dielectrics.
const MATT_ROOT: f32 = 0.2;
/// Classes that highlights have shown.
const SHOWN: usize = 4;
/// A texel's own gloss, the classes shown, and the matt ones.
const ALL: usize = 1 + SHOWN + 2;

/// Roughness and roots of specular albedo.
type Class = [f32; 4];

/// Trials of the classes in progress, at a resolution that is enough to tell them apart.
pub(crate) struct ClassTrials {
    options: EstimateOptions,
    mean: Svbrdf,
    maps: Svbrdf,
    halvings: u32,
    /// Photographs that the trials see.
    which: Vec<usize>,
    members: Membership,
    /// Without the texels' own; none where no highlight shows any.
    classes: Vec<Class>,
    /// Of each trial done, each texel's cost.
    pub costs: Vec<Vec<f32>>,
}

impl ClassTrials {
    /// Before the first trial.
    ///
    /// # Errors
    /// When sizes differ.
    pub fn new(
        photographs: &Photographs,
        belief: &Belief,
        options: &EstimateOptions,
    ) -> Result<Self> {
        crate::render::check_observations(&belief.maps, photographs.full())?;
        crate::render::check_observations(&belief.mean, photographs.full())?;
        let halvings = photographs.halvings_to(TEXELS);
        let small = |maps: &Svbrdf| halved(maps, halvings, Svbrdf::downsampled);
        let maps = small(&belief.maps);
        let mut trials = Self {
            options: options.clone(),
            mean: small(&belief.mean),
            members: Membership::new(&maps, &options.pooling),
            maps,
            halvings,
            which: photographs.drawn(0),
            classes: Vec::new(),
            costs: Vec::new(),
        };
        trials.classes = trials.shown(&photographs.level(halvings));
        if !trials.classes.is_empty() {
            let matt = options.classes.matt;
            let matt = matt.map(|roughness| [roughness, MATT_ROOT, MATT_ROOT, MATT_ROOT]);
            trials.classes.extend(matt);
        }
        Ok(trials)
    }

    /// Trials in all: the texels' own gloss, and each class.
    pub fn count(&self) -> usize {
        if self.classes.is_empty() { 0 } else { 1 + self.classes.len() }
    }

    /// Whether all trials are done.
    pub fn is_done(&self) -> bool {
        self.costs.len() >= self.count()
    }

    /// The next trial.
    ///
    /// # Errors
    /// When sizes differ.
    pub fn step(&mut self, photographs: &Photographs) -> Result<()> {
        let class = self.costs.len().checked_sub(1).and_then(|i| self.classes.get(i));
        let cost = self.cost(class, &chosen(&photographs.level(self.halvings), &self.which))?;
        self.costs.push(cost);
        Ok(())
    }

    /// Gives every texel of maps and mean the gloss of its classes, each by its responsibility.
    pub fn assign(&self, belief: &mut Belief) {
        if self.classes.is_empty() {
            return;
        }
        let options = &self.options.classes;
        let shares = responsibilities(&self.members, &self.costs, self.which.len(), options);
        let mixture = Mixture::new(&self.maps, &self.classes, &shares);
        mixture.write(&self.pooling(), [&mut belief.mean, &mut belief.maps]);
    }

    fn pooling(&self) -> Pooling {
        Pooling::new(&self.options)
    }

    /// Cost of each texel with a class, or its own gloss, after some steps of the solver.
    fn cost(&self, class: Option<&Class>, observations: &[Observation]) -> Result<Vec<f32>> {
        let (mut maps, mut mean) = (self.maps.clone(), self.mean.clone());
        if let Some(class) = class {
            for (gloss, &value) in self.pooling().glosses().into_iter().zip(class) {
                gloss.write(&mut maps, |_| value);
                gloss.write(&mut mean, |_| value);
            }
        }
        let EstimateOptions { classes, noise, .. } = &self.options;
        let mut prior = self.options.prior;
        // What is diffuse was found with another gloss.
        prior.sigma[channel::DIFFUSE..channel::SPECULAR].fill(classes.diffuse_sigma);
        solve(&mut maps, &mean, &prior, observations, STEPS, noise)?;
        let noise = Noise::expected(noise);
        let at = At { maps: &maps, mean: &mean, prior: &prior, noise };
        let information = gloss_information(at, observations);
        Ok(smoothed(information.cost(), maps.width(), &self.members))
    }

    /// The glosses that the photographs are sure of: k-means, from quantiles of roughness.
    fn shown(&self, observations: &[Observation]) -> Vec<Class> {
        let (maps, options, pooling) = (&self.maps, &self.options.classes, self.pooling());
        let information = pooling.information(maps, observations);
        let precision = information.precision();
        let glosses = pooling.glosses();
        let values = glosses.map(|gloss| gloss.read(maps));
        let sample = |t: usize| {
            // Roughness and green count.
            let trust = |i: usize| {
                precision[i][t] / (precision[i][t] + options.trust * glosses[i].precision())
            };
            (std::array::from_fn(|i| values[i][t]), trust(0) * trust(2))
        };
        let mut samples: Vec<(Class, f32)> = every(maps.texels()).map(sample).collect();
        samples.sort_by(|(a, _), (b, _)| a[0].total_cmp(&b[0]));
        let mut classes = quantiles(&samples);
        for _ in 0..ROUNDS {
            regroup(&mut classes, &samples);
        }
        classes
    }
}

/// Samples at even quantiles of weight.
fn quantiles(samples: &[(Class, f32)]) -> Vec<Class> {
    let total: f32 = samples.iter().map(|(_, weight)| weight).sum();
    let mut classes: Vec<Class> = Vec::with_capacity(SHOWN);
    let mut sum = 0.0;
    for (value, weight) in samples {
        sum += weight;
        let next = (classes.len() as f32 + 0.5) / SHOWN as f32;
        if classes.len() < SHOWN && *weight > 0.0 && sum >= next * total {
            classes.push(*value);
        }
    }
    classes
}

/// A round of k-means.
fn regroup(classes: &mut [Class], samples: &[(Class, f32)]) {
    let mut sums = [[0.0; 5]; SHOWN];
    for (value, weight) in samples {
        let distance =
            |class: &Class| -> f32 { class.iter().zip(value).map(|(a, b)| (a - b).powi(2)).sum() };
        let nearest = classes
            .iter()
            .zip(&mut sums)
            .min_by(|(a, _), (b, _)| distance(a).total_cmp(&distance(b)));
        if let Some((_, sums)) = nearest {
            sums.iter_mut().zip(value.iter().chain(&[1.0])).for_each(|(s, v)| *s += weight * v);
        }
    }
    for (class, [sums @ .., total]) in classes.iter_mut().zip(sums) {
        if total > 0.0 {
            *class = sums.map(|sum| sum / total);
        }
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

/// Responsibility of each class for each texel: from its cost and from how common it is in the
/// texel's groups, which follows from these probabilities.
///
/// How far residuals scatter is not known (in a crevice they all do): with a Laplacian's scale
/// integrated out, the likelihood is a power of the sum of residuals.
fn responsibilities(
    members: &Membership,
    costs: &[Vec<f32>],
    photographs: usize,
    options: &ClassOptions,
) -> Vec<[f32; ALL]> {
    let texels = members.shares.len();
    let power = options.independent * photographs as f32;
    let likelihoods: Vec<[f32; ALL]> = (0..texels)
        .map(|t| {
            let least = costs.iter().map(|cost| cost[t]).fold(f32::MAX, f32::min);
            let mut out = [0.0; ALL];
            out.iter_mut().zip(costs).for_each(|(out, cost)| {
                *out = ((EXPECTED_COST + least) / (EXPECTED_COST + cost[t])).powf(power);
            });
            out
        })
        .collect();
    let mut common = [[1.0 / costs.len() as f32; ALL]; GROUPS];
    let mut out = vec![[0.0; ALL]; texels];
    for _ in 0..EXPECTATIONS {
        // As if one texel of each class had been seen before.
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

/// What the classes say at the coarse resolution: responsibility of the texel's own gloss, then the
/// others' roughness and specular albedo times their responsibilities.
struct Mixture {
    width: usize,
    height: usize,
    planes: [Vec<f32>; 5],
}

impl Mixture {
    fn new(coarse: &Svbrdf, classes: &[Class], shares: &[[f32; ALL]]) -> Self {
        let others = |plane: usize| {
            let natural = |class: &Class| if plane == 0 { class[0] } else { class[plane].powi(2) };
            let values: Vec<f32> = classes.iter().map(natural).collect();
            let mixed = |[_, shares @ ..]: &[f32; ALL]| {
                shares.iter().zip(&values).map(|(share, value)| share * value).sum()
            };
            shares.iter().map(mixed).collect()
        };
        let own = shares.iter().map(|shares| shares[0]).collect();
        let planes = [own, others(0), others(1), others(2), others(3)];
        Self { width: coarse.width(), height: coarse.height(), planes }
    }

    /// Writes it to maps of a higher resolution, texels between interpolated.
    fn write(&self, pooling: &Pooling, maps: [&mut Svbrdf; 2]) {
        for maps in maps {
            let (width, height) = (maps.width(), maps.height());
            let [own, others @ ..] = &self.planes;
            for (gloss, others) in pooling.glosses().into_iter().zip(others) {
                parallel::parts(maps.plane_mut(gloss.plane()).chunks_mut(width), |y, row| {
                    let (above, below, v) = nearest(y, height, self.height);
                    for (x, out) in row.iter_mut().enumerate() {
                        let (left, right, u) = nearest(x, width, self.width);
                        let at = |plane: &[f32]| {
                            let at = |y: usize, x: usize| plane[y * self.width + x];
                            let near = [
                                at(above, left),
                                at(above, right),
                                at(below, left),
                                at(below, right),
                            ];
                            bilinear(near, [u, v])
                        };
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
    let place = (fine as f32 + 0.5) * coarse_size as f32 / fine_size as f32 - 0.5;
    between(place, coarse_size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::updates::pooling::tests::photograph;

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
    fn photographs(truth: &Svbrdf) -> Photographs {
        let mut photographs = Photographs::new();
        (0..8)
            .map(|i| [-40.0 + 25.0 * (i % 2) as f32, 24.0 * (i / 2) as f32 - 36.0])
            .for_each(|at| photographs.add(photograph(truth, at)).unwrap());
        photographs
    }

    /// Mean and maps with the classes assigned.
    fn assigned(mean: Svbrdf, maps: Svbrdf, photographs: &Photographs) -> Belief {
        let options = EstimateOptions::default();
        let mut belief = Belief { maps, ..Belief::new(mean, &options) };
        let mut trials = ClassTrials::new(photographs, &belief, &options).unwrap();
        while !trials.is_done() {
            trials.step(photographs).unwrap();
        }
        assert_eq!(trials.costs.len(), trials.count());
        trials.assign(&mut belief);
        belief
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
    fn what_the_photographs_cannot_tell_takes_the_class_of_its_colour() {
        let truth = truth();
        // solved is what the highlights have swept
        let (mean, maps) = (estimate(&truth, 0), estimate(&truth, SIDE / 2));
        let belief = assigned(mean, maps, &photographs(&truth));
        for maps in [&belief.mean, &belief.maps] {
            for white in [true, false] {
                let pairs = maps.plane(channel::ROUGHNESS).iter().zip(truth.plane(8)).enumerate();
                let errors = pairs.filter(|(t, _)| is_white(*t) == white);
                let (sum, count) = errors
                    .fold((0.0, 0), |(sum, count), (_, (v, r))| (sum + (v - r).abs(), count + 1));
                // 0.3 of the white in the solved maps before; borders of tiles are mixed
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
        let belief = assigned(estimate.clone(), estimate, &photographs(&truth));
        let roughness = belief.maps.plane(channel::ROUGHNESS);
        let white: Vec<f32> =
            (0..SIDE * SIDE).filter(|&t| is_white(t)).map(|t| roughness[t]).collect();
        let mean = white.iter().sum::<f32>() / white.len() as f32;
        // 0.2 before, 0.85 in truth, and borders of tiles are mixed
        assert!(mean > 0.6, "{mean}");
    }

    #[test]
    fn coarse_values_are_interpolated_with_centres_aligned() {
        let corners: Vec<_> = (0..8).map(|x| nearest(x, 8, 2)).collect();
        assert_eq!(corners[0], (0, 1, 0.0));
        assert_eq!(corners[1], (0, 1, 0.0));
        assert_eq!(corners[3], (0, 1, 0.375));
        assert_eq!(corners[7], (1, 1, 0.0));
    }
}
