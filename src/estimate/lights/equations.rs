//! The equations of texels and lights, and their solution.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::problem::{Light, Problem};
use super::state::{Damping, State};
use crate::estimate::correction::Correction;
use crate::estimate::prior::range;
use crate::parallel;
use crate::svbrdf::{CHANNELS, channel};

/// Differences by which derivatives are formed: radians, fraction, logarithm, coordinates of a texel.
const ANGLE: f64 = 1e-3;
const SHARE: f64 = 2e-3;
const LOGARITHM: f64 = 1e-2;
const COORDINATE: f64 = 1e-3;
/// Texels of a task.
const CHUNK: usize = 256;

/// Coordinates that are found at once.
const GROUPS: [Range<usize>; 5] = [
    channel::SLOPE_X..channel::SLOPE_Y,
    channel::SLOPE_Y..channel::DIFFUSE,
    channel::DIFFUSE..channel::SPECULAR,
    channel::SPECULAR..channel::ROUGHNESS,
    channel::ROUGHNESS..CHANNELS,
];

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

impl Problem {
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
                let (low, high) = range(group.start + i / n);
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
                if self.free.turn {
                    let [u, v] = here.turn;
                    for [du, dv] in [[ANGLE, 0.0], [0.0, ANGLE]] {
                        let ahead = at(Light { turn: [u + du, v + dv], ..here });
                        let behind = at(Light { turn: [u - du, v - dv], ..here });
                        all.push(slopes(&ahead, &behind, 2.0 * ANGLE));
                    }
                }
                if self.free.mirror {
                    let ahead = at(Light { mirrored: here.mirrored + LOGARITHM, ..here });
                    all.push(slopes(&ahead, &value[i], LOGARITHM));
                }
                if self.free.ambient {
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
        if self.free.turn { 2 * self.logs.len() } else { 0 }
    }

    pub(super) fn first_offset(&self) -> usize {
        self.first_mirrored() + if self.free.mirror { self.logs.len() } else { 0 }
    }

    /// The shared unknowns of a photograph's light: its two angles if it turns, what is mirrored if
    /// that differs, the ambient light if it is looked for.
    fn unknowns(&self, index: usize) -> impl Iterator<Item = usize> + Clone + use<> {
        let turns = if self.free.turn { 2 * index..2 * index + 2 } else { 0..0 };
        let mirrored = self.first_mirrored() + index;
        let mirrored = if self.free.mirror { mirrored..mirrored + 1 } else { 0..0 };
        let ambient = self.shared() - 1;
        let ambient = if self.free.ambient { ambient..ambient + 1 } else { 0..0 };
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
            let (low, high) = range(c);
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
    pub(super) fn away(&self, t: usize, c: usize, state: &State) -> f64 {
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
        self.add_priors(state, &mut sum);
        let shared = self.solved(state, &sum)?;
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
        let turn = |i: usize| match self.free.turn {
            true => [shared[2 * i], shared[2 * i + 1]],
            false => [0.0; 2],
        };
        let turns = (0..self.logs.len()).map(turn).collect();
        let mirrored = |i: usize| match self.free.mirror {
            true => shared[self.first_mirrored() + i],
            false => 0.0,
        };
        let mirrored = (0..self.logs.len()).map(mirrored).collect();
        let offset = std::array::from_fn(|c| shared[self.first_offset() + c]);
        let correction = Correction {
            turns,
            ambient: shared[self.shared() - 1],
            mirrored,
            ..Correction::default()
        };
        Some(State { texels, correction, offset })
    }

    /// Adds the priors of what texels share.
    fn add_priors(&self, state: &State, sum: &mut SharedSystem) {
        let [by_turn, by_ambient, by_mirrored] = self.shared_precision();
        let last = self.shared() - 1;
        if self.free.turn {
            for (i, turn) in state.correction.turns.iter().flatten().enumerate() {
                sum.matrix[(i, i)] += by_turn;
                sum.gradient[i] += by_turn * turn;
            }
        }
        if self.free.mirror {
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
    }

    /// The step of what texels share; ambient light stays at its bound where it would leave it.
    fn solved(&self, state: &State, sum: &SharedSystem) -> Option<DVector<f64>> {
        let last = self.shared() - 1;
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
        Some(shared)
    }
}
