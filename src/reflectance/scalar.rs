//! The reflection of one texel in double precision, with its partial derivatives.

use crate::svbrdf::{CHANNELS, LOBES, MIN_ROUGHNESS, channel, lobe};
use std::f64::consts::PI;

mod sheen;

use sheen::Sheen;

/// Smallest cosine, which keeps surfaces lit or seen from behind finite.
pub const MIN_COSINE: f32 = 1e-3;

/// Coefficients of Schlick's Fresnel term as a power of two: `2^((a VoH + b) VoH)`.
pub const FRESNEL: [f32; 2] = [-5.55473, -6.98316];

/// Specular albedo of a coat: a dielectric of refractive index 1.5.
pub const COAT_F0: f32 = 0.04;

/// `BRDF * NoL` of one texel with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflection {
    /// `f(l, v) * NoL` per colour channel, 1/sr.
    pub value: [f64; 3],
    /// Derivative of each colour channel by each parameter, see [`channel`].
    pub jacobian: [[f64; CHANNELS]; 3],
    /// Derivative of each colour channel by each parameter of the optional lobes, see [`lobe`].
    pub by_lobes: [[f64; LOBES]; 3],
}

/// Reflects light from direction `light` towards `view` (unit vectors from the texel, board frame)
/// for parameters in the order of [`channel`] and optional lobes in the order of [`lobe`].
#[inline(always)]
pub fn reflect(
    parameters: &[f64; CHANNELS],
    lobes: &[f64; LOBES],
    light: [f64; 3],
    view: [f64; 3],
) -> Reflection {
    let [p, q] = [parameters[channel::SLOPE_X], parameters[channel::SLOPE_Y]];
    let length = (1.0 + p * p + q * q).sqrt();
    let normal = [p / length, q / length, 1.0 / length];
    let half = {
        let sum: [f64; 3] = std::array::from_fn(|i| light[i] + view[i]);
        let norm = dot(sum, sum).sqrt();
        sum.map(|x| x / norm)
    };
    let ([nl, dnl], [nv, dnv], [nh, dnh]) =
        (cosine(normal, light), cosine(normal, view), cosine(normal, half));
    let [vh, _] = cosine(view, half);

    let min_roughness = MIN_ROUGHNESS as f64;
    let live = parameters[channel::ROUGHNESS] > min_roughness;
    let roughness = parameters[channel::ROUGHNESS].max(min_roughness);

    let fresnel = ((FRESNEL[0] as f64 * vh + FRESNEL[1] as f64) * vh).exp2();
    let stretched =
        stretched(&[lobes[lobe::ANISOTROPY_X], lobes[lobe::ANISOTROPY_Y]], normal, half);
    let sin2 = if dnh > 0.0 { stretched.value } else { 1.0 - nh * nh };
    // S = D G / (4 NoL NoV) with its log derivatives.
    let base = Lobe::new(roughness * roughness, sin2, [nl, nv, nh]);
    let by_roughness = if live { base.by_alpha * 2.0 * roughness } else { 0.0 };

    let coat_roughness = lobes[lobe::COAT_ROUGHNESS].max(min_roughness);
    let coat_live = lobes[lobe::COAT_ROUGHNESS] > min_roughness;
    let coat = Lobe::new(coat_roughness * coat_roughness, 1.0 - nh * nh, [nl, nv, nh]);
    let coat_fresnel = COAT_F0 as f64 + (1.0 - COAT_F0 as f64) * fresnel;
    let weight = lobes[lobe::COAT];
    let (through, over) = (1.0 - weight * coat_fresnel, weight * coat_fresnel * coat.value);

    let sheen = Sheen::new(lobes, [nl, nv, nh]);
    let mut reflection =
        Reflection { value: [0.0; 3], jacobian: [[0.0; CHANNELS]; 3], by_lobes: [[0.0; LOBES]; 3] };
    for c in 0..3 {
        let (kd, ks) = (parameters[channel::DIFFUSE + c], parameters[channel::SPECULAR + c]);
        let f = ks + (1.0 - ks) * fresnel;
        let (s, under) = (through * sheen.through * base.value, kd / PI + base.value * f);
        let below = sheen.through * under + sheen.value(c);
        let brdf = through * below + over;
        reflection.value[c] = brdf * nl;
        // Derivative by the normal, then through n = (p, q, 1) / length.
        let by_sheen = sheen.by_cosines(c, under);
        let [by_nl, by_nv, by_nh] = [0, 1, 2].map(|i| {
            let above = over * coat.by_cosines[i] + through * by_sheen[i];
            nl * (s * f * base.by_cosines[i] + above)
        });
        let (by_nl, by_nv) = ((brdf + by_nl) * dnl, by_nv * dnv);
        let by_sin2 = nl * s * f * base.by_sin2 * dnh;
        // sin² of the coat is 1 - NoH².
        let by_nh = (by_nh - nl * over * coat.by_sin2 * 2.0 * nh) * dnh;
        let by_normal: [f64; 3] = std::array::from_fn(|i| {
            by_nl * light[i] + by_nv * view[i] + by_nh * half[i] + by_sin2 * stretched.by_normal[i]
        });
        let along = dot(by_normal, normal);
        let row = &mut reflection.jacobian[c];
        row[channel::SLOPE_X] = (by_normal[0] - along * normal[0]) / length;
        row[channel::SLOPE_Y] = (by_normal[1] - along * normal[1]) / length;
        row[channel::DIFFUSE + c] = nl * through * sheen.through / PI;
        row[channel::SPECULAR + c] = nl * s * (1.0 - fresnel);
        row[channel::ROUGHNESS] = nl * s * f * by_roughness;
        let row = &mut reflection.by_lobes[c];
        row[lobe::ANISOTROPY_X] = by_sin2 * stretched.by_anisotropy[0];
        row[lobe::ANISOTROPY_Y] = by_sin2 * stretched.by_anisotropy[1];
        row[lobe::COAT] = nl * coat_fresnel * (coat.value - below);
        let by_roughness = coat.by_alpha * 2.0 * coat_roughness;
        row[lobe::COAT_ROUGHNESS] = if coat_live { nl * over * by_roughness } else { 0.0 };
        let by_sheen = sheen.by_parameters(c, under);
        row[lobe::SHEEN..].copy_from_slice(&by_sheen.map(|by| nl * through * by));
    }
    reflection
}

