//! Transfer curves, as closed forms and as tables.

use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// Transfer curve of stored pixel values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Encoding {
    /// Proportional to radiance.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    /// Pure power law of 2.2.
    Gamma22,
    /// Hybrid log-gamma of ITU-R BT.2100, scene linear: the inverse OETF, 1 at full signal. The
    /// reference white of ITU-R BT.2408, 75 % of the signal, is 0.265.
    Hlg,
    /// Perceptual quantiser of ITU-R BT.2100: the EOTF, 1 at the reference white of ITU-R BT.2408
    /// (203 cd/m²), 49.26 at full signal.
    Pq,
}

/// Reference white of ITU-R BT.2408, cd/m²: the unit of linear PQ values.
const REFERENCE_WHITE: f64 = 203.0;

impl Encoding {
    /// Every encoding.
    pub const ALL: [Self; 5] = [Self::Linear, Self::Srgb, Self::Gamma22, Self::Hlg, Self::Pq];

    /// Name in capture files: `linear`, `srgb`, `gamma2.2`, `hlg`, `pq`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Srgb => "srgb",
            Self::Gamma22 => "gamma2.2",
            Self::Hlg => "hlg",
            Self::Pq => "pq",
        }
    }

    /// The encoding of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|e| e.name() == name)
    }

    /// Linear value of a stored one, 1 = full scale, extended to negative values as an odd
    /// function. For [`Encoding::Pq`], 1 is 203 cd/m², and stored values above 1 are clamped.
    pub fn decode(self, stored: f64) -> f64 {
        match self {
            Self::Linear => stored,
            Self::Srgb if stored.abs() <= 0.040_45 => stored / 12.92,
            Self::Srgb => ((stored.abs() + 0.055) / 1.055).powf(2.4).copysign(stored),
            Self::Gamma22 => stored.abs().powf(2.2).copysign(stored),
            Self::Hlg => hlg::decode(stored.abs()).copysign(stored),
            Self::Pq => (pq::decode(stored.abs()) / REFERENCE_WHITE).copysign(stored),
        }
    }

    /// Inverse of [`Encoding::decode`].
    pub fn encode(self, linear: f64) -> f64 {
        match self {
            Self::Linear => linear,
            Self::Srgb if linear.abs() <= 0.003_130_8 => linear * 12.92,
            Self::Srgb => (1.055 * linear.abs().powf(1.0 / 2.4) - 0.055).copysign(linear),
            Self::Gamma22 => linear.abs().powf(1.0 / 2.2).copysign(linear),
            Self::Hlg => hlg::encode(linear.abs()).copysign(linear),
            Self::Pq => pq::encode(linear.abs() * REFERENCE_WHITE).copysign(linear),
        }
    }

    /// Linear values of all 8-bit values.
    pub(super) fn table8(self) -> &'static [f32; 256] {
        static TABLES: [OnceLock<Box<[f32; 256]>>; Encoding::ALL.len()] =
            [const { OnceLock::new() }; Encoding::ALL.len()];
        TABLES[self as usize].get_or_init(|| self.table())
    }

    /// Linear values of all 16-bit values.
    pub(super) fn table16(self) -> &'static [f32; 65536] {
        static TABLES: [OnceLock<Box<[f32; 65536]>>; Encoding::ALL.len()] =
            [const { OnceLock::new() }; Encoding::ALL.len()];
        TABLES[self as usize].get_or_init(|| self.table())
    }

    fn table<const N: usize>(self) -> Box<[f32; N]> {
        let scale = ((N - 1) as f64).recip();
        let values: Box<[f32]> = (0..N).map(|i| self.decode(i as f64 * scale) as f32).collect();
        values.try_into().expect("N values")
    }
}

/// Hybrid log-gamma, ITU-R BT.2100 table 5: signal and scene light, both 0 to 1.
mod hlg {
    const A: f64 = 0.178_832_77;
    const B: f64 = 1.0 - 4.0 * A;

    /// 0.5 - a ln(4 a), by the standard.
    fn c() -> f64 {
        0.5 - A * (4.0 * A).ln()
    }

    pub fn decode(signal: f64) -> f64 {
        if signal <= 0.5 { signal * signal / 3.0 } else { (((signal - c()) / A).exp() + B) / 12.0 }
    }

    pub fn encode(light: f64) -> f64 {
        if light <= 1.0 / 12.0 { (3.0 * light).sqrt() } else { A * (12.0 * light - B).ln() + c() }
    }
}

/// Perceptual quantiser, ITU-R BT.2100 table 4: signal 0 to 1, light in cd/m².
mod pq {
    const PEAK: f64 = 10_000.0;
    const M1: f64 = 2610.0 / 16384.0;
    const M2: f64 = 2523.0 / 4096.0 * 128.0;
    const C1: f64 = 3424.0 / 4096.0;
    const C2: f64 = 2413.0 / 4096.0 * 32.0;
    const C3: f64 = 2392.0 / 4096.0 * 32.0;

    pub fn decode(signal: f64) -> f64 {
        // The curve has a pole slightly above 1.
        let x = signal.min(1.0).powf(1.0 / M2);
        PEAK * ((x - C1).max(0.0) / (C2 - C3 * x)).powf(1.0 / M1)
    }

    pub fn encode(light: f64) -> f64 {
        let y = (light / PEAK).powf(M1);
        ((C1 + C2 * y) / (1.0 + C3 * y)).powf(M2)
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
                if encoding == Encoding::Pq && v.abs() > 1.0 {
                    continue;
                }
                // The branches of sRGB meet within 1e-7, because the standard rounds; PQ's OETF is 7e-7 at 0.
                assert!((encoding.encode(encoding.decode(v)) - v).abs() < 1e-6, "{encoding:?} {v}");
            }
        }
        // IEC 61966-2-1: 0.5 is 0.2140 linear; by the power law 0.2176.
        assert!((Encoding::Srgb.decode(0.5) - 0.214_041).abs() < 1e-6);
        assert!((Encoding::Gamma22.decode(0.5) - 0.217_638).abs() < 1e-6);
        // ITU-R BT.2408 table 1: a reference white of 203 cd/m² is 58 % of PQ and 75 % of HLG.
        assert!((Encoding::Pq.encode(1.0) - 0.58).abs() < 0.005);
        assert!((Encoding::Hlg.decode(0.75) - 0.265).abs() < 5e-4);
        // SMPTE ST 2084: 100 cd/m² are 0.508 078 of the signal, 10 000 all of it.
        assert!((Encoding::Pq.decode(0.508_078) * 203.0 - 100.0).abs() < 1e-3);
        assert!((Encoding::Pq.decode(1.0) * 203.0 - 10_000.0).abs() < 1e-6);
        assert_eq!(Encoding::Pq.decode(1.5), Encoding::Pq.decode(1.0));
        // ITU-R BT.2100: 1/12 of the light is half the signal; full light is full signal.
        assert!((Encoding::Hlg.decode(0.5) - 1.0 / 12.0).abs() < 1e-12);
        assert!((Encoding::Hlg.decode(1.0) - 1.0).abs() < 1e-7);
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
