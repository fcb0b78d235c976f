//! Least-squares integration of differences between neighbours (Poisson's equation) by
//! trigonometric transforms, as by Frankot and Chellappa (PAMI 10(4), 1988), with the eigenvalues
//! of finite differences, which are exact at the borders.

use std::f64::consts::PI;

use num_complex::Complex;

use super::fft::Fft;
use super::transpose::transpose;
use crate::parallel;

/// Boundary of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Border {
    /// Unknown beyond the last value: the solution continues as its mirror image.
    Free,
    /// The last value is adjacent to the first.
    Periodic,
}

/// Differences from each value to its right and lower neighbour; ignored in the last column or row
/// of a free axis.
pub(super) struct Differences {
    pub right: Vec<f32>,
    pub down: Vec<f32>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub width: usize,
    pub height: usize,
    /// Boundaries along rows and along columns.
    pub borders: [Border; 2],
    /// Distances between columns and between rows, for the conversion of differences to slopes.
    pub spacing: [f64; 2],
}

impl Grid {
    /// The function of mean 0 whose slopes fit the given ones best, by least squares.
    pub fn integrate(&self, differences: &Differences) -> Vec<f32> {
        let mut solver = Solver::new(*self, 0.0);
        self.diverge(differences, &mut solver.values);
        solver.solve();
        solver.values.into_iter().map(|v| v as f32).collect()
    }

    /// Share of the squared slopes that the function does not have, 0 to 1; 0 without slopes.
    pub fn unexplained(&self, differences: &Differences, values: &[f32]) -> f32 {
        let (w, h) = (self.width, self.height);
        let [kx, ky] = self.spacing.map(|s| (s * s).recip());
        let (mut all, mut left) = (0.0, 0.0);
        for i in 0..w * h {
            let (x, y) = (i % w, i / w);
            for (axis, last, to, given, k) in [
                (0, x + 1 == w, y * w + (x + 1) % w, differences.right[i], kx),
                (1, y + 1 == h, (y + 1) % h * w + x, differences.down[i], ky),
            ] {
                if last && self.borders[axis] == Border::Free {
                    continue;
                }
                let found = f64::from(values[to]) - f64::from(values[i]);
                all += k * f64::from(given).powi(2);
                left += k * (found - f64::from(given)).powi(2);
            }
        }
        if all > 0.0 { (left / all) as f32 } else { 0.0 }
    }

    fn diverge(&self, differences: &Differences, out: &mut [f64]) {
        let (w, h) = (self.width, self.height);
        let [kx, ky] = self.spacing.map(|s| (s * s).recip());
        let [free_x, free_y] = self.borders.map(|b| b == Border::Free);
        parallel::parts(out.chunks_mut(w), |y, row| {
            let above = (y + h - 1) % h;
            for (x, v) in row.iter_mut().enumerate() {
                let i = y * w + x;
                let right = if free_x && x + 1 == w { 0.0 } else { differences.right[i] };
                let left =
                    if free_x && x == 0 { 0.0 } else { differences.right[y * w + (x + w - 1) % w] };
                let down = if free_y && y + 1 == h { 0.0 } else { differences.down[i] };
                let up = if free_y && y == 0 { 0.0 } else { differences.down[above * w + x] };
                *v = kx * f64::from(right - left) + ky * f64::from(down - up);
            }
        });
    }
}

/// A target difference between two values.
pub(super) struct Step {
    pub from: usize,
    pub to: usize,
    pub by: f32,
}

/// Spreads single steps over their surroundings: finds the function with these steps whose other
/// differences and values are least, by least squares. It decays with distance. For many functions
/// on a grid with unit spacing.
pub(super) struct Spread(Solver);

impl Spread {
    pub fn new(width: usize, height: usize, borders: [Border; 2], range: f64) -> Self {
        let grid = Grid { width, height, borders, spacing: [1.0; 2] };
        Self(Solver::new(grid, (range * range).recip()))
    }

    /// The function; steps connect neighbours.
    pub fn spread(&mut self, steps: impl IntoIterator<Item = Step>) -> &[f64] {
        let values = &mut self.0.values;
        values.fill(0.0);
        for step in steps {
            values[step.from] += f64::from(step.by);
            values[step.to] -= f64::from(step.by);
        }
        self.0.solve();
        &self.0.values
    }
}

/// Screened Poisson equation on a grid: least squares of slopes and weighted values.
struct Solver {
    along: Axis,
    down: Axis,
    /// Divisors of the frequencies, per axis.
    eigenvalues: [Vec<f64>; 2],
    screening: f64,
    /// First the divergence of the slopes, then the solution.
    values: Vec<f64>,
    /// Scratch for columns.
    columns: Vec<f64>,
}

