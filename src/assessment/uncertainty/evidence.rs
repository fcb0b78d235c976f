//! Evidence on the errors of maps, and their calibrated standard deviations.

use std::ops::Range;

use super::calibration::{CALIBRATION, TERMS};
use crate::estimate::coordinates::is_albedo;
use crate::estimate::{EstimatedLobes, Estimation, Noise, Spread, spread};
use crate::parallel;
use crate::render;
use crate::svbrdf::{CHANNELS, channel, lobe};
use crate::uncertainty::Uncertainty;
use crate::{Error, Result, Svbrdf};

/// Coordinates of each map.
const MAPS: [Range<usize>; 4] = [
    channel::SLOPE_X..channel::DIFFUSE,
    channel::DIFFUSE..channel::SPECULAR,
    channel::SPECULAR..channel::ROUGHNESS,
    channel::ROUGHNESS..CHANNELS,
];

/// Radius of the window that averages a change, texels.
const RADIUS: usize = 2;
/// Lower bounds before a logarithm.
const MIN_DEVIATION: f32 = 1e-5;
const MIN_RESIDUAL: f32 = 1e-3;
const MIN_VALUE: f32 = 1e-3;
const MIN_ROUGHNESS: f32 = 0.02;
const MIN_CHANGE: f32 = 1e-4;
/// Least deviation, and the largest of each map.
const LEAST: f32 = 1e-4;
const MOST: [f32; 4] = [1.0, 0.5, 0.5, 0.5];

/// Evidence on the errors of an estimate's maps: terms of the calibrated standard deviations.
///
/// The terms of a map at a texel:
///
/// | | term |
/// |---|---|
/// | 0 | 1 |
/// | 1 | logarithm of the posterior's deviation, with noise from the residuals or, after the joint solve, with the error of its model |
/// | 2 | 1 for one photograph, otherwise 0 |
/// | 3 | logarithm of the number of photographs N |
/// | 4 | logarithm of the texel's mean residual, times 1 - 1/N, because one photograph is always explained |
/// | 5 | the same for the sample's mean residual |
/// | 6 | logarithm of the texel's value: tilt, albedo, roughness |
/// | 7 | logarithm of the sample's specular albedo |
/// | 8 | logarithm of the sample's roughness |
/// | 9 | logarithm of the map's own variation over the sample |
/// | 10 | logarithm of the map's difference from that of the latent code, round the texel |
/// | 11 | logarithm of N/2 with the joint solve, otherwise 0 |
/// | 12 | logarithm of the expected noise, in units of that of exact photographs |
pub struct Evidence {
    maps: Svbrdf,
    photographs: usize,
    joint: bool,
    /// Expected noise, in units of that of exact photographs.
    noise: f32,
    /// The planes of each map.
    planes: [Planes; MAPS.len()],
    /// Whether no photograph shows a texel.
    hidden: Vec<bool>,
    /// Mean absolute log residual of each texel, and of the sample.
    residual: Vec<f32>,
    mean_residual: f32,
    specular: f32,
    roughness: f32,
    /// Optional lobes, if any: of all texels or of each direction.
    lobes: Vec<EstimatedLobes>,
}

struct Planes {
    /// Standard deviation of the posterior.
    posterior: Vec<f32>,
    /// Root mean square difference from the latent code's map, round each texel.
    change: Vec<f32>,
    /// Standard deviation over the sample.
    variation: f32,
}

impl Estimation {
    /// Evidence on the errors of the current maps.
    ///
    /// # Errors
    /// Without photographs.
    pub fn evidence(&self) -> Result<Evidence> {
        let maps = self.maps()?;
        let photographs = self.photographs.full();
        if photographs.is_empty() {
            return Err(Error::NoMaps);
        }
        let spread = spread(&maps, &self.options.prior, self.residual_noise(&maps), photographs);
        let mut posteriors = MAPS.map(|range| posterior(&maps, &spread, range));
        let (residual, mean_residual) = residuals(&spread);
        let hidden = spread.weight().iter().map(|weight| *weight <= 0.0).collect();
        // The spread is as large as two sets of maps: frees it before the next ones.
        drop(spread);
        let latent = self.latent_maps();
        let planes = std::array::from_fn(|map| {
            let range = &MAPS[map];
            Planes {
                posterior: std::mem::take(&mut posteriors[map]),
                change: latent.as_ref().map_or_else(
                    || vec![0.0; maps.texels()],
                    |latent| smoothed_root(&squares(&maps, latent, range.clone()), maps.width()),
                ),
                variation: variation(&maps, range.clone()),
            }
        });
        Ok(Evidence {
            photographs: photographs.len(),
            joint: self.is_joint(),
            noise: self.options.noise.expected / self.least_noise.expected,
            planes,
            hidden,
            residual,
            mean_residual,
            specular: root_mean_square(&maps, channel::SPECULAR..channel::ROUGHNESS),
            roughness: root_mean_square(&maps, channel::ROUGHNESS..CHANNELS),
            lobes: self.lobes.clone(),
            maps,
        })
    }

