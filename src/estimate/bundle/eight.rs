//! Values of eight texels.

use crate::simd::{LANES, Lanes};
use crate::svbrdf::CHANNELS;

/// A value of eight texels, and their nine coordinates.
pub(super) type Eight = [f32; LANES];
pub(super) type Column = [Eight; CHANNELS];

/// Values of at most eight texels, side by side; 0 for texels that are not there.
pub(super) fn in_eights<const N: usize>(texels: impl Iterator<Item = [f64; N]>) -> [Eight; N] {
    let mut eights = [[0.0; LANES]; N];
    for (lane, values) in texels.enumerate() {
        eights.iter_mut().zip(values).for_each(|(eight, value)| eight[lane] = value as f32);
    }
    eights
}

// Loops, because closures may stay calls without the kernel's target features.
#[inline(always)]
pub(super) fn loaded<V: Lanes, const N: usize>(from: &[Eight; N]) -> [V; N] {
    let mut to = [V::splat(0.0); N];
    for (to, from) in to.iter_mut().zip(from) {
        *to = V::from_array(*from);
    }
    to
}

#[inline(always)]
pub(super) fn stored<V: Lanes, const N: usize>(from: &[V; N]) -> [Eight; N] {
    let mut to = [[0.0; LANES]; N];
    for (to, from) in to.iter_mut().zip(from) {
        *to = from.to_array();
    }
    to
}
