//! Formulas between this library's BRDF and those of other renderers, texel by texel.
//!
//! The library adds `kd / pi` to a GGX lobe with the Fresnel reflectance `F0` at normal incidence and
//! has no factor on the diffuse part. Others weaken the diffuse part by what the surface reflects,
//! know one index of refraction a material, or have a metalness in place of a specular colour.

/// Largest reflectance that an index of refraction is stated for: at 1 it would be infinite.
const MAX_F0: f32 = 0.999;

/// Cost of metalness in squared albedo: decides between splits that are equally good.
const METALNESS_COST: f32 = 1e-6;

/// A texel's diffuse albedo and specular albedo F0, linear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Albedos {
    pub diffuse: [f32; 3],
    pub specular: [f32; 3],
}

impl Albedos {
    /// Largest channel of F0.
    pub fn max_f0(&self) -> f32 {
        self.specular.into_iter().fold(0.0, f32::max)
    }

    /// Base colour of renderers that multiply the diffuse part by `1 - max F0` at normal incidence
    /// (glTF, Unity URP's specular set-up): `kd / (1 - max F0)`, at most 1.
    pub fn base_below_coat(&self) -> [f32; 3] {
        let share = (1.0 - self.max_f0()).max(1.0 - MAX_F0);
        self.diffuse.map(|kd| (kd / share).min(1.0))
    }
}

/// One index of refraction for a material whose largest F0 is given, and the F0 it stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interface {
    pub ior: f32,
    pub f0: f32,
}

impl Interface {
    /// `ior = (1 + s) / (1 - s)`, `s = sqrt(F0)`.
    pub fn of(max_f0: f32) -> Self {
        let f0 = max_f0.clamp(0.0, MAX_F0);
        let s = f0.sqrt();
        Self { ior: (1.0 + s) / (1.0 - s), f0 }
    }

    /// Colour that scales the interface's F0 to a texel's, at most 1.
    pub fn tint(&self, specular: [f32; 3]) -> [f32; 3] {
        specular.map(|f| if self.f0 > 0.0 { (f / self.f0).min(1.0) } else { 1.0 })
    }
}

/// How a renderer makes albedos of base colour and metalness:
/// `kd = diffuse (1 - m) base`, `F0 = d (1 - m) + m base` with the dielectric's reflectance `d`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MetallicModel {
    /// Share of the light that reaches the diffuse layer of a dielectric.
    pub diffuse: f32,
    /// Reflectance of a dielectric at normal incidence: fixed, or free in a range.
    pub dielectric: Dielectric,
}

/// Reflectance of the dielectric part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Dielectric {
    Fixed(f32),
    /// From 0 to this, a value of each texel.
    UpTo(f32),
}

impl MetallicModel {
    /// glTF without extensions: the diffuse layer gets what the interface of index 1.5 lets through.
    pub const GLTF: Self = Self { diffuse: 0.96, dielectric: Dielectric::Fixed(0.04) };
    /// USD's preview surface and Unity's HDRP: no loss at the interface.
    pub const LOSSLESS: Self = Self { diffuse: 1.0, dielectric: Dielectric::Fixed(0.04) };
    /// Unreal: no loss, reflectance of 0.08 times the value of `Specular`.
    pub const UNREAL: Self = Self { diffuse: 1.0, dielectric: Dielectric::UpTo(0.08) };

    /// Albedos that a renderer of this kind shows.
    pub fn albedos(&self, split: &Split) -> Albedos {
        let (m, d) = (split.metallic, split.dielectric);
        Albedos {
            diffuse: split.base.map(|b| self.diffuse * (1.0 - m) * b),
            specular: split.base.map(|b| d * (1.0 - m) + m * b),
        }
    }

