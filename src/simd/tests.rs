use super::*;

/// Every operation on eight pairs of numbers, one row per operation.
struct All([f32; LANES], [f32; LANES]);

impl Kernel for All {
    type Output = Vec<[f32; LANES]>;
    #[inline(always)]
    fn run<V: Lanes>(self) -> Self::Output {
        let (a, b) = (V::from_array(self.0), V::from_array(self.1));
        let mut sum = a;
        sum += b;
        let mut partial = [9.0; 3];
        V::load(&[1.0, 2.0], 7.0).store(&mut partial);
        [
            sum,
            a - b,
            a * b,
            a / b,
            -a,
            a.abs(),
            a.max(b),
            a.min(b),
            a.abs().sqrt(),
            a.mul_add(b, b),
            a.if_greater(b, a, V::splat(3.0)),
            a.abs().ln(),
            b.exp2(),
            b.reciprocal(),
            a.abs().reciprocal_sqrt(),
            a.clamp(-1.0, 1.0),
            V::load(&partial, 5.0),
            V::iota(),
        ]
        .map(V::to_array)
        .to_vec()
    }
}

const A: [f32; LANES] = [1.0, -2.5, 0.37, 1e-5, -7e4, 3.3, -0.1, 0.71];
const B: [f32; LANES] = [2.0, -0.5, 5.5, -12.5, 0.25, -3.3, 100.2, -90.7];

fn expected(row: usize, i: usize) -> f64 {
    let (a, b) = (A[i] as f64, B[i] as f64);
    match row {
        0 => a + b,
        1 => a - b,
        2 => a * b,
        3 => a / b,
        4 => -a,
        5 => a.abs(),
        6 => a.max(b),
        7 => a.min(b),
        8 => a.abs().sqrt(),
        9 => a * b + b,
        10 => {
            if a > b {
                a
            } else {
                3.0
            }
        }
        11 => a.abs().ln(),
        12 => b.exp2(),
        13 => 1.0 / b,
        14 => 1.0 / a.abs().sqrt(),
        15 => a.clamp(-1.0, 1.0),
        16 => [1.0, 2.0, 7.0, 5.0, 5.0, 5.0, 5.0, 5.0][i],
        _ => i as f64,
    }
}

/// Compares both back ends with `f64`. 4e-7 and 3e-7 are the stated errors of `exp2` and of the
/// reciprocal root; the rest is rounding (2e-7 are three units in the last place).
#[test]
fn every_operation_agrees_with_double_precision() {
    for rows in [dispatch(All(A, B)), All(A, B).run::<Portable>()] {
        for (row, values) in rows.iter().enumerate() {
            for (i, &v) in values.iter().enumerate() {
                let want = expected(row, i);
                let tolerance = match row {
                    12 => 4e-7,
                    14 => 3e-7,
                    _ => 2e-7,
                };
                // With cancellation, products round at the size of their terms.
                let scale = match row {
                    9 => want.abs() + B[i].abs() as f64,
                    11 => want.abs().max(1.0),
                    _ => want.abs(),
                };
                assert!(
                    (v as f64 - want).abs() <= tolerance * scale,
                    "row {row}, lane {i}: {v} for {want}"
                );
            }
        }
    }
}

struct Stored([u16; LANES]);

impl Kernel for Stored {
    type Output = [[f32; LANES]; 4];
    #[inline(always)]
    fn run<V: Lanes>(self) -> Self::Output {
        let three = [2, 1, 0].map(|digit| self.0.map(|v| v >> digit ^ 0xABC0));
        [
            V::from_halves(self.0),
            V::from_lowest(three),
            V::load_halves(&self.0[..5]),
            V::load_lowest([&three[0][..5], &three[1][..5], &three[2][..5]]),
        ]
        .map(V::to_array)
    }
}

#[test]
fn every_finite_half_float_and_its_lowest_bits_are_exact() {
    for first in (0..=u16::MAX).step_by(LANES) {
        let halves: [u16; LANES] = std::array::from_fn(|i| first + i as u16);
        for stored in [dispatch(Stored(halves)), Stored(halves).run::<Portable>()] {
            for i in 0..LANES {
                let half = half::f16::from_bits(halves[i]);
                let [value, lowest, cut, cut_lowest] = stored.map(|lanes| lanes[i]);
                let [first, second, third] = [2, 1, 0].map(|shift| halves[i] >> shift & 1);
                assert_eq!(lowest, f32::from(first + 2 * second + 4 * third));
                assert_eq!(cut_lowest, if i < 5 { lowest } else { 7.0 });
                if half.is_finite() {
                    assert_eq!(value.to_bits(), half.to_f32().to_bits(), "{half}");
                    assert_eq!(cut, if i < 5 { value } else { 0.0 });
                }
            }
        }
    }
}

struct InverseRoot([f32; LANES]);

impl Kernel for InverseRoot {
    type Output = [f32; LANES];
    #[inline(always)]
    fn run<V: Lanes>(self) -> [f32; LANES] {
        V::from_array(self.0).reciprocal_sqrt().to_array()
    }
}

#[test]
fn inverse_roots_keep_their_stated_error() {
    // Every 83rd number from 1 to 4, and other magnitudes.
    let numbers = (1.0f32.to_bits()..4.0f32.to_bits()).step_by(83).map(f32::from_bits);
    let numbers: Vec<f32> = numbers.flat_map(|x| [x, x * 1e-20, x * 1e20]).collect();
    for x in numbers.as_chunks::<LANES>().0 {
        for found in [dispatch(InverseRoot(*x)), InverseRoot(*x).run::<Portable>()] {
            for (found, &x) in found.iter().zip(x) {
                let want = 1.0 / f64::from(x).sqrt();
                assert!((f64::from(*found) / want - 1.0).abs() < 3e-7, "{x}: {found}");
            }
        }
    }
}

struct Transcendental(f32);

impl Kernel for Transcendental {
    type Output = (f32, f32);
    #[inline(always)]
    fn run<V: Lanes>(self) -> (f32, f32) {
        let x = V::splat(self.0);
        (x.ln().to_array()[0], (-x).exp2().to_array()[0])
    }
}

#[test]
fn ln_and_exp2_keep_their_stated_error() {
    let mut x = 1e-6_f32;
    while x < 1e6 {
        let (ln, _) = dispatch(Transcendental(x));
        let want = (x as f64).ln();
        assert!((ln as f64 - want).abs() < 1.5e-7 * want.abs().max(1.0), "ln {x}: {ln}");
        let y = x % 100.0;
        let (_, exp2) = dispatch(Transcendental(y));
        let want = (-y as f64).exp2();
        assert!((exp2 as f64 / want - 1.0).abs() < 4e-7, "exp2 -{y}: {exp2}");
        x *= 1.0137;
    }
}
