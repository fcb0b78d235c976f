//! Faults of real captures, drawn at random.

use std::f64::consts::TAU;

use serde::Serialize;
use svbrdf::random::Random;

use super::reflectance::{Lobe, Model};

/// Keeps these numbers apart from those of poses and noise.
const STREAM: u64 = 0xFA17;
/// Standard deviation of the log brightness of photographs, least and most.
const GAIN_SIGMA: [f64; 2] = [0.05, 0.1];
/// Exposure may follow distance with this power at most; 2 undoes the fall-off.
const MAX_EXPOSURE_EXPONENT: f64 = 2.0;
/// Distance of the flash from the camera, mm.
const FLASH_MM: [f64; 2] = [3.0, 12.0];
/// The flash is weaker to the sides by this power of the cosine, at most.
const MAX_FLASH_EXPONENT: f64 = 2.2;
/// The sample's middle above its border, mm.
const MAX_BOW_MM: f64 = 0.6;
/// Standard deviation of blur along each side of a picture, pixels.
const BLUR_PX: [f64; 2] = [0.3, 1.2];
/// Largest registration error of rectified photographs along each side, texels.
const MAX_SHIFT_TEXELS: f64 = 0.5;
/// Quality of the JPEG files, with chroma at half the resolution (4:2:0).
pub const JPEG_QUALITY: u8 = 80;

/// Faults of a capture, as `truth.json` has them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Faults {
    /// Standard deviation of the logarithm of the photographs' gains.
    pub gain_sigma: f64,
    /// Exposure goes with the camera's distance to this power.
    pub exposure_exponent: f64,
    /// Flash in the camera frame, mm; the capture does not state it.
    pub flash_offset_mm: [f64; 3],
    /// The flash goes with the cosine to the camera's axis to this power.
    pub flash_exponent: f64,
    /// Reflectance beyond the maps' model.
    pub reflectance: Model,
    /// Height of the sample's middle above its border, mm: `bow (1 - X²) (1 - Y²)`, X and Y from -1
    /// to 1.
    pub bow_mm: f64,
    /// Quality of the JPEG files.
    pub jpeg_quality: u8,
    /// Their chroma subsampling.
    pub jpeg_chroma: &'static str,
}

/// Faults of a photograph.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameFaults {
    /// Brightness that follows nothing, part of the exposure.
    pub gain: f64,
    /// Value of a radiance of 1; the capture says 1.
    pub exposure: f64,
    /// Blur along the picture's rows and columns.
    pub blur_sigma_px: [f64; 2],
    /// Offset of a rectified photograph to the right and down.
    pub registration_texels: [f64; 2],
}

fn between(random: &mut Random, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * random.uniform()
}

impl Faults {
    /// The faults of a seed, and the generator for those of its photographs. The seed also chooses the `lobe`,
    /// unless it is given.
    pub fn draw(seed: u64, lobe: Option<Lobe>) -> (Self, Random) {
        let mut random = Random::new(seed ^ STREAM);
        let (sin, cos) = (TAU * random.uniform()).sin_cos();
        let offset = between(&mut random, FLASH_MM);
        let faults = Self {
            gain_sigma: between(&mut random, GAIN_SIGMA),
            exposure_exponent: MAX_EXPOSURE_EXPONENT * random.uniform(),
            flash_offset_mm: [offset * cos, offset * sin, 0.0],
            flash_exponent: MAX_FLASH_EXPONENT * random.uniform(),
            reflectance: Model::draw(lobe.unwrap_or_else(|| Lobe::of(seed)), &mut random),
            bow_mm: MAX_BOW_MM * random.uniform(),
            jpeg_quality: JPEG_QUALITY,
            jpeg_chroma: "4:2:0",
        };
        (faults, random)
    }

    /// Faults of a photograph from `distance` times the first one's.
    pub fn photograph(&self, random: &mut Random, distance: f64) -> FrameFaults {
        let gain = (self.gain_sigma * random.bell()).exp();
        let mut shift = || MAX_SHIFT_TEXELS * (2.0 * random.uniform() - 1.0);
        let registration_texels = [shift(), shift()];
        FrameFaults {
            gain,
            exposure: gain * distance.powf(self.exposure_exponent),
            blur_sigma_px: [between(random, BLUR_PX), between(random, BLUR_PX)],
            registration_texels,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over many seeds gains spread as promised and everything stays in its range.
    #[test]
    fn faults_lie_in_their_ranges() {
        let mut squares = 0.0;
        for seed in 0..400 {
            let (faults, mut random) = Faults::draw(seed, None);
            let offset = faults.flash_offset_mm[0].hypot(faults.flash_offset_mm[1]);
            assert!((FLASH_MM[0]..FLASH_MM[1]).contains(&offset), "{offset}");
            assert!((0.0..=MAX_BOW_MM).contains(&faults.bow_mm));
            assert!((0.0..=MAX_FLASH_EXPONENT).contains(&faults.flash_exponent));
            let frame = faults.photograph(&mut random, 1.1);
            let law = 1.1f64.powf(faults.exposure_exponent);
            assert!((frame.exposure / frame.gain / law - 1.0).abs() < 1e-12);
            assert!(frame.registration_texels.iter().all(|v| v.abs() <= MAX_SHIFT_TEXELS));
            squares += (frame.gain.ln() / faults.gain_sigma).powi(2) / 400.0;
        }
        // the variance of 400 draws has a standard deviation of about 6 %
        assert!((squares - 1.0).abs() < 0.25, "{squares}");
        assert_eq!(Faults::draw(7, None).0, Faults::draw(7, None).0);
        assert_ne!(Faults::draw(7, None).0, Faults::draw(8, None).0);
    }
}
