//! The structured prior: few material classes with small deviations of texels, found together with
//! exposure and place of the flash, where photographs contradict the light that was given; its widths
//! chosen by leaving photographs out.
//!
//! Texels get their gloss from the tails of highlights, and there the model of the lobe is 10 to 15 %
//! off, alike all over the sample: a prior that lets each texel follow makes the prediction of further
//! photographs worse with every photograph. Gloss is therefore that of soft classes of like colour,
//! with deviations of texels only as far as they help to predict; slopes are flat in the same sense.
//! What all texels share (gain of each photograph, exposure over distance, one offset of the flash) is
//! found in the same equations, each texel eliminated (Schur complement).
//!
//! How far texels may deviate differs from material to material: the [`trials`] choose.

mod prediction;
mod setup;
#[cfg(test)]
mod tests;
mod trials;

use std::sync::Arc;

use super::belief::Belief;
use super::bundle::Sample;
use super::clusters::Clusters;
use super::correction::Correction;
use super::finer::full_colours;
use super::options::{EstimateOptions, Widths};
use super::photographs::Photographs;
use super::prior::{Coordinates, Prior, from_coordinate, to_coordinate};
use crate::Svbrdf;
use crate::parallel;
use setup::{DIFFUSE, DIFFUSE_FRACTION, GLOSS, Light, STEPS, Setup, descended, sigmas};
pub(crate) use trials::WidthTrials;

/// Texels along the longer side that are fitted, at most.
const TEXELS: usize = 64;

/// Fits classes, texels, exposure and flash with the chosen widths; the belief's mean are flat maps
/// with the gloss of their classes, of few photographs with a part of the estimate's own deviation,
/// its widths those chosen.
pub(super) fn fit(
    photographs: &mut Photographs,
    belief: &mut Belief,
    widths: Widths,
    options: &EstimateOptions,
) {
    let o = &options.structured;
    let sample = Arc::new(Sample::new(photographs.working(), TEXELS, TEXELS));
    let which: Vec<usize> = (0..photographs.len()).collect();
    let mut setup = Setup::new(&sample, &which, widths.classes, options);
    let own = (which.len() < options.schedule.determined_from).then_some(o.own_share);
    if let Some(own) = own {
        let maps = belief.maps.thinned(photographs.thinning());
        setup = setup.around(&sample.coordinates(&maps), own);
    }
    let classes = setup.classes.clone();
    let problem = setup.problem(&sample, which, widths, Light::Exposure, options);
    let (problem, state) = descended(problem, STEPS);
    let mut gloss = state.groups;
    for (class, mean) in gloss.iter_mut().zip(&problem.groups.mean) {
        class.iter_mut().zip(mean).for_each(|(v, m)| *v -= own.unwrap_or(0.0) * m);
    }
    let classes = Gloss { classes, values: gloss };
    belief.mean = classes.flat_maps(&belief.maps, own, photographs);
    belief.maps.clone_from(&belief.mean);
    belief.prior = Prior { sigma: sigmas(&widths).map(|s| s as f32) };
    belief.fixed_noise = Some(o.noise as f32);
    let mirrored = photographs.correction().mirrored.clone();
    photographs.correct(Correction { mirrored, ..state.correction });
}

/// Classes and the gloss of each.
struct Gloss {
    classes: Clusters,
    values: Vec<Coordinates>,
}

impl Gloss {
    /// Flat maps with the gloss of their classes, of the colours that photographs show; or with an
    /// `own` part of the estimate's gloss added, and its diffuse albedo.
    fn flat_maps(&self, estimate: &Svbrdf, own: Option<f64>, photographs: &Photographs) -> Svbrdf {
        let colours = full_colours(photographs);
        let mut maps = Svbrdf::new(estimate.width(), estimate.height());
        let width = maps.width();
        for (i, c) in DIFFUSE.enumerate() {
            let plane = maps.plane_mut(c);
            match own {
                Some(_) => plane.copy_from_slice(estimate.plane(c)),
                None => {
                    let pairs = plane.iter_mut().zip(&colours);
                    pairs.for_each(|(v, f)| *v = DIFFUSE_FRACTION * f[i] * f[i]);
                }
            }
        }
        let own = own.unwrap_or(0.0) as f32;
        let scratch = || vec![0.0; self.classes.len()];
        for c in GLOSS {
            let rows = maps.plane_mut(c).chunks_mut(width);
            parallel::parts_with(rows, scratch, |shares, y, row| {
                for (x, v) in row.iter_mut().enumerate() {
                    self.classes.shares(&colours[y * width + x], shares);
                    let of_classes = shares.iter().zip(&self.values);
                    let value: f64 = of_classes.map(|(s, g)| f64::from(*s) * g[c]).sum();
                    let estimate = to_coordinate(c, estimate.plane(c)[y * width + x]);
                    *v = from_coordinate(c, value as f32 + own * estimate);
                }
            });
        }
        maps.clamp();
        maps
    }
}
