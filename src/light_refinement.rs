//! Lights and a common ambient light, corrected against the photographs.
//!
//! A light direction that is wrong by some degrees, or light from elsewhere, explains itself badly by
//! maps that all photographs share: with three photographs and more, what each one disagrees about
//! tells where its light was. Each light turns about the centre of the sample by two small angles;
//! the ambient light is one number, a share of the flash's irradiance. Gauss-Newton on the log-L1 by
//! reweighted least squares, with priors on all of them; maps stay as they are, so callers
//! alternate with [`crate::refinement`].

use rayon::prelude::*;

use crate::Svbrdf;
use crate::observation::{Falloff, Observation, View};
use crate::render;
use crate::svbrdf::CHANNELS;

/// Photographs below which lights and maps cannot be told apart.
pub const LEAST_PHOTOGRAPHS: usize = 3;

/// Options of [`refine_lights`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Steps of Gauss-Newton.
    pub steps: usize,
    /// Expected error of a light's direction, radians.
    pub direction_sigma: f64,
    /// Expected ambient irradiance, as a share of the flash's.
    pub ambient_sigma: f64,
    /// Loss at which a correction of one sigma is a draw.
    pub prior_weight: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { steps: 3, direction_sigma: 0.05, ambient_sigma: 0.05, prior_weight: 1e-3 }
    }
}

/// What is believed of the lights: corrections of what was given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Correction {
    /// Two angles per photograph, radians.
    pub turns: Vec<[f64; 2]>,
    /// Ambient irradiance as a share of the flash's.
    pub ambient: f64,
}

impl Correction {
    /// The view of photograph `index` with its light turned and the ambient light added to what
    /// was `given`.
    pub fn apply(&self, given: &View, index: usize) -> View {
        let turn = self.turns.get(index).copied().unwrap_or_default();
        corrected(given, turn, self.ambient)
    }

    /// Largest difference to another, in units of the options' sigmas.
    pub fn distance(&self, other: &Self, options: &Options) -> f64 {
        let turns = self.turns.iter().enumerate().flat_map(|(i, turn)| {
            let before = other.turns.get(i).copied().unwrap_or_default();
            [turn[0] - before[0], turn[1] - before[1]]
        });
        let turns = turns.fold(0.0f64, |m, d| m.max(d.abs())) / options.direction_sigma;
        turns.max((self.ambient - other.ambient).abs() / options.ambient_sigma)
    }
}

/// Texels a side that are looked at, at most.
const TEXELS: usize = 128;
/// Differences by which derivatives are formed: radians, share.
const ANGLE: f64 = 2e-3;
const SHARE: f64 = 2e-3;
/// Residual below which the loss counts as quadratic.
const HUBER: f64 = 0.02;
/// Longest step and longest turn, radians; largest ambient share.
const LONGEST_STEP: f64 = 0.06;
const LONGEST_TURN: f64 = 0.3;
const MOST_AMBIENT: f64 = 0.4;
/// As in the loss.
const EPSILON: f32 = 0.01;

/// Improves a correction of the `given` views, for maps that stay. Returns whether it changed.
/// Observations (whose own views do not matter) and maps have one size; with fewer than
/// [`LEAST_PHOTOGRAPHS`] nothing happens.
pub fn refine_lights(
    maps: &Svbrdf,
    observations: &[Observation],
    given: &[View],
    options: &Options,
    correction: &mut Correction,
) -> bool {
    let count = observations.len().min(given.len());
    if count < LEAST_PHOTOGRAPHS {
        return false;
    }
    correction.turns.resize(count, [0.0; 2]);
    let problem = Problem::new(maps, observations, given, options);
    let mut changed = false;
    let mut loss = problem.loss(correction);
    for _ in 0..options.steps {
        let step = problem.step(correction);
        let mut length = 1.0;
        let before = loss;
        for _ in 0..4 {
            let next = moved(correction, &step, length);
            let value = problem.loss(&next);
            if value < loss {
                (*correction, loss, changed) = (next, value, true);
                break;
            }
            length *= 0.4;
        }
        if before - loss < 1e-3 * before {
            break;
        }
    }
    changed
}

