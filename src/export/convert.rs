//! Conversions between this library's BRDF and those of other renderers, per texel.
//!
//! The library adds `kd / pi` to a GGX lobe with the Fresnel reflectance `F0` at normal incidence, without a
//! factor on the diffuse part. Other renderers reduce the diffuse part by the reflected light, have one index
//! of refraction per material, or use metalness in place of a specular colour.

/// Largest reflectance with an index of refraction; the index diverges at 1.
const MAX_F0: f32 = 0.999;

/// Cost of metalness in squared albedo, which decides between equally good splits.
const METALNESS_COST: f32 = 1e-6;

/// Metalness values above 0 of the coarse search.
const STEPS: usize = 16;
const METALNESSES: [f32; STEPS] = {
    let mut all = [0.0; STEPS];
    let mut i = 0;
    while i < STEPS {
        all[i] = (i + 1) as f32 / STEPS as f32;
        i += 1;
    }
    all
};

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

/// An index of refraction for a given largest F0, and the F0 of that index.
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

/// Conversion of base colour and metalness to albedos in a renderer: `kd = diffuse (1 - m) base`,
/// `F0 = d (1 - m) + m base` with the dielectric's reflectance `d`.
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
    /// A value per texel, from 0 to this.
    UpTo(f32),
}

impl MetallicModel {
    /// glTF without extensions: the diffuse layer receives the light transmitted at index 1.5.
    pub const GLTF: Self = Self { diffuse: 0.96, dielectric: Dielectric::Fixed(0.04) };
    /// USD's preview surface and Unity's HDRP: no loss at the interface.
    pub const LOSSLESS: Self = Self { diffuse: 1.0, dielectric: Dielectric::Fixed(0.04) };
    /// Unreal: no loss, reflectance of 0.08 times the value of `Specular`.
    pub const UNREAL: Self = Self { diffuse: 1.0, dielectric: Dielectric::UpTo(0.08) };

    /// Albedos of a split in this renderer.
    pub fn albedos(&self, split: &Split) -> Albedos {
        let (m, d) = (split.metallic, split.dielectric);
        Albedos {
            diffuse: split.base.map(|b| self.diffuse * (1.0 - m) * b),
            specular: split.base.map(|b| d * (1.0 - m) + m * b),
        }
    }

    /// The split nearest to the albedos, by least squares over the six values. Base colour (and
    /// dielectric, if free) have a nearly closed form for each metalness. The metalness comes from
    /// a coarse search, refined to where the slope of the cost is 0.
    pub fn split(&self, albedos: &Albedos) -> Split {
        let flat = self.tried(albedos, [0.0]);
        if flat.cost[0] < METALNESS_COST / STEPS as f32 {
            return flat.split(0);
        }
        let grid = self.tried(albedos, METALNESSES);
        let mut at = 0;
        let mut best = (flat.cost[0], flat.split(0));
        for i in 0..STEPS {
            if grid.cost[i] < best.0 {
                (at, best) = (i + 1, (grid.cost[i], grid.split(i)));
            }
        }
        let end = |i: usize| match i {
            0 => (0.0, flat.slope[0]),
            _ => (grid.metallic[i - 1], grid.slope[i - 1]),
        };
        let bracket = if end(at).1 > 0.0 {
            [end(at.saturating_sub(1)), end(at)]
        } else {
            [end(at), end((at + 1).min(STEPS))]
        };
        self.refined(albedos, best, bracket)
    }

    /// The best of a split with its cost and of those tried on the way to zero slope, by regula
    /// falsi (the Illinois algorithm) between two metalness values with known slopes.
    fn refined(
        &self,
        albedos: &Albedos,
        mut best: (f32, Split),
        [mut low, mut high]: [(f32, f32); 2],
    ) -> Split {
        // Least gain worth a step, in squared albedo.
        const LEAST_GAIN: f32 = 0.01 * METALNESS_COST;
        let mut last = 0.0;
        for _ in 0..12 {
            if low.1 >= 0.0 || high.1 <= 0.0 {
                break;
            }
            let m = (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1);
            let tried = self.tried(albedos, [m.clamp(low.0, high.0)]);
            let (cost, slope) = (tried.cost[0], tried.slope[0]);
            if cost < best.0 {
                best = (cost, tried.split(0));
            }
            if slope.abs() * (high.0 - low.0) < LEAST_GAIN {
                break;
            }
            // Illinois: halve the weight of an end that stays twice.
            if slope > 0.0 {
                high = (tried.metallic[0], slope);
                low.1 *= if last > 0.0 { 0.5 } else { 1.0 };
            } else {
                low = (tried.metallic[0], slope);
                high.1 *= if last < 0.0 { 0.5 } else { 1.0 };
            }
            last = slope;
        }
        best.1
    }

