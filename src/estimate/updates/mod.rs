//! Updates of the prior's mean and widths: each changes the belief in view of the photographs.

mod classes;
mod groups;
mod network;
mod pooling;
mod slopes;
mod widths;

pub(super) use classes::{ClassTrials, TEXELS as CLASS_TEXELS};
pub use network::FitRecord;
pub(super) use network::TEXELS as NETWORK_TEXELS;
pub(super) use pooling::Pooling;
pub(super) use slopes::regress_slopes;
