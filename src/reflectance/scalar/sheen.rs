//! The sheen of one texel in double precision.

use std::f64::consts::PI;

use crate::reflectance::charlie::{SHEEN_MIN_SIN2, sheen_albedo};
use crate::svbrdf::{LOBES, MIN_SHEEN_ROUGHNESS, lobe};

/// Parameters of sheen: colour and roughness.
const PARAMETERS: usize = LOBES - lobe::SHEEN;

/// Sheen in one view.
pub(super) struct Sheen {
    colour: [f64; 3],
    /// Index of the largest colour.
    most: usize,
    /// Zero without sheen, so that materials without it do not wait.
    white: White,
    /// White sheen in any case: black sheen has derivatives too.
    any: White,
    /// Transmission to the base and back.
    pub through: f64,
}

impl Sheen {
    /// Takes parameters in the order of [`lobe`], and NoL, NoV and NoH.
    #[inline(always)]
    pub fn new(lobes: &[f64; LOBES], cosines: [f64; 3]) -> Self {
        let [r, g, b] = [0, 1, 2].map(|c| lobes[lobe::SHEEN + c]);
        let most = if r >= g.max(b) { 0 } else { 1 + usize::from(b > g) };
        let largest = r.max(g).max(b);
        let roughness = lobes[lobe::SHEEN_ROUGHNESS];
        let white = if largest > 0.0 { White::new(roughness, cosines) } else { White::default() };
        Self {
            colour: [r, g, b],
            most,
            through: 1.0 - largest * white.albedo,
            white,
            any: White::new(roughness, cosines),
        }
    }

    /// Reflection of a colour.
    #[inline(always)]
    pub fn value(&self, c: usize) -> f64 {
        self.colour[c] * self.white.value
    }

    /// Derivatives of a colour's reflection by NoL, NoV and NoH: of the sheen itself, and of its dimming of a
    /// base of this reflection.
    #[inline(always)]
    pub fn by_cosines(&self, c: usize, base: f64) -> [f64; 3] {
        let most = self.colour[self.most];
        std::array::from_fn(|i| {
            self.value(c) * self.white.by_cosines[i] - most * base * self.white.albedo_by_cosines[i]
        })
    }

    /// Derivatives of a colour's reflection by the sheen's parameters, over a base of this reflection.
    #[inline(always)]
    pub fn by_parameters(&self, c: usize, base: f64) -> [f64; PARAMETERS] {
        let mut out = [0.0; PARAMETERS];
        out[c] += self.any.value;
        out[self.most] -= base * self.any.albedo;
        out[lobe::SHEEN_ROUGHNESS - lobe::SHEEN] = self.value(c) * self.white.by_roughness
            - self.colour[self.most] * base * self.white.albedo_by_roughness;
        out
    }
}

/// White sheen.
#[derive(Default)]
struct White {
    /// D V, and the derivatives of its log by roughness, and by NoL, NoV and NoH.
    value: f64,
    by_roughness: f64,
    by_cosines: [f64; 3],
    /// Directional albedo E at the smaller of NoL and NoV, and its derivatives.
    albedo: f64,
    albedo_by_roughness: f64,
    albedo_by_cosines: [f64; 3],
}

impl White {
    #[inline(always)]
    fn new(roughness: f64, [nl, nv, nh]: [f64; 3]) -> Self {
        let least = f64::from(MIN_SHEEN_ROUGHNESS);
        let live = f64::from(u8::from(roughness > least));
        let r = roughness.max(least);
        let x = 1.0 / (r * r);
        let limit = f64::from(SHEEN_MIN_SIN2);
        let sin2 = (1.0 - nh * nh).max(limit);
        let sum = nl + nv - nl * nv;
        let by_x = 1.0 / (2.0 + x) + 0.5 * sin2.ln();
        let [albedo, by_cosine, by_roughness] = sheen_albedo(nl.min(nv), r);
        let [to_light, to_view] = if nl < nv { [1.0, 0.0] } else { [0.0, 1.0] };
        Self {
            value: (2.0 + x) * sin2.powf(0.5 * x) / (8.0 * PI * sum),
            by_roughness: -2.0 * x / r * by_x * live,
            by_cosines: [
                -(1.0 - nv) / sum,
                -(1.0 - nl) / sum,
                if sin2 > limit { -x * nh / sin2 } else { 0.0 },
            ],
            albedo,
            albedo_by_roughness: by_roughness * live,
            albedo_by_cosines: [to_light * by_cosine, to_view * by_cosine, 0.0],
        }
    }
}
