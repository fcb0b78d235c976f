//! The decoder's file: `SVBRDFM1`, length of the header, header (JSON), weights (f16).

use serde::Deserialize;

use crate::{Error, Result};

const MAGIC: &[u8; 8] = b"SVBRDFM1";
const FORMAT: &str = "svbrdf-decoder/1";
/// Limits against damaged headers; real networks are far smaller.
const MAX_HEADER_BYTES: usize = 1 << 20;
const MAX_LAYERS: usize = 64;
const MAX_CHANNELS: u32 = 4096;
const MAX_STRIDE: u32 = 64;

/// A layer of the header. Offsets count f16 elements from the end of the header.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Layer {
    /// Stride 1, zero padding `(kernel - 1) / 2`, weights `[out][in][ky][kx]`.
    Conv {
        kernel: u32,
        #[serde(rename = "in")]
        inputs: u32,
        #[serde(rename = "out")]
        outputs: u32,
        weight: u64,
        bias: u64,
    },
    /// 4x4, stride 2, padding 1, weights `[in][out][ky][kx]`.
    ConvTranspose {
        #[serde(rename = "in")]
        inputs: u32,
        #[serde(rename = "out")]
        outputs: u32,
        weight: u64,
        bias: u64,
    },
    /// `max(x, slope * x)`.
    LeakyRelu {},
    /// Saves the tensor for the next `add`.
    Save {},
    /// Adds the tensor saved last.
    Add {},
    /// Channel `c * b² + dy * b + dx` becomes texel `(dy, dx)` of channel `c`.
    DepthToSpace { block: u32 },
    /// Must be last.
    Tanh {},
}

#[derive(Debug, Deserialize)]
struct Header {
    format: String,
    code_channels: u32,
    stride: u32,
    leaky_slope: f32,
    layers: Vec<Layer>,
}

/// A parsed file: checked header fields, weights as f32.
pub(super) struct Container {
    pub code_channels: usize,
    pub stride: usize,
    pub leaky_slope: f32,
    pub layers: Vec<Layer>,
    weights: Vec<f32>,
}

pub(super) fn fault(message: impl Into<String>) -> Error {
    Error::model("decoder", message)
}

impl Container {
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        if bytes.get(..8) != Some(MAGIC) {
            return Err(fault("not a decoder file: it does not start with SVBRDFM1"));
        }
        let truncated = || fault("the file ends inside its header");
        let length = bytes.get(8..12).ok_or_else(truncated)?;
        let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize;
        if length > MAX_HEADER_BYTES {
            return Err(fault(format!("a header of {length} bytes is not plausible")));
        }
        let json = bytes.get(12..12 + length).ok_or_else(truncated)?;
        let header: Header =
            serde_json::from_slice(json).map_err(|e| fault(format!("header: {e}")))?;
        if header.format != FORMAT {
            return Err(fault(format!("format `{}`, expected `{FORMAT}`", header.format)));
        }
        if !(1..=MAX_CHANNELS).contains(&header.code_channels) {
            return Err(fault(format!("{} code channels are not supported", header.code_channels)));
        }
        if !(1..=MAX_STRIDE).contains(&header.stride) {
            return Err(fault(format!("a stride of {} is not supported", header.stride)));
        }
        // A slope of 0 would hide the sign of the input from the backward pass.
        if !(header.leaky_slope > 0.0 && header.leaky_slope <= 1.0) {
            return Err(fault(format!("a leaky slope of {} is not supported", header.leaky_slope)));
        }
        if header.layers.is_empty() || header.layers.len() > MAX_LAYERS {
            return Err(fault(format!("{} layers are not supported", header.layers.len())));
        }
        let raw = &bytes[12 + length..];
        if !raw.len().is_multiple_of(2) {
            return Err(fault("the weights end inside a number"));
        }
        let weights: Vec<f32> =
            raw.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect();
        if weights.iter().any(|w| !w.is_finite()) {
            return Err(fault("a weight is not a finite number"));
        }
        Ok(Self {
            code_channels: header.code_channels as usize,
            stride: header.stride as usize,
            leaky_slope: header.leaky_slope,
            layers: header.layers,
            weights,
        })
    }

    /// `length` weights from `offset`.
    pub fn tensor(&self, offset: u64, length: usize) -> Result<&[f32]> {
        usize::try_from(offset)
            .ok()
            .and_then(|start| self.weights.get(start..start.checked_add(length)?))
            .ok_or_else(|| {
                fault(format!(
                    "a tensor of {length} values at {offset} exceeds the {} values in the file",
                    self.weights.len()
                ))
            })
    }
}

/// Checks the channel count of a layer.
pub(super) fn channels(count: u32) -> Result<usize> {
    if (1..=MAX_CHANNELS).contains(&count) {
        Ok(count as usize)
    } else {
        Err(fault(format!("a layer of {count} channels is not supported")))
    }
}
