//! The networks that run once per photograph: maps from one photograph, and the code of given maps.
//!
//! Both are ONNX graphs executed by tract; the decoder, which runs in every step of the fit, has its
//! own code in [`crate::network`]. A plan is built once per size and kept.

mod operators;

use std::collections::HashMap;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use tract_onnx::prelude::*;

use crate::network::{Decoder, Workspace};
use crate::observation::{Falloff, Observation, View, unpack};
use crate::parallel;
use crate::svbrdf::{CHANNELS, bands, channel, encoding, halved};
use crate::{Error, Result, Svbrdf};

/// Sides of the photo network's input are multiples of this.
const PHOTO_MULTIPLE: usize = 32;
/// Longest side at which the photo network runs: what it was trained on.
const PHOTO_TEXELS: usize = 256;
const PHOTO_CHANNELS: usize = 14;
/// Planes of the photo network's input that change their sign when the sample is turned by 180
/// degrees: x and y of the directions.
const PHOTO_ODD: [usize; 4] = [3, 4, 6, 7];
/// Planes of what a fit knows: what the completion network sees.
pub(crate) const COMPLETION_CHANNELS: usize = 4 * CHANNELS + 7;
/// Those that change their sign in a half turn: the slopes of three maps.
pub(crate) const COMPLETION_ODD: [usize; 6] =
    [0, 1, CHANNELS, CHANNELS + 1, 2 * CHANNELS, 2 * CHANNELS + 1];