    /// Noise of the residuals: the expected one, or the residuals of maps that explain the photographs worse.
    fn residual_noise(&self, maps: &Svbrdf) -> Noise {
        if self.is_joint() {
            return Noise::of_model(self.options.joint.two_photographs.noise as f32);
        }
        let expected = Noise::expected(&self.options.noise);
        let loss = render::loss(maps, self.photographs.full()) as f32;
        Noise { scale: expected.scale.max(loss), ..expected }
    }
}

impl Evidence {
    /// The maps.
    pub fn maps(&self) -> &Svbrdf {
        &self.maps
    }

    /// The maps, without the evidence.
    pub fn into_maps(self) -> Svbrdf {
        self.maps
    }

    /// The terms of a map (0 normal, 1 diffuse, 2 specular, 3 roughness) at a texel.
    ///
    /// # Panics
    /// When there is no such map or texel.
    pub fn terms(&self, map: usize, texel: usize) -> [f32; TERMS] {
        let planes = &self.planes[map];
        let ln = |value: f32, least: f32| value.max(least).ln();
        let flag = |is: bool| f32::from(u8::from(is));
        let many = 1.0 - 1.0 / self.photographs as f32;
        [
            1.0,
            ln(planes.posterior[texel], MIN_DEVIATION),
            flag(self.photographs == 1),
            (self.photographs as f32).ln(),
            many * ln(self.residual[texel], MIN_RESIDUAL),
            many * ln(self.mean_residual, MIN_RESIDUAL),
            ln(self.value(map, texel), MIN_VALUE),
            ln(self.specular, MIN_VALUE),
            ln(self.roughness, MIN_ROUGHNESS),
            ln(planes.variation, MIN_VALUE),
            ln(planes.change[texel], MIN_CHANGE),
            flag(self.joint) * (0.5 * self.photographs as f32).ln(),
            ln(self.noise, 1.0),
        ]
    }

    /// Tangent of the tilt, mean albedo, or roughness.
    fn value(&self, map: usize, texel: usize) -> f32 {
        let range = MAPS[map].clone();
        let at = |c: usize| self.maps.plane(c)[texel];
        match map {
            0 => range.map(|c| at(c).powi(2)).sum::<f32>().sqrt(),
            _ => range.clone().map(at).sum::<f32>() / range.len() as f32,
        }
    }

    /// The calibrated standard deviations.
    ///
    /// # Errors
    /// Never, unless the calibration is not finite.
    pub fn uncertainty(&self) -> Result<Uncertainty> {
        let texels = self.maps.texels();
        let planes = CALIBRATION.iter().enumerate().flat_map(|(map, coefficients)| {
            parallel::values(texels, |t| {
                let terms = self.terms(map, t);
                let sum: f32 = terms.iter().zip(coefficients).map(|(t, c)| t * c).sum();
                let sigma = sum.exp();
                // The calibration does not cover unseen texels: the prior's sigma is added.
                let prior = if self.hidden[t] { self.planes[map].posterior[t] } else { 0.0 };
                sigma.hypot(prior).clamp(LEAST, MOST[map])
            })
        });
        let count = if self.lobes.is_empty() { 0 } else { self.maps.lobes().len() / texels };
        let lobes =
            (0..count).flat_map(|i| parallel::values(texels, |t| self.lobe_deviation(i, t)));
        Uncertainty::from_planes(
            self.maps.width(),
            self.maps.height(),
            planes.chain(lobes).collect(),
        )
    }

