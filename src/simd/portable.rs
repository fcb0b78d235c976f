//! Lanes as plain arrays, compiled to SSE2 or NEON.

use super::lanes::{LANES, Lanes, SQRT_HALF_BITS};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Lanes as an array. Fused multiply-add is used only on AArch64, where every processor has it;
/// elsewhere it could be a library call.
#[derive(Clone, Copy)]
#[repr(align(32))]
pub(crate) struct Portable([f32; LANES]);

/// One expression of `i` for every lane. A loop, because closures may remain calls.
macro_rules! lane_by_lane {
    ($i:ident => $value:expr) => {{
        let mut out = [Default::default(); LANES];
        for $i in 0..LANES {
            out[$i] = $value;
        }
        out
    }};
}

impl Lanes for Portable {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn from_array(a: [f32; LANES]) -> Self {
        Self(a)
    }
    #[inline(always)]
    fn from_halves(a: [u16; LANES]) -> Self {
        // The exponents differ by 112; subnormal numbers are also correct.
        let power = f32::from_bits((127 + 112) << 23);
        Self(lane_by_lane!(i => {
            let size = f32::from_bits(u32::from(a[i] & 0x7FFF) << 13) * power;
            f32::from_bits(size.to_bits() | (u32::from(a[i] & 0x8000) << 16))
        }))
    }
    #[inline(always)]
    fn from_lowest([a, b, c]: [[u16; LANES]; 3]) -> Self {
        Self(lane_by_lane!(i => f32::from(a[i] & 1 | (b[i] & 1) << 1 | (c[i] & 1) << 2)))
    }
    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        self.0
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        if cfg!(target_arch = "aarch64") {
            Self(lane_by_lane!(i => self.0[i].mul_add(b.0[i], c.0[i])))
        } else {
            self * b + c
        }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(lane_by_lane!(i => if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] }))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(lane_by_lane!(i => if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] }))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(lane_by_lane!(i => self.0[i].abs()))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(lane_by_lane!(i => self.0[i].sqrt()))
    }
    #[cfg(target_arch = "aarch64")]
    #[inline(always)]
    fn reciprocal_sqrt(self) -> Self {
        use std::arch::aarch64::{vld1q_f32, vmulq_f32, vrsqrteq_f32, vrsqrtsq_f32, vst1q_f32};
        let mut out = [0.0; LANES];
        for (x, out) in self.0.as_chunks::<4>().0.iter().zip(out.as_chunks_mut::<4>().0) {
            // SAFETY: every aarch64 target has NEON; a vector is four numbers.
            unsafe {
                let x = vld1q_f32(x.as_ptr());
                // Eight bits, doubled by each Newton step.
                let mut y = vrsqrteq_f32(x);
                for _ in 0..2 {
                    y = vmulq_f32(y, vrsqrtsq_f32(vmulq_f32(x, y), y));
                }
                vst1q_f32(out.as_mut_ptr(), y);
            }
        }
        Self(out)
    }
    #[inline(always)]
    fn if_greater(self, other: Self, yes: Self, no: Self) -> Self {
        Self(lane_by_lane!(i => if self.0[i] > other.0[i] { yes.0[i] } else { no.0[i] }))
    }
    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let bits: [i32; LANES] = lane_by_lane!(i => self.0[i].to_bits() as i32);
        let exponent: [i32; LANES] = lane_by_lane!(i => bits[i].wrapping_sub(SQRT_HALF_BITS) >> 23);
        let mantissa =
            lane_by_lane!(i => f32::from_bits(bits[i].wrapping_sub(exponent[i] << 23) as u32));
        (Self(lane_by_lane!(i => exponent[i] as f32)), Self(mantissa))
    }
    #[inline(always)]
    fn scale_by_power_of_two(self, n: Self) -> Self {
        self * Self(lane_by_lane!(i => f32::from_bits(((n.0[i] as i32 + 127) << 23) as u32)))
    }
}

macro_rules! portable_operator {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Portable {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(lane_by_lane!(i => self.0[i] $op other.0[i]))
            }
        }
    };
}
portable_operator!(Add, add, +);
portable_operator!(Sub, sub, -);
portable_operator!(Mul, mul, *);
portable_operator!(Div, div, /);

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(lane_by_lane!(i => -self.0[i]))
    }
}

impl AddAssign for Portable {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
