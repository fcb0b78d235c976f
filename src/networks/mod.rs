//! The four networks: photograph to first maps (`photo`), maps to code, code to maps (`decoder`),
//! and corrections of fitted maps (`completion`).
//!
//! The decoder runs in every step of a fit, so it has its own implementation. The others are ONNX
//! graphs run by tract (`onnx`).

mod completion;
mod decoder;
mod encoded;
mod manifest;
mod onnx;
mod photo;
#[cfg(test)]
mod test_vectors;

use std::path::Path;

use crate::observation::Observation;
use crate::svbrdf::{CHANNELS, halvings_to};
use crate::{Error, Result, Svbrdf};
pub(crate) use completion::COMPLETION_CHANNELS;
#[cfg(test)]
pub(crate) use completion::COMPLETION_ODD;
use completion::Completion;
pub use decoder::{Decoder, Workspace};
use encoded::decoded_maps;
pub(crate) use encoded::encoded_maps;
#[cfg(test)]
pub(crate) use onnx::{MAPS_ODD, half_turn};
use onnx::{MAX_TEXELS, Network};
use photo::PhotoNetwork;

/// Longest side of the maps for the fit of the latent code, texels. Twice as many take four times
/// as long and gain at most 1 % on average.
pub(crate) const CODE_TEXELS: usize = 128;

/// The four networks: photograph to maps, maps to code, code to maps, and completion.
pub struct Networks {
    decoder: Decoder,
    encoder: Network,
    photo: PhotoNetwork,
    completion: Completion,
}

impl Networks {
    /// The networks compiled into the library.
    ///
    /// # Errors
    /// [`Error::Model`] if they do not fit this version.
    #[cfg(feature = "embedded-models")]
    pub fn embedded() -> Result<Self> {
        Self::from_bytes(
            svbrdf_models::DECODER,
            svbrdf_models::ENCODER,
            svbrdf_models::PHOTO,
            svbrdf_models::COMPLETION,
        )
    }

    /// The networks of a folder with `decoder.bin`, `encoder.onnx`, `photo.onnx`, `completion.onnx`
    /// and an optional `manifest.json`.
    ///
    /// # Errors
    /// If a file cannot be read or is damaged; [`Error::Field`] if the manifest has an unknown
    /// network or option.
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
    /// [`Error::Model`] if one is damaged.
    pub fn from_bytes(
        decoder: &[u8],
        encoder: &[u8],
        photo: &[u8],
        completion: &[u8],
    ) -> Result<Self> {
        Ok(Self {
            decoder: Decoder::from_bytes(decoder)?,
            encoder: Network::parse("encoder", encoder, CHANNELS)?,
            photo: PhotoNetwork::parse(photo)?,
            completion: Completion::parse(completion)?,
        })
    }

    /// The decoder.
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// Builds the plans for photographs of `height * width` texels ahead of time.
    ///
    /// # Errors
    /// If the networks do not support the size.
    pub fn prepare(&self, height: usize, width: usize) -> Result<()> {
        self.photo.prepare(height, width)?;
        self.check_code_size(height, width)?;
        let halvings = halvings_to([width, height], CODE_TEXELS);
        self.encoder.prepare(height >> halvings, width >> halvings)
    }

    /// First maps from one photograph.
    ///
    /// Observations with more than 256 texels along a side are halved until they fit; the maps have
    /// that size. In unseen areas the network extrapolates. Diffuse albedo hidden by a highlight
    /// gets the level of its surroundings.
    ///
    /// # Errors
    /// If the sides are not multiples of 32 (after halving), or the network is broken.
    pub fn photo_maps(&self, observation: &Observation) -> Result<Svbrdf> {
        self.photo.maps(observation)
    }

    /// Encodes maps to a code of `channels * height / 16 * width / 16` values.
    ///
    /// # Errors
    /// If the sides are not multiples of the stride, or the network is broken.
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

    /// Decodes a code of `[height, width]` positions from [`Networks::encode`].
    ///
    /// # Errors
    /// If the code has another size.
    pub fn decode(&self, code: &[f32], [height, width]: [usize; 2]) -> Result<Svbrdf> {
        let mut workspace = Workspace::new(&self.decoder, height, width)?;
        let encoded = self.decoder.forward(code, &mut workspace)?.to_vec();
        let stride = self.decoder.stride();
        decoded_maps(stride * width, stride * height, encoded)
    }

    /// Corrections to the means of maps of `[height, width]` texels, in sigmas: nine planes.
    pub(crate) fn complete(
        &self,
        features: Vec<f32>,
        [height, width]: [usize; 2],
    ) -> Result<Vec<f32>> {
        self.completion.run(features, [height, width])
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

#[cfg(test)]
mod tests {
    use super::test_vectors::{difference, test_vectors};
    use super::*;

    #[test]
    fn the_encoder_agrees_with_the_training_framework() {
        let vectors = test_vectors(include_bytes!("../../models/encoder_test.bin"));
        let (shape, maps) = &vectors["maps"];
        let networks = Networks::embedded().unwrap();
        let code = networks.encoder.run(shape[2], shape[3], maps.clone()).unwrap();
        // f32 sums in another order through about 20 layers
        assert!(difference(&code, &vectors["code"].1) < 2e-4);
    }

    #[test]
    fn sizes_of_maps_are_checked() {
        let networks = Networks::embedded().unwrap();
        assert!(networks.encode(&Svbrdf::new(40, 32)).is_err());
        let code = networks.encode(&Svbrdf::new(64, 32)).unwrap();
        assert_eq!(code.len(), networks.decoder().code_channels() * 4 * 2);
    }
}
