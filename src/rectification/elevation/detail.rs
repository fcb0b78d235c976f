//! Input of the registration: octaves of brightness and colour, seen from above.

use std::array;

use crate::calibration::photometry::{Lobe, Radiometry, Vignetting};
use crate::geometry::{Camera, Pose};
use crate::observation::Observation;
use crate::photo::{Photo, ToneCurve};
use crate::rectification::rectify;
use glam::DVec3;

/// Octaves of detail.
pub(super) const LEVELS: usize = 4;
/// Brightness, and red over blue.
pub(super) const CHANNELS: usize = 2;
/// Texels along the sample's longer side, and fewest along the shorter.
const SIDE: usize = 256;
const SIDE_MIN: usize = 64;
/// Offset of values before the logarithm, relative to their mean, against noise in the dark.
const DARK: f32 = 0.02;
/// Clipping level of band-passed logs: larger values are glints or pits.
const CLIP: f32 = 0.5;
/// Filter passes between the finer and the coarser end of a band.
const PASSES: usize = 3;

/// Octaves of detail of a photograph rectified to the board's plane.
#[derive(Debug, Clone)]
pub(crate) struct Detail {
    pub(super) sample_mm: [f64; 2],
    pub(super) camera_mm: DVec3,
    /// Logs of brightness and colour (red over blue), finest octave first.
    pub(super) channels: [[Band; LEVELS]; CHANNELS],
}

/// One octave; 0 where unknown.
#[derive(Debug, Clone)]
pub(super) struct Band {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Detail {
    /// Octaves of a photograph; `None` if it shows too little of the sample.
    pub(crate) fn new(
        photo: &Photo,
        camera: &Camera,
        pose: &Pose,
        sample_mm: [f32; 2],
    ) -> Option<Self> {
        let long = sample_mm[0].max(sample_mm[1]);
        let [width, height] = sample_mm.map(|mm| {
            let texels = SIDE as f32 * mm / long;
            ((texels / 8.0).round() as usize * 8).max(SIDE_MIN)
        });
        // Light and lens are too smooth for the bands, and all photographs share the tone curve.
        let plain = Radiometry {
            gain: [1.0; 3],
            tone: ToneCurve::default(),
            veil: 0.0,
            vignetting: Vignetting::default(),
            lobe: Lobe::default(),
            flash_offset_mm: DVec3::ZERO,
            power_mm2: [1.0; 3],
            ambient: [0.0; 3],
            log_sigma: 0.0,
        };
        let top = rectify(photo, camera, pose, &plain, sample_mm, width, height).ok()?;
        let channels = Field::of(&top)?.map(|mut field| array::from_fn(|_| field.next_band()));
        let sample_mm = sample_mm.map(f64::from);
        Some(Self { sample_mm, camera_mm: pose.camera_centre(), channels })
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        self.channels.iter().flatten().map(|l| 4 * l.values.len() as u64).sum()
    }
}

/// Weighted values and weights.
struct Field {
    width: usize,
    height: usize,
    sum: Vec<f32>,
    weight: Vec<f32>,
}

impl Field {
    fn of(top: &Observation) -> Option<[Self; CHANNELS]> {
        let n = top.texels();
        let rgb = |i: usize| -> [f32; 3] { array::from_fn(|c| top.radiance(c, i)) };
        let is_seen = |i: usize| top.weight(i) > 0.0 && rgb(i).iter().all(|v| *v >= 0.0);
        let (mut total, mut seen) = (0.0, 0);
        for i in (0..n).filter(|&i| is_seen(i)) {
            total += f64::from(rgb(i).iter().sum::<f32>());
            seen += 1;
        }
        let mean = (total / (3.0 * f64::from(seen))) as f32;
        if mean.is_nan() || mean <= 0.0 {
            return None;
        }
        let field = |value: &dyn Fn([f32; 3]) -> f32| {
            let (mut sum, mut weight) = (vec![0.0; n], vec![0.0; n]);
            for i in (0..n).filter(|&i| is_seen(i)) {
                (sum[i], weight[i]) = (value(rgb(i)), 1.0);
            }
            Self { width: top.width(), height: top.height(), sum, weight }
        };
        let log = |v: f32| (v / mean + DARK).ln();
        Some([field(&|[r, g, b]| log((r + g + b) / 3.0)), field(&|[r, _, b]| log(r) - log(b))])
    }

    /// The finest octave; reduces the field to half the resolution.
    fn next_band(&mut self) -> Band {
        let (width, height) = (self.width, self.height);
        let seen = std::mem::take(&mut self.weight);
        let mut scratch = vec![0.0; seen.len()];
        let mut weight = seen.clone();
        binomial(&mut self.sum, width, &mut scratch);
        binomial(&mut weight, width, &mut scratch);
        let (mut coarse, mut coarse_weight) = (self.sum.clone(), weight.clone());
        for _ in 0..PASSES {
            binomial(&mut coarse, width, &mut scratch);
            binomial(&mut coarse_weight, width, &mut scratch);
        }
        let mut values = vec![0.0; seen.len()];
        for (i, out) in values.iter_mut().enumerate() {
            if seen[i] > 0.5 {
                let v = self.sum[i] / weight[i] - coarse[i] / coarse_weight[i];
                *out = v / (1.0 + (v / CLIP) * (v / CLIP)).sqrt();
            }
        }
        let (w2, h2) = (width / 2, height / 2);
        let halved = |from: &[f32]| -> Vec<f32> {
            let at = |i: usize| from[2 * (i / w2) * width + 2 * (i % w2)];
            let four = |i: usize| {
                let corner = 2 * (i / w2) * width + 2 * (i % w2);
                0.25 * (at(i) + from[corner + 1] + from[corner + width] + from[corner + width + 1])
            };
            (0..w2 * h2).map(four).collect()
        };
        (self.sum, self.weight) = (halved(&self.sum), halved(&weight));
        (self.width, self.height) = (w2, h2);
        Band { width, height, values }
    }
}

/// Filters rows and columns with 1 4 6 4 1 (standard deviation one texel); border values extend outwards.
fn binomial(values: &mut [f32], width: usize, scratch: &mut [f32]) {
    let height = values.len() / width;
    for (from, to) in values.chunks(width).zip(scratch.chunks_mut(width)) {
        let at = |x: isize| from[x.clamp(0, width as isize - 1) as usize];
        let taps = |x: usize| {
            let x = x as isize;
            (at(x - 2) + at(x + 2) + 4.0 * (at(x - 1) + at(x + 1)) + 6.0 * at(x)) / 16.0
        };
        for x in [0, 1, width - 2, width - 1] {
            to[x] = taps(x);
        }
        for (t, f) in to[2..width - 2].iter_mut().zip(from.windows(5)) {
            *t = (f[0] + f[4] + 4.0 * (f[1] + f[3]) + 6.0 * f[2]) / 16.0;
        }
    }
    for (y, to) in values.chunks_mut(width).enumerate() {
        let row = |dy: isize| {
            let y = (y as isize + dy).clamp(0, height as isize - 1) as usize;
            &scratch[y * width..][..width]
        };
        let (a, b, c, d, e) = (row(-2), row(-1), row(0), row(1), row(2));
        for x in 0..width {
            to[x] = (a[x] + e[x] + 4.0 * (b[x] + d[x]) + 6.0 * c[x]) / 16.0;
        }
    }
}
