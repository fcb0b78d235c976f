//! Texels, classes of gloss and nuisances, fitted together.
//!
//! Levenberg and Marquardt on the posterior by reweighted least squares. Each texel's nine
//! deviations from its prior mean are eliminated (Schur complement); what is left are four numbers a
//! class (roots of F0, roughness) and the nuisances.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::sample::{Coordinates, Lit, Sample, by_log, natural, range, residual};
use crate::estimate::correction::{Correction, Exposure, log_distance};
use crate::estimate::options::{StructuredOptions, Widths};
use crate::estimate::prior::is_albedo;
use crate::loss::{huber, huber_weight};
use crate::parallel;
use crate::svbrdf::{CHANNELS, channel};

/// What photographs leave open beside the maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Free {
    /// Gain of each photograph and the exposure law between them.
    pub exposure: bool,
    /// Offset of all lights.
    pub offset: bool,
}

/// Coordinates that classes share.
pub(super) const GLOSS: Range<usize> = channel::SPECULAR..CHANNELS;
/// Numbers of a class.
pub(super) const CLASS: usize = 4;

/// Weight of a coordinate's deviation.
pub(super) fn precision(widths: &Widths, c: usize) -> f64 {
    let sigma = match c {
        channel::SLOPE_X | channel::SLOPE_Y => widths.slope,
        channel::ROUGHNESS => widths.roughness,
        _ if c < channel::SPECULAR => widths.diffuse,
        _ => widths.specular,
    };
    sigma.powi(-2)
}

/// Difference of a light's place, mm, that derivatives are formed of.
const MILLIMETRE: f64 = 0.5;
/// Longest steps: of a coordinate, of the exponent, of a logarithm of gain, of the light in mm.
pub(super) const MAX_STEP: f64 = 0.2;
const MAX_SHARED: [f64; 3] = [1.0, 0.2, 15.0];
type Block = SMatrix<f64, CHANNELS, CHANNELS>;
pub(super) type Column = SVector<f64, CHANNELS>;

/// All unknowns.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// Deviations of texels from their prior means.
    pub deviations: Vec<Coordinates>,
    /// Roots of F0 and roughness of each class.
    pub classes: Vec<[f64; CLASS]>,
    pub correction: Correction,
}

/// A fit of some photographs of a sample.
pub(super) struct Problem<'a> {
    pub sample: &'a Sample,
    /// Photographs that are fitted.
    pub which: &'a [usize],
    /// Prior means, but for gloss: what is added to that of the classes.
    pub mean: &'a [Coordinates],
    /// Shares of each texel in each class.
    pub shares: &'a [f32],
    /// Prior means of the classes.
    pub class_means: &'a [[f64; CLASS]],
    pub widths: Widths,
    pub free: Free,
    pub options: &'a StructuredOptions,
}

/// The reduced equations of what texels share.
#[derive(Clone)]
pub(super) struct Shared {
    pub matrix: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

/// A texel's step: `-(own + columns * shared step)`.
pub(super) struct Solved {
    pub own: Column,
    /// Of the four numbers of the texel's gloss, then the nuisances.
    pub columns: Vec<Column>,
}

impl Problem<'_> {
    /// Where a fit begins.
    pub fn start(&self) -> State {
        let views = self.which.iter().map(|&i| &self.sample.photographs[i].view);
        let exposure = Exposure::as_given(views);
        State {
            deviations: vec![[0.0; CHANNELS]; self.sample.texels()],
            classes: self.class_means.to_vec(),
            correction: Correction { exposure, ..Correction::default() },
        }
    }

    pub(super) fn scale(&self) -> f64 {
        self.sample.texels() as f64 / self.options.independent_texels
    }

    pub(super) fn nuisance_count(&self) -> usize {
        let exposure = if self.free.exposure { self.which.len() + 1 } else { 0 };
        exposure + if self.free.offset { 3 } else { 0 }
    }

