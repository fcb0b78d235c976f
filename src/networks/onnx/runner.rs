//! Graphs run by tract with a plan per size.

use std::collections::HashMap;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use tract_onnx::prelude::*;

use super::operators;
use crate::{Error, Result};

pub(super) struct Graph {
    name: &'static str,
    channels: usize,
    model: InferenceModel,
    plans: Mutex<HashMap<(usize, usize), Arc<TypedRunnableModel>>>,
}

impl Graph {
    /// Parses a graph; `name` appears in errors.
    pub fn parse(name: &'static str, bytes: &[u8], channels: usize) -> Result<Self> {
        let model = guarded(name, || operators::reader().model_for_read(&mut Cursor::new(bytes)))?;
        Ok(Self { name, channels, model, plans: Mutex::default() })
    }

    /// Builds the plan for a size.
    pub fn prepare(&self, height: usize, width: usize) -> Result<()> {
        self.plan(height, width).map(|_| ())
    }

    /// The plan for a size, built on first use.
    fn plan(&self, height: usize, width: usize) -> Result<Arc<TypedRunnableModel>> {
        // Keep the lock while building, so that a plan is built once.
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

    /// Runs the graph on planes of a size.
    pub fn run(&self, height: usize, width: usize, input: Vec<f32>) -> Result<Vec<f32>> {
        let plan = self.plan(height, width)?;
        guarded(self.name, || {
            let tensor = Tensor::from_shape(&[1, self.channels, height, width], &input)?;
            drop(input);
            let output = plan.run(tvec!(tensor.into()))?;
            Ok(output[0].to_plain_array_view::<f32>()?.iter().copied().collect::<Vec<f32>>())
        })
    }
}

/// Calls tract; its errors, and panics on damaged graphs, become [`Error::Model`].
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
    use crate::svbrdf::CHANNELS;

    #[test]
    fn damaged_graphs_are_errors() {
        let good = svbrdf_models::ENCODER;
        for end in [0, 10, 1000, good.len() / 2] {
            let broken = Graph::parse("encoder", &good[..end], CHANNELS)
                .and_then(|n| n.run(16, 16, vec![0.0; CHANNELS * 256]));
            assert!(matches!(broken, Err(Error::Model { .. })), "{end}");
        }
    }
}
