//! The posterior of a grid of texels and their lights.

use super::state::{Free, State, Trial};
use crate::Svbrdf;
use crate::estimate::correction::{Correction, corrected};
use crate::estimate::options::{LightOptions, ScheduleOptions};
use crate::estimate::prior::{Prior, is_albedo, range};
use crate::loss::{huber, to_logarithms};
use crate::observation::{Observation, View};
use crate::parallel;
use crate::render;
use crate::svbrdf::{CHANNELS, channel};

/// What is believed of one photograph's light, see [`Correction`].
#[derive(Clone, Copy)]
pub(super) struct Light {
    pub turn: [f64; 2],
    pub ambient: f64,
    pub mirrored: f64,
}

impl Light {
    pub fn of(state: &State, index: usize) -> Self {
        let Correction { turns, ambient, mirrored, .. } = &state.correction;
        Self { turn: turns[index], ambient: *ambient, mirrored: mirrored[index] }
    }
}

/// A grid of texels of everything.
pub(super) struct Problem {
    width: usize,
    height: usize,
    pub(super) start: Vec<f64>,
    pub(super) prior_mean: Vec<f64>,
    /// Mean slopes of the estimate, and the precisions of the truth's, which is flat.
    mean_slope: [f64; 2],
    flatness: [f64; 2],
    given: Vec<View>,
    /// From the grid's own texel centres to those it was taken from, mm.
    offset_mm: Vec<[f32; 2]>,
    /// Logarithms of the radiances, and weights; those of saturated values are zero.
    pub(super) logs: Vec<Vec<f32>>,
    pub(super) weights: Vec<Vec<f32>>,
    total: f64,
    pub(super) noise: f64,
    /// Expected error of a light's direction, as the turns so far show it.
    direction_sigma: f64,
    pub(super) free: Free,
    prior: Prior,
    pub(super) options: LightOptions,
    /// Photographs that tell lights from maps, at least.
    least: usize,
}

impl Problem {
    pub(super) fn new(
        maps: &Svbrdf,
        prior_mean: &Svbrdf,
        observations: &[Observation],
        given: &[View],
        free: Free,
        prior: &Prior,
        (options, schedule): (&LightOptions, &ScheduleOptions),
    ) -> Self {
        let (width, height) = (maps.width(), maps.height());
        let stride = width.max(height).div_ceil(options.texels);
        let (w, h) = ((width / stride).max(1), (height / stride).max(1));
        let at = move |i: usize| {
            let (x, y) = (i % w * stride + stride / 2, i / w * stride + stride / 2);
            y.min(height - 1) * width + x.min(width - 1)
        };
        let grid = |maps: &Svbrdf| -> Vec<f64> {
            let value = |i: usize| {
                let (c, value) = (i / (w * h), maps.plane(i / (w * h))[at(i % (w * h))]);
                let (low, high) = range(c);
                let value = f64::from(value);
                if is_albedo(c) { value.max(0.0).sqrt() } else { value }.clamp(low, high)
            };
            (0..CHANNELS * w * h).map(value).collect()
        };
        let offset = |view: &View| {
            let [x, y] = view.texel_mm(width, height, stride / 2, stride / 2);
            let [x0, y0] = view.texel_mm(w, h, 0, 0);
            [x - x0, y - y0]
        };
        let (mut logs, mut weights) = (Vec::new(), Vec::new());
        let mut total = 0.0;
        for o in observations {
            let value = |i: usize| o.radiance(i / (w * h), at(i % (w * h)));
            let mut log: Vec<f32> = (0..3 * w * h).map(value).collect();
            to_logarithms(&mut log);
            logs.push(log);
            let weight = |i: usize| {
                if value(i) >= 0.0 { o.weight(at(i % (w * h))) } else { 0.0 }
            };
            let weight: Vec<f32> = (0..3 * w * h).map(weight).collect();
            total += weight.iter().map(|&w| f64::from(w)).sum::<f64>();
            weights.push(weight);
        }
        let prior_mean = grid(prior_mean);
        let moments = [channel::SLOPE_X, channel::SLOPE_Y].map(|c| {
            let slopes = &prior_mean[c * w * h..][..w * h];
            let mean = slopes.iter().sum::<f64>() / slopes.len() as f64;
            let square = slopes.iter().map(|s| (s - mean).powi(2)).sum::<f64>();
            (mean, (square / slopes.len() as f64).sqrt())
        });
        Self {
            width: w,
            height: h,
            start: grid(maps),
            prior_mean,
            mean_slope: moments.map(|m| m.0),
            flatness: moments.map(|m| (options.flatness[0] + options.flatness[1] * m.1).powi(-2)),
            given: given.to_vec(),
            offset_mm: given.iter().map(offset).collect(),
            logs,
            weights,
            total: total.max(1.0),
            noise: 0.05,
            direction_sigma: options.direction_sigma,
            free,
            prior: *prior,
            options: *options,
            least: schedule.lights_from,
        }
    }

