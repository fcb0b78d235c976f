//! Tone curves as cameras put them over their photographs.

use clap::ValueEnum;
use svbrdf::photo::Encoding;

/// A camera's mapping of linear values before sRGB encoding. White paper at the first distance has the linear
/// value 0.8.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Tone {
    /// Highlights roll off over two stops, shadows have a short toe (form of Hable, 2010)
    Filmic,
    /// Steep middle, long shoulder (rational fit of Narkowicz to the ACES transforms, 2015)
    Aces,
    /// An s-curve of the encoded values, as the contrast setting of a camera
    Contrast,
}

/// Linear value that [`Tone::Filmic`] shows as full scale, and the factor before its curve.
const FILMIC_WHITE: f64 = 4.0;
const FILMIC_EXPOSURE: f64 = 2.4;
/// Factor before the curve of [`Tone::Aces`].
const ACES_EXPOSURE: f64 = 0.8;
/// Factor before the curve of [`Tone::Contrast`], and its share of a smooth step.
const CONTRAST_EXPOSURE: f64 = 0.85;
const CONTRAST_SHARE: f64 = 0.6;

impl Tone {
    /// Value to be encoded, 0 to 1, of a linear one.
    pub fn curve(self, linear: f64) -> f64 {
        let shown = match self {
            Self::Filmic => {
                filmic(FILMIC_EXPOSURE * linear) / filmic(FILMIC_EXPOSURE * FILMIC_WHITE)
            }
            Self::Aces => {
                let x = ACES_EXPOSURE * linear;
                x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
            }
            Self::Contrast => {
                let e = Encoding::Srgb.encode((CONTRAST_EXPOSURE * linear).min(1.0));
                Encoding::Srgb.decode(e + CONTRAST_SHARE * (e * e * (3.0 - 2.0 * e) - e))
            }
        };
        shown.min(1.0)
    }

    /// Linear value at which the sensor is full: curves are for more range than the file holds.
    pub fn full(self) -> f64 {
        FILMIC_WHITE
    }
}

/// Hable's curve before it is scaled; 0 at 0.
fn filmic(x: f64) -> f64 {
    const SHOULDER: f64 = 0.15;
    const LINEAR: f64 = 0.5;
    const ANGLE: f64 = 0.1;
    const TOE: f64 = 0.2;
    const TOE_TOP: f64 = 0.02;
    const TOE_BOTTOM: f64 = 0.3;
    (x * (SHOULDER * x + ANGLE * LINEAR) + TOE * TOE_TOP)
        / (x * (SHOULDER * x + LINEAR) + TOE * TOE_BOTTOM)
        - TOE_TOP / TOE_BOTTOM
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known values: each curve is one at its white, and monotone up to it.
    #[test]
    fn curves_rise_from_black_to_white() {
        for tone in Tone::value_variants() {
            let values: Vec<f64> = (0..=400).map(|i| tone.curve(f64::from(i) / 100.0)).collect();
            assert!(values[0].abs() < 1e-9, "{tone:?}");
            assert!(values.windows(2).all(|w| w[1] >= w[0]), "{tone:?}");
            assert!(values[400] > 0.93 && values[400] <= 1.0, "{tone:?} {}", values[400]);
            // White paper is bright and not clipped: 0.45 is encoded as 0.7.
            assert!((0.45..0.9).contains(&values[80]), "{tone:?} {}", values[80]);
        }
        // Narkowicz: 0.8 of the input 1 are 0.8 of the output to 3 %.
        assert!((Tone::Aces.curve(1.0) - 0.765).abs() < 0.02, "{}", Tone::Aces.curve(1.0));
        assert_eq!(Tone::Filmic.curve(4.0), 1.0);
        // Half of the encoded range stays where it is.
        let middle = Encoding::Srgb.decode(0.5) / CONTRAST_EXPOSURE;
        assert!((Tone::Contrast.curve(middle) - Encoding::Srgb.decode(0.5)).abs() < 1e-9);
    }
}
