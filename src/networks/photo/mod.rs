//! The photo network: first maps from one photograph.

mod highlights;
mod input;

use super::encoded::decoded_maps;
use super::onnx::Network;
use crate::observation::Observation;
use crate::svbrdf::halved;
use crate::{Result, Svbrdf};
use input::{PHOTO_CHANNELS, PHOTO_ODD, photo_halvings, photo_input};

/// The photo network with completion under highlights.
pub(super) struct PhotoNetwork {
    network: Network,
}

impl PhotoNetwork {
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        Ok(Self { network: Network::parse("photo", bytes, PHOTO_CHANNELS)? })
    }

    /// Builds the plan for observations of a size.
    pub fn prepare(&self, height: usize, width: usize) -> Result<()> {
        let halvings = photo_halvings(height, width)?;
        self.network.prepare(height >> halvings, width >> halvings)
    }

    /// Maps of an observation, halved until it fits the network.
    pub fn maps(&self, observation: &Observation) -> Result<Svbrdf> {
        let halvings = photo_halvings(observation.height(), observation.width())?;
        let observation = halved(observation, halvings, Observation::downsampled);
        let (h, w) = (observation.height(), observation.width());
        let encoded = self.network.run_both_ways(h, w, photo_input(&observation), &PHOTO_ODD)?;
        let mut maps = decoded_maps(w, h, encoded)?;
        highlights::complete_diffuse(&mut maps, &observation);
        Ok(maps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::networks::onnx::{MAPS_ODD, half_turn};
    use crate::networks::test_vectors::{difference, test_vectors};
    use crate::observation::{Falloff, View};

    fn photo_network() -> PhotoNetwork {
        PhotoNetwork::parse(svbrdf_models::PHOTO).unwrap()
    }

    #[test]
    fn the_network_agrees_with_the_training_framework() {
        let vectors = test_vectors(include_bytes!("../../../models/photo_test.bin"));
        let (shape, photo) = &vectors["photo"];
        let maps = photo_network().network.run(shape[2], shape[3], photo.clone()).unwrap();
        // f32 sums in another order through about 20 layers
        assert!(difference(&maps, &vectors["maps"].1) < 2e-4);
    }

    #[test]
    fn sizes_are_checked_and_large_observations_halved() {
        assert_eq!(photo_halvings(256, 128).unwrap(), 0);
        assert_eq!(photo_halvings(1024, 512).unwrap(), 2);
        assert!(photo_halvings(100, 128).is_err());
        assert!(photo_halvings(0, 128).is_err());
        assert!(photo_halvings(1 << 20, 1 << 20).is_err());
    }

    #[test]
    fn a_turned_sample_has_turned_maps() {
        let network = photo_network();
        let (w, h) = (64, 32);
        let mut random = crate::random::Random::new(7);
        let mut radiance: Vec<f32> = (0..3 * w * h).map(|_| random.uniform() as f32).collect();
        let photo_maps = |sign: f32, radiance: &[f32]| {
            let view = View {
                sample_mm: [80.0, 40.0],
                camera_mm: [sign * 30.0, sign * -12.0, 90.0],
                light_mm: [sign * 17.0, sign * 25.0, 80.0],
                falloff: Falloff::InverseSquare { power_mm2: [2e4; 3] },
                ..View::default()
            };
            let photograph = Observation::new(w, h, view, radiance, &vec![1.0; w * h]).unwrap();
            network.maps(&photograph).unwrap().planes().to_vec()
        };
        let straight = photo_maps(1.0, &radiance);
        half_turn(&mut radiance, w * h, &[]);
        let mut turned = photo_maps(-1.0, &radiance);
        half_turn(&mut turned, w * h, &MAPS_ODD);
        // only rounding of directions and positions
        assert!(difference(&straight, &turned) < 1e-4);
        let slopes = &straight[..2 * w * h];
        assert!(slopes.iter().any(|s| s.abs() > 0.02));
    }
}
