//! Residuals of each photograph.

use crate::Result;
use crate::estimate::{Contradiction, Estimation, Part};
use crate::loss::log_l1;
use crate::observation::Observation;
use crate::render::render;
use crate::statistics::{MAD_TO_SIGMA, median};

/// Fewest photographs of which one may be an outlier.
const OUTLIER_FROM: usize = 4;
/// An outlier's residual is this many robust standard deviations above the median, and this many times the
/// median: residuals of photographs that agree differ little.
const OUTLIER_SIGMA: f32 = 5.0;
const OUTLIER_RATIO: f32 = 1.5;

/// Fit of the current maps to an accepted photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotoFit {
    /// Median over its texels of the absolute log ratio of rendered to measured radiance, averaged over the
    /// colours: a relative error.
    pub residual: f32,
    /// Mean weight of its texels, 0 to 1: the cosine to the camera; 0 for invisible and masked texels.
    pub weight: f32,
    /// Whether the photograph is an outlier. From four photographs on: its residual is far above the others'.
    /// From three on, with a board: its board has another light, or most of the sample differs; its weight is
    /// then 0.
    pub outlier: bool,
    /// The largest outlier region, masked in the fit: a hand, sun, a shadow or glare on a part of the sample.
    /// `None` with fewer than three photographs or without a board.
    pub part: Option<Part>,
}

impl Estimation {
    /// Fit of the current maps to each photograph.
    ///
    /// # Errors
    /// Without photographs.
    pub fn residuals(&self) -> Result<Vec<PhotoFit>> {
        let maps = self.maps()?;
        let texels = maps.texels();
        let mut rendered = vec![0.0; 3 * texels];
        let mut errors = Vec::with_capacity(texels);
        let mut residual = |observation: &Observation| {
            render(&maps, &observation.view, &mut rendered);
            errors.clear();
            for t in (0..texels).filter(|&t| observation.weight(t) > 0.0) {
                let error = |c: usize| {
                    log_l1(rendered[c * texels + t].into(), observation.radiance(c, t).into())
                };
                errors.push(((error(0) + error(1) + error(2)) / 3.0) as f32);
            }
            median(errors.iter().copied()).unwrap_or(0.0)
        };
        let seen = (0..self.photographs.len()).map(|i| self.photographs.unmasked(i));
        let residuals: Vec<f32> = seen.map(|observation| residual(&observation)).collect();
        let limit = limit(residuals.clone());
        let counting = self.photographs.full().iter().zip(self.photographs.contradictions());
        let fit = |(residual, (counting, found)): (f32, (&Observation, Option<&Contradiction>))| {
            let part = found.and_then(Contradiction::largest_part);
            let weight = (counting.total_weight() / texels as f64) as f32;
            let outlier = residual > limit || (found.is_some() && part.is_none());
            PhotoFit { residual, weight, outlier, part }
        };
        Ok(residuals.into_iter().zip(counting).map(fit).collect())
    }
}

/// The residual above which a photograph is an outlier.
fn limit(mut residuals: Vec<f32>) -> f32 {
    if residuals.len() < OUTLIER_FROM {
        return f32::INFINITY;
    }
    let middle = lower_median(&mut residuals);
    let mut off: Vec<f32> = residuals.iter().map(|r| (r - middle).abs()).collect();
    let sigma = MAD_TO_SIGMA as f32 * lower_median(&mut off);
    (middle + OUTLIER_SIGMA * sigma).max(OUTLIER_RATIO * middle)
}

/// The median; of an even number the lower of the two middle values, which an outlier does not move.
fn lower_median(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values[(values.len() - 1) / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_are_above_the_limit() {
        assert_eq!(limit(vec![0.01, 0.01, 0.5]), f32::INFINITY);
        let limit_of = |values: &[f32]| limit(values.to_vec());
        assert!(limit_of(&[0.02, 0.021, 0.019, 0.2]) < 0.1);
        // Photographs that agree well do not differ enough to matter.
        assert!(limit_of(&[0.01, 0.01, 0.01, 0.012]) > 0.012);
        assert!(limit_of(&[0.02, 0.05, 0.03, 0.06]) > 0.06);
    }
}
