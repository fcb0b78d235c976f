//! Lanes in two vectors of WebAssembly's simd128. Builds with `relaxed-simd` have fused multiply-add where the
//! processor has it; browsers refuse them where they do not know it.

// Functions with target features do not implement `Fn`, so intrinsics need closures.
#![allow(clippy::redundant_closure)]

use std::arch::wasm32::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

use super::lanes::{LANES, Lanes, SQRT_HALF_BITS};

/// Lanes in two vectors, the lower ones first.
#[derive(Clone, Copy)]
pub(super) struct Simd128(v128, v128);

impl Simd128 {
    #[inline(always)]
    fn map(self, f: impl Fn(v128) -> v128) -> Self {
        Self(f(self.0), f(self.1))
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(v128, v128) -> v128) -> Self {
        Self(f(self.0, other.0), f(self.1, other.1))
    }

    /// Converts eight 16-bit integers.
    #[inline(always)]
    fn widened(a: v128) -> Self {
        Self(u32x4_extend_low_u16x8(a), u32x4_extend_high_u16x8(a))
    }
}

/// Loads eight 16-bit integers.
#[inline(always)]
fn load_u16(a: [u16; LANES]) -> v128 {
    // SAFETY: the array has the size of a vector; loads need no alignment.
    unsafe { v128_load(a.as_ptr().cast()) }
}

impl Lanes for Simd128 {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(f32x4_splat(x), f32x4_splat(x))
    }
    #[inline(always)]
    fn from_array(a: [f32; LANES]) -> Self {
        // SAFETY: the array has the size of two vectors; loads need no alignment.
        unsafe { Self(v128_load(a.as_ptr().cast()), v128_load(a.as_ptr().add(4).cast())) }
    }
    #[inline(always)]
    fn from_halves(a: [u16; LANES]) -> Self {
        // The exponents differ by 112; subnormal numbers are also correct.
        let power = f32x4_splat(f32::from_bits((127 + 112) << 23));
        Self::widened(load_u16(a)).map(|x| {
            let size = f32x4_mul(i32x4_shl(v128_and(x, i32x4_splat(0x7FFF)), 13), power);
            v128_or(size, i32x4_shl(v128_and(x, i32x4_splat(0x8000)), 16))
        })
    }
    #[inline(always)]
    fn from_lowest(a: [[u16; LANES]; 3]) -> Self {
        let [a, b, c] = a.map(|a| v128_and(load_u16(a), i16x8_splat(1)));
        let all = v128_or(a, v128_or(i16x8_shl(b, 1), i16x8_shl(c, 2)));
        Self::widened(all).map(|x| f32x4_convert_i32x4(x))
    }
    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        let mut a = [0.0_f32; LANES];
        // SAFETY: the array has the size of two vectors; stores need no alignment.
        unsafe {
            v128_store(a.as_mut_ptr().cast(), self.0);
            v128_store(a.as_mut_ptr().add(4).cast(), self.1);
        }
        a
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        #[cfg(target_feature = "relaxed-simd")]
        return Self(f32x4_relaxed_madd(self.0, b.0, c.0), f32x4_relaxed_madd(self.1, b.1, c.1));
        #[cfg(not(target_feature = "relaxed-simd"))]
        return self * b + c;
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // pmax returns its first operand if the comparison fails.
        other.zip(self, |a, b| f32x4_pmax(a, b))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        other.zip(self, |a, b| f32x4_pmin(a, b))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(|x| f32x4_abs(x))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(|x| f32x4_sqrt(x))
    }
    #[inline(always)]
    fn if_greater(self, other: Self, yes: Self, no: Self) -> Self {
        let greater = self.zip(other, |a, b| f32x4_gt(a, b));
        // All bits of a lane are alike: every implementation of the relaxed instruction agrees.
        #[cfg(target_feature = "relaxed-simd")]
        use i32x4_relaxed_laneselect as select;
        #[cfg(not(target_feature = "relaxed-simd"))]
        use v128_bitselect as select;
        Self(select(yes.0, no.0, greater.0), select(yes.1, no.1, greater.1))
    }
    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let exponent = self.map(|x| i32x4_shr(i32x4_sub(x, i32x4_splat(SQRT_HALF_BITS)), 23));
        let mantissa = self.zip(exponent, |x, e| i32x4_sub(x, i32x4_shl(e, 23)));
        (exponent.map(|e| f32x4_convert_i32x4(e)), mantissa)
    }
    #[inline(always)]
    fn scale_by_power_of_two(self, n: Self) -> Self {
        // The last bits of the sum with 1.5 * 2^23 are the integer; the shift drops the others.
        let power = n.map(|n| {
            let whole = f32x4_add(n, f32x4_splat(12_582_912.0));
            i32x4_shl(i32x4_add(whole, i32x4_splat(127)), 23)
        });
        self * power
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for Simd128 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| $intrinsic(a, b))
            }
        }
    };
}
operator!(Add, add, f32x4_add);
operator!(Sub, sub, f32x4_sub);
operator!(Mul, mul, f32x4_mul);
operator!(Div, div, f32x4_div);

impl Neg for Simd128 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|x| f32x4_neg(x))
    }
}

impl AddAssign for Simd128 {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