impl Solver {
    fn new(grid: Grid, screening: f64) -> Self {
        let (w, h) = (grid.width, grid.height);
        let (along, down) = (Axis::new(w, grid.borders[0]), Axis::new(h, grid.borders[1]));
        let eigenvalues = [(&along, 0), (&down, 1)].map(|(axis, i)| {
            let k = (grid.spacing[i] * grid.spacing[i]).recip();
            (0..axis.length).map(|n| k * axis.eigenvalue(n)).collect()
        });
        let [values, columns] = [(); 2].map(|()| vec![0.0; w * h]);
        Self { along, down, eigenvalues, screening, values, columns }
    }

    /// Replaces the divergence by the solution.
    fn solve(&mut self) {
        let (w, h) = (self.along.length, self.down.length);
        let [x_eigenvalues, y_eigenvalues] = &self.eigenvalues;
        let (values, columns) = (&mut self.values, &mut self.columns);
        self.along.transform(values, Axis::forward);
        transpose(values, w, columns);
        self.down.transform(columns, Axis::forward);
        parallel::parts(columns.chunks_mut(h), |x, column| {
            for (v, y) in column.iter_mut().zip(y_eigenvalues) {
                let eigenvalue = x_eigenvalues[x] + y + self.screening;
                *v = if eigenvalue > 0.0 { *v / -eigenvalue } else { 0.0 };
            }
        });
        self.down.transform(columns, Axis::inverse);
        transpose(columns, h, values);
        self.along.transform(values, Axis::inverse);
    }
}

/// Transform of one axis into the eigenvectors of second differences: cosines for a free axis
/// (DCT-II, after Makhoul 1980), cosine plus sine for a periodic one (Hartley).
struct Axis {
    border: Border,
    length: usize,
    fft: Fft,
    /// `exp(-i pi k / 2n)`
    twiddles: Vec<Complex<f64>>,
}

/// Values of a transform, and scratch.
#[derive(Default)]
struct Buffer {
    values: Vec<Complex<f64>>,
    scratch: Vec<Complex<f64>>,
}

/// Transforms two rows in place, as real and imaginary part of one.
type Transform = fn(&Axis, [&mut [f64]; 2], &mut Buffer);

impl Axis {
    fn new(length: usize, border: Border) -> Self {
        let angle = |k: usize| -0.5 * PI * k as f64 / length as f64;
        Self {
            border,
            length,
            fft: Fft::new(length),
            twiddles: (0..length).map(|k| Complex::from_polar(1.0, angle(k))).collect(),
        }
    }

    /// Eigenvalue of the negative second difference.
    fn eigenvalue(&self, k: usize) -> f64 {
        let turn = if self.border == Border::Free { PI } else { 2.0 * PI };
        2.0 - 2.0 * (turn * k as f64 / self.length as f64).cos()
    }

    fn transform(&self, rows: &mut [f64], transform: Transform) {
        let n = self.length;
        let scratch = || {
            let values = vec![Complex::default(); n];
            (Buffer { values, ..Buffer::default() }, vec![0.0; n])
        };
        parallel::parts_with(rows.chunks_mut(2 * n), scratch, |(buffer, spare), _, rows| {
            let (first, second) = rows.split_at_mut(n);
            // The last of an odd number of rows has no partner.
            let second = if second.is_empty() { spare.as_mut_slice() } else { second };
            transform(self, [first, second], buffer);
        });
    }

    /// Separates the transform of two rows. Both are real, so their spectra are the symmetric and
    /// the antisymmetric part.
    fn apart(&self, values: &[Complex<f64>], k: usize) -> [Complex<f64>; 2] {
        let (a, b) = (values[k], values[(self.length - k) % self.length]);
        let first = Complex::new(0.5 * (a.re + b.re), 0.5 * (a.im - b.im));
        [first, Complex::new(0.5 * (a.im + b.im), 0.5 * (b.re - a.re))]
    }

    fn forward(&self, [first, second]: [&mut [f64]; 2], buffer: &mut Buffer) {
        if self.border == Border::Periodic {
            return self.hartley([first, second], buffer, 1.0);
        }
        for (n, (&a, &b)) in first.iter().zip(&*second).enumerate() {
            buffer.values[self.folded(n)] = Complex::new(a, b);
        }
        self.fft.process(&mut buffer.values, &mut buffer.scratch);
        for (k, t) in self.twiddles.iter().enumerate() {
            let [a, b] = self.apart(&buffer.values, k);
            (first[k], second[k]) = ((a * t).re, (b * t).re);
        }
    }