    pub(super) fn texels(&self) -> usize {
        self.width * self.height
    }

    pub(super) fn maps(&self, coordinates: &[f64]) -> Svbrdf {
        let mut maps = Svbrdf::new(self.width, self.height);
        let n = self.texels();
        for (i, (to, &from)) in maps.planes_mut().iter_mut().zip(coordinates).enumerate() {
            *to = if is_albedo(i / n) { from * from } else { from } as f32;
        }
        maps
    }

    /// Logarithms of a rendering.
    pub(super) fn rendering(&self, maps: &Svbrdf, index: usize, light: Light) -> Vec<f32> {
        let Light { turn, ambient, mirrored } = light;
        let mut view = corrected(&self.given[index], turn, ambient, mirrored);
        for (axis, offset) in self.offset_mm[index].into_iter().enumerate() {
            view.camera_mm[axis] -= offset;
            view.light_mm[axis] -= offset;
        }
        let mut out = vec![0.0; 3 * maps.texels()];
        render::render(maps, &view, &mut out);
        to_logarithms(&mut out);
        out
    }

    pub(super) fn renderings(&self, state: &State) -> Vec<Vec<f32>> {
        let maps = self.maps(&state.texels);
        parallel::map(self.logs.len(), |i| self.rendering(&maps, i, Light::of(state, i)))
    }

    /// Sum over photographs and values of weight times `of` the residual.
    fn sum(&self, state: &State, of: impl Fn(f64) -> f64) -> f64 {
        let mut sum = 0.0;
        for (i, rendered) in self.renderings(state).iter().enumerate() {
            let values = rendered.iter().zip(&self.logs[i]).zip(&self.weights[i]);
            sum += values.map(|((a, b), w)| f64::from(*w) * of(f64::from(a - b))).sum::<f64>();
        }
        sum
    }

    /// Mean residual.
    pub(super) fn loss(&self, state: &State) -> f64 {
        self.sum(state, f64::abs) / self.total
    }

    /// The scale of the residuals, as the refinement estimates it: texels take up some. And how wrong
    /// the lights are: those that turn little are held where they were told, as lights that are all
    /// farther out, and a sample that bulges, explain photographs nearly as well.
    pub(super) fn update_scales(&mut self, state: &State) {
        let photographs = self.total / (3 * self.texels()) as f64;
        let loss = self.loss(state);
        let free = 1.0 - 2.0 / photographs.max(self.least as f64);
        self.noise = (loss / free).clamp(self.options.noise[0], self.options.noise[1]);
        let turns = state.correction.turns.as_flattened();
        let square = turns.iter().map(|t| t * t).sum::<f64>() / turns.len().max(1) as f64;
        let widest = self.options.direction_sigma;
        self.direction_sigma =
            square.sqrt().clamp(self.options.min_direction_sigma.min(widest), widest);
    }

    /// Texels that count as one.
    fn scale(&self) -> f64 {
        self.texels() as f64 / self.options.independent_texels
    }

