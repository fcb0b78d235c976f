//! Highlights whose shape is lost: all that photographs show of them unsaturated is their tails.
//!
//! Far from its peak a lobe of GGX shows the product of F0 and the square of alpha alone: a narrow and bright highlight
//! then looks like a wide and dim one.

use crate::Svbrdf;
use crate::observation::Observation;
use crate::session::hint::Hint;

/// Half vectors whose tangent to the normal of the sample lies between this and that many alphas show the shoulder of a
/// lobe: a fifteenth to a fifth of its peak. Nearer to the normal than the least, there are too few of them.
const SHOULDER: [f32; 2] = [1.25, 1.75];
const LEAST: f32 = 0.012;
/// Materials are told by their alpha, so many for each doubling.
const BINS_PER_OCTAVE: f32 = 1.0;
const BINS: usize = 14;
/// Share of the sample whose shoulder is saturated from which on it is worth a word, and texels whose shoulder is seen
/// that are enough, relative to those.
const LOST: f32 = 0.003;
const SEEN: f32 = 0.1;

/// Adds a word where no photograph shows highlights of a material below saturation.
pub(super) fn tell(maps: Option<&Svbrdf>, photographs: &[Observation], hints: &mut [Vec<Hint>]) {
    let Some((maps, first)) = maps.zip(photographs.first()) else { return };
    let texels = first.texels();
    let (mut lost, mut seen) = ([0_usize; BINS], [0_usize; BINS]);
    for t in 0..texels {
        let roughness = maps.roughness()[t];
        let alpha = roughness * roughness;
        let bin = ((1.0 / alpha.max(1e-4)).log2() * BINS_PER_OCTAVE) as usize;
        match shoulder(photographs, t, alpha) {
            Some(Shoulder::Seen) => seen[bin.min(BINS - 1)] += 1,
            Some(Shoulder::Lost) => lost[bin.min(BINS - 1)] += 1,
            None => {}
        }
    }
    let worth = |(lost, seen): &(&usize, &usize)| {
        **lost as f32 > LOST * texels as f32 && **seen as f32 <= SEEN * **lost as f32
    };
    let count: usize = lost.iter().zip(&seen).filter(worth).map(|(lost, _)| *lost).sum();
    if count > 0 {
        let hint = Hint::Saturated { share: count as f32 / texels as f32 };
        hints.iter_mut().for_each(|hints| hints.push(hint));
    }
}

/// What photographs show of the lobe of a texel.
enum Shoulder {
    /// Its peak or its shoulder.
    Seen,
    /// A saturated shoulder, and nothing nearer to the peak.
    Lost,
}

fn shoulder(photographs: &[Observation], texel: usize, alpha: f32) -> Option<Shoulder> {
    let from = (SHOULDER[0] * alpha).max(LEAST);
    let to = from * SHOULDER[1] / SHOULDER[0];
    let mut found = None;
    for photograph in photographs.iter().filter(|photograph| photograph.weight(texel) > 0.0) {
        let tangent = half_tangent(photograph, texel);
        let saturated = (0..3).any(|c| photograph.radiance(c, texel) < 0.0);
        if tangent < to && !saturated {
            return Some(Shoulder::Seen);
        }
        if (from..to).contains(&tangent) {
            found = Some(Shoulder::Lost);
        }
    }
    found
}

/// Tangent of the angle between the half vector at a texel and the normal of the sample.
fn half_tangent(photograph: &Observation, texel: usize) -> f32 {
    let (width, height, view) = (photograph.width(), photograph.height(), &photograph.view);
    let [x, y] = view.texel_mm(width, height, texel % width, texel / width);
    let unit = |p: [f32; 3]| {
        let d = [p[0] - x, p[1] - y, p[2]];
        let length = d.iter().map(|v| v * v).sum::<f32>().sqrt();
        d.map(|v| v / length)
    };
    let (a, b) = (unit(view.camera_mm), unit(view.light_mm));
    let [x, y, z]: [f32; 3] = std::array::from_fn(|k| a[k] + b[k]);
    x.hypot(y) / z
}