/// D G / (4 NoL NoV) of a lobe, with the derivatives of its log.
struct Lobe {
    value: f64,
    by_alpha: f64,
    by_sin2: f64,
    /// By NoL, NoV and NoH at constant sin².
    by_cosines: [f64; 3],
}

impl Lobe {
    /// Takes `sin2` in place of 1 - NoH².
    #[inline(always)]
    fn new(alpha: f64, sin2: f64, [nl, nv, nh]: [f64; 3]) -> Self {
        let (alpha2, k) = (alpha * alpha, 0.5 * alpha);
        let den = nh * nh * alpha2 + sin2;
        let (light, view) = (nl * (1.0 - k) + k, nv * (1.0 - k) + k);
        let by_k = -(1.0 - nl) / light - (1.0 - nv) / view;
        let by_alpha2 = 1.0 / alpha2 - 2.0 * nh * nh / den;
        Self {
            value: alpha2 / (4.0 * PI * den * den * light * view),
            by_alpha: by_alpha2 * 2.0 * alpha + 0.5 * by_k,
            by_sin2: -2.0 / den,
            by_cosines: [-(1.0 - k) / light, -(1.0 - k) / view, -4.0 * nh * alpha2 / den],
        }
    }
}

/// The squared component of the half vector perpendicular to the normal, stretched by anisotropy.
struct Stretched {
    value: f64,
    by_normal: [f64; 3],
    by_anisotropy: [f64; 2],
}

