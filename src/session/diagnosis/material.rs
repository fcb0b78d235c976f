//! Materials outside the model: residuals depend on the angle to the vertical, whichever photograph shows it.

use crate::Svbrdf;
use crate::observation::Observation;
use crate::parallel;
use crate::render::render;
use crate::session::hint::Hint;

/// Width of a bin of angles, degrees, and number of bins.
const BIN_DEG: f32 = 4.0;
const BINS: usize = 20;
/// Fewest texels of a photograph in a bin.
const TEXELS: f64 = 200.0;
/// Fewest photographs that separate angles from photographs.
const PHOTOGRAPHS: usize = 4;
/// Largest misfit of levels by angle relative to that of levels by photograph, and least range over the angles
/// (logarithm).
const LEFT: f64 = 0.6;
const RANGE: f64 = 0.15;

/// Sum of the logarithms of measured over rendered radiance in a bin of a photograph.
#[derive(Debug, Clone, Copy, Default)]
struct Bin {
    count: f64,
    sum: f64,
}

impl Bin {
    fn mean(&self) -> f64 {
        self.sum / self.count
    }
}

/// The hint, if the residuals are due to the material.
pub(super) fn find(maps: &Svbrdf, photographs: &[Observation]) -> Option<Hint> {
    if photographs.len() < PHOTOGRAPHS {
        return None;
    }
    let all = parallel::map(photographs.len(), |i| bins(maps, &photographs[i]));
    let filled = || {
        all.iter().enumerate().flat_map(|(i, bins)| {
            let filled = bins.iter().enumerate().filter(|(_, bin)| bin.count > TEXELS);
            filled.map(move |(k, bin)| (i, k, bin.mean()))
        })
    };
    // Least squares; each bin of a photograph counts once.
    let level = |of: &dyn Fn(&(usize, usize, f64)) -> bool| {
        let (sum, count) =
            filled().filter(of).fold((0.0, 0.0), |(s, n), (_, _, mean)| (s + mean, n + 1.0));
        (count > 0.0).then(|| sum / count)
    };
    let by_angle: Vec<Option<f64>> = (0..BINS).map(|k| level(&|&(_, bin, _)| bin == k)).collect();
    let by_photograph: Vec<Option<f64>> =
        (0..photographs.len()).map(|i| level(&|&(photograph, ..)| photograph == i)).collect();
    let left = |expected: &dyn Fn(usize, usize) -> Option<f64>| {
        filled().filter_map(|(i, k, mean)| Some((mean - expected(i, k)?).powi(2))).sum::<f64>()
    };
    let of_angle = left(&|_, k| by_angle[k]);
    let of_photograph = left(&|i, _| by_photograph[i]);
    let seen: Vec<(usize, f64)> =
        by_angle.iter().enumerate().filter_map(|(k, mean)| Some((k, (*mean)?))).collect();
    let (first, last) = (seen.first()?, seen.last()?);
    let low = seen.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    let high = seen.iter().map(|s| s.1).fold(f64::NEG_INFINITY, f64::max);
    let degrees = |k: usize| (k as f32 + 0.5) * BIN_DEG;
    let is_material = of_angle < LEFT * of_photograph && high - low > RANGE;
    is_material.then(|| Hint::OtherMaterial {
        from: first.1.exp() as f32,
        from_deg: degrees(first.0),
        to: last.1.exp() as f32,
        to_deg: degrees(last.0),
    })
}

fn bins(maps: &Svbrdf, photograph: &Observation) -> [Bin; BINS] {
    let (w, h) = (photograph.width(), photograph.height());
    let texels = w * h;
    let mut rendered = vec![0.0; 3 * texels];
    render(maps, &photograph.view, &mut rendered);
    let mut bins = [Bin::default(); BINS];
    for t in (0..texels).filter(|t| photograph.weight(*t) > 0.0) {
        let [x, y] = photograph.view.texel_mm(w, h, t % w, t / w);
        let [cx, cy, cz] = photograph.view.camera_mm;
        let degrees = (cx - x).hypot(cy - y).atan2(cz).to_degrees();
        let sum = |of: &dyn Fn(usize) -> f32| (0..3).map(of).sum::<f32>();
        let (measured, expected) =
            (sum(&|c| photograph.radiance(c, t)), sum(&|c| rendered[c * texels + t]));
        let saturated = (0..3).any(|c| photograph.radiance(c, t) < 0.0);
        if !saturated && measured > 0.0 && expected > 0.0 {
            let bin = &mut bins[((degrees / BIN_DEG) as usize).min(BINS - 1)];
            bin.count += 1.0;
            bin.sum += f64::from((measured / expected).ln().clamp(-1.0, 1.0));
        }
    }
    bins
}
