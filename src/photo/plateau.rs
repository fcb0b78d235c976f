//! Clipping below full scale: clipped highlights that an editor has darkened.

/// Most values sampled.
const LOOKED_AT: usize = 400_000;
/// Least share of values in a plateau, least ratio to the frequency of its neighbours, and largest
/// share of brighter values, as scattered by compression.
const SHARE: f64 = 0.003;
const TIMES: u32 = 3;
const ABOVE: f64 = 0.35;
/// Least share of values slightly below the plateau, relative to it: light fades up to a clipping
/// level, whereas evenly lit white paper has one value and no neighbours.
const BELOW: f64 = 0.15;
const FADING: std::ops::Range<usize> = 4..18;
/// Neighbours on each side; stretched contrast leaves gaps between frequent values.
const NEIGHBOURS: usize = 4;
/// Range of plateaus, up to near full scale.
const CODES: std::ops::Range<usize> = 128..250;

/// The 8-bit value at which highlights were clipped, if below full scale.
pub(super) fn plateau(data: &[u8]) -> Option<u8> {
    let pixels = data.as_chunks::<3>().0;
    let step = (3 * pixels.len() / LOOKED_AT).max(1);
    let mut counts = [0_u32; 256];
    for pixel in pixels.iter().step_by(step) {
        pixel.iter().for_each(|v| counts[usize::from(*v)] += 1);
    }
    let all = f64::from(counts.iter().sum::<u32>());
    let is_plateau = |code: &usize| {
        let own = counts[*code];
        let beside = (1..=NEIGHBOURS).flat_map(|d| [counts[code - d], counts[code + d]]);
        let above = counts[code + 1..].iter().sum::<u32>();
        let below = FADING.map(|d| counts[code - d]).sum::<u32>();
        f64::from(own) > SHARE * all
            && f64::from(below) > BELOW * f64::from(own)
            && beside.max().is_some_and(|most| own > TIMES * most)
            && f64::from(above) < ABOVE * f64::from(own)
    };
    CODES.rev().find(is_plateau).map(|code| code as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board under a falling light with noise; values above `cut` are clipped and moved to `to`.
    fn picture(cut: f64, to: f64, stretch: f64) -> Vec<u8> {
        let mut state = 1_u64;
        let mut bell = || {
            let uniform = |state: &mut u64| {
                *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (*state >> 40) as f64 / f64::from(1 << 24)
            };
            (0..12).map(|_| uniform(&mut state)).sum::<f64>() - 6.0
        };
        let mut out = Vec::new();
        for i in 0..40_000 {
            let (x, y) = (i % 200, i / 200);
            let light = 1.3 - 0.003 * f64::from(x) - 0.002 * f64::from(y);
            let board = if (x / 10 + y / 10) % 2 == 0 { 220.0 } else { 60.0 };
            for _ in 0..3 {
                let value = board * light + 3.0 * bell();
                let value = if value > cut { cut } else { value.round() };
                out.push(((value * to / cut).round() * stretch).round().clamp(0.0, 255.0) as u8);
            }
        }
        out
    }

    #[test]
    fn a_plateau_below_full_scale_is_found() {
        assert_eq!(plateau(&picture(255.0, 232.0, 1.0)), Some(232));
        assert_eq!(plateau(&picture(240.0, 190.0, 1.0)), Some(190));
        // Clipped at full scale, not clipped, and with gaps between values.
        assert_eq!(plateau(&picture(255.0, 255.0, 1.0)), None);
        assert_eq!(plateau(&picture(1e9, 0.8e9, 1.0)), None);
        assert_eq!(plateau(&picture(1e9, 0.5e9, 1.7)), None);
        // White and black squares under an even light.
        let even = (0..90_000).map(|i| if i / 3000 % 2 == 0 { 192 } else { 50 });
        assert_eq!(plateau(&even.collect::<Vec<u8>>()), None);
    }
}