    /// Values of the free nuisances, their deviations, and longest steps.
    pub(super) fn nuisances(&self, state: &State) -> Vec<[f64; 3]> {
        let (exposure, o) = (&state.correction.exposure, self.options);
        let [of_exponent, of_gain, of_offset] = MAX_SHARED;
        let mut all = Vec::new();
        if self.free.exposure {
            all.extend(exposure.gains.iter().map(|g| [*g, o.gain_sigma, of_gain]));
            all.push([exposure.exponent, o.exponent_sigma, of_exponent]);
        }
        if self.free.offset {
            all.extend(exposure.offset_mm.iter().map(|v| [*v, o.offset_sigma_mm, of_offset]));
        }
        all
    }

    pub(super) fn set_nuisances(&self, correction: &mut Correction, values: &[f64]) {
        let (exposure, mut values) = (&mut correction.exposure, values.iter().copied());
        if self.free.exposure {
            exposure.gains.iter_mut().zip(&mut values).for_each(|(g, v)| *g = v);
            exposure.exponent = values.next().unwrap_or_default();
        }
        if self.free.offset {
            exposure.offset_mm.iter_mut().zip(values).for_each(|(o, v)| *o = v);
        }
    }

    pub(super) fn lights(&self, state: &State) -> Vec<Lit> {
        let light = |(i, &at): (usize, &usize)| {
            Lit::with(&self.sample.photographs[at].view, &state.correction, i)
        };
        self.which.iter().enumerate().map(light).collect()
    }

    /// Mean and deviation of each number of a class.
    pub(super) fn class_prior(&self, class: usize) -> [[f64; 2]; CLASS] {
        let [root, roughness] = self.options.class_sigma;
        let sigmas = [root, root, root, roughness];
        std::array::from_fn(|i| [self.class_means[class][i], sigmas[i]])
    }

    pub(super) fn texel_shares(&self, t: usize) -> &[f32] {
        let k = self.widths.classes;
        &self.shares[t * k..(t + 1) * k]
    }

    /// The prior mean of a texel.
    pub fn mean(&self, t: usize, state: &State) -> Coordinates {
        let mut mean = self.mean[t];
        for (share, class) in self.texel_shares(t).iter().zip(&state.classes) {
            for (m, v) in mean[GLOSS].iter_mut().zip(class) {
                *m += f64::from(*share) * v;
            }
        }
        mean
    }

    /// A texel's coordinates.
    pub fn coordinates(&self, t: usize, state: &State) -> Coordinates {
        let mut x = self.mean(t, state);
        for (c, (x, d)) in x.iter_mut().zip(&state.deviations[t]).enumerate() {
            *x = (*x + d).clamp(range(c).0, range(c).1);
        }
        x
    }

    /// Negative logarithm of the posterior.
    pub fn cost(&self, state: &State) -> f64 {
        self.texel_costs(state).iter().sum::<f64>() + self.shared_cost(state)
    }

    pub(super) fn texel_costs(&self, state: &State) -> Vec<f64> {
        let (lights, n) = (self.lights(state), self.sample.texels());
        let texel = |t: usize| {
            let x = self.coordinates(t, state);
            let natural = natural(&x);
            let mut cost = 0.0;
            for (light, &i) in lights.iter().zip(self.which) {
                let photograph = &self.sample.photographs[i];
                let weight = f64::from(photograph.weight[t]);
                if weight <= 0.0 {
                    continue;
                }
                let radiance = light.radiance(&natural, self.sample.places[t]);
                for c in 0..3 {
                    let (r, _) = residual(radiance.value[c], photograph.radiance[c * n + t]);
                    cost += weight * huber(r, self.options.huber) / self.options.noise;
                }
            }
            for (c, d) in state.deviations[t].iter().enumerate() {
                cost += 0.5 * precision(&self.widths, c) * d * d;
            }
            cost
        };
        parallel::values(n, texel)
    }

