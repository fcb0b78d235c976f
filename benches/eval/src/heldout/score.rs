//! Difference between a predicted photograph and the real one.

use glam::Vec3;
use svbrdf::observation::View;

/// Texels per side of the comparison.
pub const SIDE: usize = 256;
/// Gamma of the comparison.
const GAMMA: f32 = 2.2;
/// Largest gamma-encoded value used for the brightness factor.
const BRIGHT: f32 = 0.95;
/// Angle between half vector and +Z below which a texel lies in the highlight, degrees.
pub const HIGHLIGHT_DEGREES: f32 = 9.0;

/// A photograph outside the fit, seen from above: three planes of linear values, 1 = white.
pub struct HeldOut {
    /// Camera and light to render with.
    pub view: View,
    /// Value of a radiance of 1 in the units of `view`.
    pub exposure: f32,
    pub observed: Vec<f32>,
    /// Texels per side.
    pub side: usize,
    /// Visible texels; `None`: all.
    pub seen: Option<Vec<bool>>,
}

/// Squared errors of some texels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Squares {
    pub sum: f64,
    /// Number of values: three per texel.
    pub count: usize,
}

impl Squares {
    /// RMS; 0 without values.
    pub fn rms(self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.sum / self.count as f64).sqrt() }
    }

    /// Sum of both.
    pub fn plus(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, count: self.count + other.count }
    }
}

/// Error of a prediction, gamma 2.2, values in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// Brightness factor applied to the gamma-encoded prediction.
    pub factor: f32,
    /// Within [`HIGHLIGHT_DEGREES`] of the mirror direction.
    pub highlight: Squares,
    /// Rest of the picture.
    pub elsewhere: Squares,
}

impl Score {
    /// RMS over the whole picture.
    pub fn rms(&self) -> f64 {
        self.highlight.plus(self.elsewhere).rms()
    }
}

fn encoded(linear: f32) -> f32 {
    linear.max(0.0).powf(1.0 / GAMMA)
}

impl HeldOut {
    fn is_seen(&self, texel: usize) -> bool {
        self.seen.as_ref().is_none_or(|seen| seen[texel])
    }

    /// Gamma-encoded photograph in [0, 1]: three planes.
    pub fn picture(&self) -> Vec<f32> {
        self.observed.iter().map(|&v| encoded(v).min(1.0)).collect()
    }

    /// Gamma-encoded prediction in [0, 1] from `radiance` rendered with `view`, clipped like a photograph
    /// and, with `gain`, multiplied by the best-fitting factor; also returns that factor.
    pub fn prediction(&self, radiance: &[f32], gain: bool) -> (Vec<f32>, f32) {
        let picture = self.picture();
        let mut predicted: Vec<f32> =
            radiance.iter().map(|&v| encoded(v * self.exposure).min(1.0)).collect();
        let factor = if gain { self.factor(&predicted, &picture) } else { 1.0 };
        predicted.iter_mut().for_each(|v| *v = (*v * factor).min(1.0));
        (predicted, factor)
    }

    /// Least squares over texels without a bright channel.
    fn factor(&self, predicted: &[f32], picture: &[f32]) -> f32 {
        let n = self.side * self.side;
        let (mut product, mut square) = (0.0, 0.0);
        for i in (0..n).filter(|&i| self.is_seen(i)) {
            let channels = [i, n + i, 2 * n + i];
            if channels.iter().any(|&k| picture[k] >= BRIGHT) {
                continue;
            }
            for k in channels {
                let (p, o) = (f64::from(predicted[k]), f64::from(picture[k]));
                product += p * o;
                square += p * p;
            }
        }
        if square > 0.0 { (product / square) as f32 } else { 1.0 }
    }

