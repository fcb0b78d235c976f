//! The networks of the crate `svbrdf`, as the bytes of their files.
//!
//! `svbrdf` embeds them with its feature `embedded-models`; whoever brings networks of their own
//! needs none of this. What the weights were trained on, and under which terms they are offered, is
//! in `README.md`.
#![no_std]

/// Code to encoded maps: the container that `svbrdf::networks` reads.
pub const DECODER: &[u8] = include_bytes!("decoder.bin");
/// Encoded maps to their code: an ONNX graph.
pub const ENCODER: &[u8] = include_bytes!("encoder.onnx");
/// One flash photograph and its geometry to encoded maps: an ONNX graph.
pub const PHOTO: &[u8] = include_bytes!("photo.onnx");
/// Completion network: maps, prior and covariance of a fit to a shift of the maps; ONNX.
pub const COMPLETION: &[u8] = include_bytes!("completion.onnx");
