//! Elimination of eight texels' coordinates from the normal equations (Schur complement).
//!
//! For texels `x` and shared unknowns `y`, with a 9x9 block of `A` per texel:
//!
//! ```text
//! [A B; Bᵀ C] [dx; dy] = -[g; h],   A = L Lᵀ,   own = L⁻¹ g,   columns = L⁻¹ B
//! (C − columnsᵀ columns) dy = -(h − columnsᵀ own)          the reduced equations
//! dx = -L⁻ᵀ (own + columns dy)
//! ```
//!
//! Single precision suffices: sums over tasks are in double precision, and a step must lower the cost.

use std::ops::Range;

use super::sums::{Reduced, Sums};
use crate::estimate::posterior::{Cholesky, PAIRS, at};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::CHANNELS;

/// A value of eight texels, and their nine coordinates.
pub(super) type Eight = [f32; LANES];
pub(super) type Column = [Eight; CHANNELS];

/// Eight texels' normal equations.
pub(super) struct Equations<'a> {
    pub sums: &'a Sums,
    /// 1, or 0 for coordinates that are held at a bound.
    pub free: Column,
    pub precision: [f64; CHANNELS],
    /// Gradient of the prior.
    pub gradient: Column,
    pub damping: f64,
    /// Coordinates of groups, and the texels' shares of each group.
    pub moving: Range<usize>,
    pub shares: &'a [Eight],
}

/// A task's reduced equations, lane by lane; lower triangle.
pub(super) struct Totals {
    matrix: Vec<Eight>,
    gradient: Vec<Eight>,
}

impl Totals {
    pub fn zeros(size: usize) -> Self {
        let zeros = |count: usize| vec![[0.0; LANES]; count];
        Self { matrix: zeros(at(size, 0)), gradient: zeros(size) }
    }

    /// Adds the sum of the lanes.
    pub fn add_to(&self, sum: &mut Reduced) {
        let total = |lanes: &Eight| lanes.iter().copied().map(f64::from).sum::<f64>();
        for (i, gradient) in self.gradient.iter().enumerate() {
            sum.gradient[i] += total(gradient);
            for j in 0..=i {
                sum.matrix[(i, j)] += total(&self.matrix[at(i, j)]);
            }
        }
    }
}

/// `L`, `own` and `columns` of eight texels, see the module.
pub(super) struct Eliminated {
    /// `L`, see [`Cholesky`].
    factor: [Eight; PAIRS],
    own: Column,
    columns: Vec<Column>,
}

impl Equations<'_> {
    /// Eliminates the texels and adds their reduced equations to `totals`.
    pub fn eliminate(self, totals: &mut Totals) -> Eliminated {
        dispatch(Eliminate { equations: self, totals })
    }
}

impl Eliminated {
    /// The texels' steps: their own, and those that follow from the steps `shared` of the columns.
    pub fn steps(&self, shared: &[Eight]) -> [Column; 2] {
        dispatch(Substitute { eliminated: self, shared })
    }
}

struct Eliminate<'a> {
    equations: Equations<'a>,
    totals: &'a mut Totals,
}

// Loops, because closures may stay calls without the kernel's target features.
#[inline(always)]
fn loaded<V: Lanes, const N: usize>(from: &[Eight; N]) -> [V; N] {
    let mut to = [V::splat(0.0); N];
    for (to, from) in to.iter_mut().zip(from) {
        *to = V::from_array(*from);
    }
    to
}

#[inline(always)]
fn stored<V: Lanes, const N: usize>(from: &[V; N]) -> [Eight; N] {
    let mut to = [[0.0; LANES]; N];
    for (to, from) in to.iter_mut().zip(from) {
        *to = from.to_array();
    }
    to
}

#[inline(always)]
fn add<V: Lanes>(total: &mut Eight, value: V) {
    *total = (V::from_array(*total) + value).to_array();
}

/// `plus - a · b`.
#[inline(always)]
fn minus_dot<V: Lanes>(a: &[V; CHANNELS], b: &[V; CHANNELS], plus: V) -> V {
    let mut sum = plus;
    for c in 0..CHANNELS {
        sum = (-a[c]).mul_add(b[c], sum);
    }
    sum
}

impl Kernel for Eliminate<'_> {
    type Output = Eliminated;

    #[inline(always)]
    fn run<V: Lanes>(self) -> Eliminated {
        let Self { equations, totals } = self;
        let free: [V; CHANNELS] = loaded(&equations.free);
        let matrix = triangle(equations.sums, &free);
        let factor = factor(&matrix, &equations);
        let mut right = [V::splat(0.0); CHANNELS];
        for (c, right) in right.iter_mut().enumerate() {
            let of_data = V::from_array(equations.sums.gradient[c]);
            *right = free[c] * (of_data + V::from_array(equations.gradient[c]));
        }
        let own = factor.forward(&right);
        // `B`, before `L⁻¹`.
        let mixed = mixed(&equations, &matrix, &free);
        let mut columns = Vec::with_capacity(mixed.len());
        for column in &mixed {
            columns.push(stored(&factor.forward(&loaded(column))));
        }
        let groups = &equations.moving;
        for (i, column) in columns.iter().enumerate() {
            let column: [V; CHANNELS] = loaded(column);
            let mut gradient = V::splat(0.0);
            if i < groups.len() {
                let c = groups.start + i;
                gradient = free[c] * V::from_array(equations.sums.gradient[c]);
            }
            totals.add_gradient(&equations, i, minus_dot(&column, &own, gradient));
            for (j, other) in columns[..=i].iter().enumerate() {
                let mut entry = V::splat(0.0);
                if j < groups.len() {
                    entry = V::from_array(mixed[i][groups.start + j]);
                }
                totals.add(&equations, [i, j], minus_dot(&column, &loaded(other), entry));
            }
        }
        Eliminated { factor: stored(&factor.0), own: stored(&own), columns }
    }
}

