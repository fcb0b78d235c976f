//! The quadratic model of eight texels, and its minimum.

use super::model::Posterior;
use super::residual::{Appearance, Residual, Seen};
use crate::reflectance::{Directions, Lobes};
use crate::simd::Lanes;
use crate::svbrdf::{CHANNELS, channel};
use std::ops::Range;

/// Entries of a triangle.
pub(in crate::estimate) const PAIRS: usize = CHANNELS * (CHANNELS + 1) / 2;

/// Coordinates that the colours share.
pub(in crate::estimate) const SHAPE: [usize; 3] =
    [channel::SLOPE_X, channel::SLOPE_Y, channel::ROUGHNESS];

/// `H d = -g`. `H` is the weighted sum of Jacobian products plus the prior's precision. The colours share
/// slopes and roughness ("shape": p, q, r); each has its own roots of diffuse and specular albedo ("colour":
/// d, s).
pub(in crate::estimate) struct NormalEquations<V> {
    /// pp, pq, pr, qq, qr, rr.
    shape: [V; 6],
    shape_gradient: [V; 3],
    colour: [Colour<V>; 3],
}

#[derive(Clone, Copy)]
struct Colour<V> {
    /// dd, ds, ss.
    own: [V; 3],
    /// d with p, q, r; then s with p, q, r.
    mixed: [[V; 3]; 2],
    gradient: [V; 2],
}

/// Half the squared distance to the prior's mean, in sigmas.
#[inline(always)]
fn prior_cost<V: Lanes>(posterior: &Posterior, x: &[V; CHANNELS], mean: &[V; CHANNELS]) -> V {
    let mut sum = V::splat(0.0);
    for c in 0..CHANNELS {
        let d = x[c] - mean[c];
        sum = (d * d).mul_add(V::splat(0.5 * posterior.precision[c]), sum);
    }
    sum
}

/// Objective, and weighted log-L1 loss of each colour, at coordinates `x`.
#[inline(always)]
pub(in crate::estimate) fn cost<V: Lanes>(
    posterior: &Posterior,
    x: &[V; CHANNELS],
    mean: &[V; CHANNELS],
    directions: &[Directions<V>],
    texels: Range<usize>,
) -> (V, [V; 3]) {
    let material = posterior.material(x, &texels);
    let (mut cost, mut loss) = (prior_cost(posterior, x, mean), [V::splat(0.0); 3]);
    for (observation, directions) in posterior.observations.iter().zip(directions) {
        let view = &observation.view;
        let lobes = Lobes::new(&material, directions);
        let weight = observation.load_weight(&texels);
        for c in 0..3 {
            let radiance = observation.load_radiance(c, &texels);
            let seen = Seen { noise: posterior.noise[c], radiance, weight };
            let residual = Residual::of(&lobes, &material, view, c, &seen);
            cost += residual.cost;
            loss[c] += residual.loss;
        }
    }
    (cost, loss)
}

impl<V: Lanes> NormalEquations<V> {
    /// The equations at coordinates `x`, and the result of [`cost`].
    #[inline(always)]
    pub fn new(
        posterior: &Posterior,
        x: &[V; CHANNELS],
        mean: &[V; CHANNELS],
        directions: &[Directions<V>],
        texels: Range<usize>,
    ) -> (Self, (V, [V; 3])) {
        let zero = V::splat(0.0);
        let material = posterior.material(x, &texels);
        let mut equations = Self::of_prior(posterior, x, mean);
        let (mut cost, mut loss) = (prior_cost(posterior, x, mean), [zero; 3]);
        for (observation, directions) in posterior.observations.iter().zip(directions) {
            let appearance = Appearance::new(&material, directions);
            let weight = observation.load_weight(&texels);
            for c in 0..3 {
                let radiance = observation.load_radiance(c, &texels);
                let seen = Seen { noise: posterior.noise[c], radiance, weight };
                let line = appearance.line(&material, &observation.view, c, x, &seen);
                cost += line.residual.cost;
                loss[c] += line.residual.loss;
                let Residual { value, square_weight, .. } = line.residual;
                equations.add(c, line.shape, line.colour, value, square_weight);
            }
        }
        (equations, (cost, loss))
    }

    /// Equations without residuals and prior.
    #[inline(always)]
    pub fn none() -> Self {
        let zero = V::splat(0.0);
        let colour = Colour { own: [zero; 3], mixed: [[zero; 3]; 2], gradient: [zero; 2] };
        Self { shape: [zero; 6], shape_gradient: [zero; 3], colour: [colour; 3] }
    }

