//! Meaning of stored values according to the file.

use moxcms::{Chromaticity, ColorPrimaries, ColorProfile, ToneReprCurve, XyY};

use super::profile::Profile;
use crate::photo::{Encoding, Primaries};

/// Tolerance for a stated gamma.
const SAME_GAMMA: f64 = 0.006;
/// The same for chromaticities, which files round.
const SAME_CHROMATICITY: f64 = 0.004;
/// Chromaticity of D65.
const D65: [f64; 2] = [0.3127, 0.3290];
/// Plausible gammas.
const GAMMAS: std::ops::RangeInclusive<f64> = 0.1..=2.0;

/// Meaning of stored values.
pub enum Colours {
    /// sRGB, stated or by default.
    Srgb,
    /// A curve and primaries with names.
    Named(Encoding, Primaries),
    /// Curves and a matrix.
    Profile(Box<Profile>),
    /// Unusable colours: a clause with the reason.
    Unusable(String),
}

/// Chromaticities (x, y) of white, red, green and blue.
pub type Chromaticities = [[f64; 2]; 4];

impl Colours {
    /// Colours of an ICC profile.
    pub fn of_icc(bytes: &[u8]) -> Self {
        match Profile::parse(bytes) {
            Ok(profile) if profile.is_srgb() => Self::Srgb,
            Ok(profile) => Self::Profile(Box::new(profile)),
            Err(why) => Self::Unusable(format!("its ICC profile cannot be used ({why})")),
        }
    }

    /// Adobe RGB (1998), which cameras state in the Exif block.
    pub fn adobe_rgb() -> Self {
        Self::of_profile(&ColorProfile::new_adobe_rgb())
    }

    /// Colours of code points of ITU-T H.273 (PNG's `cICP`, HEIF's `nclx`).
    pub fn of_code_points(primaries: u8, transfer: u8) -> Self {
        let unusable = |what: &str, code: u8| {
            Self::Unusable(format!("its {what} of code {code} (ITU-T H.273) cannot be used"))
        };
        let primaries = match primaries {
            // "Unspecified" means the default.
            1 | 2 => Primaries::Rec709,
            9 => Primaries::Rec2020,
            12 => Primaries::DisplayP3,
            other => return unusable("primaries", other),
        };
        let encoding = match transfer {
            2 | 13 => Encoding::Srgb,
            4 => Encoding::Gamma22,
            8 => Encoding::Linear,
            16 => Encoding::Pq,
            18 => Encoding::Hlg,
            // Cameras apply the curve of BT.709 (four code points) exactly, so invert it exactly.
            1 | 6 | 14 | 15 => {
                let mut profile = icc_of(primaries);
                set_curves(&mut profile, rec709_curve());
                return Self::of_profile(&profile);
            }
            other => return unusable("transfer characteristics", other),
        };
        Self::named(encoding, primaries)
    }

    /// Colours of PNG's `gAMA` and `cHRM`: the exponent from light to stored values, and chromaticities.
    pub fn of_gamma(gamma: Option<f64>, chromaticities: Option<Chromaticities>) -> Self {
        let gamma = gamma.unwrap_or(1.0 / 2.2);
        if !GAMMAS.contains(&gamma) {
            return Self::Unusable(format!("its gamma of {gamma} cannot be used"));
        }
        let near = |other: f64| (gamma - other).abs() < SAME_GAMMA;
        // Writers of sRGB state 0.45455 for programs that know only `gAMA`.
        let encoding = if near(1.0) {
            Some(Encoding::Linear)
        } else if near(1.0 / 2.2) {
            Some(Encoding::Srgb)
        } else {
            None
        };
        let primaries = chromaticities.map_or(Some(Primaries::Rec709), |c| named_primaries(&c));
        if let (Some(encoding), Some(primaries)) = (encoding, primaries) {
            return Self::named(encoding, primaries);
        }
        let mut profile = ColorProfile::new_srgb();
        if let Some([white, red, green, blue]) = chromaticities {
            if ![white, red, green, blue].iter().all(|[x, y]| *x >= 0.0 && *y > 0.0 && x + y <= 1.0)
            {
                return Self::Unusable("its chromaticities cannot be used".into());
            }
            let point = |[x, y]: [f64; 2]| Chromaticity::new(x as f32, y as f32);
            let primaries =
                ColorPrimaries { red: point(red), green: point(green), blue: point(blue) };
            profile.update_rgb_colorimetry(XyY::new(white[0], white[1], 1.0), primaries);
        }
        if encoding != Some(Encoding::Srgb) {
            set_curves(&mut profile, moxcms::curve_from_gamma(gamma.recip() as f32));
        }
        Self::of_profile(&profile)
    }

    fn named(encoding: Encoding, primaries: Primaries) -> Self {
        match (encoding, primaries) {
            (Encoding::Srgb, Primaries::Rec709) => Self::Srgb,
            _ => Self::Named(encoding, primaries),
        }
    }

    fn of_profile(profile: &ColorProfile) -> Self {
        match Profile::of(profile) {
            Ok(profile) => Self::Profile(Box::new(profile)),
            Err(why) => Self::Unusable(format!("its colours cannot be used ({why})")),
        }
    }
}

