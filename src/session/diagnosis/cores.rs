//! Cores of highlights that photographs show, but the maps do not explain.
//!
//! Tails of a GGX lobe determine only the product of F0 and alpha². A fit to many tails can settle on the wrong pair
//! although one photograph, a darker one for example, shows the core.

use super::highlights::{Half, material, narrowest};
use crate::Svbrdf;
use crate::observation::Observation;
use crate::parallel;
use crate::render::render;
use crate::statistics::median;

/// Extent of a core: tangent of the angle between half vector and normal in alphas, and its least value.
const CORE: f32 = 1.25;
const LEAST: f32 = 0.012;
/// Roughness above which a highlight has no core of its own.
const ROUGHEST: f32 = 0.6;
/// Fewest texels that determine the error of a material.
const TEXELS: usize = 40;
/// Least error (logarithm): relief and noise leave that much in good maps.
const LEAST_LOG: f32 = 0.4;

/// Median logarithm of measured over rendered radiance in the cores of each texel's material. 0 where the maps explain
/// them, and where no photograph shows them.
pub(in crate::session) fn core_errors(maps: &Svbrdf, photographs: &[Observation]) -> Vec<f32> {
    let narrowest = narrowest(maps);
    let materials: Vec<usize> = narrowest.iter().map(|roughness| material(*roughness)).collect();
    let logs = parallel::map(photographs.len(), |i| errors(maps, &narrowest, &photographs[i]));
    let mut all: Vec<Vec<f32>> = Vec::new();
    for (texel, log) in logs.into_iter().flatten() {
        let material = materials[texel];
        all.resize_with(all.len().max(material + 1), Vec::new);
        all[material].push(log);
    }
    let errors = all.into_iter().map(|logs| match logs.len() {
        count if count < TEXELS => 0.0,
        _ => median(logs).filter(|log| log.abs() > LEAST_LOG).unwrap_or(0.0),
    });
    let errors: Vec<f32> = errors.collect();
    materials.iter().map(|material| errors.get(*material).copied().unwrap_or(0.0)).collect()
}

/// Texels whose core a photograph shows below saturation, with their errors. `narrowest` is the roughness of each
/// texel's narrowest lobe.
fn errors(maps: &Svbrdf, narrowest: &[f32], photograph: &Observation) -> Vec<(usize, f32)> {
    let texels = maps.texels();
    let mut rendered = vec![0.0; 3 * texels];
    render(maps, &photograph.view, &mut rendered);
    let [slopes_x, slopes_y] = maps.normal_slopes();
    let error = |t: usize| {
        let roughness = narrowest[t];
        if photograph.weight(t) <= 0.0 || roughness > ROUGHEST {
            return None;
        }
        let tangent = Half::of(photograph, t).tangent_to([slopes_x[t], slopes_y[t], 1.0]);
        let saturated = (0..3).any(|c| photograph.radiance(c, t) < 0.0);
        if saturated || tangent > (CORE * roughness.powi(2)).max(LEAST) {
            return None;
        }
        let sum = |of: &dyn Fn(usize) -> f32| (0..3).map(of).sum::<f32>();
        let measured = sum(&|c| photograph.radiance(c, t));
        let expected = sum(&|c| rendered[c * texels + t]);
        (measured > 0.0 && expected > 0.0).then(|| (t, (measured / expected).ln()))
    };
    (0..texels).filter_map(error).collect()
}