/// Planes of maps that change their sign in a half turn: slopes.
pub(crate) const MAPS_ODD: [usize; 2] = [channel::SLOPE_X, channel::SLOPE_Y];
/// Largest side for which a plan is built, texels.
const MAX_TEXELS: usize = 4096;
/// Offset of the logarithm in which the photo network sees radiance.
const LOG_OFFSET: f32 = 0.01;
/// Largest radiance that the photo network tells from larger ones.
const BRIGHTEST: f32 = 100.0;

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
    /// `completion.onnx`.
    ///
    /// # Errors
    /// When a file cannot be read or is damaged.
    pub fn from_folder(folder: &Path) -> Result<Self> {
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

    /// Builds the plans for maps of `height * width` ahead of the first photograph.
    ///
    /// # Errors
    /// When the sizes do not suit the networks.
    pub fn prepare(&self, height: usize, width: usize) -> Result<()> {
        let halvings = photo_halvings(height, width)?;
        self.photo.plan(height >> halvings, width >> halvings)?;
        self.check_code_size(height, width)?;
        self.encoder.plan(height, width).map(|_| ())
    }

    /// First maps from one photograph.
    ///
    /// Observations of more than 256 texels a side are halved until they fit; the result has that
    /// size. Where nothing was seen the network fills in from what lies around.
    ///
    /// # Errors
    /// When the sides are not multiples of 32 (after halving), or the network is broken.
    pub fn photo_maps(&self, observation: &Observation) -> Result<Svbrdf> {
        let halvings = photo_halvings(observation.height(), observation.width())?;
        let observation = halved(observation, halvings, Observation::downsampled);
        let (h, w) = (observation.height(), observation.width());
        let encoded = self.photo.run_both_ways(h, w, photo_input(&observation), &PHOTO_ODD)?;
        decoded_maps(w, h, encoded)
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

/// How often an observation is halved for the photo network.
fn photo_halvings(height: usize, width: usize) -> Result<u32> {
    let mut halvings = 0;
    while height.max(width) >> halvings > PHOTO_TEXELS {
        halvings += 1;
    }
    let multiple = PHOTO_MULTIPLE << halvings;
    let fits = |n: usize| n > 0 && n.is_multiple_of(multiple) && n <= MAX_TEXELS;
    if fits(height) && fits(width) {
        return Ok(halvings);
    }
    Err(Error::argument(
        "observation",
        format!("{width}x{height} texels, multiples of {multiple} up to {MAX_TEXELS} expected"),
    ))
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

/// The photo network's planes: logarithm of `pi * BRDF * NoL` up to 1 (RGB), unit directions to the
/// camera and to the light, weight, share of saturated channels, logarithm of what is above 1 (RGB).
fn photo_input(observation: &Observation) -> Vec<f32> {
    let (h, w) = (observation.height(), observation.width());
    let (n, view) = (h * w, &observation.view);
    let mut planes = vec![-1.0; PHOTO_CHANNELS * n];
    let rows = bands::<PHOTO_CHANNELS, _>(&mut planes, w, h, 1);
    let buffer = || vec![0.0; 3 * w];
    parallel::parts_with(rows, buffer, |radiance, y, row| {
        for (c, radiance) in radiance.chunks_exact_mut(w).enumerate() {
            unpack(&observation.packed()[c * n + y * w..][..w], radiance);
        }
        for x in 0..w {
            let at = view.texel_mm(w, h, x, y);
            let weight = observation.weight(y * w + x);
            let irradiance = irradiance(view, at);
            let mut saturated = 0.0;
            for (c, irradiance) in irradiance.into_iter().enumerate() {
                if weight > 0.0 {
                    // saturated: the true value is at least this
                    let radiance = radiance[c * w + x];
                    let reflected = std::f32::consts::PI * radiance.abs() / irradiance;
                    row[c][x] = log_encode(reflected);
                    row[11 + c][x] = log_excess(reflected);
                    saturated += if radiance < 0.0 { 1.0 / 3.0 } else { 0.0 };
                } else {
                    row[11 + c][x] = 0.0;
                }
            }
            for (first, point) in [(3, view.camera_mm), (6, view.light_mm)] {
                for (c, d) in direction(point, at).into_iter().enumerate() {
                    row[first + c][x] = d;
                }
            }
            row[9][x] = weight;
            row[10][x] = saturated;
        }
    });
    planes
}

fn direction(point: [f32; 3], at: [f32; 2]) -> [f32; 3] {
    glam::Vec3::new(point[0] - at[0], point[1] - at[1], point[2]).normalize_or(glam::Vec3::Z).into()
}

/// Irradiance of a texel that faces the light.
fn irradiance(view: &View, at: [f32; 2]) -> [f32; 3] {
    match view.falloff {
        Falloff::None { power } => power,
        Falloff::InverseSquare { power_mm2 } => {
            let [x, y, z] = view.light_mm;
            let d2 = (x - at[0]).powi(2) + (y - at[1]).powi(2) + z * z;
            power_mm2.map(|p| p / d2)
        }
    }
}

/// Values that are not numbers (no light in a channel) become those of black.
fn log_encode(x: f32) -> f32 {
    let x = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
    let (low, high) = (LOG_OFFSET.ln(), (1.0 + LOG_OFFSET).ln());
    2.0 * ((x + LOG_OFFSET).ln() - low) / (high - low) - 1.0
}

/// 0 up to 1, then logarithmic up to 1 for [`BRIGHTEST`].
fn log_excess(x: f32) -> f32 {
    if x.is_nan() { 0.0 } else { x.clamp(1.0, BRIGHTEST).ln() / BRIGHTEST.ln() }
}

/// One ONNX graph with an input `[1, channels, height, width]`.
struct Network {
    name: &'static str,
    channels: usize,
    model: InferenceModel,
    plans: Mutex<HashMap<(usize, usize), Arc<TypedRunnableModel>>>,
}

impl Network {
    fn parse(name: &'static str, bytes: &[u8], channels: usize) -> Result<Self> {
        let model = guarded(name, || operators::reader().model_for_read(&mut Cursor::new(bytes)))?;
        Ok(Self { name, channels, model, plans: Mutex::default() })
    }

    fn fault(&self, message: &str) -> Error {
        Error::model(self.name, message)
    }

    fn plan(&self, height: usize, width: usize) -> Result<Arc<TypedRunnableModel>> {
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

    fn run(&self, height: usize, width: usize, input: Vec<f32>) -> Result<Vec<f32>> {
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
    fn run_both_ways(
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
    use crate::network::test_vectors::{difference, test_vectors};

    fn networks() -> Networks {
        Networks::embedded().unwrap()
    }

    #[test]
    fn graphs_give_what_the_training_framework_gives() {
        let networks = networks();
        // f32 sums in another order through about 20 layers
        let tolerance = 2e-4;
        let vectors = test_vectors(svbrdf_models::test_vectors::ENCODER);
        let (shape, maps) = &vectors["maps"];
        let code = networks.encoder.run(shape[2], shape[3], maps.clone()).unwrap();
        assert!(difference(&code, &vectors["code"].1) < tolerance);
        let vectors = test_vectors(svbrdf_models::test_vectors::PHOTO);
        let (shape, photo) = &vectors["photo"];
        let maps = networks.photo.run(shape[2], shape[3], photo.clone()).unwrap();
        assert!(difference(&maps, &vectors["maps"].1) < tolerance);
        let vectors = test_vectors(svbrdf_models::test_vectors::COMPLETION);
        let (shape, features) = &vectors["features"];
        let moves = networks.completion.run(shape[2], shape[3], features.clone()).unwrap();
        assert!(difference(&moves, &vectors["moves"].1) < tolerance);
    }

    #[test]
    fn photo_planes_hold_what_the_network_was_trained_on() {
        let view = View {
            sample_mm: [20.0, 10.0],
            camera_mm: [5.0, -2.5, 30.0],
            light_mm: [-5.0, 2.5, 20.0],
            falloff: Falloff::InverseSquare { power_mm2: [1000.0, 2000.0, 0.0] },
            ambient: [0.0; 3],
            mirrored: 1.0,
        };
        // 2 x 2 texels centred at x = ±5, y = ±2.5; the last one was not seen.
        let radiance = [0.5, -0.5, 0.1, 0.2, 0.5, 0.0, 9.0, 0.2, 0.5, 0.5, 0.5, 0.2];
        let weight = [0.4, 1.0, 1.0, 0.0];
        let observation = Observation::new(2, 2, view, &radiance, &weight).unwrap();
        let planes = photo_input(&observation);
        let close = |c: usize, i: usize, expected: f32| {
            let found = planes[4 * c + i];
            assert!((found - expected).abs() < 1e-5, "plane {c}, texel {i}: {found} {expected}");
        };
        let log = |x: f32| 2.0 * ((x + 0.01) / 0.01).ln() / 101.0f32.ln() - 1.0;
        // texel 0 lies under the light: distance 20 mm, irradiance 1000 / 400
        close(0, 0, log(std::f32::consts::PI * 0.5 / 2.5));
        // saturated: at least this much; distance² = 100 + 0 + 400
        close(0, 1, log(std::f32::consts::PI * 0.5 / 2.0));
        close(1, 1, -1.0);
        close(1, 2, 1.0);
        close(2, 0, 1.0); // no light in a channel: infinitely bright
        close(0, 3, -1.0);
        close(9, 0, 3.0 / 7.0);
        close(9, 3, 0.0);
        close(10, 1, 1.0 / 3.0);
        close(10, 0, 0.0);
        close(11, 0, 0.0);
        // six times a white diffuse surface: distance² = 25 + 400, irradiance 2000 / 425
        close(12, 2, (std::f32::consts::PI * 9.0 * 425.0 / 2000.0).ln() / 100.0f32.ln());
        close(13, 2, 1.0);
        close(11, 3, 0.0);
        // texel 3 (x = 5, y = -2.5) looks straight up to the camera, texel 0 to the light
        close(5, 3, 1.0);
        close(8, 0, 1.0);
        let length = (10.0f32 * 10.0 + 5.0 * 5.0 + 900.0).sqrt();
        close(3, 0, 10.0 / length);
        close(4, 0, -5.0 / length);
        close(5, 0, 30.0 / length);
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
