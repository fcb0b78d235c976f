//! ICC profiles of pictures.

use crate::photo::Encoding;
use moxcms::{ColorProfile, DataColorSpace, ProfileText, ToneReprCurve};

/// Entries of a curve.
const STEPS: usize = 65_536;
/// Tolerance for the sRGB curve, which profiles round.
const SRGB_CURVE: f64 = 0.002;
/// The same for matrix entries.
const SRGB_MATRIX: f64 = 0.01;
/// Plausible results for white.
const WHITE: std::ops::RangeInclusive<f64> = 0.8..=1.25;

/// Colours described by three curves and a matrix.
pub struct Profile {
    /// Linear value of every stored one, per channel.
    curves: [Vec<f32>; 3],
    /// Matrix from linear values to linear Rec. 709, by rows.
    matrix: [[f64; 3]; 3],
}

impl Profile {
    /// Parses a profile; the error states the fault.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        Self::of(&ColorProfile::new_from_slice(bytes).map_err(|e| e.to_string())?)
    }

    /// Curves and matrix of a profile that has been read.
    pub fn of(profile: &ColorProfile) -> Result<Self, String> {
        let curve = |curve: &Option<ToneReprCurve>| table(curve.as_ref());
        let (curves, matrix) = match profile.color_space {
            DataColorSpace::Rgb if profile.is_matrix_shaper() => {
                let curves = [
                    curve(&profile.red_trc)?,
                    curve(&profile.green_trc)?,
                    curve(&profile.blue_trc)?,
                ];
                (curves, profile.transform_matrix(&ColorProfile::new_srgb()).v)
            }
            DataColorSpace::Gray if profile.gray_trc.is_some() => {
                let gray = curve(&profile.gray_trc)?;
                let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
                ([gray.clone(), gray.clone(), gray], identity)
            }
            _ => return Err(format!("{} is not described by curves and a matrix", name(profile))),
        };
        let white = matrix.map(|row| row.iter().sum::<f64>());
        if !white.iter().all(|v| WHITE.contains(v)) {
            return Err("its primaries do not make white".into());
        }
        Ok(Self { curves, matrix })
    }

    /// Whether it describes sRGB.
    pub fn is_srgb(&self) -> bool {
        let matrix = (0..9).all(|i| {
            let one = if i % 4 == 0 { 1.0 } else { 0.0 };
            (self.matrix[i / 3][i % 3] - one).abs() < SRGB_MATRIX
        });
        let curves = self.curves.iter().flat_map(|curve| curve.iter().enumerate().step_by(257));
        matrix
            && curves.into_iter().all(|(i, v)| {
                let srgb = Encoding::Srgb.decode(i as f64 / (STEPS - 1) as f64);
                (f64::from(*v) - srgb).abs() < SRGB_CURVE
            })
    }

    /// Converts stored values (1 = full scale) to linear Rec. 709. Channels from `clipped` on
    /// become at least 1; colours with negative values move to the border of Rec. 709.
    pub fn apply(&self, rgb: &mut [f32], clipped: f32) {
        for pixel in rgb.as_chunks_mut::<3>().0 {
            let stored = *pixel;
            let linear: [f32; 3] = std::array::from_fn(|c| self.linear(c, stored[c]));
            for (c, out) in pixel.iter_mut().enumerate() {
                let [r, g, b] = self.matrix[c].map(|v| v as f32);
                let value = (r * linear[0] + g * linear[1] + b * linear[2]).max(0.0);
                *out = if stored[c] >= clipped { value.max(1.0) } else { value };
            }
        }
    }

    fn linear(&self, channel: usize, stored: f32) -> f32 {
        let step = (stored.clamp(0.0, 1.0) * (STEPS - 1) as f32).round() as usize;
        self.curves[channel][step.min(STEPS - 1)]
    }
}

fn table(curve: Option<&ToneReprCurve>) -> Result<Vec<f32>, String> {
    let curve = curve.ok_or("a curve is missing")?;
    let evaluator = curve.make_linear_evaluator().map_err(|e| e.to_string())?;
    let values: Vec<f32> = (0..STEPS)
        .map(|i| evaluator.evaluate_value((i as f64 / (STEPS - 1) as f64) as f32).clamp(0.0, 1.0))
        .collect();
    let rises = values.is_sorted() && values[STEPS - 1] > 0.5;
    if rises { Ok(values) } else { Err("a curve does not rise from black to white".into()) }
}

fn name(profile: &ColorProfile) -> String {
    let text = match &profile.description {
        Some(ProfileText::PlainString(text)) => text.clone(),
        Some(ProfileText::Localizable(texts)) => {
            texts.first().map(|t| t.value.clone()).unwrap_or_default()
        }
        Some(ProfileText::Description(text)) => text.ascii_string.clone(),
        None => String::new(),
    };
    if text.is_empty() { "it".into() } else { format!("`{text}`") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_of_srgb_are_recognised() {
        let parse = |profile: ColorProfile| Profile::parse(&profile.encode().unwrap()).unwrap();
        assert!(parse(ColorProfile::new_srgb()).is_srgb());
        for other in [ColorProfile::new_display_p3(), ColorProfile::new_adobe_rgb()] {
            assert!(!parse(other).is_srgb());
        }
        let mut power = ColorProfile::new_srgb();
        let curve = Some(moxcms::curve_from_gamma(2.2));
        (power.red_trc, power.green_trc, power.blue_trc) = (curve.clone(), curve.clone(), curve);
        power.cicp = None;
        assert!(!parse(power).is_srgb());
    }

    #[test]
    fn white_stays_white_and_clipped_channels_stand_out() {
        let bytes = ColorProfile::new_display_p3().encode().unwrap();
        let profile = Profile::parse(&bytes).unwrap();
        let near = |a: f32, b: f32| (a - b).abs() < 2e-3;
        let mut rgb = [0.5, 0.5, 0.5, 0.9, 0.0, 0.0, 1.0, 0.5, 0.5];
        profile.apply(&mut rgb, 254.0 / 255.0);
        let gray = Encoding::Srgb.decode(0.5) as f32;
        assert!(rgb[..3].iter().all(|v| near(*v, gray)), "{rgb:?}");
        // First row of the matrix between the chromaticities: 1.2249 -0.2247 0.
        let red = 1.2249 * Encoding::Srgb.decode(0.9) as f32;
        assert!(near(rgb[3], red) && rgb[4..6] == [0.0; 2], "{rgb:?}");
        assert!(rgb[6] >= 1.0 && rgb[7] < 0.5, "{rgb:?}");
    }

    #[test]
    fn damaged_profiles_are_refused_or_plausible() {
        let good = ColorProfile::new_display_p3().encode().unwrap();
        let usable = |bytes: &[u8]| {
            if let Ok(profile) = Profile::parse(bytes) {
                let mut rgb = [0.0, 0.5, 1.0];
                profile.apply(&mut rgb, 1.0);
                assert!(rgb.iter().all(|v| v.is_finite() && *v >= 0.0), "{rgb:?}");
            }
        };
        for end in (0..good.len()).step_by(13) {
            usable(&good[..end]);
        }
        for at in (0..good.len()).step_by(13) {
            for value in [0, 0x7F, 0xFF] {
                let mut bytes = good.clone();
                bytes[at] = value;
                usable(&bytes);
            }
        }
        assert!(Profile::parse(b"no profile at all").is_err());
    }
}