    /// Upper triangle of the matrix, by rows, and gradient.
    #[inline(always)]
    pub fn whole(&self) -> ([V; PAIRS], [V; CHANNELS]) {
        let zero = V::splat(0.0);
        let mut rows = [[zero; CHANNELS]; CHANNELS];
        let mut gradient = [zero; CHANNELS];
        let [p, q, r] = SHAPE;
        let [pp, pq, pr, qq, qr, rr] = self.shape;
        for ((i, j), value) in [(p, p), (p, q), (p, r), (q, q), (q, r), (r, r)]
            .into_iter()
            .zip([pp, pq, pr, qq, qr, rr])
        {
            rows[i][j] = value;
        }
        for (i, value) in SHAPE.into_iter().zip(self.shape_gradient) {
            gradient[i] = value;
        }
        for (c, colour) in self.colour.iter().enumerate() {
            let own = [channel::DIFFUSE + c, channel::SPECULAR + c];
            let [d, s] = own;
            (rows[d][d], rows[d][s], rows[s][s]) = (colour.own[0], colour.own[1], colour.own[2]);
            for (k, at) in own.into_iter().enumerate() {
                gradient[at] = colour.gradient[k];
                for (i, value) in SHAPE.into_iter().zip(colour.mixed[k]) {
                    rows[i.min(at)][i.max(at)] = value;
                }
            }
        }
        let mut out = [zero; PAIRS];
        let mut k = 0;
        for i in 0..CHANNELS {
            for value in &rows[i][i..] {
                out[k] = *value;
                k += 1;
            }
        }
        (out, gradient)
    }

    #[inline(always)]
    fn of_prior(posterior: &Posterior, x: &[V; CHANNELS], mean: &[V; CHANNELS]) -> Self {
        let zero = V::splat(0.0);
        let precision = |c: usize| V::splat(posterior.precision[c]);
        let pull = |c: usize| (x[c] - mean[c]) * V::splat(posterior.precision[c]);
        let r = channel::ROUGHNESS;
        let mut colour = [Colour { own: [zero; 3], mixed: [[zero; 3]; 2], gradient: [zero; 2] }; 3];
        for c in 0..3 {
            let (d, s) = (channel::DIFFUSE + c, channel::SPECULAR + c);
            colour[c].own = [precision(d), zero, precision(s)];
            colour[c].gradient = [pull(d), pull(s)];
        }
        Self {
            shape: [precision(0), zero, zero, precision(1), zero, precision(r)],
            shape_gradient: [pull(0), pull(1), pull(r)],
            colour,
        }
    }

    /// Adds a residual with its derivatives.
    #[inline(always)]
    pub fn add(&mut self, c: usize, shape: [V; 3], colour: [V; 2], residual: V, weight: V) {
        let [p, q, r] = shape;
        let [wp, wq, wr] = [p * weight, q * weight, r * weight];
        let h = &mut self.shape;
        h[0] = wp.mul_add(p, h[0]);
        h[1] = wp.mul_add(q, h[1]);
        h[2] = wp.mul_add(r, h[2]);
        h[3] = wq.mul_add(q, h[3]);
        h[4] = wq.mul_add(r, h[4]);
        h[5] = wr.mul_add(r, h[5]);
        let g = &mut self.shape_gradient;
        g[0] = wp.mul_add(residual, g[0]);
        g[1] = wq.mul_add(residual, g[1]);
        g[2] = wr.mul_add(residual, g[2]);
        let own = &mut self.colour[c];
        let [d, s] = colour;
        let [wd, ws] = [d * weight, s * weight];
        own.own[0] = wd.mul_add(d, own.own[0]);
        own.own[1] = wd.mul_add(s, own.own[1]);
        own.own[2] = ws.mul_add(s, own.own[2]);
        for i in 0..3 {
            own.mixed[0][i] = wd.mul_add(shape[i], own.mixed[0][i]);
            own.mixed[1][i] = ws.mul_add(shape[i], own.mixed[1][i]);
        }
        own.gradient[0] = wd.mul_add(residual, own.gradient[0]);
        own.gradient[1] = ws.mul_add(residual, own.gradient[1]);
    }

    /// Variances of the two slopes under the quadratic posterior.
    #[inline(always)]
    pub fn slope_variances(&self) -> [V; 2] {
        let mut a = self.shape;
        for c in 0..3 {
            self.eliminate(c, V::splat(1.0), &mut a);
        }
        let inverse = inverse(a);
        [inverse[0], inverse[3]]
    }

    /// The covariance of the quadratic model: upper triangle by rows.
    #[inline(always)]
    pub fn covariance(&self) -> [V; PAIRS] {
        let zero = V::splat(0.0);
        let mut out = [zero; PAIRS];
        let mut k = 0;
        for i in 0..CHANNELS {
            let mut unit = [zero; CHANNELS];
            unit[i] = V::splat(1.0);
            let column = self.solved(V::splat(1.0), &unit);
            for value in &column[i..] {
                out[k] = *value;
                k += 1;
            }
        }
        out
    }