fn moved(from: &Correction, step: &Correction, length: f64) -> Correction {
    let turn = |(a, d): (&[f64; 2], &[f64; 2])| {
        let to = [a[0] + length * d[0], a[1] + length * d[1]];
        let size = to[0].hypot(to[1]);
        to.map(|t| t * (LONGEST_TURN / size.max(LONGEST_TURN)))
    };
    Correction {
        turns: from.turns.iter().zip(&step.turns).map(turn).collect(),
        ambient: (from.ambient + length * step.ambient).clamp(0.0, MOST_AMBIENT),
    }
}

/// The light turned about the centre of the sample, ambient light added.
fn corrected(given: &View, turn: [f64; 2], ambient: f64) -> View {
    let light = glam::Vec3::from(given.light_mm).as_dvec3();
    let (u, v) = light.normalize_or(glam::DVec3::Z).any_orthonormal_pair();
    let turn = glam::DQuat::from_scaled_axis(u * turn[0] + v * turn[1]);
    let white = match given.falloff {
        Falloff::None { power } => power,
        Falloff::InverseSquare { power_mm2 } => {
            power_mm2.map(|p| p / light.length_squared().max(1.0) as f32)
        }
    };
    let mut view = *given;
    view.light_mm = (turn * light).as_vec3().into();
    for (a, w) in view.ambient.iter_mut().zip(white) {
        *a += ambient as f32 * w / std::f32::consts::PI;
    }
    view
}

/// A grid of texels of everything.
struct Problem<'a> {
    maps: Svbrdf,
    given: &'a [View],
    /// From the grid's own texel centres to those it was taken from, mm.
    offset_mm: Vec<[f32; 2]>,
    /// Logarithms of the radiances, and weights; those of saturated values are zero.
    logs: Vec<Vec<f32>>,
    weights: Vec<Vec<f32>>,
    total: f64,
    options: &'a Options,
}

impl<'a> Problem<'a> {
    fn new(
        maps: &Svbrdf,
        observations: &[Observation],
        given: &'a [View],
        options: &'a Options,
    ) -> Self {
        let (width, height, n) = (maps.width(), maps.height(), maps.texels());
        let stride = width.max(height).div_ceil(TEXELS);
        let (w, h) = ((width / stride).max(1), (height / stride).max(1));
        let at = move |i: usize| {
            let (x, y) = (i % w * stride + stride / 2, i / w * stride + stride / 2);
            y.min(height - 1) * width + x.min(width - 1)
        };
        let mut grid = Svbrdf::new(w, h);
        for c in 0..CHANNELS {
            let from = maps.plane(c);
            grid.plane_mut(c).iter_mut().enumerate().for_each(|(i, v)| *v = from[at(i)]);
        }
        let offset_mm = given
            .iter()
            .map(|view| {
                let [x, y] = view.texel_mm(width, height, stride / 2, stride / 2);
                let [x0, y0] = view.texel_mm(w, h, 0, 0);
                [x - x0, y - y0]
            })
            .collect();
        let (mut logs, mut weights) = (Vec::new(), Vec::new());
        let mut total = 0.0;
        for o in observations {
            let value = |i: usize| o.radiance[i / (w * h) * n + at(i % (w * h))];
            logs.push((0..3 * w * h).map(|i| (value(i).max(0.0) + EPSILON).ln()).collect());
            let weight = |i: usize| {
                if value(i) >= 0.0 { o.weight[at(i % (w * h))].max(0.0) } else { 0.0 }
            };
            let weight: Vec<f32> = (0..3 * w * h).map(weight).collect();
            total += weight.iter().map(|&w| f64::from(w)).sum::<f64>();
            weights.push(weight);
        }
        Self { maps: grid, given, offset_mm, logs, weights, total: total.max(1.0), options }
    }

    /// Logarithms of a rendering.
    fn rendering(&self, index: usize, turn: [f64; 2], ambient: f64) -> Vec<f32> {
        let mut view = corrected(&self.given[index], turn, ambient);
        for (axis, offset) in self.offset_mm[index].into_iter().enumerate() {
            view.camera_mm[axis] -= offset;
            view.light_mm[axis] -= offset;
        }
        let mut out = vec![0.0; 3 * self.maps.texels()];
        render::render(&self.maps, &view, &mut out);
        out.iter_mut().for_each(|v| *v = (v.max(0.0) + EPSILON).ln());
        out
    }

    fn prior(&self) -> [f64; 2] {
        let Options { direction_sigma, ambient_sigma, prior_weight, .. } = *self.options;
        let count = self.logs.len() as f64;
        [prior_weight / (direction_sigma.powi(2) * count), prior_weight / ambient_sigma.powi(2)]
    }

