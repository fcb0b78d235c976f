//! Representations of anisotropy: of the optimiser, as two alphas, and of glTF.

/// Largest log ratio of the alphas from stored values.
const MAX_LOG_RATIO: f32 = 3.0;
/// Smallest alpha from stored values, against overflow of ratios.
const MIN_ALPHA: f32 = 1e-6;

/// The two alphas of a texel's specular lobe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anisotropy {
    /// Direction of the larger alpha, counter-clockwise from X, radians; opposite directions are equivalent.
    pub angle: f32,
    /// Alpha along the direction, at least `across`. Values above 1 are valid but cannot be stored.
    pub along: f32,
    /// Alpha across the direction.
    pub across: f32,
}

impl Anisotropy {
    /// Takes the roughness, whose square is the geometric mean of both alphas, and the parameters
    /// [`lobe::ANISOTROPY_X`](super::lobe::ANISOTROPY_X) and
    /// [`lobe::ANISOTROPY_Y`](super::lobe::ANISOTROPY_Y). The angle is in -π/2 to π/2.
    pub fn new(roughness: f32, [x, y]: [f32; 2]) -> Self {
        let (alpha, stretch) = (roughness * roughness, (0.5 * x.hypot(y)).exp());
        Self { angle: 0.5 * y.atan2(x), along: alpha * stretch, across: alpha / stretch }
    }

    /// The roughness and the two parameters of [`Anisotropy::new`].
    pub fn parameters(&self) -> (f32, [f32; 2]) {
        let log_ratio = (self.along / self.across).ln();
        let (sin, cos) = (2.0 * self.angle).sin_cos();
        ((self.along * self.across).powf(0.25), [log_ratio * cos, log_ratio * sin])
    }

    /// Takes the texture of glTF's `KHR_materials_anisotropy` (a direction of any length and the
    /// strength, 0 to 1) and the roughness across the direction: `along = mix(across, 1,
    /// strength²)`. A ratio above 20 is reduced by raising the alpha across the direction.
    pub fn from_gltf(roughness: f32, [x, y]: [f32; 2], strength: f32) -> Self {
        let across = (roughness * roughness).clamp(MIN_ALPHA, 1.0);
        let along = across + (1.0 - across) * (strength * strength).clamp(0.0, 1.0);
        let across = across.max(along * (-MAX_LOG_RATIO).exp());
        Self { angle: y.atan2(x), along, across }
    }

    /// glTF's roughness: the root of the alpha across the direction.
    pub fn roughness(&self) -> f32 {
        self.across.sqrt()
    }

    /// The direction as a unit vector.
    pub fn direction(&self) -> [f32; 2] {
        let (sin, cos) = self.angle.sin_cos();
        [cos, sin]
    }

    /// glTF's strength. Its square is `(along - across) / (1 - across)`, 1 if `along` exceeds 1.
    pub fn strength(&self) -> f32 {
        let (raised, room) = (self.along.min(1.0) - self.across, 1.0 - self.across);
        if raised > 0.0 && room > 0.0 { (raised / room).min(1.0).sqrt() } else { 0.0 }
    }

    /// The same lobe with an angle within π/2 of another one, so that similar directions of
    /// neighbours can be interpolated.
    pub fn facing(self, angle: f32) -> Self {
        use std::f32::consts::PI;
        Self { angle: self.angle - PI * ((self.angle - angle) / PI).round(), ..self }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use std::f32::consts::FRAC_PI_2;

    use super::*;

    proptest! {
        /// The optimiser's parameters survive a conversion to glTF and back within glTF's range.
        #[test]
        fn parameters_come_back_from_gltf_s_form(roughness in 0.02..1.0f32, log_ratio in 0.0..3.0f32,
            angle in -1.57..1.57f32) {
            let (sin, cos) = (2.0 * angle).sin_cos();
            let lobe = Anisotropy::new(roughness, [log_ratio * cos, log_ratio * sin]);
            prop_assume!(lobe.along <= 1.0);
            let back = Anisotropy::from_gltf(lobe.roughness(), lobe.direction(), lobe.strength());
            let (r, [x, y]) = back.parameters();
            prop_assert!((r - roughness).abs() < 1e-5 * roughness.max(0.1), "{r} for {roughness}");
            let off = (x - log_ratio * cos).hypot(y - log_ratio * sin);
            prop_assert!(off < 2e-3, "{off}: {back:?} for {lobe:?}");
        }

        /// Definitions: ratio, mean, glTF's mix.
        #[test]
        fn alphas_follow_from_the_definitions(roughness in 0.02..1.0f32, x in -2.0..2.0f32, y in -2.0..2.0f32) {
            let lobe = Anisotropy::new(roughness, [x, y]);
            prop_assert!(((lobe.along / lobe.across).ln() - x.hypot(y)).abs() < 1e-5);
            prop_assert!(((lobe.along * lobe.across).sqrt() / roughness.powi(2) - 1.0).abs() < 1e-5);
            let strength2 = lobe.strength().powi(2);
            let mixed = lobe.across + (1.0 - lobe.across) * strength2;
            // Values above 1 are not stored.
            prop_assert!((mixed - lobe.along.min(1.0).max(lobe.across)).abs() < 1e-5 || lobe.across >= 1.0);
        }

        #[test]
        fn a_lobe_that_faces_an_angle_is_the_same(angle in -9.0..9.0f32, towards in -9.0..9.0f32) {
            let lobe = Anisotropy { angle, along: 0.5, across: 0.1 };
            let facing = lobe.facing(towards);
            prop_assert!((facing.angle - towards).abs() <= FRAC_PI_2 + 1e-4);
            let [a, b] = [lobe, facing].map(|lobe| lobe.parameters().1);
            prop_assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-4);
        }
    }

    /// Alphas 0.4 along the diagonal and 0.1 across it: strength² = 0.3 / 0.9.
    #[test]
    fn a_brushed_metal_by_hand() {
        let log_ratio = 4f32.ln();
        let lobe = Anisotropy::new(0.2f32.sqrt(), [0.0, log_ratio]);
        assert!((lobe.along - 0.4).abs() < 1e-6 && (lobe.across - 0.1).abs() < 1e-6, "{lobe:?}");
        assert!((lobe.strength() - (1f32 / 3.0).sqrt()).abs() < 1e-6);
        let root = 0.5f32.sqrt();
        assert!(lobe.direction().iter().all(|v| (v - root).abs() < 1e-6));
    }

    #[test]
    fn impossible_values_are_clamped() {
        // Isotropic; too rough; a mirror across the direction.
        assert_eq!(Anisotropy::new(0.3, [0.0; 2]).strength(), 0.0);
        assert_eq!(Anisotropy::new(1.0, [0.5, 0.0]).strength(), 1.0);
        let (roughness, [x, y]) = Anisotropy::from_gltf(0.0, [1.0, 0.0], 1.0).parameters();
        assert!(roughness > 0.1 && (x - MAX_LOG_RATIO).abs() < 1e-5 && y == 0.0);
        let (roughness, none) = Anisotropy::from_gltf(0.3, [0.0; 2], 0.0).parameters();
        assert!((roughness - 0.3).abs() < 1e-6 && none == [0.0; 2]);
        let (roughness, none) = Anisotropy::from_gltf(0.0, [0.0; 2], 0.0).parameters();
        assert!(roughness < 0.01 && none == [0.0; 2]);
    }
}
