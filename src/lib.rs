//! Normal, diffuse albedo, specular albedo and roughness maps of a flat material from a few flash
//! photographs, after *Deep Inverse Rendering for High-resolution SVBRDF Estimation from an
//! Arbitrary Number of Images* (Gao et al., ACM TOG 38(4) 134, 2019).
//!
//! # Conventions
//! * Lengths are millimetres, image positions pixels, angles radians unless a name says otherwise;
//!   colours are linear RGB with Rec. 709 primaries. Pixel (0, 0) is the *centre* of the top-left
//!   pixel.
//! * Board frame: origin at the sample's centre, X right, Y up, Z out of the surface towards the
//!   camera, right-handed. Camera frame: x right, y down, z forward (OpenCV). A pose maps
//!   `x_cam = R x_board + t`.
//! * Maps are the top view: row 0 is the sample's +Y edge, column 0 its -X edge; texels share the
//!   rectangle equally. Normals point to +Z, their green channel up (OpenGL, glTF, Blender).
//! * BRDF: `kd/pi + D F G / (4 NoL NoV)`, GGX with `alpha = roughness²`, see [`reflectance`].
//! * Radiance is in units in which a white Lambertian surface seen at the reference distance comes
//!   out at its albedo, see [`observation::View`].
//!
//! # Faults and bad photographs
//! Misuse, unreadable files and broken models are [`Error`]s. A photograph that cannot be used is
//! not an error but a [`Rejection`] with its reason; it leaves the session untouched.
#![deny(missing_docs)]

mod error;

pub mod board_sheet;
pub mod calibration;
pub mod capture;
pub mod comparison;
pub mod confidence;
pub mod estimate;
pub mod export;
#[cfg(feature = "files")]
pub mod files;
pub mod frame;
pub mod geometry;
pub mod guide;
pub mod initial_estimate;
mod interpolation;
mod least_squares;
pub mod loss;
pub mod network;
pub mod observation;
mod parallel;
pub mod random;
pub mod rectification;
pub mod reflectance;
pub mod render;
pub mod session;
mod simd;
pub mod svbrdf;
#[cfg(test)]
mod test_support;
pub mod threads;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub use error::{BoardDifference, Error, Rejection, Result, Side, StateFault};
pub use svbrdf::Svbrdf;
