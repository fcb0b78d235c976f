//! Coordinates of a texel and the widths of its prior.
//!
//! Coordinates are slopes, *square roots* of albedos, and roughness, so that a sigma means about
//! the same for dark and bright materials.

use serde::{Deserialize, Serialize};

use crate::simd::Lanes;
use crate::svbrdf::{CHANNELS, MAX_SLOPE, MIN_ROUGHNESS, channel};
use crate::{Error, Result, Svbrdf};

/// How far the truth is expected to be off the prior's mean, per coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// Standard deviations in the order of [`channel`]: slopes, square roots of albedos, roughness.
    /// Positive.
    pub sigma: [f32; CHANNELS],
}

impl Default for Prior {
    /// Errors of a fair estimate from a few photographs.
    fn default() -> Self {
        Self { sigma: [0.1, 0.1, 0.08, 0.08, 0.08, 0.1, 0.1, 0.1, 0.12] }
    }
}

impl Prior {
    /// The errors of estimates of known materials: root mean squares, at least 0.001, pooled over
    /// the three colours.
    ///
    /// # Errors
    /// When sizes differ or there is no pair.
    pub fn from_estimates<'a>(
        pairs: impl IntoIterator<Item = (&'a Svbrdf, &'a Svbrdf)>,
    ) -> Result<Self> {
        let (mut sums, mut count) = ([0.0_f64; CHANNELS], 0);
        for (estimate, truth) in pairs {
            same_size("truth", estimate, truth)?;
            count += estimate.texels();
            for (c, sum) in sums.iter_mut().enumerate() {
                for (&a, &b) in estimate.plane(c).iter().zip(truth.plane(c)) {
                    *sum += (to_coordinate(c, a) - to_coordinate(c, b)).powi(2) as f64;
                }
            }
        }
        if count == 0 {
            return Err(Error::argument("pairs", "none given, at least one expected"));
        }
        let rms = |channels: std::ops::Range<usize>| {
            let (length, sum) = (channels.len(), sums[channels].iter().sum::<f64>());
            ((sum / (length * count) as f64).sqrt() as f32).max(1e-3)
        };
        let slope = rms(0..2);
        let (diffuse, specular) = (rms(2..5), rms(5..8));
        let mut sigma = [slope; CHANNELS];
        sigma[2..5].fill(diffuse);
        sigma[5..8].fill(specular);
        sigma[channel::ROUGHNESS] = rms(8..9);
        Ok(Self { sigma })
    }

    /// 1 / sigma².
    pub(super) fn precision(&self) -> [f32; CHANNELS] {
        self.sigma.map(|s| (s * s).recip())
    }

    pub(super) fn check(&self) -> Result<()> {
        if self.sigma.iter().all(|s| s.is_finite() && *s > 0.0) {
            return Ok(());
        }
        Err(Error::argument("prior.sigma", "nine positive numbers are expected"))
    }
}

/// Variance of a prior that makes deviations round its mean most probable: their sum of squares by
/// the number of parameters that photographs determine (MacKay, *Bayesian interpolation*, 1992).
/// `None` where they determine nothing.
pub(super) fn probable_variance(squares: f64, determined: f64) -> Option<f64> {
    (determined > 0.0).then(|| squares / determined)
}

/// An error where maps have not one size.
pub(super) fn same_size(argument: &'static str, a: &Svbrdf, b: &Svbrdf) -> Result<()> {
    if (a.width(), a.height()) == (b.width(), b.height()) {
        return Ok(());
    }
    let message =
        format!("{}x{} texels, expected {}x{}", b.width(), b.height(), a.width(), a.height());
    Err(Error::argument(argument, message))
}

/// Coordinates of a texel in double precision: slopes, square roots of albedos, roughness.
pub(super) type Coordinates = [f64; CHANNELS];

/// Least square root of an albedo: at zero its derivative would vanish for good. As an albedo it is
/// far below what [`EPSILON`](crate::loss::EPSILON) hides; more of it slopes and gloss would explain
/// away.
pub(super) const MIN_ROOT: f32 = 0.001;

/// Whether a parameter's coordinate is its square root.
pub(super) fn is_albedo(c: usize) -> bool {
    (channel::DIFFUSE..channel::ROUGHNESS).contains(&c)
}

/// Coordinate of a natural parameter.
pub(super) fn to_coordinate(c: usize, value: f32) -> f32 {
    if is_albedo(c) { value.max(0.0).sqrt() } else { value }
}

/// Natural parameter of a coordinate.
pub(super) fn from_coordinate(c: usize, value: f32) -> f32 {
    if is_albedo(c) { value.max(0.0).powi(2) } else { value }
}

/// Range of a coordinate.
#[inline(always)]
pub(super) fn limits(c: usize) -> (f32, f32) {
    match c {
        channel::SLOPE_X | channel::SLOPE_Y => (-MAX_SLOPE, MAX_SLOPE),
        channel::ROUGHNESS => (MIN_ROUGHNESS, 1.0),
        _ => (MIN_ROOT, 1.0),
    }
}

/// The same in double precision.
pub(super) fn range(c: usize) -> (f64, f64) {
    let (low, high) = limits(c);
    (f64::from(low), f64::from(high))
}

/// Coordinates of eight texels.
#[inline(always)]
pub(super) fn to_coordinates<V: Lanes>(natural: [V; CHANNELS]) -> [V; CHANNELS] {
    let mut out = natural;
    for c in channel::DIFFUSE..channel::ROUGHNESS {
        out[c] = natural[c].max(V::splat(MIN_ROOT * MIN_ROOT)).sqrt();
    }
    out
}

/// Natural parameters of eight texels.
#[inline(always)]
pub(super) fn from_coordinates<V: Lanes>(x: &[V; CHANNELS]) -> [V; CHANNELS] {
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
