//! Optional lobes of maps: anisotropy, a coat, sheen.

/// Number of parameters of the optional lobes of a texel.
pub const LOBES: usize = 8;

/// Index of each parameter plane of the optional lobes, [`Svbrdf::lobes`](super::Svbrdf::lobes).
pub mod lobe {
    /// Anisotropy of the specular lobe: `ln(alpha along / alpha across)` times the cosine of twice
    /// the angle of the direction of the larger alpha, counter-clockwise from X. `roughness²` is
    /// the geometric mean of both alphas.
    pub const ANISOTROPY_X: usize = 0;
    /// The same times the sine.
    pub const ANISOTROPY_Y: usize = 1;
    /// Weight of a coat, 0 to 1: a dielectric of F0 .04 above the other lobes.
    pub const COAT: usize = 2;
    /// Roughness of the coat.
    pub const COAT_ROUGHNESS: usize = 3;
    /// Colour of the sheen, red, linear; green and blue follow. This and the later planes exist only for
    /// materials with sheen.
    pub const SHEEN: usize = 4;
    /// Roughness of the sheen, `alpha = roughness²`.
    pub const SHEEN_ROUGHNESS: usize = 7;
}

/// Parameters of absent lobes.
pub const NO_LOBES: [f64; LOBES] = [0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.5];

/// Smallest roughness of sheen that is rendered.
pub const MIN_SHEEN_ROUGHNESS: f32 = 0.07;
