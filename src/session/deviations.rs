//! Standard deviations of the maps, including ambiguities of the capture that residuals do not show:
//!
//! - **Lost highlights.** Where every highlight is saturated, the tails determine only the product of F0 and alpha².
//!   Deviations then cover the F0 of all materials, with the roughness that belongs to each. If the narrowest lobe is a
//!   coat's, they cover all weights and the roughness of the coat as well.
//! - **Unexplained cores.** Where a photograph shows the core of a highlight and the maps do not explain it, F0 and
//!   roughness, or weight and roughness of the coat, are off by what the core and the tails allow.
//! - **Unknown height.** A sample nearer to the flash than the board is lit more brightly, which changes the albedos.

use crate::Result;
use crate::assessment::Evidence;
use crate::observation::Observation;
use crate::svbrdf::{channel, lobe};
use crate::uncertainty::Uncertainty;

use super::capture::{Board, Capture};
use super::diagnosis::{LostHighlights, core_errors, narrowest};

/// F0 of dielectrics and of the brightest metals.
const F0: [f32; 2] = [0.04, 1.0];
/// Planes of an [`Uncertainty`].
const DIFFUSE: usize = 1;
const SPECULAR: usize = 2;
const ROUGHNESS: usize = 3;
const COAT: usize = 4 + lobe::COAT;
const COAT_ROUGHNESS: usize = 4 + lobe::COAT_ROUGHNESS;

/// Deviations of the maps of `evidence`, with the rectified photographs of the capture.
pub(super) fn of_maps(
    evidence: &Evidence,
    capture: &Capture,
    photographs: &[Observation],
) -> Result<Uncertainty> {
    let known = evidence.uncertainty()?;
    let maps = evidence.maps();
    let (width, height, texels) = (maps.width(), maps.height(), maps.texels());
    let narrowest = narrowest(maps);
    let mut planes = known.planes().to_vec();
    let mut widen = |plane: usize, texel: usize, by: f32| {
        if let Some(value) = planes.get_mut(plane * texels + texel) {
            *value = value.hypot(by);
        }
    };
    let coat = maps.coat();
    // The weight of a texel's coat if that is the narrowest lobe.
    let coat = |texel: usize| {
        let [weights, roughness] = coat?;
        (roughness[texel] == narrowest[texel]).then_some(weights[texel])
    };
    let mean =
        |from: usize, texel: usize| (0..3).map(|c| maps.plane(from + c)[texel]).sum::<f32>() / 3.0;
    if let Some(lost) = LostHighlights::find(maps, photographs) {
        for texel in (0..texels).filter(|texel| lost.texels[*texel]) {
            let f0 = mean(channel::SPECULAR, texel);
            let highlight = narrowest[texel];
            let [of_f0, of_roughness] = of_tails(f0, highlight);
            widen(SPECULAR, texel, of_f0);
            // Where only tails are visible, bare metal looks like a coat on black.
            let coated = maps.plane(channel::ROUGHNESS)[texel] - highlight;
            widen(ROUGHNESS, texel, of_roughness.hypot(coated));
            if let Some(weight) = coat(texel) {
                // Any weight, with equal probability.
                let of_weight = (weight.powi(3) + (1.0 - weight).powi(3)) / 3.0;
                widen(COAT, texel, of_weight.sqrt());
                widen(COAT_ROUGHNESS, texel, of_roughness);
            }
        }
    }
    for (texel, log) in core_errors(maps, photographs).into_iter().enumerate() {
        if log != 0.0 {
            let [of_f0, of_roughness] = of_core(log);
            widen(SPECULAR, texel, of_f0 * mean(channel::SPECULAR, texel));
            widen(ROUGHNESS, texel, of_roughness * narrowest[texel]);
            if let Some(weight) = coat(texel) {
                widen(COAT, texel, of_f0 * weight);
                widen(COAT_ROUGHNESS, texel, of_roughness * narrowest[texel]);
            }
        }
    }
    let brightness = capture.board().map_or(0.0, Board::height_brightness) as f32;
    if brightness > 0.0 {
        for texel in 0..texels {
            widen(DIFFUSE, texel, brightness * mean(channel::DIFFUSE, texel));
            widen(SPECULAR, texel, brightness * mean(channel::SPECULAR, texel));
        }
    }
    Uncertainty::from_planes(width, height, planes)
}

/// Root mean square errors of F0 and roughness if only F0 roughness⁴ is known and F0 is uniformly distributed.
fn of_tails(f0: f32, roughness: f32) -> [f32; 2] {
    let [low, high] = F0;
    let f0 = f0.clamp(low, high);
    let of_f0 = ((high - f0).powi(3) - (low - f0).powi(3)) / (3.0 * (high - low));
    // Roughness is proportional to the power -1/4 of F0.
    let mean_power = |p: f32| (high.powf(1.0 - p) - low.powf(1.0 - p)) / (1.0 - p) / (high - low);
    let relative = f0.sqrt() * mean_power(0.5) - 2.0 * f0.powf(0.25) * mean_power(0.25) + 1.0;
    [of_f0.sqrt(), roughness * relative.max(0.0).sqrt()]
}

/// Relative errors of F0 and roughness that explain a core `exp(log)` times as bright as rendered. With the tails known,
/// the peak, F0 / (4 alpha²), goes with F0², and roughness with the power -1/4 of F0. The median over a core that is
/// taken for too wide is about half the peak's logarithm.
fn of_core(log: f32) -> [f32; 2] {
    [(log.exp() - 1.0).abs(), ((-0.25 * log).exp() - 1.0).abs()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A metal that a fit takes for something wider and darker with the same tails.
    #[test]
    fn cores_tell_how_far_f0_and_roughness_are_off() {
        for (f0, fitted) in [(0.9_f32, 0.2_f32), (0.5, 0.04), (0.3, 0.6)] {
            let alpha = 0.1_f32;
            let alpha_fitted = alpha * (f0 / fitted).sqrt();
            let peak = |f0: f32, alpha: f32| f0 / (4.0 * alpha * alpha);
            let log = 0.5 * (peak(f0, alpha) / peak(fitted, alpha_fitted)).ln();
            let [of_f0, of_roughness] = of_core(log);
            assert!((fitted * of_f0 - (f0 - fitted).abs()).abs() < 1e-4, "{f0} {fitted}");
            let [true_, found] = [alpha, alpha_fitted].map(f32::sqrt);
            assert!((found * of_roughness - (true_ - found).abs()).abs() < 1e-4, "{f0} {fitted}");
        }
    }

    /// Means over draws.
    #[test]
    fn tails_leave_f0_and_roughness_open_together() {
        for (f0, roughness) in [(0.07, 0.15), (0.3, 0.12), (0.9, 0.08), (0.04, 0.3)] {
            let count = 4000;
            let draws =
                (0..count).map(|i| F0[0] + (F0[1] - F0[0]) * (i as f32 + 0.5) / count as f32);
            let mut sums = [0.0_f64; 2];
            for drawn in draws {
                let other = roughness * (f0 / drawn).powf(0.25);
                assert!((drawn * other.powi(4) / (f0 * roughness.powi(4)) - 1.0).abs() < 1e-3);
                sums[0] += f64::from(drawn - f0).powi(2);
                sums[1] += f64::from(other - roughness).powi(2);
            }
            let expected = sums.map(|sum| (sum / f64::from(count)).sqrt() as f32);
            let found = of_tails(f0, roughness);
            for (found, expected) in found.into_iter().zip(expected) {
                assert!(
                    (found / expected - 1.0).abs() < 0.01,
                    "{f0} {roughness}: {found} {expected}"
                );
            }
        }
    }
}
