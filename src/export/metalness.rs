//! Base colour, metalness and specular colour of glTF that are exact with `KHR_materials_specular`
//! and `KHR_materials_ior`, and approximate for importers that ignore these.
//!
//! With the dielectric's reflectance `S` (index of refraction times specular colour), glTF renders
//! `kd = (1 - m) b (1 - max S)`, `F0 = m b + (1 - m) S`. For most values of the metalness `m`, some
//! `b` and `S` give any `kd` and `F0`. Importers without the extensions use 0.04 for `S`, so the
//! stored metalness is the one with the least error there.

use super::convert::Albedos;

/// Reflectance of the dielectric in importers without the extensions.
const PLAIN: f32 = 0.04;
/// Metalness steps in 8 bits.
const STEPS: i32 = 255;
/// Distance of the steps in the coarse search.
const COARSE: i32 = 15;
/// Squared albedo error below which metalness stays 0.
const NEAR: f32 = 1e-5;
/// Smallest diffuse albedo that counts.
const BLACK: f32 = 1e-4;
/// Largest reflectance of a dielectric; at 1 no light would pass.
const MAX: f32 = 0.98;

/// A texel for glTF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layer {
    /// A multiple of 1/255.
    pub metallic: f32,
    pub base: [f32; 3],
    /// Reflectance of the dielectric at normal incidence.
    pub dielectric: [f32; 3],
}

impl Layer {
    /// The layer of a texel's albedos.
    pub fn of(albedos: &Albedos) -> Self {
        let plain = Self::at(albedos, 0).unwrap_or_else(|| Self {
            metallic: 0.0,
            base: albedos.base_below_coat(),
            dielectric: albedos.specular,
        });
        let mut best = (plain.cost(albedos), 0, plain);
        if best.0 < NEAR {
            return plain;
        }
        if albedos.diffuse.iter().all(|kd| *kd < BLACK) {
            return Self { metallic: 1.0, base: albedos.specular, dielectric: [PLAIN; 3] };
        }
        let mut look = |steps: &mut dyn Iterator<Item = i32>| {
            for step in steps.filter(|step| (1..STEPS).contains(step)) {
                if let Some(layer) = Self::at(albedos, step) {
                    let cost = layer.cost(albedos);
                    if cost < best.0 {
                        best = (cost, step, layer);
                    }
                }
            }
            best.1
        };
        let near = look(&mut (0..=STEPS / COARSE).map(|k| k * COARSE));
        look(&mut (near - COARSE + 1..near + COARSE));
        best.2
    }

    /// The layer with a metalness of `step` steps; `None` if impossible.
    fn at(albedos: &Albedos, step: i32) -> Option<Self> {
        let m = step as f32 / STEPS as f32;
        let rest = 1.0 - m;
        // For one channel the reflectance t solves a quadratic equation; the layer needs the
        // largest of the three.
        let of = |c: usize| {
            let (k, f0) = (albedos.diffuse[c] / rest, albedos.specular[c]);
            let half = 0.5 * (rest + f0);
            let root = half * half - rest * (f0 - m * k);
            // The smaller root in its stable form.
            let t = (f0 - m * k) / (half + root.max(0.0).sqrt());
            (root >= 0.0).then_some(t)
        };
        let largest = of(0)?.max(of(1)?).max(of(2)?);
        if !(0.0..=MAX).contains(&largest) {
            return None;
        }
        let base = albedos.diffuse.map(|kd| kd / (rest * (1.0 - largest)));
        let dielectric = [0, 1, 2].map(|c| (albedos.specular[c] - m * base[c]) / rest);
        let fits = base.iter().all(|b| *b <= 1.0)
            && dielectric.iter().all(|s| (-1e-5..=largest + 1e-4).contains(s));
        fits.then(|| Self { metallic: m, base, dielectric: dielectric.map(|s| s.max(0.0)) })
    }

    /// Albedos without the extensions.
    pub fn plain(&self) -> Albedos {
        let rest = 1.0 - self.metallic;
        Albedos {
            diffuse: self.base.map(|b| (1.0 - PLAIN) * rest * b),
            specular: self.base.map(|b| self.metallic * b + rest * PLAIN),
        }
    }

    /// Squared error of those albedos.
    fn cost(&self, albedos: &Albedos) -> f32 {
        let shown = self.plain();
        let square =
            |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>();
        square(shown.diffuse, albedos.diffuse) + square(shown.specular, albedos.specular)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// glTF's formulas with both extensions.
    fn exact(layer: &Layer) -> Albedos {
        let rest = 1.0 - layer.metallic;
        let largest = layer.dielectric.into_iter().fold(0.0, f32::max);
        Albedos {
            diffuse: layer.base.map(|b| rest * b * (1.0 - largest)),
            specular: std::array::from_fn(|c| {
                layer.metallic * layer.base[c] + rest * layer.dielectric[c]
            }),
        }
    }

    proptest! {
        #[test]
        fn layers_are_exact_and_never_worse_without_extensions_than_no_metal(
            diffuse in prop::array::uniform3(0.0..0.6f32),
            specular in prop::array::uniform3(0.0..0.4f32),
        ) {
            let albedos = Albedos { diffuse, specular };
            let layer = Layer::of(&albedos);
            let shown = exact(&layer);
            for c in 0..3 {
                // Diffuse albedo below an interface that transmits too little is clipped.
                prop_assert!((shown.diffuse[c] - diffuse[c]).abs() < 1e-4, "{layer:?}");
                prop_assert!((shown.specular[c] - specular[c]).abs() < 1e-4, "{layer:?}");
            }
            let flat = Layer { metallic: 0.0, base: albedos.base_below_coat(), dielectric: specular };
            prop_assert!(layer.cost(&albedos) <= flat.cost(&albedos) + 1e-6);
        }
    }

    #[test]
    fn metals_keep_their_reflectance_without_extensions() {
        // The remaining diffuse albedo limits the hue of the base colour if it is to be exact.
        for (diffuse, allowed) in
            [([0.0; 3], 1e-6), ([0.02, 0.015, 0.008], 0.1), ([0.06, 0.05, 0.05], 0.5)]
        {
            let gold = Albedos { diffuse, specular: [0.9, 0.7, 0.35] };
            let layer = Layer::of(&gold);
            let plain = layer.plain();
            for c in 0..3 {
                // Black would be wrong by 0.9.
                let off = [plain.specular[c] - gold.specular[c], plain.diffuse[c] - diffuse[c]];
                assert!(off.iter().all(|off| off.abs() <= allowed), "{layer:?} {plain:?}");
            }
        }
        let plastic = Albedos { diffuse: [0.3, 0.2, 0.1], specular: [0.04; 3] };
        assert_eq!(Layer::of(&plastic).metallic, 0.0);
    }
}
