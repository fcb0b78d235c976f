//! Distributions of the slopes of microfacets, with the Smith masking that belongs to each.
//!
//! Slopes relative to the roughness follow Student's t distribution (Ribardière et al., *STD:
//! Student's t-Distribution of Slopes for Microfacet Based BSDFs*, 2017):
//!
//! ```text
//! P(s) = (1 + s² / (g - 1))^-g / pi        g = 2: GGX;  g -> infinity, exp(-s²) / pi: Beckmann
//! ```

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;

/// Entries of the table of shadows.
const ENTRIES: usize = 1024;
/// Midpoints of an integral between two entries.
const MIDPOINTS: usize = 16;

/// A distribution for any pair of roughnesses.
#[derive(Debug, Clone)]
pub struct Facets {
    /// Exponent `g`; `None`: Beckmann.
    exponent: Option<f64>,
    /// Integral of `(s - a) p(s)` from `a` on, `p` being the distribution of slopes along one axis,
    /// evenly spaced in `a / (1 + a)`.
    shadows: Vec<f64>,
}

impl Facets {
    /// Facets with an exponent above 1.5, below which the mean slope is infinite; `None`: Beckmann.
    pub fn new(exponent: Option<f64>) -> Self {
        let place = |i: f64| i / ENTRIES as f64;
        // mass of each interval of a / (1 + a), `p` being known but for its scale
        let mass = |i: usize| -> f64 {
            let midpoint = |k: usize| place(i as f64 + (k as f64 + 0.5) / MIDPOINTS as f64);
            let density = |t: f64| along_axis(exponent, t / (1.0 - t)) / (1.0 - t).powi(2);
            (0..MIDPOINTS).map(midpoint).map(density).sum::<f64>() / (MIDPOINTS * ENTRIES) as f64
        };
        let mut beyond = 0.0;
        let mut shadows = vec![0.0; ENTRIES + 1];
        for i in (0..ENTRIES).rev() {
            beyond += mass(i);
            let a = place(i as f64) / (1.0 - place(i as f64));
            shadows[i] = (first_moment(exponent, a) - a * beyond).max(0.0);
        }
        // slopes of both signs are as likely: `beyond` is half of all
        shadows.iter_mut().for_each(|v| *v *= 0.5 / beyond);
        Self { exponent, shadows }
    }

    /// Distribution of normals at `half`, in a frame whose axes have these roughnesses; its integral
    /// with the cosine over the hemisphere is 1.
    pub fn density(&self, half: DVec3, alphas: [f64; 2]) -> f64 {
        let [ax, ay] = alphas;
        let square = (half.x / (ax * half.z)).powi(2) + (half.y / (ay * half.z)).powi(2);
        let shape = match self.exponent {
            Some(g) => (1.0 + square / (g - 1.0)).powf(-g),
            None => (-square).exp(),
        };
        FRAC_1_PI * shape / (ax * ay * half.z.powi(4))
    }

    /// Share of the facets towards both directions that neither hides, heights being correlated.
    pub fn visible(&self, light: DVec3, view: DVec3, alphas: [f64; 2]) -> f64 {
        1.0 / (1.0 + self.hidden(light, alphas) + self.hidden(view, alphas))
    }

    /// Smith's lambda of a direction above the surface.
    fn hidden(&self, direction: DVec3, alphas: [f64; 2]) -> f64 {
        let slope = (alphas[0] * direction.x).hypot(alphas[1] * direction.y);
        let a = direction.z / slope.max(1e-12);
        let place = a / (1.0 + a) * ENTRIES as f64;
        let i = (place as usize).min(ENTRIES - 1);
        let fraction = place - i as f64;
        ((1.0 - fraction) * self.shadows[i] + fraction * self.shadows[i + 1]) / a
    }
}

/// Distribution of slopes along one axis, times some number.
fn along_axis(exponent: Option<f64>, s: f64) -> f64 {
    match exponent {
        Some(g) => (1.0 + s * s / (g - 1.0)).powf(0.5 - g),
        None => (-s * s).exp(),
    }
}

/// Integral of `s` times [`along_axis`] from `a` on.
fn first_moment(exponent: Option<f64>, a: f64) -> f64 {
    match exponent {
        Some(g) => (g - 1.0) / (2.0 * g - 3.0) * (1.0 + a * a / (g - 1.0)).powf(1.5 - g),
        None => 0.5 * (-a * a).exp(),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const TAILS: [Option<f64>; 4] = [Some(1.6), Some(2.0), Some(4.0), None];
    const ALPHAS: [[f64; 2]; 3] = [[0.1, 0.3], [0.4, 0.4], [0.6, 0.2]];

    /// Integral over the hemisphere of a function times the cosine: midpoints in azimuth and in the
    /// eighth root of the squared cosine, since long tails are singular at the horizon.
    fn integral(of: impl Fn(DVec3) -> f64) -> f64 {
        let (rings, steps) = (8000, 96);
        let mut sum = 0.0;
        for i in 0..rings {
            let root = (f64::from(i) + 0.5) / f64::from(rings);
            let z = root.powi(4);
            let weight = 8.0 * root.powi(7);
            for j in 0..steps {
                let (sin, cos) = (2.0 * PI * (f64::from(j) + 0.5) / f64::from(steps)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                sum += weight * of(DVec3::new(r * cos, r * sin, z));
            }
        }
        PI * sum / f64::from(rings * steps)
    }

    /// The narrowest lobe here changes over 0.01 in the squared cosine, ten rings.
    #[test]
    fn distributions_integrate_to_one() {
        for tails in TAILS {
            let facets = Facets::new(tails);
            for alphas in ALPHAS {
                let whole = integral(|half| facets.density(half, alphas));
                assert!((whole - 1.0).abs() < 3e-3, "{tails:?} {alphas:?}: {whole}");
            }
        }
    }

    /// The definition of Smith's masking: the visible facets cover exactly the visible surface.
    #[test]
    fn visible_facets_cover_what_is_seen() {
        for tails in TAILS {
            let facets = Facets::new(tails);
            for alphas in ALPHAS {
                for polar in [0.3f64, 1.0, 1.3] {
                    let (sin, cos) = polar.sin_cos();
                    let view = DVec3::new(sin * 0.7f64.cos(), sin * 0.7f64.sin(), cos);
                    let seen = 1.0 / (1.0 + facets.hidden(view, alphas));
                    let covered = seen
                        * integral(|half| {
                            facets.density(half, alphas) * view.dot(half).max(0.0) / half.z
                        });
                    assert!(
                        (covered / cos - 1.0).abs() < 6e-3,
                        "{tails:?} {alphas:?} {polar}: {covered} {cos}"
                    );
                }
            }
        }
    }

    /// Closed forms: GGX, and Beckmann's with erf(0.5) = 0.5204999, erf(1) = 0.8427008.
    #[test]
    fn hidden_shares_are_the_known_ones() {
        let hidden = |tails, a: f64| {
            let direction = DVec3::new(1.0, 0.0, a).normalize();
            Facets::new(tails).hidden(direction, [1.0, 0.3])
        };
        for a in [0.1f64, 0.5, 1.0, 3.0] {
            let known = 0.5 * ((1.0 + 1.0 / (a * a)).sqrt() - 1.0);
            assert!((hidden(Some(2.0), a) / known - 1.0).abs() < 1e-3, "{a}");
        }
        for (a, known) in [(0.5, 0.199_641), (1.0, 0.025_127)] {
            assert!((hidden(None, a) / known - 1.0).abs() < 1e-3, "{a}");
        }
    }
}
