//! Lanes in one AVX register.

// SAFETY of every block below: values of this type exist only inside `dispatch`, which has checked
// that the processor has AVX2, FMA and F16C; loads and stores go through whole arrays.
use super::lanes::{LANES, Lanes, SQRT_HALF_BITS};
use std::arch::x86_64::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

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
        // Twelve bits, doubled by one Newton step.
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
