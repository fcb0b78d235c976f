//! The equations of texels and lights.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::{Correction, LEAST_PHOTOGRAPHS, MOST_MIRRORED, Options, corrected};
use crate::Svbrdf;
use crate::loss::{huber, to_logarithms};
use crate::observation::{Observation, View};
use crate::parallel;
use crate::refinement::MIN_ROOT;
use crate::render;
use crate::svbrdf::{CHANNELS, RANGE, channel};

/// Texels a side that are looked at, at most.
const TEXELS: usize = 64;
/// Differences by which derivatives are formed: radians, share, logarithm, coordinates of a texel.
const ANGLE: f64 = 1e-3;
const SHARE: f64 = 2e-3;
const LOGARITHM: f64 = 1e-2;
const COORDINATE: f64 = 1e-3;
/// Largest residual below which the loss counts as quadratic; less where the noise is less.
const HUBER: f64 = 0.02;
/// Least and greatest noise assumed, log residuals.
const NOISE: (f64, f64) = (0.001, 0.1);
/// Longest step and longest turn, radians; largest ambient share.
const LONGEST_STEP: f64 = 0.06;
const LONGEST_TURN: f64 = 0.3;
const MOST_AMBIENT: f64 = 0.4;
/// Longest step of a texel's coordinate, and shares of its step that a texel may take.
const LONGEST_COORDINATE: f64 = 0.2;
const TEXEL_LENGTHS: [f64; 2] = [1.0, 0.3];
/// What a texel's damping is multiplied by after its whole step, and after less of it; the least
/// and the greatest: with more, texels hold the lights where they are.
const EASED: f64 = 0.2;
const RAISED: f64 = 2.0;
const DAMPING: (f64, f64) = (1e-6, 0.01);
const FIRST_DAMPING: f64 = 1e-4;
/// What every damping is multiplied by when no step descends.
const REFUSED: f64 = 30.0;
/// Least error of a light's direction that is expected, radians: however little they have turned.
const LEAST_DIRECTION: f64 = 0.003;
/// Expected mean slope of a sample's piece: at least, and relative to the slopes' deviation.
const FLATNESS: (f64, f64) = (0.005, 0.12);
/// Texels of a task.
const CHUNK: usize = 256;

/// Unknowns: nine planes of texel coordinates (see [`crate::refinement`]), lights, and by how much
/// the coordinates of the estimate are off everywhere.
#[derive(Clone)]
pub(super) struct State {
    pub(super) texels: Vec<f64>,
    pub(super) correction: Correction,
    pub(super) offset: [f64; CHANNELS],
}

impl State {
    /// After `length` of a step of what texels share, and `texel_length` of their own.
    pub(super) fn moved(&self, step: &Self, length: f64, texel_length: f64) -> Self {
        let n = self.texels.len() / CHANNELS;
        let texel = |(i, (from, by)): (usize, (&f64, &f64))| {
            let by = (texel_length * by).clamp(-LONGEST_COORDINATE, LONGEST_COORDINATE);
            let (low, high) = coordinate_range(i / n);
            (from + by).clamp(low, high)
        };
        let turn = |(a, d): (&[f64; 2], &[f64; 2])| {
            let longest = (LONGEST_STEP / d[0].hypot(d[1]).max(LONGEST_STEP)) * length;
            let to = [a[0] + longest * d[0], a[1] + longest * d[1]];
            let size = to[0].hypot(to[1]);
            to.map(|t| t * (LONGEST_TURN / size.max(LONGEST_TURN)))
        };
        let mirrored = |(m, by): (&f64, &f64)| {
            (m + (length * by).clamp(-1.0, 1.0)).clamp(-MOST_MIRRORED, MOST_MIRRORED)
        };
        let (at, by) = (&self.correction, &step.correction);
        Self {
            texels: self.texels.iter().zip(&step.texels).enumerate().map(texel).collect(),
            correction: Correction {
                turns: at.turns.iter().zip(&by.turns).map(turn).collect(),
                ambient: (at.ambient + length * by.ambient).clamp(0.0, MOST_AMBIENT),
                mirrored: at.mirrored.iter().zip(&by.mirrored).map(mirrored).collect(),
            },
            offset: std::array::from_fn(|c| self.offset[c] + length * step.offset[c]),
        }
    }
}

