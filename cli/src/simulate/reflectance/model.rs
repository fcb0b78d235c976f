//! Random reflectance beyond one lobe of isotropic GGX on a Lambertian base.

use std::f64::consts::{FRAC_PI_2, PI};

use clap::ValueEnum;
use glam::DVec2;
use serde::Serialize;
use svbrdf::random::Random;

use super::sheen::Sheen;

/// Kinds of lobes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Lobe {
    /// GGX with exact Smith masking
    Ggx,
    /// Beckmann
    Beckmann,
    /// Between GGX and Beckmann
    ShortTails,
    /// Longer tails than GGX's
    LongTails,
    /// A second, wider lobe of the same F0
    Haze,
    /// Oren-Nayar diffuse
    OrenNayar,
    /// A clear coat
    Coat,
    /// Anisotropic GGX of one direction
    Anisotropic,
    /// Anisotropic GGX whose direction alternates between stripes
    TwoDirections,
    /// The sheen of cloth
    Sheen,
}

/// Exponents of tails shorter and longer than GGX's, which has 2.
const SHORT_TAILS: [f64; 2] = [2.5, 6.0];
const LONG_TAILS: [f64; 2] = [1.6, 1.85];
/// Share of the wider lobe and its roughness relative to the other's, both as alpha.
const HAZE_SHARE: [f64; 2] = [0.1, 0.4];
const HAZE_ALPHA: [f64; 2] = [2.0, 5.0];
/// Standard deviation of the facets' angle of Oren and Nayar, radians.
const OREN_NAYAR: [f64; 2] = [0.2, 0.5];
const COAT_WEIGHT: [f64; 2] = [0.5, 1.0];
const COAT_ALPHA: [f64; 2] = [0.03, 0.15];
/// Roughness across the direction over that along it.
const RATIO: [f64; 2] = [1.5, 4.0];
const STRIPE_MM: [f64; 2] = [6.0, 25.0];
const SHEEN_COLOUR: [f64; 2] = [0.1, 0.6];
const SHEEN_ROUGHNESS: [f64; 2] = [0.25, 0.8];
/// Kinds that seeds choose: all but the last, so that seeds keep their meaning.
const SEEDED: u64 = 9;

/// A second, wider lobe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Haze {
    /// Its share of F0.
    pub share: f64,
    /// Its alpha relative to that of the first lobe.
    pub alpha: f64,
}

/// A dielectric layer of F0 0.04 over the base. Its reflection dims the base.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Coat {
    /// 0 to 1.
    pub weight: f64,
    /// Alpha of its GGX lobe.
    pub alpha: f64,
}

/// Stripes across which the direction turns by a quarter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Stripes {
    /// Width of a stripe.
    pub width_mm: f64,
    /// Direction across the stripes, from +X towards +Y, radians.
    pub azimuth: f64,
}

/// Two roughnesses of a lobe, whose geometric mean is the map's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Anisotropy {
    /// Alpha across over alpha along.
    pub ratio: f64,
    /// Direction of the lesser alpha from +X towards +Y, radians.
    pub azimuth: f64,
    /// Stripes of two directions, if there are two.
    pub stripes: Option<Stripes>,
}

impl Anisotropy {
    /// The direction at a place of the sample, mm.
    pub fn along(&self, place: DVec2) -> DVec2 {
        let odd = self.stripes.is_some_and(|stripes| {
            let across = place.dot(DVec2::from_angle(stripes.azimuth)) / stripes.width_mm;
            across.floor().rem_euclid(2.0) == 1.0
        });
        DVec2::from_angle(self.azimuth + if odd { FRAC_PI_2 } else { 0.0 })
    }
}

/// A material's lobes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Model {
    pub lobe: Lobe,
    /// Exponent of Student's t distribution of slopes: 2 is GGX; `None`: Beckmann.
    pub tail_exponent: Option<f64>,
    pub haze: Option<Haze>,
    /// Standard deviation of the angle of diffuse facets, radians; 0: Lambert.
    pub oren_nayar: f64,
    pub coat: Option<Coat>,
    pub anisotropy: Option<Anisotropy>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheen: Option<Sheen>,
}

impl Lobe {
    /// The lobe of a seed. Consecutive seeds have all kinds but sheen in turn.
    pub fn of(seed: u64) -> Self {
        Self::value_variants()[(seed % SEEDED) as usize]
    }
}

impl Model {
    /// GGX alone.
    pub fn ggx() -> Self {
        Self {
            lobe: Lobe::Ggx,
            tail_exponent: Some(2.0),
            haze: None,
            oren_nayar: 0.0,
            coat: None,
            anisotropy: None,
            sheen: None,
        }
    }

    /// One of a kind.
    pub fn draw(lobe: Lobe, random: &mut Random) -> Self {
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * random.uniform();
        let mut model = Self { lobe, ..Self::ggx() };
        match lobe {
            Lobe::Ggx => {}
            Lobe::Beckmann => model.tail_exponent = None,
            Lobe::ShortTails => model.tail_exponent = Some(between(SHORT_TAILS)),
            Lobe::LongTails => model.tail_exponent = Some(between(LONG_TAILS)),
            Lobe::Haze => {
                model.haze = Some(Haze { share: between(HAZE_SHARE), alpha: between(HAZE_ALPHA) });
            }
            Lobe::OrenNayar => model.oren_nayar = between(OREN_NAYAR),
            Lobe::Coat => {
                model.coat =
                    Some(Coat { weight: between(COAT_WEIGHT), alpha: between(COAT_ALPHA) });
            }
            Lobe::Anisotropic | Lobe::TwoDirections => {
                let stripes = (lobe == Lobe::TwoDirections)
                    .then(|| Stripes { width_mm: between(STRIPE_MM), azimuth: between([0.0, PI]) });
                let (ratio, azimuth) = (between(RATIO), between([0.0, PI]));
                model.anisotropy = Some(Anisotropy { ratio, azimuth, stripes });
            }
            Lobe::Sheen => {
                let colour = [0; 3].map(|_| between(SHEEN_COLOUR));
                model.sheen = Some(Sheen { colour, roughness: between(SHEEN_ROUGHNESS) });
            }
        }
        model
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each kind differs in the property of its name alone.
    #[test]
    fn kinds_differ_from_ggx_in_one_thing() {
        let mut random = Random::new(3);
        for (seed, lobe) in Lobe::value_variants().iter().enumerate() {
            if *lobe != Lobe::Sheen {
                assert_eq!(Lobe::of(seed as u64), *lobe);
            }
            let model = Model::draw(*lobe, &mut random);
            let differences = [
                model.tail_exponent != Some(2.0),
                model.haze.is_some(),
                model.oren_nayar > 0.0,
                model.coat.is_some(),
                model.anisotropy.is_some(),
                model.sheen.is_some(),
            ];
            let count = differences.iter().filter(|d| **d).count();
            assert_eq!(count, usize::from(*lobe != Lobe::Ggx), "{model:?}");
        }
    }

    /// Over two stripes the direction comes back, over one it turns by a quarter.
    #[test]
    fn stripes_turn_the_direction() {
        let stripes = Some(Stripes { width_mm: 8.0, azimuth: 0.0 });
        let anisotropy = Anisotropy { ratio: 2.0, azimuth: 0.3, stripes };
        let along = |x: f64| anisotropy.along(DVec2::new(x, 5.0));
        assert_eq!(along(-7.0), along(9.0));
        assert_eq!(along(1.0), along(-15.0));
        assert!(along(1.0).dot(along(9.0)).abs() < 1e-12);
    }
}
