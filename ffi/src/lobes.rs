//! Optional lobes in the terms of glTF's `KHR_materials_anisotropy` and `KHR_materials_clearcoat`. The Python
//! module and the web page compile this file as well.
// Each of the three uses a part of it.
#![allow(dead_code)]

use engine::Svbrdf;
use engine::svbrdf::{LOBE_RANGE, LOBES, NO_LOBES, channel, lobe};

/// Which optional lobes a material shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shown {
    pub anisotropy: bool,
    pub coat: bool,
}

impl Shown {
    /// A lobe is shown where it is there at any texel.
    pub(crate) fn of(maps: &Svbrdf) -> Self {
        let any = |lobe| maps.lobe(lobe).is_some_and(|plane| plane.iter().any(|v| *v != 0.0));
        let anisotropy = any(lobe::ANISOTROPY_X) || any(lobe::ANISOTROPY_Y);
        Self { anisotropy, coat: any(lobe::COAT) }
    }
}

/// Roughness and anisotropy of a texel as glTF states them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Glossiness {
    /// Square root of the smaller alpha.
    pub roughness: f32,
    /// Cosine and sine of the direction of the larger alpha, counter-clockwise from X.
    pub direction: [f32; 2],
    /// The larger alpha is `mix(alpha, 1, strength²)` of the smaller one.
    pub strength: f32,
}

/// Least roughness whose logarithm is taken.
const LEAST_ROUGHNESS: f32 = 1e-3;

impl Glossiness {
    /// Of a texel.
    pub(crate) fn of(maps: &Svbrdf, texel: usize) -> Self {
        let part = |lobe| maps.lobe(lobe).map_or(0.0, |plane| plane[texel]);
        let anisotropy = [part(lobe::ANISOTROPY_X), part(lobe::ANISOTROPY_Y)];
        Self::from_natural(maps.plane(channel::ROUGHNESS)[texel], anisotropy)
    }

    /// Of the roughness of the geometric mean of both alphas, and the logarithm of their ratio times the
    /// cosine and sine of twice the direction.
    pub(crate) fn from_natural(mean: f32, [x, y]: [f32; 2]) -> Self {
        let log_ratio = x.hypot(y);
        let roughness = mean * (-0.25 * log_ratio).exp();
        let (alpha, angle) = (roughness * roughness, 0.5 * y.atan2(x));
        // The larger alpha ends at 1.
        let share = alpha * log_ratio.exp_m1() / (1.0 - alpha).max(f32::MIN_POSITIVE);
        let strength = share.min(1.0).sqrt();
        Self { roughness, direction: [angle.cos(), angle.sin()], strength }
    }

    /// The inverse. Ratios beyond the range of the maps end there.
    pub(crate) fn to_natural(self) -> (f32, [f32; 2]) {
        let roughness = self.roughness.max(LEAST_ROUGHNESS);
        let alpha = roughness * roughness;
        let rise = self.strength * self.strength * (1.0 - alpha) / alpha;
        if rise <= 0.0 {
            return (self.roughness, [0.0; 2]);
        }
        let log_ratio = rise.ln_1p().min(LOBE_RANGE[lobe::ANISOTROPY_X].1);
        let mean = (roughness * (0.25 * log_ratio).exp()).min(1.0);
        let angle = 2.0 * self.direction[1].atan2(self.direction[0]);
        (mean, [log_ratio * angle.cos(), log_ratio * angle.sin()])
    }
}

/// Weight and roughness of a texel's coat.
pub(crate) fn coat(maps: &Svbrdf, texel: usize) -> [f32; 2] {
    [lobe::COAT, lobe::COAT_ROUGHNESS].map(|lobe| maps.lobe(lobe).map_or(0.0, |plane| plane[texel]))
}

/// Planes of roughness and optional lobes; none of the latter without anisotropy and coat. Each texel of
/// `anisotropy` is cosine and sine of the direction, and strength; each of `coat` weight and roughness.
pub(crate) fn planes(
    mut roughness: Vec<f32>,
    anisotropy: Option<impl Iterator<Item = [f32; 3]>>,
    coat: Option<impl Iterator<Item = [f32; 2]>>,
) -> (Vec<f32>, Vec<f32>) {
    if anisotropy.is_none() && coat.is_none() {
        return (roughness, Vec::new());
    }
    let texels = roughness.len();
    let mut lobes = vec![0.0; LOBES * texels];
    lobes[lobe::COAT_ROUGHNESS * texels..].fill(NO_LOBES[lobe::COAT_ROUGHNESS] as f32);
    for (i, [cos, sin, strength]) in anisotropy.into_iter().flatten().enumerate() {
        let given = Glossiness { roughness: roughness[i], direction: [cos, sin], strength };
        let (mean, [x, y]) = given.to_natural();
        roughness[i] = mean;
        lobes[lobe::ANISOTROPY_X * texels + i] = x;
        lobes[lobe::ANISOTROPY_Y * texels + i] = y;
    }
    for (i, [weight, coat_roughness]) in coat.into_iter().flatten().enumerate() {
        lobes[lobe::COAT * texels + i] = weight;
        lobes[lobe::COAT_ROUGHNESS * texels + i] = coat_roughness;
    }
    (roughness, lobes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alphas_are_those_of_gltf_and_come_back() {
        for mean in [0.05, 0.3, 0.5] {
            for ratio in [1.0f32, 1.001, 2.0, 3.0] {
                for degrees in [0.0f32, 20.0, 90.0, 135.0, 179.0] {
                    let twice = (2.0 * degrees).to_radians();
                    let anisotropy = [ratio.ln() * twice.cos(), ratio.ln() * twice.sin()];
                    let found = Glossiness::from_natural(mean, anisotropy);
                    let across = found.roughness * found.roughness;
                    let along = across + (1.0 - across) * found.strength * found.strength;
                    assert!((along / across / ratio - 1.0).abs() < 1e-4, "{found:?}");
                    assert!(((along * across).sqrt().sqrt() / mean - 1.0).abs() < 1e-4);
                    let [cos, sin] = found.direction;
                    assert!((cos * cos + sin * sin - 1.0).abs() < 1e-6);
                    if ratio > 1.0 {
                        // A direction is the same as its opposite.
                        let (c, s) = (degrees.to_radians().cos(), degrees.to_radians().sin());
                        assert!((cos * c + sin * s).abs() > 1.0 - 1e-4, "{found:?} {degrees}");
                    }
                    let (back, [x, y]) = found.to_natural();
                    assert!((back - mean).abs() < 1e-5, "{back} {mean}");
                    assert!((x - anisotropy[0]).abs() + (y - anisotropy[1]).abs() < 2e-4);
                }
            }
        }
    }

    #[test]
    fn isotropic_texels_stay_as_they_are() {
        for roughness in [0.0, 0.02, 0.37, 1.0] {
            let found = Glossiness::from_natural(roughness, [0.0; 2]);
            assert_eq!(found, Glossiness { roughness, direction: [1.0, 0.0], strength: 0.0 });
            assert_eq!(found.to_natural(), (roughness, [0.0; 2]));
        }
    }

    /// The larger alpha may be beyond 1, a smaller one may be 0.
    #[test]
    fn extremes_are_finite() {
        let found = Glossiness::from_natural(1.0, [3.0, 0.0]);
        assert_eq!(found.strength, 1.0);
        let mirror = Glossiness { roughness: 0.0, direction: [0.0, 1.0], strength: 1.0 };
        let (mean, [x, y]) = mirror.to_natural();
        assert!(mean > 0.0 && (x + 3.0).abs() < 1e-5 && y.abs() < 1e-5);
    }
}
