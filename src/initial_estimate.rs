//! The networks that run once per photograph: maps from one photograph, and the code of given maps.
//!
//! Both are ONNX graphs executed by tract; the decoder, which runs in every step of the fit, has its
//! own code in [`crate::network`]. A plan is built once per size and kept.

#[cfg(not(feature = "networks"))]
mod absent;
mod graph;
mod highlights;
mod manifest;
#[cfg(feature = "networks")]
mod operators;
mod photo_input;
#[cfg(feature = "networks")]
mod runner;

use std::path::Path;

use crate::network::{Decoder, Workspace};
use crate::observation::Observation;
use crate::svbrdf::{CHANNELS, encoding, halved, halvings_to};
use crate::{Error, Result, Svbrdf};
#[cfg(test)]
pub(crate) use graph::{MAPS_ODD, half_turn};
use graph::{MAX_TEXELS, Network};
use photo_input::{PHOTO_CHANNELS, PHOTO_ODD, photo_halvings, photo_input};

/// Texels along the longer side of the maps that the latent code is fitted to, at most: twice as many take four
/// times as long and gain 1 % at most on average.
pub(crate) const CODE_TEXELS: usize = 128;
/// Planes of what a fit knows: what the completion network sees.
pub(crate) const COMPLETION_CHANNELS: usize = 4 * CHANNELS + 7;
/// Those that change their sign in a half turn: the slopes of three maps.
pub(crate) const COMPLETION_ODD: [usize; 6] =
    [0, 1, CHANNELS, CHANNELS + 1, 2 * CHANNELS, 2 * CHANNELS + 1];

/// The four networks: photograph to maps, maps to code, code to maps, and what fits leave open.
pub struct Networks {
    decoder: Decoder,
    encoder: Network,
    photo: Network,
    completion: Network,
}

impl Networks {
    /// The networks that are compiled into the library.
    ///
    /// # Errors
    /// [`Error::Model`] when they do not fit this version.
    #[cfg(feature = "embedded-models")]
    pub fn embedded() -> Result<Self> {
        Self::from_bytes(
            svbrdf_models::DECODER,
            svbrdf_models::ENCODER,
            svbrdf_models::PHOTO,
            svbrdf_models::COMPLETION,
        )
    }

    /// The networks of a folder with `decoder.bin`, `encoder.onnx`, `photo.onnx` and
    /// `completion.onnx`; `manifest.json`, where there is one, describes them.
    ///
    /// # Errors
    /// When a file cannot be read or is damaged; [`Error::Field`] where the description names a network
    /// or an option that this version does not know.
    pub fn from_folder(folder: &Path) -> Result<Self> {
        manifest::check(folder)?;
        let read = |name: &str| {
            let path = folder.join(name);
            std::fs::read(&path).map_err(|e| Error::io(&path, e))
        };
        Self::from_bytes(
            &read("decoder.bin")?,
            &read("encoder.onnx")?,
            &read("photo.onnx")?,
            &read("completion.onnx")?,
        )
    }

    /// The networks from the contents of their files.
    ///
    /// # Errors
    /// [`Error::Model`] when one is damaged.
    pub fn from_bytes(
        decoder: &[u8],
        encoder: &[u8],
        photo: &[u8],
        completion: &[u8],
    ) -> Result<Self> {
        Ok(Self {
            decoder: Decoder::from_bytes(decoder)?,
            encoder: Network::parse("encoder", encoder, CHANNELS)?,
            photo: Network::parse("photo", photo, PHOTO_CHANNELS)?,
            completion: Network::parse("completion", completion, COMPLETION_CHANNELS)?,
        })
    }

    /// The decoder.
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// Builds the plans for photographs of `height * width` texels ahead of the first photograph.
    ///
    /// # Errors
    /// When the sizes do not suit the networks.
    pub fn prepare(&self, height: usize, width: usize) -> Result<()> {
        let halvings = photo_halvings(height, width)?;
        self.photo.prepare(height >> halvings, width >> halvings)?;
        self.check_code_size(height, width)?;
        let halvings = halvings_to([width, height], CODE_TEXELS);
        self.encoder.prepare(height >> halvings, width >> halvings)
    }

    /// First maps from one photograph.
    ///
    /// Observations of more than 256 texels a side are halved until they fit; the result has that
    /// size. Where nothing was seen the network fills in from what lies around; diffuse albedo that a
    /// highlight hides takes its level from there as well.
    ///
    /// # Errors
    /// When the sides are not multiples of 32 (after halving), or the network is broken.
    pub fn photo_maps(&self, observation: &Observation) -> Result<Svbrdf> {
        let halvings = photo_halvings(observation.height(), observation.width())?;
        let observation = halved(observation, halvings, Observation::downsampled);
        let (h, w) = (observation.height(), observation.width());
        let encoded = self.photo.run_both_ways(h, w, photo_input(&observation), &PHOTO_ODD)?;
        let mut maps = decoded_maps(w, h, encoded)?;
        highlights::complete_diffuse(&mut maps, &observation);
        Ok(maps)
    }

    /// The code of maps: `channels * height / 16 * width / 16` values.
    ///
    /// # Errors
    /// When the sides are not multiples of the stride, or the network is broken.
    pub fn encode(&self, maps: &Svbrdf) -> Result<Vec<f32>> {
        let (h, w) = (maps.height(), maps.width());
        self.check_code_size(h, w)?;
        let code = self.encoder.run(h, w, encoded_maps(maps))?;
        let stride = self.decoder.stride();
        if code.len() != self.decoder.code_channels() * (h / stride) * (w / stride) {
            return Err(self.encoder.fault("its code does not match that of the decoder"));
        }
        Ok(code)
    }

