//! Error of a predicted photograph.

use crate::estimate::bundle::Sample;
use crate::estimate::coordinates::Coordinates;
use crate::estimate::coordinates::natural;
use crate::estimate::correction::Correction;
use crate::render::PointView;
use crate::svbrdf::LOBES;

/// Weighted mean squared error of the prediction of a photograph that was not fitted, in gamma 2.2, with the
/// best factor of brightness.
pub(super) fn error(
    sample: &Sample,
    photograph: usize,
    correction: &Correction,
    lobes: impl Fn(usize) -> [f64; LOBES],
    coordinates: impl Fn(usize) -> Coordinates,
) -> f64 {
    let photograph = &sample.photographs[photograph];
    let light = PointView::new(&correction.predict(&photograph.view));
    let n = sample.texels();
    let gamma = |v: f64| v.clamp(0.0, 1e6).powf(1.0 / 2.2);
    let mut values = Vec::with_capacity(3 * n);
    let (mut products, mut squares) = (0.0, 1e-12);
    for t in 0..n {
        let weight = f64::from(photograph.weight[t]);
        let value = light.value(&natural(&coordinates(t)), &lobes(t), sample.places[t]);
        for c in 0..3 {
            let seen = f64::from(photograph.radiance[c * n + t]);
            let (ours, theirs) = (gamma(value[c]), gamma(seen.abs()));
            if seen >= 0.0 {
                products += weight * ours * theirs;
                squares += weight * ours * ours;
            }
            values.push([weight, ours, theirs, if seen < 0.0 { theirs } else { f64::MAX }]);
        }
    }
    let factor = products / squares;
    let (mut sum, mut total) = (0.0, 1e-12);
    for [weight, ours, theirs, limit] in values {
        sum += weight * ((factor * ours).min(limit) - theirs).powi(2);
        total += weight;
    }
    sum / total
}
