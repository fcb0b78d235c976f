//! The vector type of the texel kernels.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

pub(crate) const LANES: usize = 8;

/// Eight `f32`. Every operation works lane by lane.
pub(crate) trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
    /// The same value in every lane.
    fn splat(x: f32) -> Self;
    fn from_array(a: [f32; LANES]) -> Self;
    /// From the bits of half floats.
    fn from_halves(a: [u16; LANES]) -> Self;
    /// Number whose binary digits are the lowest bits of three numbers, the lowest digit first.
    fn from_lowest(a: [[u16; LANES]; 3]) -> Self;
    fn to_array(self) -> [f32; LANES];
    /// `self * b + c`, fused where that is fast.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// The larger value; `other` if `self` is NaN.
    fn max(self, other: Self) -> Self;
    /// The smaller value; `other` if `self` is NaN.
    fn min(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// `yes` where `self > other`, else `no` (also for NaN).
    fn if_greater(self, other: Self, yes: Self, no: Self) -> Self;
    /// Splits a positive normal number into exponent and mantissa in [sqrt(1/2), sqrt(2)).
    fn split_exponent(self) -> (Self, Self);
    /// `self * 2^n` for integers `n` with a normal result.
    fn scale_by_power_of_two(self, n: Self) -> Self;

    /// `1 / x` to half a unit in the last place.
    #[inline(always)]
    fn reciprocal(self) -> Self {
        Self::splat(1.0) / self
    }

    /// `1 / sqrt(x)` of a positive normal number with a relative error below 3e-7.
    #[inline(always)]
    fn reciprocal_sqrt(self) -> Self {
        self.sqrt().reciprocal()
    }

    /// Limits the value to `low..=high`.
    #[inline(always)]
    fn clamp(self, low: f32, high: f32) -> Self {
        self.max(Self::splat(low)).min(Self::splat(high))
    }

    /// Natural log of a positive normal number, with an absolute error below 1.5e-7 of `max(1, |ln
    /// x|)` (polynomial of degree 9 of the Cephes library).
    #[inline(always)]
    fn ln(self) -> Self {
        let (exponent, mantissa) = self.split_exponent();
        let m = mantissa - Self::splat(1.0);
        let mut p = Self::splat(7.037_683_6e-2);
        for c in [
            -1.151_461e-1,
            1.167_699_9e-1,
            -1.242_014_1e-1,
            1.424_932_3e-1,
            -1.666_805_8e-1,
            2.000_071_5e-1,
            -2.499_999_4e-1,
            3.333_333e-1,
        ] {
            p = p.mul_add(m, Self::splat(c));
        }
        let m2 = m * m;
        let fraction = (p * m).mul_add(m2, m2 * Self::splat(-0.5)) + m;
        exponent.mul_add(Self::splat(std::f32::consts::LN_2), fraction)
    }

    /// `2^x` for |x| < 126 with a relative error below 4e-7 (Taylor series of degree 6 on ±1/2).
    #[inline(always)]
    fn exp2(self) -> Self {
        // Adding 1.5 * 2^23 rounds to the nearest integer.
        let magic = Self::splat(12_582_912.0);
        let whole = (self + magic) - magic;
        let f = self - whole;
        let mut p = Self::splat(1.540_353e-4);
        for c in [1.333_355_8e-3, 9.618_129e-3, 5.550_411e-2, 2.402_265e-1, 6.931_472e-1, 1.0] {
            p = p.mul_add(f, Self::splat(c));
        }
        p.scale_by_power_of_two(whole)
    }

    /// The first eight values of `x`, padded with `fill`.
    #[inline(always)]
    fn load(x: &[f32], fill: f32) -> Self {
        match x.first_chunk() {
            Some(full) => Self::from_array(*full),
            None => Self::from_array(padded(x, fill)),
        }
    }

    /// The first eight half floats of `x` (none infinite), padded with zeros.
    #[inline(always)]
    fn load_halves(x: &[u16]) -> Self {
        match x.first_chunk() {
            Some(full) => Self::from_halves(*full),
            None => Self::from_halves(padded(x, 0)),
        }
    }

    /// [`Lanes::from_lowest`] of the first eight numbers, padded with seven.
    #[inline(always)]
    fn load_lowest(x: [&[u16]; 3]) -> Self {
        Self::from_lowest(x.map(|x| match x.first_chunk() {
            Some(full) => *full,
            None => padded(x, 1),
        }))
    }

    /// Writes as many of the first lanes as fit.
    #[inline(always)]
    fn store(self, x: &mut [f32]) {
        let a = self.to_array();
        match x.first_chunk_mut() {
            Some(full) => *full = a,
            None => {
                let count = x.len();
                x.copy_from_slice(&a[..count]);
            }
        }
    }

    /// Sum of the lanes in double precision.
    #[inline(always)]
    fn sum(self) -> f64 {
        let mut total = 0.0;
        for x in self.to_array() {
            total += x as f64;
        }
        total
    }

    /// 0, 1, ... 7.
    #[inline(always)]
    fn iota() -> Self {
        Self::from_array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    }
}

#[cold]
#[inline(never)]
fn padded<T: Copy>(x: &[T], fill: T) -> [T; LANES] {
    let mut a = [fill; LANES];
    a[..x.len()].copy_from_slice(x);
    a
}

/// Bits of `sqrt(1/2)`.
pub(super) const SQRT_HALF_BITS: i32 = 0x3f35_04f3;