    fn inverse(&self, [first, second]: [&mut [f64]; 2], buffer: &mut Buffer) {
        let scale = (self.length as f64).recip();
        if self.border == Border::Periodic {
            return self.hartley([first, second], buffer, scale);
        }
        // The inverse transform is the conjugate's conjugate transform.
        buffer.values[0] = Complex::new(first[0], -second[0]);
        for k in 1..self.length {
            let mirrored = |row: &[f64]| Complex::new(row[k], -row[self.length - k]);
            let both = mirrored(first) + Complex::<f64>::i() * mirrored(second);
            buffer.values[k] = self.twiddles[k] * both.conj();
        }
        self.fft.process(&mut buffer.values, &mut buffer.scratch);
        for (n, (a, b)) in first.iter_mut().zip(second).enumerate() {
            let value = buffer.values[self.folded(n)];
            (*a, *b) = (scale * value.re, -scale * value.im);
        }
    }

    fn hartley(&self, [first, second]: [&mut [f64]; 2], buffer: &mut Buffer, scale: f64) {
        for (v, (&a, &b)) in buffer.values.iter_mut().zip(first.iter().zip(&*second)) {
            *v = Complex::new(a, b);
        }
        self.fft.process(&mut buffer.values, &mut buffer.scratch);
        for k in 0..self.length {
            let [a, b] = self.apart(&buffer.values, k);
            (first[k], second[k]) = (scale * (a.re - a.im), scale * (b.re - b.im));
        }
    }

    /// Even values in order, then odd ones in reverse.
    fn folded(&self, n: usize) -> usize {
        if n.is_multiple_of(2) { n / 2 } else { self.length - 1 - n / 2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn differences(values: &[f32], w: usize, h: usize) -> Differences {
        let to = |f: fn(usize, usize, usize, usize) -> usize| {
            (0..w * h).map(|i| values[f(i % w, i / w, w, h)] - values[i]).collect()
        };
        Differences {
            right: to(|x, y, w, _| y * w + (x + 1) % w),
            down: to(|x, y, w, h| (y + 1) % h * w + x),
        }
    }

    /// Differences reconstruct any function, for all sizes and boundaries.
    #[test]
    fn values_come_back_from_their_differences() {
        for (w, h) in [(2, 2), (5, 8), (16, 9), (1, 7), (30, 1), (13, 13)] {
            let mut values: Vec<f32> =
                (0..w * h).map(|i| ((i * i * 7 + 3 * i) % 101) as f32 * 0.1).collect();
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            values.iter_mut().for_each(|v| *v -= mean);
            for borders in [
                [Border::Free; 2],
                [Border::Periodic; 2],
                [Border::Periodic, Border::Free],
                [Border::Free, Border::Periodic],
            ] {
                let grid = Grid { width: w, height: h, borders, spacing: [0.5, 2.0] };
                let given = differences(&values, w, h);
                let found = grid.integrate(&given);
                for (a, b) in found.iter().zip(&values) {
                    assert!((a - b).abs() < 1e-4, "{w} x {h} {borders:?}: {a} {b}");
                }
                assert!(grid.unexplained(&given, &found) < 1e-9);
            }
        }
    }

    /// One step in a long periodic row: each side takes half of it, and the solution decays as the
    /// difference equation predicts.
    #[test]
    fn spread_steps_decay() {
        let (n, range) = (200, 10.0);
        let mut spread = Spread::new(n, 1, [Border::Periodic; 2], range);
        // Earlier calls have no influence.
        spread.spread([Step { from: 3, to: 4, by: 5.0 }]);
        let found = spread.spread([Step { from: 99, to: 100, by: 1.0 }]);
        // (u[i+1] - 2 u[i] + u[i-1]) range² = u[i] gives this decay per value.
        let decay = (0.5 / range).asinh() * 2.0;
        for i in 0..60 {
            let expected = found[100] * (-decay * i as f64).exp();
            assert!((found[100 + i] - expected).abs() < 1e-4, "{i}: {} {expected}", found[100 + i]);
            assert!((found[100 + i] + found[99 - i]).abs() < 1e-6, "antisymmetric");
        }
        assert!((found[100] - 0.5).abs() < 0.03);
    }

    /// A vortex has no height: the result is flat, and everything is unexplained.
    #[test]
    fn a_vortex_stays_unexplained() {
        let (w, h) = (16, 16);
        let turn = |i: usize| (2.0 * PI * i as f64 / 16.0).sin() as f32;
        let given = Differences {
            right: (0..w * h).map(|i| turn(i / w)).collect(),
            down: (0..w * h).map(|i| turn(i % w)).collect(),
        };
        let grid = Grid { width: w, height: h, borders: [Border::Periodic; 2], spacing: [1.0; 2] };
        let found = grid.integrate(&given);
        assert!(found.iter().all(|v| v.abs() < 1e-6));
        assert!((grid.unexplained(&given, &found) - 1.0).abs() < 1e-6);
    }
}