    /// The split that differs least from the albedos: least squares over the six values, found by a
    /// search over the metalness, for each of which the base colour is a closed form.
    pub fn split(&self, albedos: &Albedos) -> Split {
        const STEPS: usize = 16;
        let cost = |m: f32| {
            let split = self.at(albedos, m);
            (split.squared_error(self, albedos) + METALNESS_COST * m, split)
        };
        let flat = cost(0.0);
        if flat.0 < METALNESS_COST / STEPS as f32 {
            return flat.1;
        }
        let step = 1.0 / STEPS as f32;
        let (mut centre, mut best) = (0.0, flat);
        for i in 1..=STEPS {
            let m = i as f32 * step;
            let candidate = cost(m);
            if candidate.0 < best.0 {
                (centre, best) = (m, candidate);
            }
        }
        // Golden section between the neighbours of the best sample.
        let ratio = 0.5 * (5f32.sqrt() - 1.0);
        let (mut low, mut high) = ((centre - step).max(0.0), (centre + step).min(1.0));
        for _ in 0..18 {
            let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
            let (at_a, at_b) = (cost(a), cost(b));
            let lower = if at_a.0 <= at_b.0 { at_a } else { at_b };
            if at_a.0 <= at_b.0 {
                high = b
            } else {
                low = a
            }
            if lower.0 < best.0 {
                best = lower;
            }
        }
        best.1
    }

    /// Best base colour (and dielectric, where free) for a metalness.
    fn at(&self, albedos: &Albedos, m: f32) -> Split {
        let k = self.diffuse * (1.0 - m);
        let dielectric = match self.dielectric {
            Dielectric::Fixed(d) => d,
            Dielectric::UpTo(limit) => self.best_dielectric(albedos, m, limit),
        };
        let base = std::array::from_fn(|c| best_base(albedos, c, k, m, dielectric).clamp(0.0, 1.0));
        Split { base, metallic: m, dielectric }
    }

    /// The dielectric's reflectance, from 0 to `limit`, that is best together with the base colours
    /// that are best for it. Their cost is convex in it and its derivative piecewise linear, as base
    /// colours stop at 0 and 1: Newton's steps end in few.
    fn best_dielectric(&self, albedos: &Albedos, m: f32, limit: f32) -> f32 {
        let (k, mut d) = (self.diffuse * (1.0 - m), 0.5 * limit);
        if k <= 0.0 {
            return 0.0;
        }
        for _ in 0..8 {
            let (mut residual, mut slope) = (0.0, 0.0);
            for c in 0..3 {
                let base = best_base(albedos, c, k, m, d);
                residual += albedos.specular[c] - d * (1.0 - m) - m * base.clamp(0.0, 1.0);
                let is_free = (0.0..=1.0).contains(&base);
                slope += (1.0 - m) * if is_free { k * k / (k * k + m * m) } else { 1.0 };
            }
            let next = (d + residual / slope).clamp(0.0, limit);
            if (next - d).abs() < 1e-6 {
                return next;
            }
            d = next;
        }
        d
    }
}

/// Best base colour of channel `c` for a metalness, beyond its range where it would be better there.
fn best_base(albedos: &Albedos, c: usize, k: f32, m: f32, dielectric: f32) -> f32 {
    let metal = albedos.specular[c] - dielectric * (1.0 - m);
    (k * albedos.diffuse[c] + m * metal) / (k * k + m * m)
}

/// Base colour and metalness in place of two albedos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Split {
    pub base: [f32; 3],
    pub metallic: f32,
    /// Reflectance of the dielectric part.
    pub dielectric: f32,
}

