//! Primaries other than Rec. 709.

use glam::{DMat3, DVec3};

use super::pixels::{Photo, Pixels};

/// Primaries of linear RGB with white D65.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Primaries {
    /// ITU-R BT.709, as in sRGB.
    #[default]
    Rec709,
    /// Display P3: primaries of SMPTE RP 431-2.
    DisplayP3,
    /// ITU-R BT.2020 and BT.2100.
    Rec2020,
}

/// Chromaticity (x, y) of D65 as rounded by the standards.
const WHITE: [f64; 2] = [0.3127, 0.3290];

impl Primaries {
    /// Chromaticities (x, y) of red, green and blue.
    pub(crate) fn chromaticities(self) -> [[f64; 2]; 3] {
        match self {
            Self::Rec709 => [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]],
            Self::DisplayP3 => [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]],
            Self::Rec2020 => [[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]],
        }
    }

    /// From linear RGB to CIE XYZ with Y = 1 for white.
    pub fn to_xyz(self) -> DMat3 {
        let xyz = |[x, y]: [f64; 2]| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
        let [r, g, b] = self.chromaticities().map(xyz);
        let columns = DMat3::from_cols(r, g, b);
        columns * DMat3::from_diagonal(columns.inverse() * xyz(WHITE))
    }

    /// Rows of the matrix from linear RGB in these primaries to linear Rec. 709. Each row sums to
    /// 1, to preserve gray.
    pub fn to_rec709(self) -> [[f32; 3]; 3] {
        let matrix = match self {
            Self::Rec709 => DMat3::IDENTITY,
            _ => Self::Rec709.to_xyz().inverse() * self.to_xyz(),
        };
        matrix.transpose().to_cols_array_2d().map(|row| row.map(|v| v as f32))
    }
}

impl Photo {
    /// Interprets the pixels as linear RGB in other primaries and converts them to Rec. 709.
    /// Colours outside of Rec. 709 keep values above 1; negative values become 0. If a channel was
    /// clipped, all are, because their true values are unknown. The result holds floats (four times
    /// the memory of 8 bits) except with [`Primaries::Rec709`], which changes nothing.
    pub fn with_primaries(self, primaries: Primaries) -> Self {
        if primaries == Primaries::Rec709 {
            return self;
        }
        let matrix = primaries.to_rec709();
        // Unclipped values stay below this: the positive part of a row times the old level.
        let gain = matrix.map(|row| row.iter().map(|v| v.max(0.0)).sum::<f32>());
        let (before, after) =
            (self.saturation(), self.saturation() * gain[0].max(gain[1]).max(gain[2]));
        let mut rgb = self.to_linear();
        for pixel in rgb.as_chunks_mut::<3>().0 {
            let [r, g, b] = *pixel;
            let clipped = pixel.iter().any(|&v| v >= before);
            *pixel = matrix.map(|m| {
                let value = m[0] * r + m[1] * g + m[2] * b;
                if clipped {
                    value.max(after)
                } else if value < 0.0 {
                    0.0
                } else {
                    value
                }
            });
        }
        self.with_pixels(self.width(), self.height(), Pixels::F32(rgb)).with_saturation(after)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo::Encoding;

    fn near(found: [[f32; 3]; 3], expected: [[f32; 3]; 3], tolerance: f32) {
        for (f, e) in found.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((f - e).abs() <= tolerance, "{found:?}");
        }
    }

    #[test]
    fn matrices_are_the_published_ones() {
        // ITU-R BT.2407-0, from BT.2020 to BT.709, to four places.
        near(
            Primaries::Rec2020.to_rec709(),
            [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]],
            6e-5,
        );
        // W3C CSS Color 4, lin_P3_to_XYZ then XYZ_to_lin_sRGB.
        near(
            Primaries::DisplayP3.to_rec709(),
            [[1.2249, -0.2249, 0.0], [-0.0421, 1.0421, 0.0], [-0.0196, -0.0786, 1.0983]],
            6e-5,
        );
        near(
            Primaries::Rec709.to_rec709(),
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            0.0,
        );
        // IEC 61966-2-1: luminance of the primaries of sRGB.
        let y = Primaries::Rec709.to_xyz().row(1);
        for (found, expected) in y.to_array().iter().zip([0.2126, 0.7152, 0.0722]) {
            assert!((found - expected).abs() < 5e-5, "{y}");
        }
    }

    #[test]
    fn gray_is_preserved_and_negative_values_are_clipped() {
        let data = [128, 128, 128, 200, 0, 0, 60, 200, 20u8];
        let photo = Photo::from_rgb8(3, 1, &data, 9, Encoding::Srgb, 2.0).unwrap();
        let (gray, red) = (photo.pixel(0, 0)[0], photo.pixel(1, 0)[0]);
        let same = photo.clone().with_primaries(Primaries::Rec709);
        assert_eq!(same.stored_bytes(), 9);
        assert_eq!(same.to_linear(), photo.to_linear());
        for (primaries, red_in_709) in
            [(Primaries::DisplayP3, 1.2249), (Primaries::Rec2020, 1.6605)]
        {
            let wide = photo.clone().with_primaries(primaries);
            assert_eq!((wide.width(), wide.height(), wide.exposure()), (3, 1, 2.0));
            for v in wide.pixel(0, 0) {
                assert!((v - gray).abs() < 1e-6);
            }
            let [r, g, b] = wide.pixel(1, 0);
            assert!((r - red_in_709 * red).abs() < 1e-4 && g == 0.0 && b == 0.0, "{r} {g} {b}");
            assert!(wide.to_linear().iter().all(|v| *v >= 0.0));
            assert_eq!(wide.clip_mask(), [false; 3]);
        }
    }

    #[test]
    fn clipped_pixels_stay_clipped_and_only_they() {
        // The brightest unclipped colours, and one with a clipped channel.
        let data = [253, 0, 0, 253, 253, 253, 0, 0, 255, 0, 253, 253u8];
        let photo = Photo::from_rgb8(4, 1, &data, 12, Encoding::Srgb, 1.0).unwrap();
        for primaries in [Primaries::DisplayP3, Primaries::Rec2020] {
            let wide = photo.clone().with_primaries(primaries);
            assert_eq!(wide.clip_mask(), [false, false, true, false]);
            assert!(wide.pixel(2, 0).iter().all(|v| *v >= wide.saturation()));
        }
        // Never clipped, and NaN is still reported.
        let floats = Photo::from_linear(1, 1, vec![f32::NAN, 9.0, 1.0], 1.0, f32::INFINITY);
        let wide = floats.unwrap().with_primaries(Primaries::DisplayP3);
        assert!(!wide.is_finite() && wide.clip_mask() == [false]);
    }
}
