//! The normal equations of texels and of what they share, texels eliminated.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::problem::{Problem, State};
use super::sums::{Linear, Reduced, Sums};
use crate::estimate::prior::{Coordinates, range};
use crate::simd::LANES;
use crate::svbrdf::CHANNELS;

type Block = SMatrix<f64, CHANNELS, CHANNELS>;
pub(super) type Column = SVector<f64, CHANNELS>;

/// Least share in a group that counts.
const MIN_SHARE: f32 = 1e-3;

/// One of eight texels at its coordinates.
struct Texel<'a> {
    t: usize,
    x: Coordinates,
    lane: usize,
    sums: &'a Sums,
}

/// A texel's step: `-inverse^T (own + columns * step of its groups' coordinates and of the parameters)`.
pub(super) struct Solved {
    /// Of the Cholesky factor of its own equations; nothing where they have none.
    pub inverse: Block,
    pub own: Column,
    pub columns: Vec<Column>,
}

/// The inverse of a lower triangle.
fn inverse_of_lower(lower: &Block) -> Block {
    let mut inverse = Block::zeros();
    for j in 0..CHANNELS {
        inverse[(j, j)] = lower[(j, j)].recip();
        for i in j + 1..CHANNELS {
            let sum: f64 = (j..i).map(|k| lower[(i, k)] * inverse[(k, j)]).sum();
            inverse[(i, j)] = -sum / lower[(i, i)];
        }
    }
    inverse
}

impl Sums {
    /// The matrix of one of the texels.
    fn block(&self, lane: usize) -> Block {
        let mut block = Block::zeros();
        let mut k = 0;
        for i in 0..CHANNELS {
            for j in i..CHANNELS {
                let value = f64::from(self.matrix[k][lane]);
                (block[(i, j)], block[(j, i)]) = (value, value);
                k += 1;
            }
        }
        block
    }
}

impl Problem {
    /// Adds some texels, at most eight, to the reduced equations, themselves eliminated.
    pub(super) fn eliminate_eight(
        &self,
        texels: Range<usize>,
        state: &State,
        linear: &[Linear],
        damping: f64,
        sum: &mut Reduced,
        scratch: &mut Reduced,
    ) -> Vec<Solved> {
        let coordinates: Vec<Coordinates> =
            texels.clone().map(|t| self.coordinates(t, state)).collect();
        let first = self.groups.coordinates.len() * state.groups.len();
        let sums = self.sums(texels.clone(), &coordinates, linear, sum, first);
        let eliminate = |((lane, t), x): ((usize, usize), Coordinates)| {
            self.eliminate(&Texel { t, x, lane, sums: &sums }, state, damping, sum, scratch)
        };
        texels.enumerate().zip(coordinates).map(eliminate).collect()
    }

