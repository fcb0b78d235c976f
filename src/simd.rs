//! Eight `f32` at a time: the vector type of the texel kernels, and the choice of instruction set.
//!
//! A kernel is written once, generic over [`Lanes`], and [`dispatch`]ed: on x86-64 to AVX2 with
//! fused multiply-add and half floats where the processor has them, else to plain arrays, which compilers turn
//! into SSE2 or NEON. Sixteen lanes spilled registers and were several times slower.
//!
//! This is the one module with `unsafe`: AVX2 intrinsics and the call that enters code compiled
//! for AVX2, both sound because [`Avx2`] is reachable through [`dispatch`] only, after the check.
#![allow(unsafe_code)]

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Number of lanes.
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
    /// From an array.
    fn from_array(a: [f32; LANES]) -> Self;
    /// From the bits of half floats.
    fn from_halves(a: [u16; LANES]) -> Self;
    /// The number of which three others' lowest bits are the digits, the first the lowest.
    fn from_lowest(a: [[u16; LANES]; 3]) -> Self;
    /// To an array.
    fn to_array(self) -> [f32; LANES];
    /// `self * b + c`, with one rounding where that is as fast as two.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// The larger value; `other` where `self` is not a number.
    fn max(self, other: Self) -> Self;
    /// The smaller value; `other` where `self` is not a number.
    fn min(self, other: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// `yes` where `self > other`, else `no` (also where one is not a number).
    fn if_greater(self, other: Self, yes: Self, no: Self) -> Self;
    /// Splits a positive normal number into exponent and mantissa in [sqrt(1/2), sqrt(2)).
    fn split_exponent(self) -> (Self, Self);
    /// `self * 2^n` for whole numbers `n` such that the result is normal.
    fn scale_by_power_of_two(self, n: Self) -> Self;

    /// `1 / x`, to half a unit in the last place.
    #[inline(always)]
    fn reciprocal(self) -> Self {
        Self::splat(1.0) / self
    }

    /// `1 / sqrt(x)` of a positive normal number, relative error below 3e-7.
    #[inline(always)]
    fn reciprocal_sqrt(self) -> Self {
        self.sqrt().reciprocal()
    }

    /// Value limited to `low..=high`.
    #[inline(always)]
    fn clamp(self, low: f32, high: f32) -> Self {
        self.max(Self::splat(low)).min(Self::splat(high))
    }

    /// Natural logarithm of a positive normal number; absolute error below 1.5e-7 of
    /// `max(1, |ln x|)` (polynomial of degree 9 of the Cephes library).
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

    /// `2^x` for |x| < 126, relative error below 4e-7 (Taylor series of degree 6 on ±1/2).
    #[inline(always)]
    fn exp2(self) -> Self {
        // Adding 1.5 * 2^23 leaves no bits for the fraction: rounds to the nearest whole number.
        let magic = Self::splat(12_582_912.0);
        let whole = (self + magic) - magic;
        let f = self - whole;
        let mut p = Self::splat(1.540_353e-4);
        for c in [1.333_355_8e-3, 9.618_129e-3, 5.550_411e-2, 2.402_265e-1, 6.931_472e-1, 1.0] {
            p = p.mul_add(f, Self::splat(c));
        }
        p.scale_by_power_of_two(whole)
    }

    /// The first eight values of `x`; where there are fewer, `fill` follows.
    #[inline(always)]
    fn load(x: &[f32], fill: f32) -> Self {
        match x.first_chunk() {
            Some(full) => Self::from_array(*full),
            None => Self::from_array(padded(x, fill)),
        }
    }

    /// The first eight half floats of `x`, none of them infinite; where there are fewer, zeros
    /// follow.
    #[inline(always)]
    fn load_halves(x: &[u16]) -> Self {
        match x.first_chunk() {
            Some(full) => Self::from_halves(*full),
            None => Self::from_halves(padded(x, 0)),
        }
    }

    /// [`Lanes::from_lowest`] of the first eight numbers; where there are fewer, seven follows.
    #[inline(always)]
    fn load_lowest(x: [&[u16]; 3]) -> Self {
        Self::from_lowest(x.map(|x| match x.first_chunk() {
            Some(full) => *full,
            None => padded(x, 1),
        }))
    }

    /// Writes the first lanes, as many as fit.
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

/// Work written once for every instruction set. `run` and all it calls must be
/// `#[inline(always)]`, else it is not compiled for the chosen set.
pub(crate) trait Kernel {
    /// What comes out.
    type Output;
    /// Does the work with the vector type of the instruction set.
    fn run<V: Lanes>(self) -> Self::Output;
}

/// Runs a kernel with the best instruction set of this processor.
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("f16c")
    {
        #[target_feature(enable = "avx2,fma,f16c")]
        fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
            kernel.run::<Avx2>()
        }
        // SAFETY: the processor has these features.
        return unsafe { with_avx2(kernel) };
    }
    kernel.run::<Portable>()
}

/// Lanes as an array. Fused multiply-add on AArch64 only, where every processor has it: elsewhere
/// it would be a library call.
#[derive(Clone, Copy)]
#[repr(align(32))]
pub(crate) struct Portable([f32; LANES]);

