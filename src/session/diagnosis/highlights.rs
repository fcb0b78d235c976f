//! Saturated highlights of which photographs show only the tails.
//!
//! Far from its peak a GGX lobe depends on the product of F0 and alpha² alone: a narrow, bright highlight looks like a
//! wide, dim one.

use crate::Svbrdf;
use crate::observation::Observation;
use crate::parallel;

/// Range of the shoulder of a lobe (a fifteenth to a fifth of its peak) in alphas, for the tangent of the angle between
/// the half vector and the sample's normal; and the least tangent, below which there are too few texels.
const SHOULDER: [f32; 2] = [1.25, 1.75];
const LEAST: f32 = 0.012;
/// Classes of alpha per octave; each counts as one material.
const BINS_PER_OCTAVE: f32 = 1.0;
const BINS: usize = 14;
/// Least share of the sample with a saturated shoulder, and largest number of texels with a visible one relative to it.
const LOST: f32 = 0.0015;
const SEEN: f32 = 0.1;
/// Least weight of a coat whose highlight counts.
const COAT: f32 = 0.05;

/// Texels of materials whose highlights are saturated in every photograph.
pub(in crate::session) struct LostHighlights {
    /// One entry per texel.
    pub texels: Vec<bool>,
    /// Share of the sample whose shoulder is saturated.
    pub share: f32,
}

impl LostHighlights {
    /// `None` if the photographs show enough of the highlights.
    pub fn find(maps: &Svbrdf, photographs: &[Observation]) -> Option<Self> {
        let texels = photographs.first()?.texels();
        let narrowest = narrowest(maps);
        let bin = |t: usize| material(narrowest[t]);
        let all = parallel::values(texels, |t| shoulder(photographs, t, narrowest[t].powi(2)));
        let mut counts = [Counts::default(); BINS];
        for t in 0..texels {
            let of = &mut counts[bin(t)];
            of.seen += usize::from(all[t] == Shoulder::Seen);
            of.lost += usize::from(all[t] == Shoulder::Lost);
        }
        let many = |count: usize| count as f32 > LOST * texels as f32;
        let is_lost = |k: usize| {
            let Counts { lost, seen, .. } = counts[k];
            many(lost) && seen as f32 <= SEEN * lost as f32
        };
        let total: usize = (0..BINS).filter(|k| is_lost(*k)).map(|k| counts[k].lost).sum();
        // Texels of the same material that show no highlight are affected as well.
        let is_open =
            |(t, shoulder): (usize, &Shoulder)| *shoulder != Shoulder::Seen && is_lost(bin(t));
        (total > 0).then(|| Self {
            texels: all.iter().enumerate().map(is_open).collect(),
            share: total as f32 / texels as f32,
        })
    }
}

/// Roughness of each texel's narrowest lobe: that of the base or of the coat.
pub(in crate::session) fn narrowest(maps: &Svbrdf) -> Vec<f32> {
    let mut narrowest = maps.roughness().to_vec();
    if let Some([weights, coats]) = maps.coat() {
        for ((roughness, weight), coat) in narrowest.iter_mut().zip(weights).zip(coats) {
            if *weight > COAT {
                *roughness = roughness.min(*coat);
            }
        }
    }
    narrowest
}

/// Class of a texel with this roughness of its narrowest lobe.
pub(super) fn material(roughness: f32) -> usize {
    let octaves = (1.0 / roughness.powi(2).max(1e-4)).log2() * BINS_PER_OCTAVE;
    (octaves as usize).min(BINS - 1)
}

/// Numbers of a material's texels.
#[derive(Clone, Copy, Default)]
struct Counts {
    seen: usize,
    lost: usize,
}

/// Visibility of a texel's lobe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Shoulder {
    /// Neither peak nor shoulder.
    #[default]
    Nowhere,
    /// Its peak or its shoulder.
    Seen,
    /// Only a saturated shoulder.
    Lost,
}

fn shoulder(photographs: &[Observation], texel: usize, alpha: f32) -> Shoulder {
    let from = (SHOULDER[0] * alpha).max(LEAST);
    let to = from * SHOULDER[1] / SHOULDER[0];
    let mut found = Shoulder::Nowhere;
    for photograph in photographs.iter().filter(|photograph| photograph.weight(texel) > 0.0) {
        let tangent = Half::of(photograph, texel).tangent_to([0.0, 0.0, 1.0]);
        let saturated = (0..3).any(|c| photograph.radiance(c, texel) < 0.0);
        if tangent < to && !saturated {
            return Shoulder::Seen;
        }
        if (from..to).contains(&tangent) {
            found = Shoulder::Lost;
        }
    }
    found
}

/// Half vector of camera and light at a texel, not normalised.
pub(super) struct Half([f32; 3]);

impl Half {
    pub fn of(photograph: &Observation, texel: usize) -> Self {
        let (width, height, view) = (photograph.width(), photograph.height(), &photograph.view);
        let [x, y] = view.texel_mm(width, height, texel % width, texel / width);
        let unit = |p: [f32; 3]| {
            let d = [p[0] - x, p[1] - y, p[2]];
            let length = d.iter().map(|v| v * v).sum::<f32>().sqrt();
            d.map(|v| v / length)
        };
        let (a, b) = (unit(view.camera_mm), unit(view.light_mm));
        Self(std::array::from_fn(|k| a[k] + b[k]))
    }

    /// Tangent of the angle to a normal of any length; infinite beyond 90 degrees.
    pub fn tangent_to(&self, normal: [f32; 3]) -> f32 {
        let Self([x, y, z]) = *self;
        let [a, b, c] = normal;
        let cross = [y * c - z * b, z * a - x * c, x * b - y * a];
        let along = x * a + y * b + z * c;
        let across = cross.iter().map(|v| v * v).sum::<f32>().sqrt();
        if along > 0.0 { across / along } else { f32::INFINITY }
    }
}
