//! Standard deviations of the maps at each texel.
//!
//! The posterior ranks texels, but underestimates their errors, because errors of the model are alike all
//! over a sample: fifty thousand texels that share a wrong highlight do not average it out. Therefore the
//! stated deviations combine the posterior with other evidence on the estimate. [`calibration`] was fitted to
//! known materials.

mod calibration;
mod evidence;

pub use evidence::Evidence;
