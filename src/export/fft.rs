//! Discrete Fourier transforms of any length in little code: Stockham radix 4 for powers of two,
//! and Bluestein's convolution (*A Linear Filtering Approach to the Computation of the Discrete
//! Fourier Transform*, 1970) for other lengths.

use std::f64::consts::PI;

use num_complex::Complex;

/// The transform of one length: `X[k] = sum x[n] exp(-2 pi i k n / length)`.
pub(super) struct Fft {
    /// `exp(-2 pi i k / n)` for the internal power of two `n`.
    twiddles: Vec<Complex<f64>>,
    /// For lengths other than powers of two.
    chirp: Option<Chirp>,
}

/// Data of Bluestein's convolution.
struct Chirp {
    /// `exp(-pi i n² / length)`
    values: Vec<Complex<f64>>,
    /// Spectrum of the conjugate, over the length of the convolution.
    spectrum: Vec<Complex<f64>>,
}

impl Fft {
    pub fn new(length: usize) -> Self {
        let unit = |turns: f64| Complex::from_polar(1.0, -2.0 * PI * turns);
        let twiddles = |n: usize| (0..n).map(|k| unit(k as f64 / n as f64)).collect();
        if length.is_power_of_two() {
            return Self { twiddles: twiddles(length), chirp: None };
        }
        let n = (2 * length - 1).next_power_of_two();
        let turns = |k: usize| (k * k % (2 * length)) as f64 / (2 * length) as f64;
        let values: Vec<_> = (0..length).map(|k| unit(turns(k))).collect();
        let mut spectrum = vec![Complex::default(); n];
        for (k, v) in values.iter().enumerate() {
            spectrum[k] = v.conj();
            spectrum[(n - k) % n] = v.conj();
        }
        let twiddles: Vec<_> = twiddles(n);
        powers_of_two(&twiddles, &mut spectrum, &mut vec![Complex::default(); n]);
        spectrum.iter_mut().for_each(|v| *v /= n as f64);
        Self { twiddles, chirp: Some(Chirp { values, spectrum }) }
    }

    /// Transforms `length` values in place.
    pub fn process(&self, values: &mut [Complex<f64>], scratch: &mut Vec<Complex<f64>>) {
        let n = self.twiddles.len();
        let Some(chirp) = &self.chirp else {
            scratch.resize(n, Complex::default());
            return powers_of_two(&self.twiddles, values, scratch);
        };
        scratch.clear();
        scratch.resize(2 * n, Complex::default());
        let (product, scratch) = scratch.split_at_mut(n);
        for (p, (v, c)) in product.iter_mut().zip(values.iter().zip(&chirp.values)) {
            *p = v * c;
        }
        powers_of_two(&self.twiddles, product, scratch);
        // The inverse transform is the conjugate's conjugate transform.
        product.iter_mut().zip(&chirp.spectrum).for_each(|(p, s)| *p = (*p * s).conj());
        powers_of_two(&self.twiddles, product, scratch);
        for (v, (p, c)) in values.iter_mut().zip(product.iter().zip(&chirp.values)) {
            *v = p.conj() * c;
        }
    }
}

/// Transforms as many values as there are twiddles.
fn powers_of_two(
    twiddles: &[Complex<f64>],
    values: &mut [Complex<f64>],
    scratch: &mut [Complex<f64>],
) {
    let n = values.len();
    // Blocks of `done` values are transformed.
    let (mut from, mut to, mut done) = (&mut *values, &mut *scratch, 1);
    let mut swapped = false;
    while done < n {
        let radix = if n / done >= 4 { 4 } else { 2 };
        let groups = n / done / radix;
        for group in 0..groups {
            let part = |i: usize| &from[(group + i * groups) * done..][..done];
            let out = &mut to[radix * group * done..][..radix * done];
            let twiddle = |i: usize| twiddles[i * group * done];
            if radix == 4 {
                quarter(out, [0, 1, 2, 3].map(part), [1, 2, 3].map(twiddle));
            } else {
                let (sum, difference) = out.split_at_mut(done);
                for (k, (a, b)) in part(0).iter().zip(part(1)).enumerate() {
                    (sum[k], difference[k]) = (a + b, a - b);
                }
            }
        }
        std::mem::swap(&mut from, &mut to);
        (done, swapped) = (radix * done, !swapped);
    }
    if swapped {
        to.copy_from_slice(from);
    }
}

/// A radix-4 step.
fn quarter(
    out: &mut [Complex<f64>],
    [a, b, c, d]: [&[Complex<f64>]; 4],
    twiddles: [Complex<f64>; 3],
) {
    let n = a.len();
    let (b, c, d) = (&b[..n], &c[..n], &d[..n]);
    let (out0, rest) = out.split_at_mut(n);
    let (out1, rest) = rest.split_at_mut(n);
    let (out2, out3) = rest.split_at_mut(n);
    let out3 = &mut out3[..n];
    for k in 0..n {
        let (even, even_turned) = (a[k] + c[k], a[k] - c[k]);
        let (odd, difference) = (b[k] + d[k], b[k] - d[k]);
        // times i
        let odd_turned = Complex::new(-difference.im, difference.re);
        out0[k] = even + odd;
        out1[k] = twiddles[0] * (even_turned - odd_turned);
        out2[k] = twiddles[1] * (even - odd);
        out3[k] = twiddles[2] * (even_turned + odd_turned);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn spectra_are_those_of_the_definition() {
        let mut random = Random::new(3);
        for length in (1..=20).chain([31, 32, 48, 64, 100, 127, 128]) {
            let mut number = || random.uniform() - 0.5;
            let values: Vec<_> = (0..length).map(|_| Complex::new(number(), number())).collect();
            let mut found = values.clone();
            // The content of the scratch is irrelevant.
            Fft::new(length).process(&mut found, &mut vec![Complex::new(7.0, 7.0); 3]);
            for (k, found) in found.iter().enumerate() {
                let angle = |n: usize| -2.0 * PI * ((k * n) % length) as f64 / length as f64;
                let term = |(n, v): (usize, &Complex<f64>)| v * Complex::from_polar(1.0, angle(n));
                let expected: Complex<f64> = values.iter().enumerate().map(term).sum();
                assert!((found - expected).norm() < 1e-12, "{length}: {k}");
            }
        }
    }
}