    /// Compares `radiance`, rendered with `view`, with the photograph.
    pub fn score(&self, radiance: &[f32], gain: bool) -> Score {
        let (predicted, factor) = self.prediction(radiance, gain);
        let picture = self.picture();
        let n = self.side * self.side;
        let mut score =
            Score { factor, highlight: Squares::default(), elsewhere: Squares::default() };
        for i in (0..n).filter(|&i| self.is_seen(i)) {
            let near = self.half_degrees(i) < HIGHLIGHT_DEGREES;
            let part = if near { &mut score.highlight } else { &mut score.elsewhere };
            for k in [i, n + i, 2 * n + i] {
                part.sum += f64::from(predicted[k] - picture[k]).powi(2);
            }
            part.count += 3;
        }
        score
    }

    /// Angle between +Z and the half vector of the directions to camera and light, degrees.
    fn half_degrees(&self, texel: usize) -> f32 {
        let [x, y] = self.view.texel_mm(self.side, self.side, texel % self.side, texel / self.side);
        let point = Vec3::new(x, y, 0.0);
        let towards = |from: [f32; 3]| (Vec3::from(from) - point).normalize();
        let half = (towards(self.view.camera_mm) + towards(self.view.light_mm)).normalize();
        half.z.clamp(-1.0, 1.0).acos().to_degrees()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use svbrdf::observation::Falloff;

    fn held_out(observed: Vec<f32>, side: usize) -> HeldOut {
        let view = View {
            sample_mm: [100.0; 2],
            camera_mm: [0.0, 0.0, 200.0],
            light_mm: [0.0, 0.0, 200.0],
            falloff: Falloff::None { power: [1.0; 3] },
            ..View::default()
        };
        HeldOut { view, exposure: 2.0, observed, side, seen: None }
    }

    fn ramp(side: usize) -> Vec<f32> {
        let values = 3 * side * side;
        (0..values).map(|i| 0.02 + 0.6 * i as f32 / values as f32).collect()
    }

    /// The photograph at another brightness has no error, and the factor is the root of the ratio.
    #[test]
    fn a_factor_makes_up_for_brightness() {
        let held_out = held_out(ramp(16), 16);
        let radiance: Vec<f32> = ramp(16).iter().map(|v| 0.5 * v / 1.3).collect();
        let score = held_out.score(&radiance, true);
        assert!(score.rms() < 1e-6, "{}", score.rms());
        assert!((score.factor - 1.3f32.powf(1.0 / 2.2)).abs() < 1e-5, "{}", score.factor);
        assert!(held_out.score(&radiance, false).rms() > 0.05);
    }

    /// A constant difference of encoded values is the error, in the whole and in the parts.
    #[test]
    fn error_is_the_root_mean_square_of_encoded_values() {
        let held_out = held_out(vec![0.5f32.powf(2.2); 3 * 256], 16);
        let score = held_out.score(&vec![0.5 * 0.6f32.powf(2.2); 3 * 256], false);
        for error in [score.rms(), score.highlight.rms(), score.elsewhere.rms()] {
            assert!((error - 0.1).abs() < 1e-5, "{error}");
        }
    }

    /// With camera and light at one position above the centre, 9 degrees are a circle of radius 200 mm * tan
    /// 9° and area pi * 31.68² mm² in 100² mm²; 64 texels per side resolve it to about 1 %.
    #[test]
    fn highlight_is_a_circle_below_a_light_at_the_camera() {
        let held_out = held_out(ramp(64), 64);
        let score = held_out.score(&ramp(64), false);
        let share = score.highlight.count as f64 / (3 * 64 * 64) as f64;
        let radius = 200.0 * f64::from(HIGHLIGHT_DEGREES).to_radians().tan();
        let expected = std::f64::consts::PI * radius * radius / 1e4;
        assert!((share / expected - 1.0).abs() < 0.02, "{share} {expected}");
    }

    #[test]
    fn texels_out_of_sight_do_not_count() {
        let mut held_out = held_out(ramp(4), 4);
        held_out.seen = Some((0..16).map(|i| i > 0).collect());
        let mut radiance: Vec<f32> = ramp(4).iter().map(|v| 0.5 * v).collect();
        radiance[0] = 1e6;
        assert!(held_out.score(&radiance, true).rms() < 1e-6);
    }
}