    /// Mean log-L1 with the priors.
    fn loss(&self, correction: &Correction) -> f64 {
        let [by_turn, by_ambient] = self.prior();
        let sum: f64 = (0..self.logs.len())
            .map(|i| {
                let rendered = self.rendering(i, correction.turns[i], correction.ambient);
                let values = rendered.iter().zip(&self.logs[i]).zip(&self.weights[i]);
                values.map(|((a, b), w)| f64::from(w * (a - b).abs())).sum::<f64>()
            })
            .sum();
        let turns: f64 = correction.turns.iter().map(|t| t[0] * t[0] + t[1] * t[1]).sum();
        sum / self.total + by_turn * turns + by_ambient * correction.ambient.powi(2)
    }

    /// The step of Gauss-Newton. Turns couple through the ambient light only: one Schur complement.
    fn step(&self, at: &Correction) -> Correction {
        let [by_turn, by_ambient] = self.prior();
        let blocks: Vec<([[f64; 3]; 3], [f64; 3])> = (0..self.logs.len())
            .into_par_iter()
            .map(|i| self.normal_equations(i, at.turns[i], at.ambient))
            .collect();
        let mut curvature = by_ambient;
        let mut slope = by_ambient * at.ambient;
        let mut solved = Vec::with_capacity(blocks.len());
        for ((a, g), turn) in blocks.iter().zip(&at.turns) {
            let block =
                nalgebra::Matrix2::new(a[0][0] + by_turn, a[0][1], a[1][0], a[1][1] + by_turn);
            let side = nalgebra::Vector2::new(a[0][2], a[1][2]);
            let gradient =
                nalgebra::Vector2::new(g[0] + by_turn * turn[0], g[1] + by_turn * turn[1]);
            let inverse = block.try_inverse().unwrap_or_default();
            curvature += a[2][2] - side.dot(&(inverse * side));
            slope += g[2] - side.dot(&(inverse * gradient));
            solved.push((inverse * gradient, inverse * side));
        }
        let mut ambient = if curvature > 0.0 { -slope / curvature } else { 0.0 };
        // not below zero
        ambient = ambient.max(-at.ambient);
        let turns = solved.iter().map(|(gradient, side)| {
            let turn = -(gradient + side * ambient);
            let turn = turn * (LONGEST_STEP / turn.norm().max(LONGEST_STEP));
            [turn.x, turn.y]
        });
        Correction { turns: turns.collect(), ambient }
    }

    /// Curvature and slope of one photograph's share of the loss in its turn and the ambient light.
    fn normal_equations(
        &self,
        index: usize,
        turn: [f64; 2],
        ambient: f64,
    ) -> ([[f64; 3]; 3], [f64; 3]) {
        let here = self.rendering(index, turn, ambient);
        let there = [
            (self.rendering(index, [turn[0] + ANGLE, turn[1]], ambient), ANGLE),
            (self.rendering(index, [turn[0], turn[1] + ANGLE], ambient), ANGLE),
            (self.rendering(index, turn, ambient + SHARE), SHARE),
        ];
        let (mut a, mut g) = ([[0.0; 3]; 3], [0.0; 3]);
        for (i, &value) in here.iter().enumerate() {
            let weight = f64::from(self.weights[index][i]);
            if weight <= 0.0 {
                continue;
            }
            let residual = f64::from(value - self.logs[index][i]);
            let weight = weight / (residual.abs().max(HUBER) * self.total);
            let derivative = there.each_ref().map(|(v, d)| f64::from(v[i] - value) / d);
            for j in 0..3 {
                g[j] += weight * derivative[j] * residual;
                for k in 0..3 {
                    a[j][k] += weight * derivative[j] * derivative[k];
                }
            }
        }
        (a, g)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::svbrdf::channel;

    const SIDE: usize = 96;

    /// Bumpy, with glossy and matt patches.
    fn material() -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        for y in 0..SIDE {
            for x in 0..SIDE {
                let i = y * SIDE + x;
                let (u, v) = (x as f32 / 9.0, y as f32 / 7.0);
                maps.plane_mut(channel::SLOPE_X)[i] = 0.2 * u.sin() * v.cos();
                maps.plane_mut(channel::SLOPE_Y)[i] = 0.15 * (u + v).cos();
                for c in 0..3 {
                    maps.plane_mut(channel::DIFFUSE + c)[i] = 0.25 + 0.1 * (u * 0.7).sin();
                    maps.plane_mut(channel::SPECULAR + c)[i] = 0.05 + 0.02 * v.sin();
                }
                maps.plane_mut(channel::ROUGHNESS)[i] = 0.4 + 0.15 * (0.5 * (u - v)).sin();
            }
        }
        maps
    }

