//! Input planes of the photo network.

use crate::networks::onnx::MAX_TEXELS;
use crate::observation::{Falloff, LEAST_WEIGHT, Observation, View, unpack};
use crate::parallel;
use crate::svbrdf::bands;
use crate::{Error, Result};

/// Sides of the input are multiples of this.
const PHOTO_MULTIPLE: usize = 32;
/// Longest side of the input, as in training.
const PHOTO_TEXELS: usize = 256;
/// Planes of the input.
pub(super) const PHOTO_CHANNELS: usize = 14;
/// Planes of the input that change sign when the sample is turned by 180 degrees: x and y of the directions.
pub(super) const PHOTO_ODD: [usize; 4] = [3, 4, 6, 7];
/// Offset of the radiance's logarithm in the input.
const LOG_OFFSET: f32 = 0.01;
/// Largest radiance that the input distinguishes.
const BRIGHTEST: f32 = 100.0;

/// Number of times an observation is halved for the input.
pub(super) fn photo_halvings(height: usize, width: usize) -> Result<u32> {
    let mut halvings = 0;
    while height.max(width) >> halvings > PHOTO_TEXELS {
        halvings += 1;
    }
    let multiple = PHOTO_MULTIPLE << halvings;
    let fits = |n: usize| n > 0 && n.is_multiple_of(multiple) && n <= MAX_TEXELS;
    if fits(height) && fits(width) {
        return Ok(halvings);
    }
    Err(Error::argument(
        "observation",
        format!("{width}x{height} texels, multiples of {multiple} up to {MAX_TEXELS} expected"),
    ))
}

/// Input planes: log of `pi * BRDF * NoL` up to 1 (RGB), unit directions to camera and light,
/// weight, share of saturated channels, log of the excess above 1 (RGB).
pub(super) fn photo_input(observation: &Observation) -> Vec<f32> {
    let (h, w) = (observation.height(), observation.width());
    let (n, view) = (h * w, &observation.view);
    let mut planes = vec![-1.0; PHOTO_CHANNELS * n];
    let rows = bands::<PHOTO_CHANNELS, _>(&mut planes, w, h, 1);
    let buffer = || vec![0.0; 3 * w];
    parallel::parts_with(rows, buffer, |radiance, y, row| {
        for (c, radiance) in radiance.chunks_exact_mut(w).enumerate() {
            unpack(&observation.packed()[c * n + y * w..][..w], radiance);
        }
        for x in 0..w {
            let at = view.texel_mm(w, h, x, y);
            let weight = observation.weight(y * w + x);
            let irradiance = irradiance(view, at);
            let mut saturated = 0.0;
            for (c, irradiance) in irradiance.into_iter().enumerate() {
                if weight > 0.0 {
                    // saturated: a lower bound
                    let radiance = radiance[c * w + x];
                    let reflected = std::f32::consts::PI * radiance.abs() / irradiance;
                    row[c][x] = log_encode(reflected);
                    row[11 + c][x] = log_excess(reflected);
                    saturated += if radiance < 0.0 { 1.0 / 3.0 } else { 0.0 };
                } else {
                    row[11 + c][x] = 0.0;
                }
            }
            for (first, point) in [(3, view.camera_mm), (6, view.light_mm)] {
                for (c, d) in direction(point, at).into_iter().enumerate() {
                    row[first + c][x] = d;
                }
            }
            // No other photograph could show such a texel better.
            row[9][x] = if weight == LEAST_WEIGHT { 1.0 } else { weight };
            row[10][x] = saturated;
        }
    });
    planes
}

fn direction(point: [f32; 3], at: [f32; 2]) -> [f32; 3] {
    glam::Vec3::new(point[0] - at[0], point[1] - at[1], point[2]).normalize_or(glam::Vec3::Z).into()
}

/// Irradiance of a texel facing the light.
fn irradiance(view: &View, at: [f32; 2]) -> [f32; 3] {
    match view.falloff {
        Falloff::None { power } => power,
        Falloff::InverseSquare { power_mm2 } => {
            let [x, y, z] = view.light_mm;
            let d2 = (x - at[0]).powi(2) + (y - at[1]).powi(2) + z * z;
            power_mm2.map(|p| p / d2)
        }
    }
}

/// NaN (no light in a channel) becomes black.
fn log_encode(x: f32) -> f32 {
    let x = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
    let (low, high) = (LOG_OFFSET.ln(), (1.0 + LOG_OFFSET).ln());
    2.0 * ((x + LOG_OFFSET).ln() - low) / (high - low) - 1.0
}

/// 0 up to 1, then logarithmic to 1 at [`BRIGHTEST`].
fn log_excess(x: f32) -> f32 {
    if x.is_nan() { 0.0 } else { x.clamp(1.0, BRIGHTEST).ln() / BRIGHTEST.ln() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photo_planes_match_the_training() {
        let view = View {
            sample_mm: [20.0, 10.0],
            camera_mm: [5.0, -2.5, 30.0],
            light_mm: [-5.0, 2.5, 20.0],
            falloff: Falloff::InverseSquare { power_mm2: [1000.0, 2000.0, 0.0] },
            ..View::default()
        };
        // 2 x 2 texels centred at x = ±5, y = ±2.5; the last one is unseen.
        let radiance = [0.5, -0.5, 0.1, 0.2, 0.5, 0.0, 9.0, 0.2, 0.5, 0.5, 0.5, 0.2];
        let weight = [0.4, 1.0, 1.0, 0.0];
        let observation = Observation::new(2, 2, view, &radiance, &weight).unwrap();
        let planes = photo_input(&observation);
        let close = |c: usize, i: usize, expected: f32| {
            let found = planes[4 * c + i];
            assert!((found - expected).abs() < 1e-5, "plane {c}, texel {i}: {found} {expected}");
        };
        let log = |x: f32| 2.0 * ((x + 0.01) / 0.01).ln() / 101.0f32.ln() - 1.0;
        // texel 0 lies under the light: distance 20 mm, irradiance 1000 / 400
        close(0, 0, log(std::f32::consts::PI * 0.5 / 2.5));
        // saturated: at least this much; distance² = 100 + 0 + 400
        close(0, 1, log(std::f32::consts::PI * 0.5 / 2.0));
        close(1, 1, -1.0);
        close(1, 2, 1.0);
        close(2, 0, 1.0); // no light in a channel: infinitely bright
        close(0, 3, -1.0);
        close(9, 0, 3.0 / 7.0);
        close(9, 3, 0.0);
        close(10, 1, 1.0 / 3.0);
        close(10, 0, 0.0);
        close(11, 0, 0.0);
        // six times a white diffuse surface: distance² = 25 + 400, irradiance 2000 / 425
        close(12, 2, (std::f32::consts::PI * 9.0 * 425.0 / 2000.0).ln() / 100.0f32.ln());
        close(13, 2, 1.0);
        close(11, 3, 0.0);
        // texel 3 (x = 5, y = -2.5) lies below the camera, texel 0 below the light
        close(5, 3, 1.0);
        close(8, 0, 1.0);
        let length = (10.0f32 * 10.0 + 5.0 * 5.0 + 900.0).sqrt();
        close(3, 0, 10.0 / length);
        close(4, 0, -5.0 / length);
        close(5, 0, 30.0 / length);
    }
}
