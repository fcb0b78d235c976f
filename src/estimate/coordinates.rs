//! Coordinates of a texel: slopes, *square roots* of albedos, and roughness. A sigma of a root means about
//! the same for dark and bright materials.

use crate::Svbrdf;
use crate::simd::Lanes;
use crate::svbrdf::{CHANNELS, MAX_SLOPE, MIN_ROUGHNESS, channel};

/// Coordinates of a texel in double precision.
pub(crate) type Coordinates = [f64; CHANNELS];

/// Least square root of an albedo: at zero its derivative vanishes. The albedo is far below
/// [`EPSILON`](crate::loss::EPSILON); slopes and gloss would compensate a larger one.
pub(crate) const MIN_ROOT: f32 = 0.001;

/// Whether a parameter's coordinate is its square root.
pub(crate) fn is_albedo(c: usize) -> bool {
    (channel::DIFFUSE..channel::ROUGHNESS).contains(&c)
}

/// Coordinate of a natural parameter.
pub(crate) fn to_coordinate(c: usize, value: f32) -> f32 {
    if is_albedo(c) { value.max(0.0).sqrt() } else { value }
}

/// Natural parameter of a coordinate.
pub(crate) fn from_coordinate(c: usize, value: f32) -> f32 {
    if is_albedo(c) { value.max(0.0).powi(2) } else { value }
}

/// Range of a coordinate.
#[inline(always)]
pub(crate) fn limits(c: usize) -> (f32, f32) {
    match c {
        channel::SLOPE_X | channel::SLOPE_Y => (-MAX_SLOPE, MAX_SLOPE),
        channel::ROUGHNESS => (MIN_ROUGHNESS, 1.0),
        _ => (MIN_ROOT, 1.0),
    }
}

/// The same in double precision.
pub(crate) fn range(c: usize) -> (f64, f64) {
    let (low, high) = limits(c);
    (f64::from(low), f64::from(high))
}

/// Coordinates of eight texels.
#[inline(always)]
pub(crate) fn to_coordinates<V: Lanes>(natural: [V; CHANNELS]) -> [V; CHANNELS] {
    let mut out = natural;
    for c in channel::DIFFUSE..channel::ROUGHNESS {
        out[c] = natural[c].max(V::splat(MIN_ROOT * MIN_ROOT)).sqrt();
    }
    out
}

/// Natural parameters of eight texels.
#[inline(always)]
pub(crate) fn from_coordinates<V: Lanes>(x: &[V; CHANNELS]) -> [V; CHANNELS] {
    let mut out = *x;
    for c in channel::DIFFUSE..channel::ROUGHNESS {
        out[c] = x[c] * x[c];
    }
    out
}

/// Nine planes of coordinates.
pub fn coordinates(maps: &Svbrdf) -> Vec<f32> {
    let n = maps.texels();
    maps.planes().iter().enumerate().map(|(i, &v)| to_coordinate(i / n, v)).collect()
}

/// Natural parameters of coordinates.
pub(crate) fn natural(x: &Coordinates) -> [f64; CHANNELS] {
    std::array::from_fn(|c| if is_albedo(c) { x[c] * x[c] } else { x[c] })
}

/// Derivative of a natural parameter by its coordinate.
pub(crate) fn by_coordinate(x: &Coordinates, c: usize) -> f64 {
    if is_albedo(c) { 2.0 * x[c] } else { 1.0 }
}

/// A coordinate within its range.
pub(crate) fn clamped(c: usize, x: f64) -> f64 {
    let (low, high) = range(c);
    x.clamp(low, high)
}
