//! How far the maps may be off: a standard deviation for each map of every texel.
//!
//! What the photographs and the prior leave open (the posterior of [`super::posterior`]) tells which
//! texels are known better than others, not by how much maps are off: errors of the model are alike
//! all over a sample, and fifty thousand texels that share one wrong highlight do not make it right.
//! Stated deviations are therefore the posterior's, together with other evidence on the estimate,
//! through a calibration that was fitted where the truth is known, see
//! `calibration.rs`.

mod calibration;
mod evidence;

pub use evidence::Evidence;