/// One expression of `i` for every lane. Loops, not closures: those may stay calls.
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
        // The exponents differ by 112; subnormal numbers come out right as well.
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
                // Eight bits, doubled by each step of Newton's method.
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

/// Bits of `sqrt(1/2)`.
const SQRT_HALF_BITS: i32 = 0x3f35_04f3;

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

#[cfg(target_arch = "x86_64")]
use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    // SAFETY of every block below: values of this type exist only inside `dispatch`, which has
    // checked that the processor has AVX2, FMA and F16C; loads and stores go through whole arrays.
    use super::*;
    use std::arch::x86_64::*;

    /// Lanes in one AVX register.
    #[derive(Clone, Copy)]
    pub(super) struct Avx2(__m256);

    impl Lanes for Avx2 {
        #[inline(always)]
        fn splat(x: f32) -> Self {
            Self(unsafe { _mm256_set1_ps(x) })
        }
        #[inline(always)]
        fn from_array(a: [f32; LANES]) -> Self {
            Self(unsafe { _mm256_loadu_ps(a.as_ptr()) })
        }
        #[inline(always)]
        fn from_halves(a: [u16; LANES]) -> Self {
            Self(unsafe { _mm256_cvtph_ps(_mm_loadu_si128(a.as_ptr().cast())) })
        }
        #[inline(always)]
        fn from_lowest(a: [[u16; LANES]; 3]) -> Self {
            Self(unsafe {
                let [a, b, c] =
                    a.map(|a| _mm_and_si128(_mm_loadu_si128(a.as_ptr().cast()), _mm_set1_epi16(1)));
                let all = _mm_or_si128(a, _mm_or_si128(_mm_slli_epi16(b, 1), _mm_slli_epi16(c, 2)));
                _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(all))
            })
        }
        #[inline(always)]
        fn reciprocal_sqrt(self) -> Self {
            // Twelve bits, doubled by a step of Newton's method.
            Self(unsafe {
                let y = _mm256_rsqrt_ps(self.0);
                let half = _mm256_mul_ps(self.0, _mm256_set1_ps(0.5));
                let error = _mm256_fnmadd_ps(half, _mm256_mul_ps(y, y), _mm256_set1_ps(0.5));
                _mm256_fmadd_ps(y, error, y)
            })
        }
        #[inline(always)]
        fn to_array(self) -> [f32; LANES] {
            let mut a = [0.0; LANES];
            unsafe { _mm256_storeu_ps(a.as_mut_ptr(), self.0) };
            a
        }
        #[inline(always)]
        fn mul_add(self, b: Self, c: Self) -> Self {
            Self(unsafe { _mm256_fmadd_ps(self.0, b.0, c.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(unsafe { _mm256_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn abs(self) -> Self {
            Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn if_greater(self, other: Self, yes: Self, no: Self) -> Self {
            Self(unsafe {
                let greater = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, other.0);
                _mm256_blendv_ps(no.0, yes.0, greater)
            })
        }
        #[inline(always)]
        fn split_exponent(self) -> (Self, Self) {
            unsafe {
                let bits = _mm256_castps_si256(self.0);
                let shifted = _mm256_sub_epi32(bits, _mm256_set1_epi32(SQRT_HALF_BITS));
                let exponent = _mm256_srai_epi32::<23>(shifted);
                let mantissa = _mm256_sub_epi32(bits, _mm256_slli_epi32::<23>(exponent));
                (Self(_mm256_cvtepi32_ps(exponent)), Self(_mm256_castsi256_ps(mantissa)))
            }
        }
        #[inline(always)]
        fn scale_by_power_of_two(self, n: Self) -> Self {
            let power = unsafe {
                let biased = _mm256_add_epi32(_mm256_cvtps_epi32(n.0), _mm256_set1_epi32(127));
                _mm256_castsi256_ps(_mm256_slli_epi32::<23>(biased))
            };
            self * Self(power)
        }
    }

    macro_rules! operator {
        ($trait:ident, $method:ident, $intrinsic:ident) => {
            impl $trait for Avx2 {
                type Output = Self;
                #[inline(always)]
                fn $method(self, other: Self) -> Self {
                    Self(unsafe { $intrinsic(self.0, other.0) })
                }
            }
        };
    }
    operator!(Add, add, _mm256_add_ps);
    operator!(Sub, sub, _mm256_sub_ps);
    operator!(Mul, mul, _mm256_mul_ps);
    operator!(Div, div, _mm256_div_ps);

    impl Neg for Avx2 {
        type Output = Self;
        #[inline(always)]
        fn neg(self) -> Self {
            Self(unsafe { _mm256_xor_ps(_mm256_set1_ps(-0.0), self.0) })
        }
    }

    impl AddAssign for Avx2 {
        #[inline(always)]
        fn add_assign(&mut self, other: Self) {
            *self = *self + other;
        }
    }
}

#[cfg(test)]
mod tests {
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

    /// Both back ends against `f64`: 4e-7 and 3e-7 are the stated errors of `exp2` and of one over
    /// a root, the rest is rounding (2e-7 leaves three units in the last place).
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
                    // Cancellation: the products above round at the size of their terms.
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
        // every 83rd number from 1 to 4, and other magnitudes of them
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
}
