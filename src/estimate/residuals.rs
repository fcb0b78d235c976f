//! How the maps of the moment explain each photograph, how much noise is expected, and estimates begun
//! anew.

use super::contradiction::{self, Part};
use super::estimation::Estimation;
use super::options::EstimateOptions;
use crate::Result;
use crate::loss::log_l1;
use crate::observation::Observation;
use crate::render::render;

/// How maps explain a photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Residual {
    /// Median over the texels seen of the absolute log residual, mean of the channels.
    pub median: f32,
    /// Mean weight of all texels.
    pub weight: f32,
    /// The largest part that contradicts the other photographs.
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
    pub fn residuals(&self) -> Result<Vec<Residual>> {
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
            Residual { median, weight, part: None }
        };
        let full = self.photographs.full();
        let mut residuals: Vec<Residual> = full.iter().map(residual).collect();
        let parts = contradiction::parts(&maps, &full.iter().collect::<Vec<_>>());
        for (residual, part) in residuals.iter_mut().zip(parts) {
            residual.part = part;
        }
        Ok(residuals)
    }
}
