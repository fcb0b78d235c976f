//! The completion network: corrections to the maps of a fit.

use super::onnx::Network;
use crate::Result;
use crate::svbrdf::CHANNELS;

/// Planes of the network's input, which describe the state of a fit.
pub(crate) const COMPLETION_CHANNELS: usize = 4 * CHANNELS + 7;
/// Planes that change sign under a half-turn: the slopes of three maps.
pub(crate) const COMPLETION_ODD: [usize; 6] =
    [0, 1, CHANNELS, CHANNELS + 1, 2 * CHANNELS, 2 * CHANNELS + 1];

pub(super) struct Completion {
    network: Network,
}

impl Completion {
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        Ok(Self { network: Network::parse("completion", bytes, COMPLETION_CHANNELS)? })
    }

    /// Nine planes of corrections, in sigmas.
    pub fn run(&self, features: Vec<f32>, [height, width]: [usize; 2]) -> Result<Vec<f32>> {
        self.network.run_both_ways(height, width, features, &COMPLETION_ODD)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::networks::test_vectors::{difference, test_vectors};

    #[test]
    fn the_network_agrees_with_the_training_framework() {
        let vectors = test_vectors(include_bytes!("../../models/completion_test.bin"));
        let (shape, features) = &vectors["features"];
        let completion = Completion::parse(svbrdf_models::COMPLETION).unwrap();
        let moves = completion.network.run(shape[2], shape[3], features.clone()).unwrap();
        // Sums in f32 in another order through about 20 layers.
        assert!(difference(&moves, &vectors["moves"].1) < 2e-4);
    }
}
