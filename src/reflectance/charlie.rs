//! Constants of the sheen, and its directional albedo.

/// Least sin² of the angle between half vector and normal, as in Filament and three.js: it keeps the
/// derivatives finite at the normal.
pub const SHEEN_MIN_SIN2: f32 = 1.0 / 128.0;

/// Coefficients of the directional albedo, a rational function of cosine c and roughness r: numerator and
/// denominator as factors of 1, c, r, c r, c², r². A least-squares fit to integrals of D V for roughness from
/// 0.07, within 0.05; from a cosine of 0.1 on within 0.03.
pub const SHEEN_ALBEDO: [[f32; 6]; 2] = [
    [-0.02575, -0.44755, 2.30768, -1.10077, -0.41754, 2.97055],
    [0.00937, 0.17418, -0.65193, 10.0, 3.46543, 10.0],
];

/// Largest directional albedo: white sheen always lets some light pass. D V alone exceeds 1 at grazing angles
/// for small roughness.
pub const SHEEN_MAX_ALBEDO: f32 = 0.96;

/// Directional albedo of white sheen, and its derivatives by the cosine and by roughness.
#[inline(always)]
pub fn sheen_albedo(cosine: f64, roughness: f64) -> [f64; 3] {
    let (c, r) = (cosine, roughness);
    let [[top, top_c, top_r], [bottom, bottom_c, bottom_r]] = SHEEN_ALBEDO.map(|factors| {
        let [one, of_c, of_r, of_cr, of_cc, of_rr] = factors.map(f64::from);
        [
            one + of_c * c + of_r * r + of_cr * c * r + of_cc * c * c + of_rr * r * r,
            of_c + of_cr * r + 2.0 * of_cc * c,
            of_r + of_cr * c + 2.0 * of_rr * r,
        ]
    });
    let albedo = top / bottom;
    if !(0.0..f64::from(SHEEN_MAX_ALBEDO)).contains(&albedo) {
        return [albedo.clamp(0.0, SHEEN_MAX_ALBEDO.into()), 0.0, 0.0];
    }
    [albedo, (top_c - albedo * bottom_c) / bottom, (top_r - albedo * bottom_r) / bottom]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// The integral of D V NoL over the hemisphere for a view with this cosine.
    fn integral(view: f64, roughness: f64) -> f64 {
        let (steps, exponent) = (300, roughness.powi(-2));
        let mut sum = 0.0;
        for i in 0..steps {
            // Uniform in cos² (equal projected solid angles) and azimuth.
            let cos = ((f64::from(i) + 0.5) / f64::from(steps)).sqrt();
            for j in 0..steps {
                let azimuth = 2.0 * PI * (f64::from(j) + 0.5) / f64::from(steps);
                let sines = (1.0 - cos * cos).sqrt() * (1.0 - view * view).sqrt();
                // |l + v|² and the square of its normal component.
                let length2 = 2.0 + 2.0 * (cos * view + sines * azimuth.cos());
                let sin2 = (1.0 - (cos + view).powi(2) / length2).max(f64::from(SHEEN_MIN_SIN2));
                let density = (2.0 + exponent) * sin2.powf(0.5 * exponent) / (2.0 * PI);
                sum += density / (4.0 * (cos + view - cos * view));
            }
        }
        PI * sum / f64::from(steps * steps)
    }

    #[test]
    fn the_fit_is_near_the_integral() {
        for roughness in [0.07, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0] {
            for cosine in [0.02, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0] {
                let expected = integral(cosine, roughness).min(SHEEN_MAX_ALBEDO.into());
                let [found, ..] = sheen_albedo(cosine, roughness);
                let tolerance = if cosine < 0.1 { 0.06 } else { 0.035 };
                assert!(
                    (found - expected).abs() < tolerance,
                    "cosine {cosine}, roughness {roughness}: {found} for {expected}"
                );
            }
        }
    }
}