impl Totals {
    /// Adds to the gradient of a column. A group's coordinate gets its share of each texel.
    #[inline(always)]
    fn add_gradient<V: Lanes>(&mut self, equations: &Equations, i: usize, value: V) {
        let Equations { moving, shares, .. } = equations;
        let g = moving.len();
        if i >= g {
            add(&mut self.gradient[g * shares.len() + i - g], value);
            return;
        }
        for (k, share) in shares.iter().enumerate() {
            add(&mut self.gradient[g * k + i], value * V::from_array(*share));
        }
    }

    /// Adds to the entry of columns `i` and `j <= i`.
    #[inline(always)]
    fn add<V: Lanes>(&mut self, equations: &Equations, [i, j]: [usize; 2], value: V) {
        let Equations { moving, shares, .. } = equations;
        let g = moving.len();
        // Parameters follow the groups' coordinates.
        let row = |i: usize| g * shares.len() + i - g;
        if j >= g {
            add(&mut self.matrix[at(row(i), row(j))], value);
            return;
        }
        for (k, share) in shares.iter().enumerate() {
            let value = value * V::from_array(*share);
            if i >= g {
                add(&mut self.matrix[at(row(i), g * k + j)], value);
                continue;
            }
            for (l, other) in shares[..=k].iter().enumerate() {
                let value = value * V::from_array(*other);
                add(&mut self.matrix[at(g * k + i, g * l + j)], value);
                if l < k && i != j {
                    add(&mut self.matrix[at(g * k + j, g * l + i)], value);
                }
            }
        }
    }
}

/// `B`: columns of the groups' coordinates, then of the parameters.
#[inline(always)]
fn mixed<V: Lanes>(
    equations: &Equations,
    matrix: &[V; PAIRS],
    free: &[V; CHANNELS],
) -> Vec<Column> {
    let Equations { sums, moving, .. } = equations;
    let mut columns = Vec::with_capacity(moving.len() + sums.mixed.len());
    for c in moving.clone() {
        let mut column = [V::splat(0.0); CHANNELS];
        for (i, to) in column.iter_mut().enumerate() {
            *to = matrix[at(i.max(c), i.min(c))];
        }
        columns.push(stored(&column));
    }
    for mixed in &sums.mixed {
        let mut column: [V; CHANNELS] = loaded(mixed);
        for (to, free) in column.iter_mut().zip(free) {
            *to = *to * *free;
        }
        columns.push(stored(&column));
    }
    columns
}

/// Lower triangle of the photographs' matrix without the held coordinates.
#[inline(always)]
fn triangle<V: Lanes>(sums: &Sums, free: &[V; CHANNELS]) -> [V; PAIRS] {
    let mut matrix = [V::splat(0.0); PAIRS];
    for i in 0..CHANNELS {
        for j in 0..=i {
            matrix[at(i, j)] = V::from_array(sums.matrix[at(i, j)]) * free[i] * free[j];
        }
    }
    matrix
}

/// The factors of the matrix with prior and damping.
#[inline(always)]
fn factor<V: Lanes>(matrix: &[V; PAIRS], equations: &Equations) -> Cholesky<V> {
    let damping = equations.damping as f32;
    let mut damped = *matrix;
    for i in 0..CHANNELS {
        let own = V::splat(equations.precision[i] as f32 + damping * 1e-9);
        damped[at(i, i)] = damped[at(i, i)].mul_add(V::splat(1.0 + damping), own);
    }
    Cholesky::new(&damped)
}

struct Substitute<'a> {
    eliminated: &'a Eliminated,
    shared: &'a [Eight],
}

impl Kernel for Substitute<'_> {
    type Output = [Column; 2];

    #[inline(always)]
    fn run<V: Lanes>(self) -> [Column; 2] {
        let Eliminated { factor, own, columns } = self.eliminated;
        let factor = Cholesky::<V>(loaded(factor));
        let mut of_shared = [V::splat(0.0); CHANNELS];
        for (column, by) in columns.iter().zip(self.shared) {
            for (sum, value) in of_shared.iter_mut().zip(column) {
                *sum = V::from_array(*by).mul_add(V::from_array(*value), *sum);
            }
        }
        [stored(&factor.backward(&loaded(own))), stored(&factor.backward(&of_shared))]
    }
}