    /// Eliminates a colour from the shape's equations. Returns the inverse of its block, and the inverse
    /// times its mixed terms.
    #[inline(always)]
    fn eliminate(&self, c: usize, raise: V, a: &mut [V; 6]) -> ([V; 3], [[V; 3]; 2]) {
        let zero = V::splat(0.0);
        let colour = &self.colour[c];
        let (d, s, o) = (colour.own[0] * raise, colour.own[2] * raise, colour.own[1]);
        // d s - o² > 0 by Cauchy-Schwarz and the prior; the bound guards against rounding.
        let determinant = d.mul_add(s, -(o * o)).max(d * s * V::splat(1e-6));
        let scale = determinant.reciprocal();
        let inverse = [s * scale, -(o * scale), d * scale];
        let [md, ms] = colour.mixed;
        let (mut td, mut ts) = ([zero; 3], [zero; 3]);
        for i in 0..3 {
            td[i] = inverse[0].mul_add(md[i], inverse[1] * ms[i]);
            ts[i] = inverse[1].mul_add(md[i], inverse[2] * ms[i]);
        }
        let mut k = 0;
        for i in 0..3 {
            for j in i..3 {
                a[k] = a[k] - md[i].mul_add(td[j], ms[i] * ts[j]);
                k += 1;
            }
        }
        (inverse, [td, ts])
    }

    /// The step to the minimum, with the diagonal times `1 + damping`. Colours are eliminated, and LDLᵀ
    /// solves the 3x3 system of the shape.
    #[inline(always)]
    pub fn solve(&self, damping: V) -> [V; CHANNELS] {
        let mut right = [V::splat(0.0); CHANNELS];
        for (i, gradient) in SHAPE.into_iter().zip(self.shape_gradient) {
            right[i] = -gradient;
        }
        for (c, colour) in self.colour.iter().enumerate() {
            right[channel::DIFFUSE + c] = -colour.gradient[0];
            right[channel::SPECULAR + c] = -colour.gradient[1];
        }
        self.solved(damping + V::splat(1.0), &right)
    }

    /// The solution for a right-hand side, with the diagonal times `raise`.
    #[inline(always)]
    fn solved(&self, raise: V, right: &[V; CHANNELS]) -> [V; CHANNELS] {
        let zero = V::splat(0.0);
        let h = &self.shape;
        let mut a = [h[0] * raise, h[1], h[2], h[3] * raise, h[4], h[5] * raise];
        let [p, q, r] = SHAPE;
        let mut b = [right[p], right[q], right[r]];
        let mut inverses = [[zero; 3]; 3];
        for c in 0..3 {
            let (inverse, [td, ts]) = self.eliminate(c, raise, &mut a);
            inverses[c] = inverse;
            let colour = [right[channel::DIFFUSE + c], right[channel::SPECULAR + c]];
            for i in 0..3 {
                b[i] = b[i] - td[i].mul_add(colour[0], ts[i] * colour[1]);
            }
        }
        // Pivots are positive except for rounding.
        let floor = V::splat(1e-6);
        let d0 = a[0].max(h[0] * floor);
        let i0 = d0.reciprocal();
        let (l10, l20) = (a[1] * i0, a[2] * i0);
        let d1 = (a[3] - l10 * a[1]).max(h[3] * floor);
        let i1 = d1.reciprocal();
        let u21 = a[4] - l10 * a[2];
        let l21 = u21 * i1;
        let d2 = (a[5] - l20 * a[2] - l21 * u21).max(h[5] * floor);
        let y1 = b[1] - l10 * b[0];
        let y2 = b[2] - l20 * b[0] - l21 * y1;
        let r = y2 * d2.reciprocal();
        let q = y1 * i1 - l21 * r;
        let p = b[0] * i0 - l10 * q - l20 * r;

        let mut out = [zero; CHANNELS];
        out[channel::SLOPE_X] = p;
        out[channel::SLOPE_Y] = q;
        out[channel::ROUGHNESS] = r;
        for c in 0..3 {
            let colour = &self.colour[c];
            // A closure in `map` may stay a call without the kernel's target features.
            let mut rest = [right[channel::DIFFUSE + c], right[channel::SPECULAR + c]];
            for (rest, [mp, mq, mr]) in rest.iter_mut().zip(colour.mixed) {
                *rest = *rest - mp * p - mq * q - mr * r;
            }
            let inverse = inverses[c];
            out[channel::DIFFUSE + c] = inverse[0].mul_add(rest[0], inverse[1] * rest[1]);
            out[channel::SPECULAR + c] = inverse[1].mul_add(rest[0], inverse[2] * rest[1]);
        }
        out
    }
}

/// Inverse of a symmetric positive matrix (pp, pq, pr, qq, qr, rr) by cofactors.
#[inline(always)]
fn inverse<V: Lanes>([pp, pq, pr, qq, qr, rr]: [V; 6]) -> [V; 6] {
    let by_pp = qq.mul_add(rr, -(qr * qr));
    let by_pq = pr.mul_add(qr, -(pq * rr));
    let by_pr = pq.mul_add(qr, -(pr * qq));
    let by_qq = pp.mul_add(rr, -(pr * pr));
    let by_qr = pq.mul_add(pr, -(pp * qr));
    let by_rr = pp.mul_add(qq, -(pq * pq));
    let determinant = pp.mul_add(by_pp, pq.mul_add(by_pq, pr * by_pr));
    let scale = determinant.max(pp * qq * rr * V::splat(1e-6)).reciprocal();
    [by_pp, by_pq, by_pr, by_qq, by_qr, by_rr].map(|v| v * scale)
}

#[cfg(test)]
mod tests;