    /// Mean of absolute log residuals.
    pub fn mean_residual(&self, state: &State) -> f64 {
        let (lights, n) = (self.lights(state), self.sample.texels());
        let (mut sum, mut total) = (0.0, 1e-12);
        for t in 0..n {
            let natural = natural(&self.coordinates(t, state));
            for (light, &i) in lights.iter().zip(self.which) {
                let photograph = &self.sample.photographs[i];
                let weight = f64::from(photograph.weight[t]);
                let radiance = light.radiance(&natural, self.sample.places[t]);
                for c in 0..3 {
                    let (r, _) = residual(radiance.value[c], photograph.radiance[c * n + t]);
                    sum += weight * r.abs();
                }
                total += 3.0 * weight;
            }
        }
        sum / total
    }

    pub(super) fn shared_cost(&self, state: &State) -> f64 {
        let squares: f64 = self.nuisances(state).iter().map(|[v, s, _]| (v / s).powi(2)).sum();
        let mut classes = 0.0;
        for (k, class) in state.classes.iter().enumerate() {
            for (v, [mean, sigma]) in class.iter().zip(self.class_prior(k)) {
                classes += ((v - mean) / sigma).powi(2);
            }
        }
        0.5 * self.scale() * (squares + classes / self.widths.classes as f64)
    }

    /// Rows of the linear model of a texel: each residual, its weight, and its derivatives by the
    /// texel's coordinates and the nuisances.
    pub(super) fn rows(
        &self,
        t: usize,
        x: &Coordinates,
        lights: &[Lit],
        correction: &Correction,
        mut each: impl FnMut(f64, f64, &Column, &[f64]),
    ) {
        let (n, at) = (self.sample.texels(), self.sample.places[t]);
        let natural = natural(x);
        let mut shared = vec![0.0; self.nuisance_count()];
        let offset_at = shared.len() - if self.free.offset { 3 } else { 0 };
        for (k, (light, &i)) in lights.iter().zip(self.which).enumerate() {
            let photograph = &self.sample.photographs[i];
            let weight = f64::from(photograph.weight[t]);
            if weight <= 0.0 {
                continue;
            }
            let here = light.radiance(&natural, at);
            let by_light: [[f64; 3]; 3] = if self.free.offset {
                std::array::from_fn(|axis| {
                    let at = |by| light.moved(axis, by).radiance(&natural, at).value;
                    let (ahead, behind) = (at(MILLIMETRE), at(-MILLIMETRE));
                    std::array::from_fn(|c| (ahead[c] - behind[c]) / (2.0 * MILLIMETRE))
                })
            } else {
                [[0.0; 3]; 3]
            };
            let away = log_distance(&photograph.view) - correction.exposure.log_distance;
            for c in 0..3 {
                let (r, tells) = residual(here.value[c], photograph.radiance[c * n + t]);
                if !tells {
                    continue;
                }
                let inverse = by_log(here.value[c]);
                let row = Column::from_fn(|i, _| {
                    let chain = if is_albedo(i) { 2.0 * x[i] } else { 1.0 };
                    here.jacobian[c][i] * chain * inverse
                });
                shared.fill(0.0);
                if self.free.exposure {
                    let lit = here.value[c] * inverse;
                    shared[k] = lit;
                    shared[self.which.len()] = lit * away;
                }
                if self.free.offset {
                    for axis in 0..3 {
                        shared[offset_at + axis] = by_light[axis][c] * inverse;
                    }
                }
                let weight = weight * huber_weight(r, self.options.huber) / self.options.noise;
                each(r, weight, &row, &shared);
            }
        }
    }