pub(super) fn is_albedo(c: usize) -> bool {
    (channel::DIFFUSE..channel::ROUGHNESS).contains(&c)
}

fn coordinate_range(c: usize) -> (f64, f64) {
    let (low, high) = (f64::from(RANGE[c].0), f64::from(RANGE[c].1));
    if is_albedo(c) { (f64::from(MIN_ROOT), high.sqrt()) } else { (low, high) }
}

/// Coordinates that are found at once.
const GROUPS: [Range<usize>; 5] = [
    channel::SLOPE_X..channel::SLOPE_Y,
    channel::SLOPE_Y..channel::DIFFUSE,
    channel::DIFFUSE..channel::SPECULAR,
    channel::SPECULAR..channel::ROUGHNESS,
    channel::ROUGHNESS..CHANNELS,
];

/// What is believed of one photograph's light, see [`Correction`].
#[derive(Clone, Copy)]
struct Light {
    turn: [f64; 2],
    ambient: f64,
    mirrored: f64,
}

impl Light {
    fn of(state: &State, index: usize) -> Self {
        let Correction { turns, ambient, mirrored } = &state.correction;
        Self { turn: turns[index], ambient: *ambient, mirrored: mirrored[index] }
    }
}

/// Where a step may lead.
pub(super) struct Trial {
    /// How much of the step of what texels share was taken.
    pub(super) length: f64,
    pub(super) cost: f64,
    pub(super) state: State,
    /// Texels that took less than their whole step.
    cut: Vec<bool>,
}

/// Damping of each texel's equations, relative to their diagonal.
pub(super) struct Damping(pub(super) Vec<f64>);

impl Damping {
    pub(super) fn new(texels: usize) -> Self {
        Self(vec![FIRST_DAMPING; texels])
    }

    pub(super) fn update(&mut self, trial: &Trial) {
        for (damping, cut) in self.0.iter_mut().zip(&trial.cut) {
            *damping *= if *cut { RAISED } else { EASED };
            *damping = damping.clamp(DAMPING.0, DAMPING.1);
        }
    }

    /// More for all, as no step descends; whether that is possible.
    pub(super) fn raise(&mut self) -> bool {
        let more = self.0.iter().any(|d| *d < DAMPING.1);
        self.0.iter_mut().for_each(|d| *d = (REFUSED * *d).min(DAMPING.1));
        more
    }
}

/// A grid of texels of everything.
pub(super) struct Problem<'a> {
    width: usize,
    height: usize,
    pub(super) start: Vec<f64>,
    prior_mean: Vec<f64>,
    /// Mean slopes of the estimate, and the precisions of the truth's, which is flat.
    mean_slope: [f64; 2],
    flatness: [f64; 2],
    given: &'a [View],
    /// From the grid's own texel centres to those it was taken from, mm.
    offset_mm: Vec<[f32; 2]>,
    /// Logarithms of the radiances, and weights; those of saturated values are zero.
    logs: Vec<Vec<f32>>,
    weights: Vec<Vec<f32>>,
    total: f64,
    noise: f64,
    /// Expected error of a light's direction, as the turns so far show it.
    direction_sigma: f64,
    pub(super) options: &'a Options,
}

/// Logarithms of renderings of all photographs, and their derivatives by each plane of
/// coordinates, and by each photograph's [`Problem::unknowns`].
pub(super) struct Linearised {
    value: Vec<Vec<f32>>,
    by_texel: Vec<Vec<Vec<f32>>>,
    by_light: Vec<Vec<Vec<f32>>>,
}

type Block = SMatrix<f64, CHANNELS, CHANNELS>;
type Column = SVector<f64, CHANNELS>;

/// The equations of one texel.
pub(super) struct TexelSystem {
    block: Block,
    pub(super) gradient: Column,
    /// Coordinates that stay where they are.
    held: [bool; CHANNELS],
}

