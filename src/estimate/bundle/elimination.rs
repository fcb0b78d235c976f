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

use super::eight::{Column, Eight, loaded, stored};
use super::sums::{Block, Reduced, Sums};
use crate::estimate::coordinates::limits;
use crate::estimate::posterior::{Cholesky, PAIRS, at};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::CHANNELS;

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

impl Eliminated {
    /// The texels' steps: their own, and those that follow from the steps `shared` of the columns.
    pub fn steps(&self, shared: &[Eight]) -> [Column; 2] {
        dispatch(Substitute { eliminated: self, shared })
    }
}

/// Eliminates the texels of a block and adds their reduced equations to `totals`, and products of parameters to
/// `reduced`.
pub(super) struct Eliminate<'a> {
    pub block: Block<'a>,
    /// Deviations of the texels from their prior means.
    pub deviations: Column,
    pub damping: f64,
    pub reduced: &'a mut Reduced,
    pub totals: &'a mut Totals,
}

// Loops, because closures may stay calls without the kernel's target features.
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

/// 1, or 0 for a coordinate at a bound that its gradient would make it leave. Such coordinates are held out of the
/// step, because clipping would make the step of the others wrong.
#[inline(always)]
fn free<V: Lanes>(c: usize, x: V, gradient: V) -> V {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    let (low, high) = limits(c);
    let falls = gradient.if_greater(zero, zero, one);
    let rises = zero.if_greater(gradient, zero, one);
    V::splat(high).if_greater(x, x.if_greater(V::splat(low), one, falls), rises)
}

impl Kernel for Eliminate<'_> {
    type Output = Eliminated;

    #[inline(always)]
    fn run<V: Lanes>(self) -> Eliminated {
        let Self { block, deviations, damping, reduced, totals } = self;
        let Sums { texels, mixed } = Sums::<V>::new(&block, reduced);
        let precision = &block.problem.precision;
        let (x, deviations): ([V; CHANNELS], [V; CHANNELS]) =
            (loaded(&block.coordinates), loaded(&deviations));
        let (mut right, mut unbound) = ([V::splat(0.0); CHANNELS], [V::splat(0.0); CHANNELS]);
        for c in 0..CHANNELS {
            let gradient = deviations[c].mul_add(V::splat(precision[c] as f32), texels.gradient[c]);
            unbound[c] = free(c, x[c], gradient);
            right[c] = unbound[c] * gradient;
        }
        let mut matrix = texels.matrix;
        for i in 0..CHANNELS {
            for j in 0..=i {
                matrix[at(i, j)] = matrix[at(i, j)] * unbound[i] * unbound[j];
            }
        }
        let factor = factor(&matrix, precision, damping as f32);
        let own = factor.forward(&right);
        // `B`, before `L⁻¹`: columns of the groups' coordinates, then of the parameters.
        let groups = block.problem.groups.coordinates.clone();
        let mut before = Vec::with_capacity(groups.len() + mixed.len());
        for c in groups.clone() {
            let mut column = [V::splat(0.0); CHANNELS];
            for (i, to) in column.iter_mut().enumerate() {
                *to = matrix[at(i.max(c), i.min(c))];
            }
            before.push(column);
        }
        for mut column in mixed {
            for (value, free) in column.iter_mut().zip(unbound) {
                *value = *value * free;
            }
            before.push(column);
        }
        let mut columns = Vec::with_capacity(before.len());
        let mut kept = Vec::with_capacity(before.len());
        for column in &before {
            let column = factor.forward(column);
            kept.push(stored(&column));
            columns.push(column);
        }
        for (i, column) in columns.iter().enumerate() {
            let mut gradient = V::splat(0.0);
            if i < groups.len() {
                let c = groups.start + i;
                gradient = unbound[c] * texels.gradient[c];
            }
            totals.add_gradient(&block, i, minus_dot(column, &own, gradient));
            for (j, other) in columns[..=i].iter().enumerate() {
                let mut entry = V::splat(0.0);
                if j < groups.len() {
                    entry = before[i][groups.start + j];
                }
                totals.add(&block, [i, j], minus_dot(column, other, entry));
            }
        }
        Eliminated { factor: stored(&factor.0), own: stored(&own), columns: kept }
    }
}

impl Totals {
    /// Adds to the gradient of a column. A group's coordinate gets its share of each texel.
    #[inline(always)]
    fn add_gradient<V: Lanes>(&mut self, block: &Block, i: usize, value: V) {
        let (g, shares) = (block.problem.groups.coordinates.len(), &block.shares);
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
    fn add<V: Lanes>(&mut self, block: &Block, [i, j]: [usize; 2], value: V) {
        let (g, shares) = (block.problem.groups.coordinates.len(), &block.shares);
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

/// The factors of the matrix with prior and damping.
#[inline(always)]
fn factor<V: Lanes>(matrix: &[V; PAIRS], precision: &[f64; CHANNELS], damping: f32) -> Cholesky<V> {
    let mut damped = *matrix;
    for i in 0..CHANNELS {
        let own = V::splat(precision[i] as f32 + damping * 1e-9);
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
