//! ONNX graphs executed by tract, with a plan for each size.

use std::collections::HashMap;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use tract_onnx::prelude::*;

use super::operators;
use crate::svbrdf::{CHANNELS, channel};
use crate::{Error, Result};

/// Largest side for which a plan is built, texels.
pub(super) const MAX_TEXELS: usize = 4096;
/// Planes of maps that change their sign in a half turn: slopes.
pub(crate) const MAPS_ODD: [usize; 2] = [channel::SLOPE_X, channel::SLOPE_Y];

/// One ONNX graph with an input `[1, channels, height, width]`.
pub(super) struct Network {
    name: &'static str,
    channels: usize,
    model: InferenceModel,
    plans: Mutex<HashMap<(usize, usize), Arc<TypedRunnableModel>>>,
}

impl Network {
    /// Reads a graph; `name` is what errors call it.
    pub fn parse(name: &'static str, bytes: &[u8], channels: usize) -> Result<Self> {
        let model = guarded(name, || operators::reader().model_for_read(&mut Cursor::new(bytes)))?;
        Ok(Self { name, channels, model, plans: Mutex::default() })
    }

    /// An error of this network.
    pub fn fault(&self, message: &str) -> Error {
        Error::model(self.name, message)
    }

    /// The plan for a size, built once.
    pub fn plan(&self, height: usize, width: usize) -> Result<Arc<TypedRunnableModel>> {
        // Held while building: two threads that want the same plan build it once.
        let mut plans = self.plans.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(plan) = plans.get(&(height, width)) {
            return Ok(plan.clone());
        }
        let fact = f32::fact([1, self.channels, height, width]);
        let plan = guarded(self.name, || {
            self.model.clone().with_input_fact(0, fact.into())?.into_optimized()?.into_runnable()
        })?;
        plans.insert((height, width), plan.clone());
        Ok(plan)
    }

    /// What the graph answers to planes of a size.
    pub fn run(&self, height: usize, width: usize, input: Vec<f32>) -> Result<Vec<f32>> {
        let plan = self.plan(height, width)?;
        let output = guarded(self.name, || {
            let tensor = Tensor::from_shape(&[1, self.channels, height, width], &input)?;
            drop(input);
            let output = plan.run(tvec!(tensor.into()))?;
            Ok(output[0].to_plain_array_view::<f32>()?.iter().copied().collect::<Vec<f32>>())
        })?;
        if output.iter().all(|v| v.is_finite()) {
            Ok(output)
        } else {
            Err(self.fault("the result is not finite"))
        }
    }

    /// The mean of what a graph that answers with the planes of maps says of its input and of the
    /// same turned by 180 degrees, which changes the sign of the planes `odd`: two guesses are
    /// better than one, and two threads make them in the time of one.
    pub fn run_both_ways(
        &self,
        height: usize,
        width: usize,
        input: Vec<f32>,
        odd: &[usize],
    ) -> Result<Vec<f32>> {
        let n = height * width;
        let mut turned = input.clone();
        half_turn(&mut turned, n, odd);
        let run = |input| self.run(height, width, input);
        let (straight, turned) = rayon::join(|| run(input), || run(turned));
        let (mut mean, mut turned) = (straight?, turned?);
        if mean.len() != CHANNELS * n {
            return Err(self.fault("the result has an unexpected size"));
        }
        half_turn(&mut turned, n, &MAPS_ODD);
        mean.iter_mut().zip(turned).for_each(|(a, b)| *a = 0.5 * (*a + b));
        Ok(mean)
    }
}

/// Planes of `n` texels after a turn of the sample by 180 degrees.
pub(crate) fn half_turn(planes: &mut [f32], n: usize, odd: &[usize]) {
    for (c, plane) in planes.chunks_exact_mut(n).enumerate() {
        plane.reverse();
        if odd.contains(&c) {
            plane.iter_mut().for_each(|v| *v = -*v);
        }
    }
}

/// Calls into tract; its errors, and its panics on damaged graphs, become [`Error::Model`].
fn guarded<T>(name: &str, call: impl FnOnce() -> TractResult<T>) -> Result<T> {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(Error::model(name, format!("{error:#}"))),
        Err(_) => Err(Error::model(name, "the graph cannot be run")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damaged_graphs_are_errors() {
        let good = svbrdf_models::ENCODER;
        for end in [0, 10, 1000, good.len() / 2] {
            let broken = Network::parse("encoder", &good[..end], CHANNELS)
                .and_then(|n| n.run(16, 16, vec![0.0; CHANNELS * 256]));
            assert!(matches!(broken, Err(Error::Model { .. })), "{end}");
        }
    }
}