/// See [`lobe::ANISOTROPY_X`]; the tangent is X made orthogonal to the normal.
#[inline(always)]
fn stretched([u, v]: &[f64; 2], n: [f64; 3], h: [f64; 3]) -> Stretched {
    let r2 = 1.0 / (1.0 - n[0] * n[0]);
    let r = r2.sqrt();
    let nh = dot(n, h);
    let [t, b] = [(h[0] - n[0] * nh) * r, (n[2] * h[1] - n[1] * h[2]) * r];
    let m2 = u * u + v * v;
    let m = m2.sqrt();
    let cosh = m.cosh();
    // sinh(m) / m and its derivative by m, divided by m.
    let [sinhc, slope] = if m < 1e-3 {
        [1.0 + m2 / 6.0, 1.0 / 3.0]
    } else {
        [m.sinh() / m, (cosh - m.sinh() / m) / m2]
    };
    let (square, difference, product) = (t * t + b * b, t * t - b * b, 2.0 * t * b);
    let turned = u * difference + v * product;
    let by_t = 2.0 * (cosh * t - sinhc * (u * t + v * b));
    let by_b = 2.0 * (cosh * b + sinhc * (u * b - v * t));
    let along = (by_t * t + by_b * b) * n[0] * r2;
    Stretched {
        value: cosh * square - sinhc * turned,
        by_normal: [
            -by_t * r * (nh + n[0] * h[0]) + along,
            -by_t * r * n[0] * h[1] - by_b * r * h[2],
            -by_t * r * n[0] * h[2] + by_b * r * h[1],
        ],
        by_anisotropy: [[*u, difference], [*v, product]]
            .map(|[u, own]| sinhc * u * square - slope * u * turned - sinhc * own),
    }
}

