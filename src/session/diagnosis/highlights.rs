//! Highlights whose shape is lost: all that photographs show of them unsaturated is their tails.
//!
//! The same is so where maps, for whatever reason, do not explain how bright highlights are.
//!
//! Far from its peak a lobe of GGX shows the product of F0 and the square of alpha alone: a narrow and bright highlight
//! then looks like a wide and dim one.

use crate::Svbrdf;
use crate::observation::Observation;
use crate::parallel;
use crate::render::render;
use crate::statistics::median;
use crate::svbrdf::channel;

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
/// Maps must explain so much of a saturated highlight, and so much of one that a darker photograph shows: values so many
/// times those that are usually saturated. Share of a material's texels that may be brighter.
const EXPLAINED: f32 = 0.4;
const EXPLAINED_SEEN: f32 = 0.6;
const BEYOND: f32 = 1.5;
const DIM: f32 = 0.02;
/// Weight of a coat whose highlight counts.
const COAT: f32 = 0.05;
/// Half vectors within this tangent of the normal of the sample are near the mirror direction; of what is brighter than
/// explained, so much may be elsewhere, relative to that.
const MIRROR: f32 = 0.25;
const ELSEWHERE: f32 = 0.2;

/// Texels of materials whose highlights no photograph shows below saturation, or whose maps do not explain them.
pub(in crate::session) struct LostHighlights {
    /// Which texels.
    pub texels: Vec<bool>,
    /// Share of the sample whose shoulder is saturated, or whose highlight is brighter than the maps explain.
    pub share: f32,
    /// Whether maps do not explain highlights: no photograph is to blame for that.
    pub unexplained: bool,
}

impl LostHighlights {
    /// `None` where photographs show enough of the highlights.
    pub fn find(maps: &Svbrdf, photographs: &[Observation]) -> Option<Self> {
        let texels = photographs.first()?.texels();
        let level = saturation(photographs)?;
        let bin = |t: usize| {
            let octaves = (1.0 / narrowest(maps, t).powi(2).max(1e-4)).log2() * BINS_PER_OCTAVE;
            (octaves as usize).min(BINS - 1)
        };
        let all =
            parallel::values(texels, |t| shoulder(photographs, t, narrowest(maps, t).powi(2)));
        let dim = dim_texels(maps, photographs, level);
        let mut counts = [Counts::default(); BINS];
        for t in 0..texels {
            let of = &mut counts[bin(t)];
            of.all += 1;
            of.dim += usize::from(dim[t]);
            of.seen += usize::from(all[t] == Shoulder::Seen);
            of.lost += usize::from(all[t] == Shoulder::Lost);
        }
        let many = |count: usize| count as f32 > LOST * texels as f32;
        let is_lost = |k: usize| {
            let Counts { lost, seen, .. } = counts[k];
            many(lost) && seen as f32 <= SEEN * lost as f32
        };
        let is_dim =
            |k: usize| many(counts[k].dim) && counts[k].dim as f32 > DIM * counts[k].all as f32;
        let count = |k: usize| match (is_dim(k), is_lost(k)) {
            (false, false) => 0,
            (true, false) => counts[k].dim,
            (false, true) => counts[k].lost,
            (true, true) => counts[k].dim.max(counts[k].lost),
        };
        let total: usize = (0..BINS).map(count).sum();
        // What holds for a material holds where none of its highlights fell as well.
        let is_open = |(t, shoulder): (usize, &Shoulder)| {
            is_dim(bin(t)) || (*shoulder != Shoulder::Seen && is_lost(bin(t)))
        };
        (total > 0).then(|| Self {
            texels: all.iter().enumerate().map(is_open).collect(),
            share: total as f32 / texels as f32,
            unexplained: (0..BINS).any(is_dim),
        })
    }
}

/// Roughness of the lobe that a texel's highlight is that of: a coat takes up what is narrower than the base.
pub(in crate::session) fn narrowest(maps: &Svbrdf, texel: usize) -> f32 {
    let base = maps.plane(channel::ROUGHNESS)[texel];
    match maps.coat() {
        Some([weight, coat]) if weight[texel] > COAT => base.min(coat[texel]),
        _ => base,
    }
}

/// Texels of a material.
#[derive(Clone, Copy, Default)]
struct Counts {
    all: usize,
    /// Whose highlight is brighter than the maps explain.
    dim: usize,
    seen: usize,
    lost: usize,
}

/// Mean of the channels, and whether one is saturated.
fn seen(photograph: &Observation, texel: usize) -> (f32, bool) {
    let values: [f32; 3] = std::array::from_fn(|c| photograph.radiance(c, texel));
    let sum: f32 = values.iter().map(|v| v.abs()).sum();
    (sum / 3.0, values.iter().any(|v| *v < 0.0))
}

/// The usual value that is saturated; `None` where none is.
fn saturation(photographs: &[Observation]) -> Option<f32> {
    let of = |photograph: &Observation| {
        let seen = (0..photograph.texels()).map(|t| seen(photograph, t));
        median(seen.filter(|(_, saturated)| *saturated).map(|(value, _)| f64::from(value)))
    };
    median(photographs.iter().filter_map(of)).map(|level| level as f32)
}

/// Texels whose highlight is far brighter than the maps have it, in some photograph: saturated, or of a darker
/// photograph that shows what is saturated in the others. None where that is so away from the mirror direction as
/// well: other light is on the sample then.
fn dim_texels(maps: &Svbrdf, photographs: &[Observation], level: f32) -> Vec<bool> {
    let texels = maps.texels();
    let mut dim = vec![false; texels];
    let (mut near, mut far) = (0_usize, 0_usize);
    let mut rendered = vec![0.0; 3 * texels];
    for photograph in photographs {
        render(maps, &photograph.view, &mut rendered);
        for t in (0..texels).filter(|t| photograph.weight(*t) > 0.0) {
            let (value, saturated) = seen(photograph, t);
            let explained = (0..3).map(|c| rendered[c * texels + t]).sum::<f32>() / 3.0;
            let least = if saturated { EXPLAINED } else { EXPLAINED_SEEN };
            if explained < least * value && (saturated || value > BEYOND * level) {
                if half_tangent(photograph, t) < MIRROR {
                    dim[t] = true;
                    near += 1;
                } else {
                    far += 1;
                }
            }
        }
    }
    if far as f32 > ELSEWHERE * near as f32 { vec![false; texels] } else { dim }
}

/// What photographs show of the lobe of a texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Shoulder {
    /// Neither peak nor shoulder.
    #[default]
    Nowhere,
    /// Its peak or its shoulder.
    Seen,
    /// A saturated shoulder, and nothing nearer to the peak.
    Lost,
}

fn shoulder(photographs: &[Observation], texel: usize, alpha: f32) -> Shoulder {
    let from = (SHOULDER[0] * alpha).max(LEAST);
    let to = from * SHOULDER[1] / SHOULDER[0];
    let mut found = Shoulder::Nowhere;
    for photograph in photographs.iter().filter(|photograph| photograph.weight(texel) > 0.0) {
        let tangent = half_tangent(photograph, texel);
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