    /// Adds a texel to the reduced equations, itself eliminated.
    fn eliminate(
        &self,
        texel: &Texel,
        state: &State,
        damping: f64,
        sum: &mut Reduced,
        scratch: &mut Reduced,
    ) -> Solved {
        let &Texel { t, ref x, lane, sums } = texel;
        let moving = self.groups.coordinates.clone();
        let g = moving.len();
        let mut block = sums.block(lane);
        let of_lane =
            |lanes: &[[f32; LANES]; CHANNELS]| Column::from_fn(|c, _| f64::from(lanes[c][lane]));
        let mut gradient = of_lane(&sums.gradient);
        let mut mixed: Vec<Column> = sums.mixed.iter().map(of_lane).collect();
        let Reduced { matrix: local, gradient: local_gradient } = scratch;
        local.fill(0.0);
        local_gradient.fill(0.0);
        let held = self.held(t, state, x, &gradient);
        // A coordinate that would leave its range stays out of the step, or all others would be off
        // by what its step is cut.
        for c in (0..CHANNELS).filter(|&c| held[c]) {
            block.row_mut(c).fill(0.0);
            block.column_mut(c).fill(0.0);
            gradient[c] = 0.0;
            mixed.iter_mut().for_each(|m| m[c] = 0.0);
        }
        let mut columns: Vec<Column> =
            moving.clone().map(|c| block.column(c).into_owned()).collect();
        for (i, c) in moving.clone().enumerate() {
            local_gradient[i] = gradient[c];
            for (j, d) in moving.clone().enumerate().take(i + 1) {
                local[(i, j)] = block[(c, d)];
            }
            for (a, mixed) in mixed.iter().enumerate() {
                local[(g + a, i)] = mixed[c];
            }
        }
        columns.extend(mixed);
        for c in 0..CHANNELS {
            block[(c, c)] += self.precision[c] + damping * (block[(c, c)] + 1e-9);
            gradient[c] += self.precision[c] * state.deviations[t][c];
            if held[c] {
                (block[(c, c)], gradient[c]) = (1.0, 0.0);
            }
        }
        let factor = block.cholesky();
        let inverse = factor.map_or_else(Block::zeros, |f| inverse_of_lower(f.l_dirty()));
        let own = inverse * gradient;
        columns.iter_mut().for_each(|column| *column = inverse * *column);
        for (i, column) in columns.iter().enumerate() {
            local_gradient[i] -= column.dot(&own);
            for (j, other) in columns.iter().enumerate().take(i + 1) {
                local[(i, j)] -= column.dot(other);
            }
        }
        self.scatter(t, local, local_gradient, sum);
        Solved { inverse, own, columns }
    }

    /// Coordinates that would leave their range.
    fn held(
        &self,
        t: usize,
        state: &State,
        x: &Coordinates,
        gradient: &Column,
    ) -> [bool; CHANNELS] {
        std::array::from_fn(|c| {
            let (low, high) = range(c);
            let pull = gradient[c] + self.precision[c] * state.deviations[t][c];
            (x[c] <= low && pull > 0.0) || (x[c] >= high && pull < 0.0)
        })
    }

    /// Adds what a texel says of its groups' coordinates and of the parameters to the reduced
    /// equations.
    fn scatter(&self, t: usize, local: &DMatrix<f64>, gradient: &DVector<f64>, sum: &mut Reduced) {
        let (shares, g) = (self.texel_shares(t), self.groups.coordinates.len());
        let first = g * shares.len();
        let at = |i: usize, j: usize| if i >= j { local[(i, j)] } else { local[(j, i)] };
        for (k, share) in shares.iter().enumerate().filter(|(_, s)| **s > MIN_SHARE) {
            let share = f64::from(*share);
            for i in 0..g {
                sum.gradient[g * k + i] += share * gradient[i];
                for (l, other) in shares.iter().enumerate().take(k + 1) {
                    let both = share * f64::from(*other);
                    for j in 0..g {
                        sum.matrix[(g * k + i, g * l + j)] += both * at(i, j);
                    }
                }
                for a in g..gradient.len() {
                    sum.matrix[(first + a - g, g * k + i)] += share * at(a, i);
                }
            }
        }
        for a in g..gradient.len() {
            sum.gradient[first + a - g] += gradient[a];
            for b in g..=a {
                sum.matrix[(first + a - g, first + b - g)] += at(a, b);
            }
        }
    }

    /// Adds the priors of groups and parameters.
    pub(super) fn add_priors(&self, state: &State, sum: &mut Reduced) {
        let (moving, g) = (self.groups.coordinates.clone(), self.groups.coordinates.len());
        for (k, (group, mean)) in state.groups.iter().zip(&self.groups.mean).enumerate() {
            for (i, c) in moving.clone().enumerate() {
                let precision = self.groups.precision[c];
                sum.matrix[(g * k + i, g * k + i)] += precision;
                sum.gradient[g * k + i] += precision * (group[c] - mean[c]);
            }
        }
        let first = g * state.groups.len();
        for (a, shared) in self.shared.iter().enumerate() {
            sum.matrix[(first + a, first + a)] += shared.precision;
            sum.gradient[first + a] += shared.precision * shared.parameter.get(&state.correction);
        }
    }
}