    /// Adds a texel to the shared equations, itself eliminated.
    pub(super) fn eliminate(
        &self,
        t: usize,
        state: &State,
        lights: &[Lit],
        damping: f64,
        sum: &mut Shared,
    ) -> Solved {
        let q = self.nuisance_count();
        let x = self.coordinates(t, state);
        let (mut block, mut gradient) = (Block::zeros(), Column::zeros());
        let mut mixed = vec![Column::zeros(); q];
        let mut local = DMatrix::<f64>::zeros(CLASS + q, CLASS + q);
        let mut local_gradient = DVector::<f64>::zeros(CLASS + q);
        self.rows(t, &x, lights, &state.correction, |r, weight, row, shared| {
            block.syger(weight, row, row, 1.0);
            gradient.axpy(weight * r, row, 1.0);
            for (a, &by) in shared.iter().enumerate().filter(|(_, by)| **by != 0.0) {
                mixed[a].axpy(weight * by, row, 1.0);
                local_gradient[CLASS + a] += weight * by * r;
                for (b, &other) in shared.iter().enumerate().take(a + 1) {
                    local[(CLASS + a, CLASS + b)] += weight * by * other;
                }
            }
        });
        block.fill_upper_triangle_with_lower_triangle();
        let held = self.held(t, state, &x, &gradient);
        // a held coordinate answers to nothing
        for c in (0..CHANNELS).filter(|&c| held[c]) {
            block.row_mut(c).fill(0.0);
            block.column_mut(c).fill(0.0);
            gradient[c] = 0.0;
            mixed.iter_mut().for_each(|m| m[c] = 0.0);
        }
        let mut columns: Vec<Column> = GLOSS.map(|c| block.column(c).into_owned()).collect();
        for (i, c) in GLOSS.enumerate() {
            local_gradient[i] = gradient[c];
            for (j, d) in GLOSS.enumerate().take(i + 1) {
                local[(i, j)] = block[(c, d)];
            }
            for (a, mixed) in mixed.iter().enumerate() {
                local[(CLASS + a, i)] = mixed[c];
            }
        }
        columns.extend(mixed);
        for c in 0..CHANNELS {
            let precision = precision(&self.widths, c);
            block[(c, c)] += precision + damping * (block[(c, c)] + 1e-9);
            gradient[c] += precision * state.deviations[t][c];
            if held[c] {
                (block[(c, c)], gradient[c]) = (1.0, 0.0);
            }
        }
        let Some(factor) = block.cholesky() else {
            return Solved { own: Column::zeros(), columns: vec![Column::zeros(); CLASS + q] };
        };
        let own = factor.solve(&gradient);
        let solved: Vec<Column> = columns.iter().map(|c| factor.solve(c)).collect();
        for (i, column) in columns.iter().enumerate() {
            local_gradient[i] -= column.dot(&own);
            for (j, other) in solved.iter().enumerate().take(i + 1) {
                local[(i, j)] -= column.dot(other);
            }
        }
        self.scatter(t, &local, &local_gradient, sum);
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
            let pull = gradient[c] + precision(&self.widths, c) * state.deviations[t][c];
            (x[c] <= low && pull > 0.0) || (x[c] >= high && pull < 0.0)
        })
    }

    /// Adds what a texel says of its own gloss and of the nuisances to the shared equations (lower
    /// triangle).
    fn scatter(&self, t: usize, local: &DMatrix<f64>, gradient: &DVector<f64>, sum: &mut Shared) {
        let shares = self.texel_shares(t);
        let first = CLASS * shares.len();
        let at = |i: usize, j: usize| if i >= j { local[(i, j)] } else { local[(j, i)] };
        for (k, share) in shares.iter().enumerate().filter(|(_, s)| **s > 1e-3) {
            let share = f64::from(*share);
            for i in 0..CLASS {
                sum.gradient[CLASS * k + i] += share * gradient[i];
                for (l, other) in shares.iter().enumerate().filter(|(_, s)| **s > 1e-3) {
                    for j in 0..CLASS {
                        sum.matrix[(CLASS * k + i, CLASS * l + j)] +=
                            share * f64::from(*other) * at(i, j);
                    }
                }
                for a in CLASS..gradient.len() {
                    sum.matrix[(first + a - CLASS, CLASS * k + i)] += share * at(a, i);
                }
            }
        }
        for a in CLASS..gradient.len() {
            sum.gradient[first + a - CLASS] += gradient[a];
            for b in CLASS..=a {
                sum.matrix[(first + a - CLASS, first + b - CLASS)] += at(a, b);
            }
        }
    }
}