    /// The standard deviation of one of a texel's optional lobes. A texel between two directions belongs to one of
    /// them; its share is the probability.
    fn lobe_deviation(&self, i: usize, texel: usize) -> f32 {
        let (Some(a), Some(b)) = (self.lobes.first(), self.lobes.last()) else { return 0.0 };
        let [[of_a, sigma_a], [of_b, sigma_b]] = [a, b];
        let (mut along, mut square) = (0.0, f64::MIN_POSITIVE);
        for c in [lobe::ANISOTROPY_X, lobe::ANISOTROPY_Y] {
            along += (of_b[c] - of_a[c]) * (self.maps.lobes_at(texel)[c] - of_a[c]);
            square += (of_b[c] - of_a[c]).powi(2);
        }
        let share = (along / square).clamp(0.0, 1.0);
        let within = (1.0 - share) * sigma_a[i].powi(2) + share * sigma_b[i].powi(2);
        let between = share * (1.0 - share) * (of_b[i] - of_a[i]).powi(2);
        (within + between).sqrt() as f32
    }
}

/// Mean residual of each texel, and of all. Unseen texels get the mean of all.
fn residuals(spread: &Spread) -> (Vec<f32>, f32) {
    let pairs = || spread.loss().iter().zip(spread.weight());
    let seen = pairs().filter(|(_, weight)| **weight > 0.0);
    let (sum, count) = seen
        .fold((0.0, 0), |(sum, count), (loss, weight)| (sum + f64::from(loss / weight), count + 1));
    let mean = (sum / f64::from(count.max(1))) as f32;
    let of = |(loss, weight): (&f32, &f32)| if *weight > 0.0 { loss / weight } else { mean };
    (pairs().map(of).collect(), mean)
}

/// Posterior deviation of a map in natural parameters, root mean square of its channels.
fn posterior(maps: &Svbrdf, spread: &Spread, range: Range<usize>) -> Vec<f32> {
    parallel::values(maps.texels(), |t| {
        let variance = |c: usize| {
            let v = spread.variance(c)[t];
            match is_albedo(c) {
                // The variance of the square of a normal variable.
                true => (4.0 * maps.plane(c)[t] + 2.0 * v) * v,
                false => v,
            }
        };
        (range.clone().map(variance).sum::<f32>() / range.len() as f32).sqrt()
    })
}

/// Mean squared difference of a map's channels.
fn squares(maps: &Svbrdf, latent: &Svbrdf, range: Range<usize>) -> Vec<f32> {
    parallel::values(maps.texels(), |t| {
        let square = |c: usize| (maps.plane(c)[t] - latent.plane(c)[t]).powi(2);
        range.clone().map(square).sum::<f32>() / range.len() as f32
    })
}

/// Standard deviation over the sample, root mean square of the channels.
fn variation(maps: &Svbrdf, range: Range<usize>) -> f32 {
    let n = maps.texels() as f64;
    let variance = |c: usize| {
        let mean = maps.plane(c).iter().map(|v| f64::from(*v)).sum::<f64>() / n;
        maps.plane(c).iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n
    };
    let channels = range.len() as f64;
    (range.map(variance).sum::<f64>() / channels).sqrt() as f32
}

/// Root mean square over the sample of the mean of some channels.
fn root_mean_square(maps: &Svbrdf, range: Range<usize>) -> f32 {
    let mean = |t: usize| {
        range.clone().map(|c| f64::from(maps.plane(c)[t])).sum::<f64>() / range.len() as f64
    };
    let n = maps.texels();
    ((0..n).map(|t| mean(t).powi(2)).sum::<f64>() / n as f64).sqrt() as f32
}

/// Root of the mean in the window round each texel.
fn smoothed_root(plane: &[f32], width: usize) -> Vec<f32> {
    let height = plane.len() / width;
    let range = |i: usize, n: usize| i.saturating_sub(RADIUS)..(i + RADIUS + 1).min(n);
    let rows = parallel::values(plane.len(), |t| {
        let (first, columns) = (t - t % width, range(t % width, width));
        let count = columns.len() as f32;
        columns.map(|x| plane[first + x]).sum::<f32>() / count
    });
    parallel::values(plane.len(), |t| {
        let (x, lines) = (t % width, range(t / width, height));
        let count = lines.len() as f32;
        (lines.map(|y| rows[y * width + x]).sum::<f32>() / count).sqrt()
    })
}
