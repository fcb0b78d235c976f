//! One photograph as the fit sees it: radiance of every texel from the top, and the geometry of
//! camera and light that produced it.

use std::ops::Range;

use rayon::prelude::*;

/// How the light's strength depends on distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Falloff {
    /// The same irradiance at every texel (before the cosine): the reference renderer's light.
    None {
        /// Irradiance per channel; pi makes a white Lambertian texel facing the light come out
        /// at its albedo.
        power: [f32; 3],
    },
    /// `power / distance²`.
    InverseSquare {
        /// Intensity per channel times mm², i.e. irradiance at 1 mm.
        power_mm2: [f32; 3],
    },
}

/// Camera and light of one photograph in the board frame.
///
/// Radiance of a texel: `BRDF * NoL * E(texel) + ambient * (kd + ks)` with `E` from
/// [`Falloff`]. With `power_mm2 = pi * d²` a white Lambertian texel facing a light at distance `d`
/// comes out at its albedo: all of a capture's photographs share one such `d`, so that albedos are
/// absolute and radiances lie near [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Width and height of the sample, mm.
    pub sample_mm: [f32; 2],
    /// Camera centre, mm, board frame.
    pub camera_mm: [f32; 3],
    /// Light position, mm, board frame.
    pub light_mm: [f32; 3],
    /// Strength of the light over distance.
    pub falloff: Falloff,
    /// Radiance of a uniform surround per channel, in the same units.
    pub ambient: [f32; 3],
}

impl View {
    /// Position of a texel's centre on the sample, mm: `[x, y]`, for maps of `width * height`.
    pub fn texel_mm(&self, width: usize, height: usize, x: usize, y: usize) -> [f32; 2] {
        [
            self.sample_mm[0] * ((x as f32 + 0.5) / width as f32 - 0.5),
            self.sample_mm[1] * (0.5 - (y as f32 + 0.5) / height as f32),
        ]
    }

    /// The view of some rows of maps of `height` rows, as if they were the sample.
    pub(crate) fn of_rows(&self, rows: &Range<usize>, height: usize) -> Self {
        let pitch = self.sample_mm[1] / height as f32;
        let centre = pitch * (0.5 * height as f32 - 0.5 * (rows.start + rows.end) as f32);
        let mut view = *self;
        view.sample_mm[1] = pitch * rows.len() as f32;
        view.camera_mm[1] -= centre;
        view.light_mm[1] -= centre;
        view
    }
}

/// A rectified photograph: linear radiance and weight of each texel, with its [`View`].
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Texels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Camera and light.
    pub view: View,
    /// Three planes (R, G, B) of `width * height` radiances in the units of [`View`]. A
    /// *negative* value `-v` marks a saturated measurement: the true radiance is at least `v`.
    pub radiance: Vec<f32>,
    /// Weight of each texel, 0 (not seen) to 1: validity times foreshortening.
    pub weight: Vec<f32>,
}

impl Observation {
    /// Texels in a plane.
    pub fn texels(&self) -> usize {
        self.width * self.height
    }

    /// The same photograph at half the resolution: weighted means of 2x2 texels; saturated where
    /// one of the four is. Sizes must be even.
    ///
    /// # Panics
    /// When width or height is odd.
    pub fn downsampled(&self) -> Self {
        let (w, h) = (self.width, self.height);
        assert!(w % 2 == 0 && h % 2 == 0, "{w}x{h} cannot be halved");
        let (w2, h2) = (w / 2, h / 2);
        let mut weight = vec![0.0; w2 * h2];
        let mut radiance = vec![0.0; 3 * w2 * h2];
        let four = |y: usize, x: usize| {
            let corner = 2 * y * w + 2 * x;
            [corner, corner + 1, corner + w, corner + w + 1]
        };
        weight.par_chunks_mut(w2).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                *out = 0.25 * four(y, x).iter().map(|&i| self.weight[i]).sum::<f32>();
            }
        });
        radiance.par_chunks_mut(w2).enumerate().for_each(|(row, out)| {
            let (c, y) = (row / h2, row % h2);
            let plane = &self.radiance[c * w * h..(c + 1) * w * h];
            for (x, (out, quarter)) in out.iter_mut().zip(&weight[y * w2..]).enumerate() {
                let (four, sum) = (four(y, x), 4.0 * quarter);
                if sum <= 0.0 {
                    continue;
                }
                let mean = four.iter().map(|&i| self.weight[i] * plane[i].abs()).sum::<f32>() / sum;
                let saturated = four.iter().any(|&i| self.weight[i] > 0.0 && plane[i] < 0.0);
                *out = if saturated { -mean } else { mean };
            }
        });
        Self { width: w2, height: h2, view: self.view, radiance, weight }
    }
}
