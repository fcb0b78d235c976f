//! Eight `f32` at a time: the vector type of the texel kernels, and the choice of instruction set.
//!
//! A kernel is written once, generic over [`Lanes`], and [`dispatch`]ed to AVX2 with fused
//! multiply-add and half floats on x86-64 processors that have them, to simd128 in WebAssembly
//! builds with it, and otherwise to plain arrays, which compilers turn into SSE2 or NEON. Sixteen
//! lanes spilled registers and were several times slower.
//!
//! This module contains `unsafe`: AVX2 intrinsics and the call into code compiled for AVX2, both
//! sound because [`Avx2`] is reachable only through [`dispatch`] after its check; and loads and
//! stores of whole arrays.
#![allow(unsafe_code)]

#[cfg(target_arch = "x86_64")]
mod avx2;
mod lanes;
#[cfg(any(test, not(all(target_arch = "wasm32", target_feature = "simd128"))))]
mod portable;
#[cfg(test)]
mod tests;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
mod wasm;

pub(crate) use lanes::{LANES, Lanes};

#[cfg(target_arch = "x86_64")]
use avx2::Avx2;
#[cfg(any(test, not(all(target_arch = "wasm32", target_feature = "simd128"))))]
use portable::Portable;

/// Work written once for every instruction set. `run` and everything it calls must be
/// `#[inline(always)]`, or it is not compiled for the chosen set.
pub(crate) trait Kernel {
    /// Result of the kernel.
    type Output;
    /// Runs with the vector type of the instruction set.
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
    #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
    return kernel.run::<wasm::Simd128>();
    #[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
    kernel.run::<Portable>()
}
