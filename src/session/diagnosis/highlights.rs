//! Highlights that no photograph shows unsaturated.

use crate::observation::Observation;
use crate::session::hint::Hint;

/// Half vectors so near to the normal of the sample show the peak of a highlight, degrees.
const PEAK_DEG: f32 = 2.0;
/// Share of texels at the peak that are saturated from which on it is worth a word, and least share of the sample
/// that photographs have the peak on.
const SATURATED: f32 = 0.8;
const SEEN: f32 = 0.01;

/// Adds a word where the peaks of highlights are saturated.
pub(super) fn tell(photographs: &[Observation], hints: &mut [Vec<Hint>]) {
    let Some(first) = photographs.first() else { return };
    let (width, height) = (first.width(), first.height());
    let (mut peaks, mut saturated) = (0_usize, 0_usize);
    let limit = PEAK_DEG.to_radians().cos();
    for t in (0..width * height).step_by(3) {
        let at_peak = |o: &&Observation| {
            let [x, y] = o.view.texel_mm(width, height, t % width, t / width);
            let unit = |p: [f32; 3]| {
                let d = [p[0] - x, p[1] - y, p[2]];
                let length = d.iter().map(|v| v * v).sum::<f32>().sqrt();
                d.map(|v| v / length)
            };
            let (a, b) = (unit(o.view.camera_mm), unit(o.view.light_mm));
            let half: [f32; 3] = std::array::from_fn(|k| a[k] + b[k]);
            half[2] > limit * half.iter().map(|v| v * v).sum::<f32>().sqrt()
        };
        let mut seen = photographs.iter().filter(at_peak).peekable();
        if seen.peek().is_some() {
            peaks += 1;
            saturated += usize::from(seen.all(|o| o.weight(t) == 0.0));
        }
    }
    let share = peaks as f32 / (width * height).div_ceil(3) as f32;
    let dark = saturated as f32 / peaks.max(1) as f32;
    if share > SEEN && dark > SATURATED {
        let hint = Hint::Saturated { share: dark * share };
        hints.iter_mut().for_each(|hints| hints.push(hint));
    }
}