fn named_primaries(chromaticities: &Chromaticities) -> Option<Primaries> {
    let near = |[x, y]: [f64; 2], [u, v]: [f64; 2]| {
        (x - u).abs() < SAME_CHROMATICITY && (y - v).abs() < SAME_CHROMATICITY
    };
    [Primaries::Rec709, Primaries::DisplayP3, Primaries::Rec2020].into_iter().find(|primaries| {
        let [white, rgb @ ..] = chromaticities;
        near(*white, D65)
            && primaries.chromaticities().iter().zip(rgb).all(|(known, c)| near(*known, *c))
    })
}

fn icc_of(primaries: Primaries) -> ColorProfile {
    match primaries {
        Primaries::Rec709 => ColorProfile::new_srgb(),
        Primaries::DisplayP3 => ColorProfile::new_display_p3(),
        Primaries::Rec2020 => ColorProfile::new_bt2020(),
    }
}

fn set_curves(profile: &mut ColorProfile, curve: ToneReprCurve) {
    profile.red_trc = Some(curve.clone());
    profile.green_trc = Some(curve.clone());
    profile.blue_trc = Some(curve);
    profile.cicp = None;
}

/// ITU-R BT.709 from stored values to light, as ICC's parametric curve of type 3. The two parts
/// meet with the constants of 12-bit BT.2020; those of BT.709 are rounded.
fn rec709_curve() -> ToneReprCurve {
    const ALPHA: f32 = 1.099_296_8;
    const BETA: f32 = 0.018_053_97;
    let (a, b) = (1.0 / ALPHA, (ALPHA - 1.0) / ALPHA);
    ToneReprCurve::Parametric(vec![1.0 / 0.45, a, b, 1.0 / 4.5, 4.5 * BETA])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Linear Rec. 709 of one stored colour.
    fn linear(colours: &Colours, stored: [f32; 3]) -> [f32; 3] {
        let mut rgb = stored;
        match colours {
            Colours::Srgb => rgb.map(|v| Encoding::Srgb.decode(f64::from(v)) as f32),
            Colours::Named(encoding, primaries) => {
                let light = rgb.map(|v| encoding.decode(f64::from(v)) as f32);
                primaries.to_rec709().map(|row| row.iter().zip(light).map(|(m, v)| m * v).sum())
            }
            Colours::Profile(profile) => {
                profile.apply(&mut rgb, 2.0);
                rgb
            }
            Colours::Unusable(why) => panic!("{why}"),
        }
    }

    #[test]
    fn gamma_and_chromaticities_of_png() {
        let chromaticities = |p: Primaries| {
            let [r, g, b] = p.chromaticities();
            Some([D65, r, g, b])
        };
        let p3 = chromaticities(Primaries::DisplayP3);
        assert!(matches!(Colours::of_gamma(Some(0.45455), None), Colours::Srgb));
        assert!(matches!(
            Colours::of_gamma(Some(1.0), None),
            Colours::Named(Encoding::Linear, Primaries::Rec709)
        ));
        assert!(matches!(
            Colours::of_gamma(Some(1.0), p3),
            Colours::Named(Encoding::Linear, Primaries::DisplayP3)
        ));
        let old = linear(&Colours::of_gamma(Some(1.0 / 1.8), None), [0.5; 3]);
        assert!(old.iter().all(|v| (v - 0.5f32.powf(1.8)).abs() < 1e-3), "{old:?}");
        // Compare primaries without a name, shifted slightly from P3, in moxcms and in this module.
        let [white, [rx, ry], green, blue] = p3.unwrap();
        let moved = Some([white, [rx - 0.01, ry], green, blue]);
        let (a, b) = (Colours::of_gamma(Some(1.0), p3), Colours::of_gamma(Some(1.0), moved));
        assert!(matches!(b, Colours::Profile(_)));
        let (a, b) = (linear(&a, [0.5, 0.3, 0.4]), linear(&b, [0.5, 0.3, 0.4]));
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.02), "{a:?} {b:?}");
        for nonsense in [0.0, 1e3, f64::NAN] {
            assert!(matches!(Colours::of_gamma(Some(nonsense), None), Colours::Unusable(_)));
        }
        let flat = Some([[0.0; 2]; 4]);
        assert!(matches!(Colours::of_gamma(Some(1.0), flat), Colours::Unusable(_)));
    }

    #[test]
    fn code_points() {
        assert!(matches!(Colours::of_code_points(1, 13), Colours::Srgb));
        assert!(matches!(
            Colours::of_code_points(9, 16),
            Colours::Named(Encoding::Pq, Primaries::Rec2020)
        ));
        assert!(matches!(Colours::of_code_points(99, 13), Colours::Unusable(_)));
        assert!(matches!(Colours::of_code_points(1, 99), Colours::Unusable(_)));
        // ITU-R BT.709: half the light is a signal of 1.099 * 0.5^0.45 - 0.099.
        let signal = 1.099 * 0.5f32.powf(0.45) - 0.099;
        let half = linear(&Colours::of_code_points(1, 1), [signal; 3]);
        assert!(half.iter().all(|v| (v - 0.5).abs() < 1e-3), "{half:?}");
    }
}
