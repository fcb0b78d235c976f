//! Updates of the prior's mean and widths: each a small type that changes the belief in view of the
//! photographs.

mod classes;
mod groups;
mod network;
mod pooling;
mod slopes;
mod widths;

pub(super) use classes::ClassTrials;
pub use network::FitRecord;
pub(super) use network::LearnedPrior;
pub(super) use pooling::{PoolGloss, Pooling};
pub(super) use slopes::RegressSlopes;
