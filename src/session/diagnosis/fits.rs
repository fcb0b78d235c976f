//! Hints from the residuals of the fit: contradictions, and materials outside the model.

use super::material;
use crate::Svbrdf;
use crate::assessment::PhotoFit;
use crate::estimate::Part;
use crate::observation::Observation;
use crate::session::capture::Board;
use crate::session::hint::{Group, Hint};
use crate::statistics::median;

/// Least residual of a contradiction, absolute and relative to the median photograph's. Photographs that agree leave
/// some hundredths, glossy ones more; a false hint is worse than none.
const CONTRADICTING_RESIDUAL: f32 = 0.08;
const CONTRADICTING_TIMES: f32 = 2.5;
/// A standard deviation of the height above this may explain contradicting parts, mm.
const HEIGHT_SIGMA_MM: f64 = 2.0;
/// Share of the highlight in a prediction above which a darker part is a wrong prediction: the highlights of brushed
/// metal and of flakes turn with directions that a few photographs do not tell.
const ALL_HIGHLIGHT: f32 = 0.8;

/// Adds the hints.
pub(super) fn tell(
    board: Option<&Board>,
    maps: Option<&Svbrdf>,
    photographs: &[Observation],
    fits: &[PhotoFit],
    group: Option<Group>,
    hints: &mut [Vec<Hint>],
) {
    if fits.len() != photographs.len() {
        return;
    }
    if let Some(group) = group {
        let members = (0..hints.len()).filter(|i| group.contains(*i));
        members.for_each(|i| hints[i].push(Hint::TwoGroups { group }));
        return;
    }
    // With a wrong light, every photograph contradicts the others.
    if hints.iter().flatten().any(|hint| matches!(hint, Hint::LightStays { .. })) {
        return;
    }
    let usual = median(fits.iter().map(|fit| fit.residual)).unwrap_or(0.0);
    let limit = CONTRADICTING_RESIDUAL.max(CONTRADICTING_TIMES * usual);
    let contradicts = |fit: &PhotoFit| fit.outlier && (fit.weight == 0.0 || fit.residual > limit);
    let odd = fits.iter().any(contradicts);
    if let Some(material) = maps.filter(|_| odd).and_then(|maps| material::find(maps, photographs))
    {
        hints.iter_mut().for_each(|hints| hints.push(material));
        return;
    }
    let height_unknown = board.is_some_and(|board| {
        !board.is_height_stated() && board.elevation.sigma_mm > HEIGHT_SIGMA_MM
    });
    for (fit, hints) in fits.iter().zip(hints) {
        let residual = fit.residual;
        if contradicts(fit) {
            hints.push(Hint::Contradicts { residual, usual });
        } else if let Some(part) = fit.part.filter(|part| !is_missing_highlight(part)) {
            hints.push(Hint::PartContradicts { part, height_unknown });
        }
    }
}

/// Whether a part only lacks a highlight that the other photographs predict.
fn is_missing_highlight(part: &Part) -> bool {
    part.ratio < 1.0 && part.highlight > ALL_HIGHLIGHT
}