    /// Weights of the squares of a turn, of the ambient light, and of what is mirrored.
    pub(super) fn shared_precision(&self) -> [f64; 3] {
        let LightOptions { ambient_sigma, mirrored_sigma, .. } = self.options;
        [self.direction_sigma, ambient_sigma, mirrored_sigma].map(|s| self.scale() / (s * s))
    }

    /// Negative logarithm of the prior of the estimate's offset: half of the first times the square
    /// of the offset, plus half of the second times that of the offset plus the third.
    pub(super) fn offset_prior(&self, c: usize) -> [f64; 3] {
        let own = self.scale() * self.precision(c);
        match c {
            channel::SLOPE_X => [own, self.scale() * self.flatness[0], self.mean_slope[0]],
            channel::SLOPE_Y => [own, self.scale() * self.flatness[1], self.mean_slope[1]],
            _ => [own, 0.0, 0.0],
        }
    }

    /// Negative logarithm of the posterior.
    pub(super) fn cost(&self, state: &State) -> f64 {
        self.texel_costs(state).iter().sum::<f64>() + self.shared_cost(state)
    }

    /// Of each texel: of its residuals, and of the prior of its coordinates.
    fn texel_costs(&self, state: &State) -> Vec<f64> {
        let limit = self.huber();
        let mut costs = vec![0.0; self.texels()];
        for (i, rendered) in self.renderings(state).iter().enumerate() {
            for plane in rendered
                .chunks(costs.len())
                .zip(self.logs[i].chunks(costs.len()))
                .zip(self.weights[i].chunks(costs.len()))
            {
                let ((rendered, logs), weights) = plane;
                for (((cost, a), b), w) in costs.iter_mut().zip(rendered).zip(logs).zip(weights) {
                    *cost += f64::from(*w) * huber(f64::from(a - b), limit) / self.noise;
                }
            }
        }
        for c in 0..CHANNELS {
            let half = 0.5 * self.precision(c);
            for (t, cost) in costs.iter_mut().enumerate() {
                *cost += half * self.away(t, c, state).powi(2);
            }
        }
        costs
    }

    /// Of what texels share.
    fn shared_cost(&self, state: &State) -> f64 {
        let [by_turn, by_ambient, by_mirrored] = self.shared_precision();
        let mirrored: f64 = state.correction.mirrored.iter().map(|m| m * m).sum();
        let turns: f64 = state.correction.turns.iter().flatten().map(|t| t * t).sum();
        let offset = |(c, by): (usize, &f64)| {
            let [own, flat, mean] = self.offset_prior(c);
            own * by.powi(2) + flat * (by + mean).powi(2)
        };
        let offset: f64 = state.offset.iter().enumerate().map(offset).sum();
        let ambient = by_ambient * state.correction.ambient.powi(2);
        0.5 * (by_turn * turns + by_mirrored * mirrored + ambient + offset)
    }

    /// After `length` of the step of what texels share, and of each texel's own as much as is best for
    /// it.
    pub(super) fn stepped(&self, state: &State, step: &State, length: f64) -> Trial {
        let n = self.texels();
        let whole = state.moved(step, length, self.options.lengths[0], &self.options);
        let mut costs = self.texel_costs(&whole);
        let mut trial = Trial { length, cost: 0.0, state: whole, cut: vec![false; n] };
        for by in self.options.lengths.into_iter().skip(1) {
            let other = state.moved(step, length, by, &self.options);
            for (t, cost) in self.texel_costs(&other).into_iter().enumerate() {
                if cost < costs[t] {
                    (costs[t], trial.cut[t]) = (cost, true);
                    for at in (0..CHANNELS).map(|c| c * n + t) {
                        trial.state.texels[at] = other.texels[at];
                    }
                }
            }
        }
        trial.cost = costs.iter().sum::<f64>() + self.shared_cost(&trial.state);
        trial
    }

    pub(super) fn huber(&self) -> f64 {
        self.noise.clamp(2.0 * self.options.noise[0], self.options.huber)
    }

    pub(super) fn precision(&self, c: usize) -> f64 {
        f64::from(self.prior.sigma[c]).powi(-2)
    }
}