    /// Maps of a code of `[height, width]` positions, as [`Networks::encode`] gives it.
    ///
    /// # Errors
    /// When the code has another size.
    pub fn decode(&self, code: &[f32], [height, width]: [usize; 2]) -> Result<Svbrdf> {
        let mut workspace = Workspace::new(&self.decoder, height, width)?;
        let encoded = self.decoder.forward(code, &mut workspace)?.to_vec();
        let stride = self.decoder.stride();
        decoded_maps(stride * width, stride * height, encoded)
    }

    /// How far the means of maps of `[height, width]` texels should move, in sigmas: nine planes.
    pub(crate) fn complete(
        &self,
        features: Vec<f32>,
        [height, width]: [usize; 2],
    ) -> Result<Vec<f32>> {
        self.completion.run_both_ways(height, width, features, &COMPLETION_ODD)
    }

    fn check_code_size(&self, height: usize, width: usize) -> Result<()> {
        let stride = self.decoder.stride();
        let fits = |n: usize| n > 0 && n.is_multiple_of(stride) && n <= MAX_TEXELS;
        if fits(height) && fits(width) {
            return Ok(());
        }
        Err(Error::argument(
            "maps",
            format!("{width}x{height} texels, multiples of {stride} up to {MAX_TEXELS} expected"),
        ))
    }
}

/// Nine planes in [-1, 1], see [`encoding`].
pub(crate) fn encoded_maps(maps: &Svbrdf) -> Vec<f32> {
    let n = maps.texels();
    let encode = |(i, &v): (usize, &f32)| encoding::encode(i / n, v);
    maps.planes().iter().enumerate().map(encode).collect()
}

/// Maps of nine encoded planes, within their physical range.
pub(crate) fn decoded_maps(width: usize, height: usize, mut encoded: Vec<f32>) -> Result<Svbrdf> {
    for (c, plane) in encoded.chunks_exact_mut(width * height).enumerate() {
        for v in plane {
            *v = encoding::decode(c, *v);
        }
    }
    let mut maps = Svbrdf::from_planes(width, height, encoded)?;
    maps.clamp();
    Ok(maps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::test_vectors::{difference, test_vectors};
    use crate::observation::{Falloff, View};

    fn networks() -> Networks {
        Networks::embedded().unwrap()
    }

    #[test]
    fn graphs_give_what_the_training_framework_gives() {
        let networks = networks();
        // f32 sums in another order through about 20 layers
        let tolerance = 2e-4;
        let vectors = test_vectors(include_bytes!("../models/encoder_test.bin"));
        let (shape, maps) = &vectors["maps"];
        let code = networks.encoder.run(shape[2], shape[3], maps.clone()).unwrap();
        assert!(difference(&code, &vectors["code"].1) < tolerance);
        let vectors = test_vectors(include_bytes!("../models/photo_test.bin"));
        let (shape, photo) = &vectors["photo"];
        let maps = networks.photo.run(shape[2], shape[3], photo.clone()).unwrap();
        assert!(difference(&maps, &vectors["maps"].1) < tolerance);
        let vectors = test_vectors(include_bytes!("../models/completion_test.bin"));
        let (shape, features) = &vectors["features"];
        let moves = networks.completion.run(shape[2], shape[3], features.clone()).unwrap();
        assert!(difference(&moves, &vectors["moves"].1) < tolerance);
    }

    #[test]
    fn sizes_are_checked_and_large_observations_halved() {
        assert_eq!(photo_halvings(256, 128).unwrap(), 0);
        assert_eq!(photo_halvings(1024, 512).unwrap(), 2);
        assert!(photo_halvings(100, 128).is_err());
        assert!(photo_halvings(0, 128).is_err());
        assert!(photo_halvings(1 << 20, 1 << 20).is_err());
        let networks = networks();
        assert!(networks.encode(&Svbrdf::new(40, 32)).is_err());
        let code = networks.encode(&Svbrdf::new(64, 32)).unwrap();
        assert_eq!(code.len(), networks.decoder().code_channels() * 4 * 2);
    }

    #[test]
    fn a_turned_sample_has_turned_maps() {
        let networks = networks();
        let (w, h) = (64, 32);
        let mut random = crate::random::Random::new(7);
        let mut radiance: Vec<f32> = (0..3 * w * h).map(|_| random.uniform() as f32).collect();
        let photo_maps = |sign: f32, radiance: &[f32]| {
            let view = View {
                sample_mm: [80.0, 40.0],
                camera_mm: [sign * 30.0, sign * -12.0, 90.0],
                light_mm: [sign * 17.0, sign * 25.0, 80.0],
                falloff: Falloff::InverseSquare { power_mm2: [2e4; 3] },
                ambient: [0.0; 3],
                mirrored: 1.0,
            };
            let photograph = Observation::new(w, h, view, radiance, &vec![1.0; w * h]).unwrap();
            networks.photo_maps(&photograph).unwrap().planes().to_vec()
        };
        let straight = photo_maps(1.0, &radiance);
        half_turn(&mut radiance, w * h, &[]);
        let mut turned = photo_maps(-1.0, &radiance);
        half_turn(&mut turned, w * h, &MAPS_ODD);
        // rounding of directions and of positions only
        assert!(difference(&straight, &turned) < 1e-4);
        let slopes = &straight[..2 * w * h];
        assert!(slopes.iter().any(|s| s.abs() > 0.02));
    }
}
