//! ONNX graphs from planes to planes, run by tract with one cached plan per size.

#[cfg(not(feature = "networks"))]
mod absent;
#[cfg(feature = "networks")]
mod operators;
#[cfg(feature = "networks")]
mod runner;

use crate::svbrdf::{CHANNELS, channel};
use crate::{Error, Result};
#[cfg(not(feature = "networks"))]
use absent::Graph;
#[cfg(feature = "networks")]
use runner::Graph;

/// Longest side of a plan, texels.
pub(super) const MAX_TEXELS: usize = 4096;
/// Planes of maps that change sign under a half-turn: slopes.
pub(crate) const MAPS_ODD: [usize; 2] = [channel::SLOPE_X, channel::SLOPE_Y];

/// An ONNX graph with an input `[1, channels, height, width]`.
pub(super) struct Network {
    name: &'static str,
    graph: Graph,
}

impl Network {
    /// Parses a graph; `name` appears in errors.
    pub fn parse(name: &'static str, bytes: &[u8], channels: usize) -> Result<Self> {
        Ok(Self { name, graph: Graph::parse(name, bytes, channels)? })
    }

    /// An error of this network.
    pub fn fault(&self, message: &str) -> Error {
        Error::model(self.name, message)
    }

    /// Builds the plan for a size ahead of time.
    pub fn prepare(&self, height: usize, width: usize) -> Result<()> {
        self.graph.prepare(height, width)
    }

    /// Runs the graph on planes of a size.
    pub fn run(&self, height: usize, width: usize, input: Vec<f32>) -> Result<Vec<f32>> {
        let output = self.graph.run(height, width, input)?;
        if output.iter().all(|v| v.is_finite()) {
            Ok(output)
        } else {
            Err(self.fault("the result is not finite"))
        }
    }

    /// Mean of the results for the input and for the input turned by 180 degrees, which changes the sign of
    /// the planes `odd`. Two guesses are better than one, and two threads compute them in parallel.
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

/// Turns planes of `n` texels by 180 degrees with the sample.
pub(crate) fn half_turn(planes: &mut [f32], n: usize, odd: &[usize]) {
    for (c, plane) in planes.chunks_exact_mut(n).enumerate() {
        plane.reverse();
        if odd.contains(&c) {
            plane.iter_mut().for_each(|v| *v = -*v);
        }
    }
}
