//! Texels and what they share, fitted together.
//!
//! Exposure, place of the flash, directions of the lights and ambient light concern all texels; so does
//! the gloss of a material class. Texels would slowly follow what is wrong there if each were fitted in turn. So a grid of them is fitted together with what they share,
//! as in bundle adjustment: Levenberg and Marquardt on the posterior of [`super`] by reweighted least
//! squares, each texel's nine deviations from its prior mean eliminated (Schur complement).

mod costs;
mod descent;
mod elimination;
mod equations;
mod parameters;
mod problem;
mod sample;
mod state;
mod sums;
#[cfg(test)]
mod tests;

pub(super) use descent::{Descent, Limits};
pub(super) use parameters::{MIRRORED, Parameter, Shared};
pub(super) use problem::{Groups, Problem};
pub(super) use sample::{Sample, colours};
pub(crate) use state::{SharedLobes, State};
