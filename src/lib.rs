//! Normal, diffuse albedo, specular albedo and roughness maps of a flat material from a few flash photographs.
//!
//! The library implements *Deep Inverse Rendering for High-resolution SVBRDF Estimation from an Arbitrary
//! Number of Images* (Gao et al., ACM TOG 38(4) 134, 2019), with calibration from a printed board, maps from
//! the first photograph on, and a refinement of every texel.
//!
//! # Example
//! A [`session::Session`] takes photographs one at a time. [`add_photo`](session::Session::add_photo) calibrates a
//! photograph and returns as soon as the maps include it; the fit continues on a thread of the session.
//!
//! ```no_run
//! use svbrdf::calibration::Target;
//! use svbrdf::export::{MapsOptions, write_maps};
//! use svbrdf::photo::{Encoding, Photo};
//! use svbrdf::session::{Outcome, Scene, Session, Settings};
//!
//! # fn pixels(_: &str) -> (u32, u32, Vec<u8>) { (0, 0, Vec::new()) }
//! # fn main() -> svbrdf::Result<()> {
//! // The board that `svbrdf board` prints; camera, flash and height are estimated from the photographs.
//! let scene = Scene::board(Target::default());
//! let settings = Settings { sample_mm: [100.0, 80.0], ..Settings::default() };
//! let session = Session::new(scene, settings)?;
//! for name in ["0.jpg", "1.jpg", "2.jpg"] {
//!     let (width, height, rgb) = pixels(name); // 8-bit sRGB
//!     let photo = Photo::from_rgb8(width, height, &rgb, 3 * width as usize, Encoding::Srgb, 1.0)?;
//!     match session.add_photo(&photo)? {
//!         Outcome::Accepted(photo) => println!("maps after {:.2} s", photo.maps_seconds),
//!         Outcome::Rejected(reason) => println!("{name}: {reason}"),
//!     }
//! }
//! session.wait()?; // until the fit has settled
//! write_maps("maps", &*session.snapshot()?, &MapsOptions::default())?;
//! # Ok(())
//! # }
//! ```
//!
//! `examples/fit.rs` in the repository is a complete program.
//!
//! # Conventions
//! * Lengths are in millimetres, image positions in pixels, and angles in radians, unless a name says otherwise.
//!   Colours are linear RGB with Rec. 709 primaries. Pixel (0, 0) is the *centre* of the top-left pixel.
//! * Board frame: origin at the sample's centre, X right, Y up, Z out of the surface towards the camera,
//!   right-handed. Camera frame: x right, y down, z forward (OpenCV). A pose maps `x_cam = R x_board + t`.
//! * Maps are the top view. Row 0 is the sample's +Y edge, column 0 its -X edge; texels divide the rectangle
//!   equally. Normals point to +Z; their green channel points up (OpenGL, glTF, Blender).
//! * BRDF: `kd/pi + D F G / (4 NoL NoV)`, GGX with `alpha = roughness²`; see [`reflectance`].
//! * Radiance is in units in which a white Lambertian surface at the reference distance comes out at its
//!   albedo; see [`observation::View`].
//!
//! # Errors and bad photographs
//! Misuse, unreadable files and broken models are [`Error`]s. A photograph that cannot be used is not an error
//! but a [`Rejection`] with its reason, and it leaves the session untouched.
//!
//! # Events
//! Sessions and fits emit events of the crate [`tracing`](https://docs.rs/tracing), which cost nothing without a
//! subscriber. Targets: `svbrdf::photo` (info: accepted, removed; warn: rejected), `svbrdf::session` (info: restored,
//! paused, resumed, cancelled), `svbrdf::calibration` (debug: camera, flash and ambient light after each photograph),
//! `svbrdf::fit` (debug: the end of each phase, in a span `fit` with the number of photographs). The threads of a
//! session keep the subscriber of the thread that started it, if it had one of its own.
//!
//! # Features
//! * `embedded-models` (default): compiles the networks into the library (10 MB, crate `svbrdf-models`).
//! * `networks` (part of the former): runs networks, which [`session::Networks`] can also read from files. Without
//!   it, everything but the fit works: boards, calibration, rendering, comparison, export.
//! * `files` (default), `heic` (default): read encoded photographs with their metadata and colours (module
//!   `files`), and HEIC among them.
//! * `jxl`: reads DNG with JPEG XL inside (newer iPhones and Samsung phones).
//!
//! # Stability
//! Versions follow semantic versioning for everything on these pages. Public modules that they do not show are
//! internals for the command line, benchmarks and evaluation, and may change in any version. Types of [`glam`]
//! appear in the interface; the crate is re-exported in the version that fits.
#![deny(missing_docs)]

mod error;

#[doc(hidden)]
pub mod assessment;
pub mod board_sheet;
pub mod calibration;
pub mod capture;
pub mod comparison;
#[doc(hidden)]
pub mod estimate;
#[doc(hidden)]
pub mod estimator;
pub mod export;
#[cfg(feature = "files")]
pub mod files;
pub mod geometry;
pub mod guide;
mod interpolation;
mod least_squares;
mod little_endian;
#[doc(hidden)]
pub mod loss;
#[doc(hidden)]
pub mod networks;
pub mod observation;
mod parallel;
pub mod photo;
#[doc(hidden)]
pub mod random;
pub mod rectification;
pub mod reflectance;
pub mod render;
mod scene;
pub mod session;
mod simd;
mod statistics;
pub mod svbrdf;
#[cfg(test)]
mod test_support;
pub mod threads;
pub mod uncertainty;

#[cfg(all(doctest, feature = "embedded-models"))]
#[doc = include_str!("../README.md")]
struct Readme;

pub use error::{BoardDifference, Error, Rejection, Result, Side, StateFault};
pub use glam;
pub use svbrdf::Svbrdf;
