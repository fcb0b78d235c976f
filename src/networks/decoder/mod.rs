//! The SVBRDF decoder: forward pass and vector-Jacobian product.
//!
//! The decoder turns a latent code of `channels x height x width` into the nine encoded maps
//! ([`crate::svbrdf::encoding`]) at `stride` times its resolution. A fit runs it forward and
//! backward hundreds of times, so it has its own implementation: channels-last tensors,
//! convolutions as matrix products over shifted windows, fused biases and activations, packed
//! weights. The backward pass computes only the gradient by the code; weights are fixed.
//!
//! Rows are divided among the threads of the current rayon pool. The partition depends only on the
//! code's size, so the results on one machine are bit-identical for any number of threads.
//!
//! # File
//! `SVBRDFM1`, the length of the header (`u32`, little endian), the header (JSON: `format`
//! `svbrdf-decoder/1`, `code_channels`, `stride`, `leaky_slope`, `layers`), then the weights as little-endian
//! `f16`. Layers in order: `conv` (1x1 or 3x3), `conv_transpose` (4x4, stride 2), `leaky_relu`, `save` and
//! `add` (a residual round a convolution), and at the end `depth_to_space`, `tanh`.

mod container;
mod gemm;
mod graph;
mod kernels;
mod passes;
mod texels;
#[cfg(any(test, target_feature = "relaxed-simd"))]
mod tiles;
mod workspace;

#[cfg(test)]
mod tests;

pub use passes::Decoder;
pub use workspace::Workspace;
