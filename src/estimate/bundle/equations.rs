//! The normal equations of texels and of what they share, texels eliminated.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::light::{Lit, by_coordinate, by_log, natural};
use super::parameters::Derivative;
use super::problem::{Problem, State};
use crate::estimate::correction::Correction;
use crate::estimate::prior::{Coordinates, range};
use crate::loss::{huber_weight, log_residual};
use crate::svbrdf::CHANNELS;

type Block = SMatrix<f64, CHANNELS, CHANNELS>;
pub(super) type Column = SVector<f64, CHANNELS>;

/// Least share in a group that counts.
const MIN_SHARE: f32 = 1e-3;

/// The reduced equations of what texels share: groups, then parameters. Lower triangle.
#[derive(Clone)]
pub(super) struct Reduced {
    pub matrix: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

impl Reduced {
    pub fn zeros(size: usize) -> Self {
        Self { matrix: DMatrix::zeros(size, size), gradient: DVector::zeros(size) }
    }
}

/// A texel's step: `-(own + columns * step of its groups' coordinates and of the parameters)`.
pub(super) struct Solved {
    pub own: Column,
    pub columns: Vec<Column>,
}

/// A photograph's light, and derivatives by the parameters that concern it.
pub(super) struct Linear {
    light: Lit,
    derivatives: Vec<(usize, Derivative)>,
}

impl Problem {
    pub(super) fn linear(&self, correction: &Correction) -> Vec<Linear> {
        let photographs = self.photographs().enumerate();
        let linear = photographs.map(|(i, photograph)| {
            let of = |(a, shared): (usize, &super::Shared)| {
                Some((a, shared.parameter.derivative(&photograph.view, i, correction)?))
            };
            Linear {
                light: Lit::new(&correction.apply(&photograph.view, i)),
                derivatives: self.shared.iter().enumerate().filter_map(of).collect(),
            }
        });
        linear.collect()
    }

    /// Rows of the linear model of a texel: each residual, its weight, and its derivatives by the
    /// texel's coordinates and by the parameters.
    pub(super) fn rows(
        &self,
        t: usize,
        x: &Coordinates,
        linear: &[Linear],
        mut each: impl FnMut(f64, f64, &Column, &[(usize, f64)]),
    ) {
        let (n, at) = (self.sample.texels(), self.sample.places[t]);
        let natural = natural(x);
        let limit = f64::from(self.noise.huber);
        let mut shared: Vec<(usize, f64)> = Vec::with_capacity(self.shared.len());
        let mut by_parameter: Vec<(usize, [f64; 3])> = Vec::with_capacity(self.shared.len());
        for (linear, photograph) in linear.iter().zip(self.photographs()) {
            let weight = f64::from(photograph.weight[t]);
            if weight <= 0.0 {
                continue;
            }
            let here = linear.light.radiance(&natural, at);
            by_parameter.clear();
            by_parameter.extend(linear.derivatives.iter().map(|(a, derivative)| {
                let by = match derivative {
                    Derivative::Factor(factor) => here.value.map(|v| factor * v),
                    Derivative::OfView(change) => change.of(&here, &natural),
                };
                (*a, by)
            }));
            for c in 0..3 {
                let seen = f64::from(photograph.radiance[c * n + t]);
                let r = log_residual(here.value[c].max(0.0), seen);
                // A saturated value that is explained says nothing.
                if seen < 0.0 && r >= 0.0 {
                    continue;
                }
                let inverse = by_log(here.value[c]);
                let row =
                    Column::from_fn(|i, _| here.jacobian[c][i] * by_coordinate(x, i) * inverse);
                shared.clear();
                shared.extend(by_parameter.iter().map(|(a, by)| (*a, by[c] * inverse)));
                let weight = weight * huber_weight(r, limit) / f64::from(self.noise.scale);
                each(r, weight, &row, &shared);
            }
        }
    }

    /// Adds a texel to the reduced equations, itself eliminated.
    pub(super) fn eliminate(
        &self,
        t: usize,
        state: &State,
        linear: &[Linear],
        damping: f64,
        sum: &mut Reduced,
        scratch: &mut Reduced,
    ) -> Solved {
        let (moving, q) = (self.groups.coordinates.clone(), self.shared.len());
        let g = moving.len();
        let x = self.coordinates(t, state);
        let (mut block, mut gradient) = (Block::zeros(), Column::zeros());
        let mut mixed = vec![Column::zeros(); q];
        let Reduced { matrix: local, gradient: local_gradient } = scratch;
        local.fill(0.0);
        local_gradient.fill(0.0);
        self.rows(t, &x, linear, |r, weight, row, shared| {
            block.syger(weight, row, row, 1.0);
            gradient.axpy(weight * r, row, 1.0);
            for (i, &(a, by)) in shared.iter().enumerate() {
                mixed[a].axpy(weight * by, row, 1.0);
                local_gradient[g + a] += weight * by * r;
                for &(b, other) in &shared[..=i] {
                    local[(g + a, g + b)] += weight * by * other;
                }
            }
        });
        block.fill_upper_triangle_with_lower_triangle();
        let held = self.held(t, state, &x, &gradient);
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
        let Some(factor) = block.cholesky() else {
            return Solved { own: Column::zeros(), columns: vec![Column::zeros(); g + q] };
        };
        let own = factor.solve(&gradient);
        let solved: Vec<Column> = columns.iter().map(|c| factor.solve(c)).collect();
        for (i, column) in columns.iter().enumerate() {
            local_gradient[i] -= column.dot(&own);
            for (j, other) in solved.iter().enumerate().take(i + 1) {
                local[(i, j)] -= column.dot(other);
            }
        }
        self.scatter(t, local, local_gradient, sum);
        Solved { own, columns: solved }
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