    fn capture(maps: &Svbrdf, ambient: f32) -> (Vec<Observation>, Vec<View>) {
        let mut random = Random::new(4);
        let (mut observations, mut views) = (Vec::new(), Vec::new());
        for _ in 0..6 {
            let at = random.direction(0.6).map(|v| 120.0 * v as f32);
            let view = View {
                sample_mm: [100.0; 2],
                camera_mm: at,
                light_mm: at,
                falloff: Falloff::None { power: [std::f32::consts::PI; 3] },
                ambient: [ambient; 3],
            };
            let mut radiance = vec![0.0; 3 * maps.texels()];
            render::render(maps, &view, &mut radiance);
            let (width, height) = (maps.width(), maps.height());
            let weight = vec![1.0; maps.texels()];
            observations.push(Observation { width, height, view, radiance, weight });
            views.push(View { ambient: [0.0; 3], ..view });
        }
        (observations, views)
    }

    #[test]
    fn lights_and_ambient_are_found_for_true_maps() {
        let maps = material();
        let (observations, mut given) = capture(&maps, 0.04);
        let truth: Vec<_> = given.iter().map(|v| glam::Vec3::from(v.light_mm)).collect();
        for (i, view) in given.iter_mut().enumerate() {
            let error = if i % 2 == 0 { [0.05, -0.02] } else { [-0.03, 0.04] };
            *view = corrected(view, error, 0.0);
        }
        let mut correction = Correction::default();
        let options = Options { steps: 8, ..Options::default() };
        assert!(refine_lights(&maps, &observations, &given, &options, &mut correction));
        // the priors pull back a little
        assert!((correction.ambient - 0.04).abs() < 0.003, "{}", correction.ambient);
        for (i, truth) in truth.iter().enumerate() {
            let found = glam::Vec3::from(correction.apply(&given[i], i).light_mm);
            let error = found.angle_between(*truth).to_degrees();
            assert!(error < 0.3, "{i}: {error} degrees");
        }
    }

    #[test]
    fn true_lights_stay() {
        let maps = material();
        let (observations, given) = capture(&maps, 0.0);
        let mut correction = Correction::default();
        refine_lights(&maps, &observations, &given, &Options::default(), &mut correction);
        let zero = Correction { turns: vec![[0.0; 2]; given.len()], ambient: 0.0 };
        assert!(correction.distance(&zero, &Options::default()) < 0.02, "{correction:?}");
    }

    #[test]
    fn the_slope_is_that_of_finite_differences() {
        let maps = material();
        let (observations, given) = capture(&maps, 0.03);
        let options = Options::default();
        let problem = Problem::new(&maps, &observations, &given, &options);
        let turn = [0.04, 0.03];
        let (_, slope) = problem.normal_equations(2, turn, 0.01);
        let value = |turn: [f64; 2], ambient: f64| {
            let rendered = problem.rendering(2, turn, ambient);
            let values = rendered.iter().zip(&problem.logs[2]).zip(&problem.weights[2]);
            // Huber's loss, of which the weights are the derivative
            let huber = |r: f64| {
                if r.abs() < HUBER { r * r / (2.0 * HUBER) } else { r.abs() - HUBER / 2.0 }
            };
            values.map(|((a, b), w)| f64::from(*w) * huber(f64::from(a - b))).sum::<f64>()
                / problem.total
        };
        let h = 2e-3;
        let expected = [
            value([turn[0] + h, turn[1]], 0.01) - value([turn[0] - h, turn[1]], 0.01),
            value([turn[0], turn[1] + h], 0.01) - value([turn[0], turn[1] - h], 0.01),
            value(turn, 0.01 + h) - value(turn, 0.01 - h),
        ];
        for (found, expected) in slope.iter().zip(expected) {
            let expected = expected / (2.0 * h);
            // one-sided differences inside
            assert!((found - expected).abs() < 0.05 * expected.abs() + 1e-4, "{found} {expected}");
        }
    }
}
