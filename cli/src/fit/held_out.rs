//! Photographs that are predicted, not fitted.

use serde_json::{Value, json};
use svbrdf::Svbrdf;
use svbrdf::comparison::{Prediction, predict};
use svbrdf::export::resized;
use svbrdf::session::{LightCorrection, Observed};

use crate::failure::Result;

/// Texels along each side at which predictions are compared.
pub const TEXELS: usize = 256;

/// A photograph that was held out.
pub struct HeldOut {
    /// Its number in the capture.
    pub index: usize,
    pub observed: Observed,
}

/// Maps after some photographs.
pub struct Stage {
    photographs: usize,
    maps: Svbrdf,
    correction: LightCorrection,
}

impl Stage {
    /// Maps after a number of photographs, with their light correction.
    pub fn new(photographs: usize, maps: &Svbrdf, correction: LightCorrection) -> Self {
        Self { photographs, maps: resized(maps, TEXELS, TEXELS), correction }
    }
}

/// How well each stage predicts the photographs that were held out.
pub struct Errors {
    /// Numbers of the photographs in the capture.
    pub indices: Vec<usize>,
    /// Photographs fitted, and the error for each one held out.
    pub after: Vec<(usize, Vec<f64>)>,
    /// Mean CIEDE2000 of all of them after each stage.
    delta_e: Vec<f64>,
    /// Predictions of the last stage.
    pub predictions: Vec<Prediction>,
}

impl Errors {
    /// Predicts every photograph after every stage.
    pub fn measure(stages: &[Stage], held_out: Vec<HeldOut>) -> Result<Self> {
        let indices = held_out.iter().map(|h| h.index).collect();
        let mut after: Vec<(usize, Vec<f64>)> =
            stages.iter().map(|s| (s.photographs, Vec::new())).collect();
        let (mut predictions, mut delta_e) = (Vec::new(), vec![0.0; stages.len()]);
        let count = held_out.len().max(1) as f64;
        for HeldOut { observed, .. } in held_out {
            let mut photograph = observed.observation;
            while photograph.width() > TEXELS {
                photograph = photograph.downsampled();
            }
            let mut latest = None;
            for ((stage, (_, errors)), delta_e) in stages.iter().zip(&mut after).zip(&mut delta_e) {
                let given = photograph.view;
                photograph.view = stage.correction.predict(&given);
                let prediction = predict(&stage.maps, &photograph)?;
                photograph.view = given;
                errors.push(prediction.error);
                *delta_e += prediction.delta_e / count;
                latest = Some(prediction);
            }
            predictions.extend(latest);
        }
        Ok(Self { indices, after, delta_e, predictions })
    }

    /// Mean error of each stage.
    pub fn means(&self) -> impl Iterator<Item = (usize, f64)> {
        self.after.iter().map(|(n, each)| (*n, each.iter().sum::<f64>() / each.len() as f64))
    }

    /// For `report.json`.
    pub fn json(&self) -> Value {
        let after: Vec<Value> = self
            .after
            .iter()
            .zip(self.means())
            .zip(&self.delta_e)
            .map(|(((fitted, each), (_, mean)), delta_e)| {
                json!({ "fitted": fitted, "error": mean, "each": each, "delta_e00": delta_e })
            })
            .collect();
        let brightness: Vec<f64> = self.predictions.iter().map(|p| p.brightness).collect();
        json!({ "photographs": self.indices, "brightness": brightness, "after": after })
    }
}