    /// The best splits for several metalness values, all at once for vectorisation.
    fn tried<const N: usize>(&self, albedos: &Albedos, metallic: [f32; N]) -> Tried<N> {
        let dielectric = match self.dielectric {
            Dielectric::Fixed(d) => [d; N],
            Dielectric::UpTo(limit) => self.best_dielectrics(albedos, &metallic, limit),
        };
        let cost = metallic.map(|m| METALNESS_COST * m);
        let (mut base, mut cost, mut slope) = ([[0.0; N]; 3], cost, [METALNESS_COST; N]);
        for c in 0..3 {
            for i in 0..N {
                let (m, d) = (metallic[i], dielectric[i]);
                let k = self.diffuse * (1.0 - m);
                let b = best_base(albedos, c, k, m, d).clamp(0.0, 1.0);
                let diffuse = albedos.diffuse[c] - k * b;
                let specular = albedos.specular[c] - d * (1.0 - m) - m * b;
                base[c][i] = b;
                cost[i] += diffuse * diffuse + specular * specular;
                // Base colour and dielectric are optimal, so their part of the slope is 0.
                slope[i] += 2.0 * (diffuse * self.diffuse * b + specular * (d - b));
            }
        }
        Tried { metallic, base, dielectric, cost, slope }
    }

    /// The dielectrics' reflectances from 0 to `limit` that are optimal together with their base
    /// colours. The cost is convex with a piecewise linear derivative (base colours are clipped to
    /// 0 and 1), so Newton's method needs few steps.
    fn best_dielectrics<const N: usize>(
        &self,
        albedos: &Albedos,
        metallic: &[f32; N],
        limit: f32,
    ) -> [f32; N] {
        let mut best = [0.5 * limit; N];
        for _ in 0..8 {
            let (mut residual, mut slope) = ([0.0; N], [0.0; N]);
            for c in 0..3 {
                for i in 0..N {
                    let (m, d) = (metallic[i], best[i]);
                    let k = self.diffuse * (1.0 - m);
                    let base = best_base(albedos, c, k, m, d);
                    residual[i] += albedos.specular[c] - d * (1.0 - m) - m * base.clamp(0.0, 1.0);
                    let is_free = (0.0..=1.0).contains(&base);
                    slope[i] += (1.0 - m) * if is_free { k * k / (k * k + m * m) } else { 1.0 };
                }
            }
            let mut moved = 0.0f32;
            for i in 0..N {
                let step = if slope[i] > 0.0 { residual[i] / slope[i] } else { -limit };
                let next = (best[i] + step).clamp(0.0, limit);
                moved = moved.max((next - best[i]).abs());
                best[i] = next;
            }
            if moved < 1e-6 {
                break;
            }
        }
        best
    }
}

/// Optimal base colour of channel `c` for a metalness, not clipped to its range.
fn best_base(albedos: &Albedos, c: usize, k: f32, m: f32, dielectric: f32) -> f32 {
    let metal = albedos.specular[c] - dielectric * (1.0 - m);
    (k * albedos.diffuse[c] + m * metal) / (k * k + m * m)
}

/// Splits for several metalness values with their costs (squared albedo) and the derivatives of these.
struct Tried<const N: usize> {
    metallic: [f32; N],
    base: [[f32; N]; 3],
    dielectric: [f32; N],
    cost: [f32; N],
    slope: [f32; N],
}

impl<const N: usize> Tried<N> {
    fn split(&self, i: usize) -> Split {
        Split {
            base: self.base.map(|b| b[i]),
            metallic: self.metallic[i],
            dielectric: self.dielectric[i],
        }
    }
}

/// Base colour and metalness in place of two albedos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Split {
    pub base: [f32; 3],
    pub metallic: f32,
    /// Reflectance of the dielectric part.
    pub dielectric: f32,
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

    /// Sum of the squared differences of all six albedos.
    fn squared_error(model: &MetallicModel, split: &Split, albedos: &Albedos) -> f32 {
        let shown = model.albedos(split);
        let square = |a: [f32; 3], b: [f32; 3]| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>();
        square(shown.diffuse, albedos.diffuse) + square(shown.specular, albedos.specular)
    }

    #[test]
    fn the_index_of_refraction_gives_back_its_reflectance() {
        // Water, glass, diamond: indices and reflectances by the Fresnel equations.
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
            assert!(squared_error(&model, &split, &plastic) < 1e-9);
            let split = model.split(&gold);
            // The cost of metalness keeps it about 1e-6 below its limit.
            assert!(split.metallic > 0.9999 && squared_error(&model, &split, &gold) < 1e-8);
        }
        let lacquer = Albedos { diffuse: [0.4, 0.4, 0.1], specular: [0.07; 3] };
        let split = MetallicModel::UNREAL.split(&lacquer);
        assert_eq!((split.metallic, split.dielectric), (0.0, 0.07));
    }

    proptest! {
        /// A dense search over metalness and base colour without closed forms finds nothing better:
        /// a grid of 1/50 lies within (1/100)² x 6 of the least cost.
        #[test]
        fn no_other_split_is_better(albedos in albedos(), which in 0usize..3) {
            let model = MODELS[which];
            let split = model.split(&albedos);
            let found = squared_error(&model, &split, &albedos);
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
                    // Sixteen metalness samples may select the other one of two similar minima.
                    prop_assert!(found <= 1.01 * error + 2e-5, "{found} for {error} at {m} {dielectric}");
                }
            }
        }

        /// Materials of base colour and metalness keep their albedos.
        #[test]
        fn metallic_materials_lose_nothing(base in [0.05..1.0f32, 0.05..1.0f32, 0.05..1.0f32],
            metallic in 0.0..1.0f32, which in 0usize..2) {
            let model = MODELS[which];
            let albedos = model.albedos(&Split { base, metallic, dielectric: 0.04 });
            let error = squared_error(&model, &model.split(&albedos), &albedos);
            // The cost of metalness shifts the optimum by its own size.
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
