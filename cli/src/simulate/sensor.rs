//! From radiance to a picture file.

use image::{ImageFormat, RgbImage};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use rayon::prelude::*;
use svbrdf::photo::Encoding;
use svbrdf::random::Random;

use super::faults::FrameFaults;
use super::tone::Tone;
use crate::failure::{Failure, Result};

/// Linear RGB, row by row.
pub struct Picture {
    pub width: u32,
    pub height: u32,
    pub values: Vec<[f64; 3]>,
}

/// Blur reaches so many standard deviations.
const REACH: f64 = 3.5;

impl Picture {
    /// Asks for every pixel.
    pub fn new(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [f64; 3] + Sync) -> Self {
        let values = (0..height)
            .into_par_iter()
            .flat_map_iter(|y| {
                let pixel = &pixel;
                (0..width).map(move |x| pixel(x, y))
            })
            .collect();
        Self { width, height, values }
    }

    /// As lens and exposure of a photograph with faults leave it.
    pub fn with_faults(self, faults: &FrameFaults) -> Self {
        let [along_rows, along_columns] = faults.blur_sigma_px;
        let mut picture = self.blurred(along_rows).transposed().blurred(along_columns).transposed();
        picture.values.iter_mut().for_each(|v| *v = v.map(|v| v * faults.exposure));
        picture
    }

    /// Convolved with a Gaussian along its rows; borders repeat.
    fn blurred(&self, sigma: f64) -> Self {
        let reach = (REACH * sigma).ceil() as i64;
        let weight = |i: i64| (-0.5 * (i as f64 / sigma).powi(2)).exp();
        let total: f64 = (-reach..=reach).map(weight).sum();
        let weights: Vec<f64> = (-reach..=reach).map(|i| weight(i) / total).collect();
        let width = i64::from(self.width);
        let values = self
            .values
            .par_chunks(self.width as usize)
            .flat_map_iter(|row| {
                let weights = &weights;
                (0..width).map(move |x| {
                    let mut sum = [0.0; 3];
                    for (i, weight) in weights.iter().enumerate() {
                        let from = (x + i as i64 - reach).clamp(0, width - 1) as usize;
                        (0..3).for_each(|c| sum[c] += weight * row[from][c]);
                    }
                    sum
                })
            })
            .collect();
        Self { values, ..*self }
    }

    fn transposed(&self) -> Self {
        let (width, height) = (self.width as usize, self.height as usize);
        let values = (0..width)
            .into_par_iter()
            .flat_map_iter(|x| (0..height).map(move |y| self.values[y * width + x]))
            .collect();
        Self { width: self.height, height: self.width, values }
    }

    /// An 8-bit sRGB picture with shot and read noise, through the camera's tone curve if it has
    /// one; each row has its own random numbers.
    pub fn taken(&self, seed: u64, tone: Option<Tone>) -> RgbImage {
        let full = tone.map_or(1.0, Tone::full);
        let rows: Vec<Vec<u8>> = self
            .values
            .par_chunks(self.width as usize)
            .enumerate()
            .map(|(y, values)| {
                let mut random = Random::new(seed ^ ((y as u64) << 32));
                let mut stored = |v: f64| {
                    let sigma = (1e-6 + 2e-5 * v).sqrt();
                    let noisy = (v + sigma * random.bell()).clamp(0.0, full);
                    let shown = tone.map_or(noisy, |tone| tone.curve(noisy));
                    (255.0 * Encoding::Srgb.encode(shown)).round() as u8
                };
                values.iter().flatten().map(|&v| stored(v)).collect()
            })
            .collect();
        RgbImage::from_raw(self.width, self.height, rows.concat()).expect("three values a pixel")
    }
}

/// Ending of a picture file and its contents: PNG, or JPEG of some quality with chroma at half the
/// resolution.
pub fn file(picture: &RgbImage, jpeg_quality: Option<u8>) -> Result<(&'static str, Vec<u8>)> {
    let Some(quality) = jpeg_quality else {
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture
            .write_to(&mut bytes, ImageFormat::Png)
            .map_err(|e| Failure::Other(e.to_string()))?;
        return Ok(("png", bytes.into_inner()));
    };
    let side = |v: u32| {
        u16::try_from(v).map_err(|_| Failure::Input(format!("{v} pixels: too many for JPEG")))
    };
    let (width, height) = (side(picture.width())?, side(picture.height())?);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, quality);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder
        .encode(picture, width, height, ColorType::Rgb)
        .map_err(|e| Failure::Other(e.to_string()))?;
    Ok(("jpg", bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point spreads to variances of the two Gaussians; nothing is lost. Sampling and the cut at
    /// 3.5 standard deviations leave about 1 % of the variance.
    #[test]
    fn blur_has_its_width_along_each_axis() {
        let point = |x, y| if (x, y) == (20, 16) { [1.0; 3] } else { [0.0; 3] };
        let faults = FrameFaults {
            gain: 1.0,
            exposure: 2.0,
            blur_sigma_px: [0.9, 1.7],
            registration_texels: [0.0; 2],
        };
        let picture = Picture::new(41, 33, point).with_faults(&faults);
        let (mut total, mut squares) = (0.0, [0.0; 2]);
        for (i, v) in picture.values.iter().enumerate() {
            let (x, y) = ((i % 41) as f64 - 20.0, (i / 41) as f64 - 16.0);
            total += v[1];
            squares[0] += v[1] * x * x;
            squares[1] += v[1] * y * y;
        }
        assert!((total - 2.0).abs() < 1e-9, "{total}");
        for (square, sigma) in squares.iter().zip(faults.blur_sigma_px) {
            assert!((square / total / (sigma * sigma) - 1.0).abs() < 0.02, "{square}");
        }
    }

    /// Colour that alternates from pixel to pixel survives in PNG and not in JPEG, whose brightness
    /// does.
    #[test]
    fn jpeg_halves_the_resolution_of_chroma() {
        let stripes = RgbImage::from_fn(64, 64, |x, _| {
            image::Rgb(if x % 2 == 0 { [90, 120, 90] } else { [140, 120, 140] })
        });
        let difference = |quality| {
            let (_, bytes) = file(&stripes, quality).unwrap();
            let read = image::load_from_memory(&bytes).unwrap().into_rgb8();
            i32::from(read.get_pixel(31, 30)[0]) - i32::from(read.get_pixel(30, 30)[0])
        };
        assert_eq!(difference(None), 50);
        // luma differs by (0.299 + 0.114) 50 = 21, chroma not
        let halved = difference(Some(80));
        assert!((10..30).contains(&halved), "{halved}");
    }
}
