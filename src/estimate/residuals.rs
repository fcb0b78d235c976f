//! How the maps of the moment explain each photograph, how much noise is expected, and estimates begun
//! anew.

use super::contradiction::{self, Part};
use super::estimation::Estimation;
use super::options::EstimateOptions;
use crate::Result;
use crate::loss::log_l1;
use crate::observation::Observation;
use crate::render::render;

/// Photographs from which on one may stand out.
const OUTLIER_FROM: usize = 4;
/// A residual stands out that is so many robust standard deviations above the median, and so many
/// times as large: of photographs that agree, deviations are tiny.
const OUTLIER_SIGMA: f32 = 5.0;
const OUTLIER_RATIO: f32 = 1.5;
/// Standard deviation of a normal distribution over its median absolute deviation.
const MAD_TO_SIGMA: f32 = 1.4826;

/// How the maps of the moment explain an accepted photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameFit {
    /// Median over its texels of the absolute difference of the logarithms of rendered and measured
    /// radiance, mean of the channels: a relative error.
    pub residual: f32,
    /// Mean weight of its texels, 0 to 1: the cosine to the camera, 0 for texels that it does not show.
    pub weight: f32,
    /// Whether it contradicts the others: its residual stands out. Of fewer than four photographs
    /// none does.
    pub outlier: bool,
    /// A part of it that contradicts the others: sun, a shadow, a hand or glare on a part of the
    /// sample. Of fewer than four photographs none does.
    pub part: Option<Part>,
}

impl Estimation {
    /// An estimate of the same kind without photographs.
    pub fn afresh(&self) -> Self {
        let mut fresh = Self::new(self.networks.clone(), self.task, self.least_options());
        fresh.keep_record = self.keep_record;
        fresh
    }

    /// The options before any photograph has shown its noise.
    pub(super) fn least_options(&self) -> EstimateOptions {
        EstimateOptions { noise: self.least_noise, ..self.options.clone() }
    }

    /// Expects as much noise as the photographs' calibration shows, or without one the texels.
    pub(super) fn expect_noise(&mut self) {
        let least = self.least_noise;
        self.options.noise = match self.photographs.log_sigma() {
            0.0 => least.uncalibrated(self.texel_residual),
            log_sigma => least.calibrated(log_sigma),
        };
    }

    /// How the maps as they are now explain each photograph.
    ///
    /// # Errors
    /// Without photographs.
    pub fn residuals(&self) -> Result<Vec<FrameFit>> {
        let maps = self.maps()?;
        let texels = maps.texels();
        let mut rendered = vec![0.0; 3 * texels];
        let mut errors = Vec::with_capacity(texels);
        let residual = |observation: &Observation| {
            render(&maps, &observation.view, &mut rendered);
            errors.clear();
            for t in (0..texels).filter(|&t| observation.weight(t) > 0.0) {
                let error = |c: usize| {
                    log_l1(rendered[c * texels + t].into(), observation.radiance(c, t).into())
                };
                errors.push(((error(0) + error(1) + error(2)) / 3.0) as f32);
            }
            let middle = errors.len() / 2;
            let median = match errors.is_empty() {
                true => 0.0,
                false => *errors.select_nth_unstable_by(middle, f32::total_cmp).1,
            };
            let weight = (observation.total_weight() / texels as f64) as f32;
            FrameFit { residual: median, weight, outlier: false, part: None }
        };
        let full = self.photographs.full();
        let mut fits: Vec<FrameFit> = full.iter().map(residual).collect();
        let limit = limit(fits.iter().map(|fit| fit.residual).collect());
        let parts = contradiction::parts(&maps, &full.iter().collect::<Vec<_>>());
        for (fit, part) in fits.iter_mut().zip(parts) {
            (fit.outlier, fit.part) = (fit.residual > limit, part);
        }
        Ok(fits)
    }
}

/// The residual above which a photograph stands out.
fn limit(mut residuals: Vec<f32>) -> f32 {
    if residuals.len() < OUTLIER_FROM {
        return f32::INFINITY;
    }
    let median = |values: &mut Vec<f32>| {
        values.sort_by(f32::total_cmp);
        values[(values.len() - 1) / 2]
    };
    let middle = median(&mut residuals);
    let mut off: Vec<f32> = residuals.iter().map(|r| (r - middle).abs()).collect();
    let sigma = MAD_TO_SIGMA * median(&mut off);
    (middle + OUTLIER_SIGMA * sigma).max(OUTLIER_RATIO * middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_out_is_above_the_limit() {
        assert_eq!(limit(vec![0.01, 0.01, 0.5]), f32::INFINITY);
        let limit_of = |values: &[f32]| limit(values.to_vec());
        assert!(limit_of(&[0.02, 0.021, 0.019, 0.2]) < 0.1);
        // Photographs that agree well do not differ enough to matter.
        assert!(limit_of(&[0.01, 0.01, 0.01, 0.012]) > 0.012);
        assert!(limit_of(&[0.02, 0.05, 0.03, 0.06]) > 0.06);
    }
}
