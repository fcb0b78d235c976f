//! Bundle adjustment of texels and shared unknowns.
//!
//! Exposure, flash, lights, ambient light and the gloss of a material class concern many texels. An
//! alternation between these unknowns and the texels would converge slowly, because each absorbs the other's
//! errors. Therefore one Levenberg-Marquardt (iteratively reweighted, posterior of [`super`]) solves for
//! both. It eliminates the nine deviations of each texel from its prior mean (Schur complement).

mod costs;
mod descent;
mod eight;
mod elimination;
mod equations;
mod lobes;
mod parameters;
mod problem;
mod sample;
mod state;
mod sums;
#[cfg(test)]
mod tests;

pub(super) use descent::{Descent, Limits};
pub(crate) use lobes::EstimatedLobes;
pub(super) use parameters::{MIRRORED, Parameter, Shared};
pub(super) use problem::{Groups, Problem};
pub(super) use sample::{Sample, colours};
pub(crate) use state::{SharedLobes, State};
