//! What is known of how far maps may be off, before it is calibrated.

use super::widths::{Widths, widths};
use crate::estimate::estimation::Estimation;
use crate::estimate::noise::Noise;
use crate::estimate::prior::is_albedo;
use crate::parallel;
use crate::render;
use crate::svbrdf::{CHANNELS, channel};
use crate::{Error, Result, Svbrdf};
use std::ops::Range;

/// Coordinates of each map: normal, diffuse, specular, roughness.
pub(super) const MAPS: [Range<usize>; 4] = [
    channel::SLOPE_X..channel::DIFFUSE,
    channel::DIFFUSE..channel::SPECULAR,
    channel::SPECULAR..channel::ROUGHNESS,
    channel::ROUGHNESS..CHANNELS,
];

/// Planes of a map: P, D, B0, B, V.
pub const PLANES: usize = 5;
const RADIUS: usize = 2;

/// Evidence on an estimate.
pub struct Evidence {
    pub texels: usize,
    pub width: usize,
    pub planes: Vec<Vec<f32>>,
    pub residual: Vec<f32>,
    /// N, noise, structured, free, loss
    pub scalars: Vec<f32>,
    pub shared: [f32; 4],
    pub maps: Svbrdf,
}

impl Estimation {
    /// Evidence on the maps as they are now.
    pub fn evidence(&self) -> Result<Evidence> {
        let maps = self.maps()?;
        let photographs = self.photographs.full();
        let n = photographs.len();
        if n == 0 {
            return Err(Error::NoMaps);
        }
        let base = self.latent.as_ref().map_or_else(|| maps.clone(), |latent| latent.maps());
        let loss = render::loss(&maps, photographs);
        let weight: f64 = photographs.iter().map(|o| o.total_weight()).sum();
        let noise = match self.structured {
            true => Noise::of_model(self.options.structured.noise as f32),
            false => Noise::found(&self.options.noise, loss, weight / maps.texels() as f64),
        };
        let widths = widths(&maps, photographs, &self.options.prior, noise);
        let mut planes = Vec::new();
        for range in MAPS {
            planes.push(posterior(&maps, &widths, range.clone()));
            planes.push(detail(&maps, range.clone()));
            let b0 = deviation(&maps, &base, range.clone());
            let b = smoothed(&b0, maps.width());
            planes.push(b0.iter().map(|v| v.sqrt()).collect());
            planes.push(b.iter().map(|v| v.sqrt()).collect());
            planes.push(value(&maps, range));
        }
        let pairs = widths.loss().iter().zip(widths.weight());
        let residual = pairs.map(|(l, w)| l / w.max(1e-3)).collect();
        let shared = MAPS.map(|range| {
            let len = range.len() as f32;
            let of = |c: usize| {
                let p = self.options.prior.sigma[c].powi(-2);
                1.0 / (p + 14.0 * widths.information[c] as f32)
            };
            (range.map(of).sum::<f32>() / len).sqrt()
        });
        let flag = |b: bool| f32::from(u8::from(b));
        Ok(Evidence {
            texels: maps.texels(),
            width: maps.width(),
            planes,
            residual,
            scalars: vec![
                n as f32,
                noise.scale,
                flag(self.structured),
                flag(self.task.free_lights),
                loss as f32,
            ],
            shared,
            maps,
        })
    }
}

fn posterior(maps: &Svbrdf, widths: &Widths, range: Range<usize>) -> Vec<f32> {
    parallel::values(maps.texels(), |t| {
        let variance = |c: usize| {
            let v = widths.variance(c)[t];
            match is_albedo(c) {
                true => (4.0 * maps.plane(c)[t] + 2.0 * v) * v,
                false => v,
            }
        };
        (range.clone().map(variance).sum::<f32>() / range.len() as f32).sqrt()
    })
}

fn deviation(maps: &Svbrdf, base: &Svbrdf, range: Range<usize>) -> Vec<f32> {
    parallel::values(maps.texels(), |t| {
        let square = |c: usize| (maps.plane(c)[t] - base.plane(c)[t]).powi(2);
        range.clone().map(square).sum::<f32>() / range.len() as f32
    })
}

fn value(maps: &Svbrdf, range: Range<usize>) -> Vec<f32> {
    parallel::values(maps.texels(), |t| {
        let of = |c: usize| maps.plane(c)[t];
        match range.start {
            channel::SLOPE_X => range.clone().map(|c| of(c).powi(2)).sum::<f32>().sqrt(),
            _ => range.clone().map(of).sum::<f32>() / range.len() as f32,
        }
    })
}

fn detail(maps: &Svbrdf, range: Range<usize>) -> Vec<f32> {
    let mut sum = vec![0.0; maps.texels()];
    for c in range.clone() {
        let plane = maps.plane(c);
        let mean = smoothed(plane, maps.width());
        let squares: Vec<f32> = plane.iter().map(|v| v * v).collect();
        let squares = smoothed(&squares, maps.width());
        for ((s, q), m) in sum.iter_mut().zip(squares).zip(mean) {
            *s += (q - m * m).max(0.0) / range.len() as f32;
        }
    }
    sum.iter().map(|v| v.sqrt()).collect()
}

/// Means over squares round each texel, cut off at the borders.
fn smoothed(plane: &[f32], width: usize) -> Vec<f32> {
    let height = plane.len() / width;
    let mean = |i: usize, n: usize, at: &dyn Fn(usize) -> f32| {
        let range = i.saturating_sub(RADIUS)..(i + RADIUS + 1).min(n);
        let len = range.len() as f32;
        range.map(at).sum::<f32>() / len
    };
    let rows = parallel::values(plane.len(), |t| {
        let (x, first) = (t % width, t - t % width);
        mean(x, width, &|k| plane[first + k])
    });
    parallel::values(plane.len(), |t| {
        let (x, y) = (t % width, t / width);
        mean(y, height, &|k| rows[k * width + x])
    })
}