/// Clamped cosine, and its derivative: 1, or 0 if clamped.
fn cosine(a: [f64; 3], b: [f64; 3]) -> [f64; 2] {
    let c = dot(a, b);
    let min = MIN_COSINE as f64;
    if c > min { [c, 1.0] } else { [min, 0.0] }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::svbrdf::NO_LOBES;
    use proptest::prelude::*;

    fn direction(cos: f64, azimuth: f64) -> [f64; 3] {
        let sin = (1.0 - cos * cos).sqrt();
        [sin * azimuth.cos(), sin * azimuth.sin(), cos]
    }

    prop_compose! {
        /// Slopes up to 45 degrees, all albedos, roughness from 0.05.
        fn material()(slopes in [-1.0..1.0, -1.0..1.0], albedo in [0.0..1.0, 0.0..1.0, 0.0..1.0,
            0.0..1.0, 0.0..1.0, 0.0..1.0], roughness in 0.05..1.0_f64) -> [f64; CHANNELS] {
            let [a, b, c, d, e, f] = albedo;
            [slopes[0], slopes[1], a, b, c, d, e, f, roughness]
        }
    }

    prop_compose! {
        /// Ratios of alpha up to 7, directions all round, any coat, any sheen; half of them without sheen.
        fn optional()(anisotropy in [-1.4..1.4, -1.4..1.4], weight in 0.0..1.0_f64,
            roughness in 0.1..0.9_f64, sheen in [0.0..1.0, 0.0..1.0, 0.0..1.0],
            sheen_roughness in 0.1..1.0_f64, factor in 0..2_u8) -> [f64; LOBES] {
            let [r, g, b] = sheen.map(|v| v * f64::from(factor));
            [anisotropy[0], anisotropy[1], weight, roughness, r, g, b, sheen_roughness]
        }
    }

    prop_compose! {
        /// Down to 1.1 degrees above the surface.
        fn any_direction()(cos in 0.02..1.0_f64, azimuth in 0.0..6.3_f64) -> [f64; 3] {
            direction(cos, azimuth)
        }
    }

    /// Whether a finite difference would cross the limit of a clamped cosine or a kink of the sheen.
    fn near_kink(
        parameters: &[f64; CHANNELS],
        lobes: &[f64; LOBES],
        light: [f64; 3],
        view: [f64; 3],
    ) -> bool {
        let length = (1.0 + parameters[0].powi(2) + parameters[1].powi(2)).sqrt();
        let n = [parameters[0] / length, parameters[1] / length, 1.0 / length];
        let half: [f64; 3] = std::array::from_fn(|i| light[i] + view[i]);
        let sin2 = 1.0 - dot(n, half).powi(2) / dot(half, half);
        let [r, g, b] = [0, 1, 2].map(|c| lobes[lobe::SHEEN + c]);
        let mut colours = [r, g, b];
        colours.sort_by(f64::total_cmp);
        [light, view].iter().any(|&d| (dot(n, d) - MIN_COSINE as f64).abs() < 1e-4)
            || (dot(n, light) - dot(n, view)).abs() < 1e-5
            || (sin2 - 1.0 / 128.0).abs() < 1e-5
            || (colours[2] > 0.0 && colours[2] - colours[1] < 1e-5)
    }

    proptest! {
        /// Central differences with h = 1e-6. Truncation: h²/6 times the third derivative, which at
        /// roughness 0.05 (alpha = 0.0025) reaches about 1e8 of the value per parameter³, i.e. 2e-5
        /// relative to the value's scale. Rounding: 1e-16 / h = 1e-10 of the value.
        #[test]
        fn every_partial_derivative_matches_finite_differences(
            parameters in material(), lobes in optional(), light in any_direction(),
            view in any_direction(),
        ) {
            prop_assume!(!near_kink(&parameters, &lobes, light, view));
            check_derivatives(&parameters, &lobes, light, view)?;
        }

        /// The same near the mirror direction, inside narrow highlights.
        #[test]
        fn derivatives_hold_inside_highlights(
            mut parameters in material(), lobes in optional(), view in any_direction(),
            offset in [-0.05..0.05, -0.05..0.05],
        ) {
            parameters[0] = offset[0];
            parameters[1] = offset[1];
            let light = [-view[0], -view[1], view[2]];
            prop_assume!(!near_kink(&parameters, &lobes, light, view));
            check_derivatives(&parameters, &lobes, light, view)?;
        }

        /// Schlick's shadowing is a symmetric product, so light and camera may be exchanged.
        #[test]
        fn reciprocal(parameters in material(), lobes in optional(), a in any_direction(), b in any_direction()) {
            let flat = { let mut m = parameters; m[0] = 0.0; m[1] = 0.0; m };
            let forth = reflect(&flat, &lobes, a, b).value.map(|v| v / a[2]);
            let back = reflect(&flat, &lobes, b, a).value.map(|v| v / b[2]);
            for c in 0..3 {
                prop_assert!((forth[c] - back[c]).abs() <= 1e-12 * forth[c]);
            }
        }
    }

    fn check_derivatives(
        parameters: &[f64; CHANNELS],
        lobes: &[f64; LOBES],
        light: [f64; 3],
        view: [f64; 3],
    ) -> std::result::Result<(), TestCaseError> {
        let here = reflect(parameters, lobes, light, view);
        let h = 1e-6;
        let black = lobes[lobe::SHEEN..lobe::SHEEN_ROUGHNESS] == [0.0; 3];
        for i in 0..CHANNELS + LOBES {
            // The largest colour has a kink.
            if black && (lobe::SHEEN..lobe::SHEEN_ROUGHNESS).contains(&(i.wrapping_sub(CHANNELS))) {
                continue;
            }
            let moved = |d: f64| {
                let (mut m, mut lobes) = (*parameters, *lobes);
                if i < CHANNELS {
                    m[i] += d
                } else {
                    lobes[i - CHANNELS] += d
                }
                reflect(&m, &lobes, light, view).value
            };
            let (plus, minus) = (moved(h), moved(-h));
            for c in 0..3 {
                let numeric = (plus[c] - minus[c]) / (2.0 * h);
                let row = [here.jacobian[c].as_slice(), &here.by_lobes[c]].concat();
                let analytic = row[i];
                let tolerance = 1e-5 * analytic.abs() + 1e-4 * here.value[c] + 1e-8;
                prop_assert!(
                    (numeric - analytic).abs() < tolerance,
                    "parameter {i}, channel {c}: {analytic} for {numeric}"
                );
            }
        }
        Ok(())
    }

    /// Share of uniform light that is reflected towards a view.
    fn furnace(m: &[f64; CHANNELS], lobes: &[f64; LOBES], view_cos: f64) -> f64 {
        let view = direction(view_cos, 0.0);
        let (steps, mut sum) = (600, 0.0);
        for i in 0..steps {
            // Uniform in cos² (equal projected solid angles) and azimuth.
            let cos = ((i as f64 + 0.5) / steps as f64).sqrt();
            for j in 0..steps {
                let azimuth = 2.0 * PI * (j as f64 + 0.5) / steps as f64;
                sum += reflect(m, lobes, direction(cos, azimuth), view).value[0] / cos;
            }
        }
        PI * sum / (steps * steps) as f64
    }

    /// The specular lobe alone must not reflect more than it receives. Schlick's shadowing with k =
    /// alpha / 2 loses slightly less than exact Smith; integrals stay below 1 for F0 = 1.
    #[test]
    fn the_specular_lobe_conserves_energy() {
        for roughness in [0.2, 0.4, 0.7, 1.0] {
            for view_cos in [0.1, 0.3, 0.6, 1.0] {
                let m = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, roughness];
                let albedo = furnace(&m, &NO_LOBES, view_cos);
                assert!(albedo < 1.02, "roughness {roughness}, view {view_cos}: {albedo}");
                assert!(albedo > 0.25, "roughness {roughness}, view {view_cos}: {albedo}");
            }
        }
    }

    fn sheen(colour: [f64; 3], roughness: f64) -> [f64; LOBES] {
        let mut lobes = NO_LOBES;
        lobes[lobe::SHEEN..lobe::SHEEN_ROUGHNESS].copy_from_slice(&colour);
        lobes[lobe::SHEEN_ROUGHNESS] = roughness;
        lobes
    }

    /// Derivatives by a gray sheen's colour exist without sheen.
    #[test]
    fn black_sheen_has_the_derivatives_of_almost_black_sheen() {
        let m = [0.1, -0.2, 0.3, 0.2, 0.1, 0.04, 0.05, 0.06, 0.4];
        let (light, view) = (direction(0.6, 0.3), direction(0.4, 1.0));
        let at = |v: f64| reflect(&m, &sheen([v; 3], 0.4), light, view);
        let (black, gray) = (at(0.0), at(1e-6));
        for c in 0..3 {
            let numeric = (gray.value[c] - black.value[c]) / 1e-6;
            let by: f64 = (0..3).map(|k| black.by_lobes[c][lobe::SHEEN + k]).sum();
            assert!((numeric - by).abs() < 1e-6 * by.abs(), "{numeric} {by}");
        }
    }

    /// A white furnace: sheen dims a white base by at least as much as it adds, up to errors of the fit of its
    /// directional albedo. Below 6 degrees, narrow sheen alone reflects more than it receives, as the extension
    /// says of this visibility.
    #[test]
    fn sheen_on_a_white_base_conserves_energy() {
        let m = [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        for roughness in [0.1, 0.2, 0.3, 0.5, 0.7, 1.0] {
            for view_cos in [0.1, 0.3, 0.6, 1.0] {
                let albedo = furnace(&m, &sheen([1.0; 3], roughness), view_cos);
                assert!(albedo < 1.015, "roughness {roughness}, view {view_cos}: {albedo}");
                assert!(albedo > 0.85, "roughness {roughness}, view {view_cos}: {albedo}");
            }
        }
    }

    #[test]
    fn a_lambertian_texel_reflects_its_albedo_over_pi() {
        let m = [0.0, 0.0, 0.8, 0.5, 0.2, 0.0, 0.0, 0.0, 1.0];
        let up = [0.0, 0.0, 1.0];
        let value = reflect(&m, &NO_LOBES, up, up).value;
        for c in 0..3 {
            // Only F(VoH = 1) = 2^-12.54 remains of the specular lobe: 1.7e-4 / (4 pi).
            let left = (FRESNEL[0] as f64 + FRESNEL[1] as f64).exp2() / (4.0 * PI);
            assert!((value[c] - m[2 + c] / PI - left).abs() < 1e-12);
        }
    }

    /// At normal incidence (all cosines 1) the lobe is F0 / (4 pi alpha²).
    #[test]
    fn the_peak_of_the_lobe_has_its_closed_form() {
        let up = [0.0, 0.0, 1.0];
        let m = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.3];
        let peak = reflect(&m, &NO_LOBES, up, up).value[0];
        assert!((peak * 4.0 * PI * 0.3_f64.powi(4) - 1.0).abs() < 1e-12);
    }
}