/// The equations of what all texels share.
#[derive(Clone)]
pub(super) struct SharedSystem {
    pub(super) matrix: DMatrix<f64>,
    pub(super) gradient: DVector<f64>,
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        maps: &Svbrdf,
        prior_mean: &Svbrdf,
        observations: &[Observation],
        given: &'a [View],
        options: &'a Options,
    ) -> Self {
        let (width, height) = (maps.width(), maps.height());
        let stride = width.max(height).div_ceil(TEXELS);
        let (w, h) = ((width / stride).max(1), (height / stride).max(1));
        let at = move |i: usize| {
            let (x, y) = (i % w * stride + stride / 2, i / w * stride + stride / 2);
            y.min(height - 1) * width + x.min(width - 1)
        };
        let grid = |maps: &Svbrdf| -> Vec<f64> {
            let value = |i: usize| {
                let (c, value) = (i / (w * h), maps.plane(i / (w * h))[at(i % (w * h))]);
                let (low, high) = coordinate_range(c);
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
            flatness: moments.map(|m| (FLATNESS.0 + FLATNESS.1 * m.1).powi(-2)),
            given,
            offset_mm: given.iter().map(offset).collect(),
            logs,
            weights,
            total: total.max(1.0),
            noise: 0.05,
            direction_sigma: options.direction_sigma,
            options,
        }
    }

    pub(super) fn texels(&self) -> usize {
        self.width * self.height
    }

    fn maps(&self, coordinates: &[f64]) -> Svbrdf {
        let mut maps = Svbrdf::new(self.width, self.height);
        let n = self.texels();
        for (i, (to, &from)) in maps.planes_mut().iter_mut().zip(coordinates).enumerate() {
            *to = if is_albedo(i / n) { from * from } else { from } as f32;
        }
        maps
    }

    /// Logarithms of a rendering.
    fn rendering(&self, maps: &Svbrdf, index: usize, light: Light) -> Vec<f32> {
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

    fn renderings(&self, state: &State) -> Vec<Vec<f32>> {
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
        let free = 1.0 - 2.0 / photographs.max(LEAST_PHOTOGRAPHS as f64);
        self.noise = (loss / free).clamp(NOISE.0, NOISE.1);
        let turns = state.correction.turns.as_flattened();
        let square = turns.iter().map(|t| t * t).sum::<f64>() / turns.len().max(1) as f64;
        let widest = self.options.direction_sigma;
        self.direction_sigma = square.sqrt().clamp(LEAST_DIRECTION.min(widest), widest);
    }

    /// Texels that count as one.
    fn scale(&self) -> f64 {
        self.texels() as f64 / self.options.independent_texels
    }

    /// Weights of the squares of a turn, of the ambient light, and of what is mirrored.
    pub(super) fn shared_precision(&self) -> [f64; 3] {
        let Options { ambient_sigma, mirrored_sigma, .. } = *self.options;
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
        let whole = state.moved(step, length, TEXEL_LENGTHS[0]);
        let mut costs = self.texel_costs(&whole);
        let mut trial = Trial { length, cost: 0.0, state: whole, cut: vec![false; n] };
        for by in TEXEL_LENGTHS.into_iter().skip(1) {
            let other = state.moved(step, length, by);
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

    fn huber(&self) -> f64 {
        self.noise.clamp(2.0 * NOISE.0, HUBER)
    }

    fn precision(&self, c: usize) -> f64 {
        f64::from(self.options.prior.sigma[c]).powi(-2)
    }

    pub(super) fn linearise(&self, state: &State) -> Linearised {
        let n = self.texels();
        let value = self.renderings(state);
        let slopes = |ahead: &[f32], behind: &[f32], by: f64| -> Vec<f32> {
            ahead.iter().zip(behind).map(|(a, b)| (a - b) / by as f32).collect()
        };
        // central differences: lobes are narrow; colours of an albedo move at once, as each shows in
        // its own colour of the rendering only
        let by_group = |group: &Range<usize>| -> Vec<Vec<Vec<f32>>> {
            let (mut ahead, mut behind) = (state.texels.clone(), state.texels.clone());
            let mut scale = vec![0.0; group.len() * n];
            let planes = group.start * n..group.end * n;
            let pairs = ahead[planes.clone()].iter_mut().zip(&mut behind[planes]);
            for (i, ((a, b), scale)) in pairs.zip(&mut scale).enumerate() {
                let (low, high) = coordinate_range(group.start + i / n);
                (*a, *b) = ((*a + COORDINATE).min(high), (*b - COORDINATE).max(low));
                *scale = (2.0 * COORDINATE / (*a - *b)) as f32;
            }
            let (ahead, behind) = (self.maps(&ahead), self.maps(&behind));
            let of = |i: usize| {
                let at = |maps| self.rendering(maps, i, Light::of(state, i));
                let mut slopes = slopes(&at(&ahead), &at(&behind), 2.0 * COORDINATE);
                slopes.iter_mut().enumerate().for_each(|(j, s)| *s *= scale[j % scale.len()]);
                slopes
            };
            let all: Vec<Vec<f32>> = parallel::map(value.len(), of);
            if group.len() == 1 {
                return vec![all];
            }
            let own = |colour: usize| {
                let only = |slopes: &Vec<f32>| {
                    let mut out = vec![0.0; slopes.len()];
                    let plane = colour * n..(colour + 1) * n;
                    out[plane.clone()].copy_from_slice(&slopes[plane]);
                    out
                };
                all.iter().map(only).collect()
            };
            (0..group.len()).map(own).collect()
        };
        let by_texel = parallel::map_parts(GROUPS.iter(), |_, group| by_group(group)).concat();
        let maps = self.maps(&state.texels);
        let by_light = (0..value.len())
            .map(|i| {
                let here = Light::of(state, i);
                let at = |light: Light| self.rendering(&maps, i, light);
                let mut all = Vec::new();
                if self.options.turn {
                    let [u, v] = here.turn;
                    for [du, dv] in [[ANGLE, 0.0], [0.0, ANGLE]] {
                        let ahead = at(Light { turn: [u + du, v + dv], ..here });
                        let behind = at(Light { turn: [u - du, v - dv], ..here });
                        all.push(slopes(&ahead, &behind, 2.0 * ANGLE));
                    }
                }
                if self.options.mirror {
                    let ahead = at(Light { mirrored: here.mirrored + LOGARITHM, ..here });
                    all.push(slopes(&ahead, &value[i], LOGARITHM));
                }
                if self.options.ambient {
                    let ahead = at(Light { ambient: here.ambient + SHARE, ..here });
                    all.push(slopes(&ahead, &value[i], SHARE));
                }
                all
            })
            .collect();
        Linearised { value, by_texel, by_light }
    }

    /// Shared unknowns: two per photograph if lights turn, one if what is mirrored differs, the
    /// estimate's offset, the ambient light.
    pub(super) fn shared(&self) -> usize {
        self.first_offset() + CHANNELS + 1
    }

    pub(super) fn first_mirrored(&self) -> usize {
        if self.options.turn { 2 * self.logs.len() } else { 0 }
    }

    pub(super) fn first_offset(&self) -> usize {
        self.first_mirrored() + if self.options.mirror { self.logs.len() } else { 0 }
    }

    /// The shared unknowns of a photograph's light: its two angles if it turns, what is mirrored if
    /// that differs, the ambient light if it is looked for.
    fn unknowns(&self, index: usize) -> impl Iterator<Item = usize> + Clone + use<> {
        let turns = if self.options.turn { 2 * index..2 * index + 2 } else { 0..0 };
        let mirrored = self.first_mirrored() + index;
        let mirrored = if self.options.mirror { mirrored..mirrored + 1 } else { 0..0 };
        let ambient = self.shared() - 1;
        let ambient = if self.options.ambient { ambient..ambient + 1 } else { 0..0 };
        turns.chain(mirrored).chain(ambient)
    }

    /// Equations of a texel; `each` gets every residual's photograph and place, its weight, itself
    /// and its derivatives by the texel's coordinates.
    fn texel_system(
        &self,
        t: usize,
        state: &State,
        linear: &Linearised,
        damping: f64,
        mut each: impl FnMut(usize, usize, f64, f64, &Column),
    ) -> TexelSystem {
        let n = self.texels();
        let (mut block, mut gradient) = (Block::zeros(), Column::zeros());
        for i in 0..self.logs.len() {
            for j in [t, n + t, 2 * n + t] {
                let weight = f64::from(self.weights[i][j]);
                if weight <= 0.0 {
                    continue;
                }
                let residual = f64::from(linear.value[i][j] - self.logs[i][j]);
                let weight = weight / (residual.abs().max(self.huber()) * self.noise);
                let row = Column::from_fn(|c, _| f64::from(linear.by_texel[c][i][j]));
                block.syger(weight, &row, &row, 1.0);
                gradient.axpy(weight * residual, &row, 1.0);
                each(i, j, weight, residual, &row);
            }
        }
        block.fill_upper_triangle_with_lower_triangle();
        let mut held = [false; CHANNELS];
        for c in 0..CHANNELS {
            let precision = self.precision(c);
            block[(c, c)] += precision + damping * block[(c, c)];
            gradient[c] += precision * self.away(t, c, state);
            // A coordinate that would leave its range stays out of the step, or all others would be
            // off by what its step is cut.
            let (low, high) = coordinate_range(c);
            let x = state.texels[c * n + t];
            held[c] = (x <= low && gradient[c] > 0.0) || (x >= high && gradient[c] < 0.0);
        }
        for c in (0..CHANNELS).filter(|&c| held[c]) {
            block.row_mut(c).fill(0.0);
            block.column_mut(c).fill(0.0);
            block[(c, c)] = 1.0;
            gradient[c] = 0.0;
        }
        TexelSystem { block, gradient, held }
    }

    /// How far a texel's coordinate is from the estimate without its offset.
    fn away(&self, t: usize, c: usize, state: &State) -> f64 {
        let at = c * self.texels() + t;
        state.texels[at] - self.prior_mean[at] - state.offset[c]
    }

    /// Equations of a texel. What it says of the shared unknowns alone is added to `shared`, what
    /// couples it to each of them to `coupling`.
    pub(super) fn coupled_system(
        &self,
        t: usize,
        state: &State,
        linear: &Linearised,
        damping: f64,
        shared: &mut SharedSystem,
        coupling: &mut [Column],
    ) -> TexelSystem {
        coupling.fill(Column::zeros());
        let system = self.texel_system(t, state, linear, damping, |i, j, weight, residual, row| {
            let lights = self.unknowns(i).zip(&linear.by_light[i]);
            for (a, x) in lights.clone().map(|(a, x)| (a, f64::from(x[j]))) {
                coupling[a].axpy(weight * x, row, 1.0);
                shared.gradient[a] += weight * x * residual;
                for (b, y) in lights.clone() {
                    shared.matrix[(a, b)] += weight * x * f64::from(y[j]);
                }
            }
        });
        for c in 0..CHANNELS {
            let (at, precision) = (self.first_offset() + c, self.precision(c));
            coupling[at][c] -= precision;
            shared.matrix[(at, at)] += precision;
            shared.gradient[at] -= precision * self.away(t, c, state);
            if system.held[c] {
                coupling.iter_mut().for_each(|column| column[c] = 0.0);
            }
        }
        system
    }

    /// The step of a texel when the shared unknowns make theirs.
    fn texel_step(
        &self,
        t: usize,
        state: &State,
        linear: &Linearised,
        damping: f64,
        shared: &DVector<f64>,
    ) -> Column {
        let mut change = Column::zeros();
        let system = self.texel_system(t, state, linear, damping, |i, j, weight, _, row| {
            let lights = self.unknowns(i).zip(&linear.by_light[i]);
            let by: f64 = lights.map(|(a, x)| shared[a] * f64::from(x[j])).sum();
            change.axpy(weight * by, row, 1.0);
        });
        for c in 0..CHANNELS {
            change[c] -= self.precision(c) * shared[self.first_offset() + c];
            if system.held[c] {
                change[c] = 0.0;
            }
        }
        let gradient = system.gradient + change;
        system.block.cholesky().map_or(Column::zeros(), |factor| -factor.solve(&gradient))
    }

    /// The step of Levenberg and Marquardt; nothing when the equations cannot be solved.
    pub(super) fn step(&self, state: &State, damping: &Damping) -> Option<State> {
        let damping = &damping.0;
        let n = self.texels();
        let linear = self.linearise(state);
        let empty = SharedSystem {
            matrix: DMatrix::zeros(self.shared(), self.shared()),
            gradient: DVector::zeros(self.shared()),
        };
        let chunks: Vec<usize> = (0..n).step_by(CHUNK).collect();
        let parts: Vec<SharedSystem> = parallel::map_parts(chunks.iter(), |_, &first| {
            let mut shared = empty.clone();
            let mut coupling = vec![Column::zeros(); self.shared()];
            for t in first..(first + CHUNK).min(n) {
                let system =
                    self.coupled_system(t, state, &linear, damping[t], &mut shared, &mut coupling);
                let Some(factor) = system.block.cholesky() else { continue };
                let inverse = factor.inverse();
                for (b, column) in coupling.iter().enumerate() {
                    let solved = inverse * column;
                    shared.gradient[b] -= solved.dot(&system.gradient);
                    for (a, other) in coupling.iter().enumerate() {
                        shared.matrix[(a, b)] -= other.dot(&solved);
                    }
                }
            }
            shared
        });
        let mut sum = empty;
        for part in parts {
            sum.matrix += part.matrix;
            sum.gradient += part.gradient;
        }
        let [by_turn, by_ambient, by_mirrored] = self.shared_precision();
        let last = self.shared() - 1;
        if self.options.turn {
            for (i, turn) in state.correction.turns.iter().flatten().enumerate() {
                sum.matrix[(i, i)] += by_turn;
                sum.gradient[i] += by_turn * turn;
            }
        }
        if self.options.mirror {
            for (i, mirrored) in state.correction.mirrored.iter().enumerate() {
                let at = self.first_mirrored() + i;
                sum.matrix[(at, at)] += by_mirrored;
                sum.gradient[at] += by_mirrored * mirrored;
            }
        }
        sum.matrix[(last, last)] += by_ambient;
        sum.gradient[last] += by_ambient * state.correction.ambient;
        for (c, by) in state.offset.iter().enumerate() {
            let [own, flat, mean] = self.offset_prior(c);
            let at = self.first_offset() + c;
            sum.matrix[(at, at)] += own + flat;
            sum.gradient[at] += own * by + flat * (by + mean);
        }
        let mut shared = sum.matrix.clone().cholesky()?.solve(&-&sum.gradient);
        if state.correction.ambient + shared[last] < 0.0 {
            // At its bound: the others without it.
            let ambient = -state.correction.ambient;
            let matrix = sum.matrix.view((0, 0), (last, last)).into_owned();
            let side = sum.matrix.view((0, last), (last, 1)).column(0) * ambient;
            let gradient = sum.gradient.rows(0, last) + side;
            let turns = matrix.cholesky()?.solve(&-gradient);
            shared.rows_mut(0, last).copy_from(&turns);
            shared[last] = ambient;
        }
        let shared = &shared;
        let steps: Vec<Column> = parallel::map_parts(chunks.iter(), |_, &first| {
            let texels = first..(first + CHUNK).min(n);
            texels
                .map(|t| self.texel_step(t, state, &linear, damping[t], shared))
                .collect::<Vec<_>>()
        })
        .concat();
        let mut texels = vec![0.0; CHANNELS * n];
        for (t, step) in steps.iter().enumerate() {
            for c in 0..CHANNELS {
                texels[c * n + t] = step[c];
            }
        }
        let turn = |i: usize| match self.options.turn {
            true => [shared[2 * i], shared[2 * i + 1]],
            false => [0.0; 2],
        };
        let turns = (0..self.logs.len()).map(turn).collect();
        let mirrored = |i: usize| match self.options.mirror {
            true => shared[self.first_mirrored() + i],
            false => 0.0,
        };
        let mirrored = (0..self.logs.len()).map(mirrored).collect();
        let offset = std::array::from_fn(|c| shared[self.first_offset() + c]);
        let correction = Correction { turns, ambient: shared[last], mirrored };
        Some(State { texels, correction, offset })
    }
}