impl Split {
    /// Sum of the squared differences of all six albedos.
    pub fn squared_error(&self, model: &MetallicModel, albedos: &Albedos) -> f32 {
        let shown = model.albedos(self);
        let square = |a: [f32; 3], b: [f32; 3]| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>();
        square(shown.diffuse, albedos.diffuse) + square(shown.specular, albedos.specular)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    prop_compose! {
        fn albedos()(v in [0.0..0.9f32, 0.0..0.9f32, 0.0..0.9f32, 0.0..0.9f32, 0.0..0.9f32,
            0.0..0.9f32]) -> Albedos {
            Albedos { diffuse: [v[0], v[1], v[2]], specular: [v[3], v[4], v[5]] }
        }
    }

    const MODELS: [MetallicModel; 3] =
        [MetallicModel::GLTF, MetallicModel::LOSSLESS, MetallicModel::UNREAL];

    #[test]
    fn the_index_of_refraction_gives_back_its_reflectance() {
        // Water, glass, diamond: indices and reflectances from the Fresnel equations.
        for (ior, f0) in [(1.0f32, 0.0f32), (1.333, 0.020_37), (1.5, 0.04), (2.417, 0.171_98)] {
            assert!((Interface::of(f0).ior - ior).abs() < 1e-3);
        }
        let mirror = Interface::of(1.0);
        assert!(mirror.ior.is_finite() && mirror.tint([1.0; 3]) == [1.0; 3]);
        assert_eq!(Interface::of(0.0).tint([0.0; 3]), [1.0; 3]);
    }

    #[test]
    fn plain_dielectrics_and_metals_are_split_exactly() {
        let plastic = Albedos { diffuse: [0.3, 0.2, 0.1], specular: [0.04; 3] };
        let gold = Albedos { diffuse: [0.0; 3], specular: [1.0, 0.77, 0.34] };
        for model in MODELS {
            let split = model.split(&plastic);
            assert_eq!(split.metallic, 0.0);
            assert!(split.squared_error(&model, &plastic) < 1e-9);
            let split = model.split(&gold);
            // The golden section ends within 3e-5 of the limit.
            assert!(split.metallic > 0.9999 && split.squared_error(&model, &gold) < 1e-8);
        }
        let lacquer = Albedos { diffuse: [0.4, 0.4, 0.1], specular: [0.07; 3] };
        let split = MetallicModel::UNREAL.split(&lacquer);
        assert_eq!((split.metallic, split.dielectric), (0.0, 0.07));
    }

    proptest! {
        /// A dense search over metalness and base colour, which knows no closed form, finds
        /// nothing better: a grid of 1/50 is within (1/100)² x 6 of the least cost.
        #[test]
        fn no_other_split_is_better(albedos in albedos(), which in 0usize..3) {
            let model = MODELS[which];
            let split = model.split(&albedos);
            let found = split.squared_error(&model, &albedos);
            let limit = match model.dielectric { Dielectric::Fixed(d) => d..=d, Dielectric::UpTo(d) => 0.0..=d };
            for i in 0..=50 {
                let m = i as f32 / 50.0;
                for dielectric in [*limit.start(), 0.5 * (limit.start() + limit.end()), *limit.end()] {
                    let mut error = 0.0;
                    for c in 0..3 {
                        let channel = |base: f32| {
                            let shown = model.albedos(&Split { base: [base; 3], metallic: m, dielectric });
                            (shown.diffuse[0] - albedos.diffuse[c]).powi(2)
                                + (shown.specular[0] - albedos.specular[c]).powi(2)
                        };
                        error += (0..=50).map(|b| channel(b as f32 / 50.0)).fold(f32::MAX, f32::min);
                    }
                    // Sixteen samples of the metalness may take the other of two minima of like depth.
                    prop_assert!(found <= 1.01 * error + 2e-5, "{found} for {error} at {m} {dielectric}");
                }
            }
        }

        /// What was made of base colour and metalness comes back as the same albedos.
        #[test]
        fn metallic_materials_lose_nothing(base in [0.05..1.0f32, 0.05..1.0f32, 0.05..1.0f32],
            metallic in 0.0..1.0f32, which in 0usize..2) {
            let model = MODELS[which];
            let albedos = model.albedos(&Split { base, metallic, dielectric: 0.04 });
            let error = model.split(&albedos).squared_error(&model, &albedos);
            // The cost of metalness moves the optimum by its own size.
            prop_assert!(error < 2.0 * METALNESS_COST, "{error}");
        }

        #[test]
        fn the_base_colour_below_the_interface_inverts(albedos in albedos()) {
            let share = 1.0 - albedos.max_f0();
            for (base, kd) in albedos.base_below_coat().into_iter().zip(albedos.diffuse) {
                prop_assert!(base == 1.0 || (base * share - kd).abs() < 1e-6);
            }
        }
    }
}
