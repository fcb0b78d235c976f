//! Transfer curves, as closed forms and as tables.

use std::sync::OnceLock;

/// Transfer curve of stored pixel values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Proportional to radiance.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    /// Pure power law of 2.2.
    Gamma22,
}

impl Encoding {
    /// Every encoding.
    pub const ALL: [Self; 3] = [Self::Linear, Self::Srgb, Self::Gamma22];

    /// Name in capture files: `linear`, `srgb`, `gamma2.2`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Srgb => "srgb",
            Self::Gamma22 => "gamma2.2",
        }
    }

    /// The encoding of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|e| e.name() == name)
    }

    /// Linear value of a stored one, 1 = full scale; odd below 0.
    pub fn decode(self, stored: f64) -> f64 {
        match self {
            Self::Linear => stored,
            Self::Srgb if stored.abs() <= 0.040_45 => stored / 12.92,
            Self::Srgb => ((stored.abs() + 0.055) / 1.055).powf(2.4).copysign(stored),
            Self::Gamma22 => stored.abs().powf(2.2).copysign(stored),
        }
    }

    /// Stored value of a linear one, 1 = full scale; odd below 0.
    pub fn encode(self, linear: f64) -> f64 {
        match self {
            Self::Linear => linear,
            Self::Srgb if linear.abs() <= 0.003_130_8 => linear * 12.92,
            Self::Srgb => (1.055 * linear.abs().powf(1.0 / 2.4) - 0.055).copysign(linear),
            Self::Gamma22 => linear.abs().powf(1.0 / 2.2).copysign(linear),
        }
    }

    /// Linear value of every 8-bit one.
    pub(super) fn table8(self) -> &'static [f32; 256] {
        static TABLES: [OnceLock<Box<[f32; 256]>>; 3] = [const { OnceLock::new() }; 3];
        TABLES[self as usize].get_or_init(|| self.table())
    }

    /// Linear value of every 16-bit one.
    pub(super) fn table16(self) -> &'static [f32; 65536] {
        static TABLES: [OnceLock<Box<[f32; 65536]>>; 3] = [const { OnceLock::new() }; 3];
        TABLES[self as usize].get_or_init(|| self.table())
    }

    fn table<const N: usize>(self) -> Box<[f32; N]> {
        let scale = ((N - 1) as f64).recip();
        let values: Box<[f32]> = (0..N).map(|i| self.decode(i as f64 * scale) as f32).collect();
        values.try_into().expect("N values")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_invert_each_other_and_meet_the_standard() {
        for encoding in Encoding::ALL {
            assert_eq!(Encoding::from_name(encoding.name()), Some(encoding));
            for i in -50..=400 {
                let v = f64::from(i) / 200.0;
                // The two branches of sRGB meet within 1e-7 only, by the standard's own rounding.
                assert!((encoding.encode(encoding.decode(v)) - v).abs() < 1e-6, "{encoding:?} {v}");
            }
        }
        // IEC 61966-2-1: middle gray 0.5 is 0.2140 linear; the power law's is 0.2176.
        assert!((Encoding::Srgb.decode(0.5) - 0.214_041).abs() < 1e-6);
        assert!((Encoding::Gamma22.decode(0.5) - 0.217_638).abs() < 1e-6);
        assert_eq!(Encoding::from_name("sRGB"), None);
    }

    #[test]
    fn tables_are_the_curves() {
        for encoding in Encoding::ALL {
            for i in [0, 1, 10, 11, 128, 254, 255] {
                let exact = encoding.decode(i as f64 / 255.0) as f32;
                assert_eq!(encoding.table8()[i], exact);
                assert_eq!(encoding.table16()[i * 257], exact);
            }
        }
    }
}
