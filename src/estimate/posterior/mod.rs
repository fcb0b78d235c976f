//! The posterior of a texel: what is maximised, its quadratic model, and what photographs tell.
//!
//! Negative logarithm, apart from a constant:
//!
//! ```text
//! sum over photographs, colours of weight * huber(log residual) / noise
//! + sum over coordinates of (x - m)² / (2 sigma²)
//! ```
//!
//! Once poses and lights are known, texels do not depend on each other: nine unknowns against three
//! log residuals a photograph.

mod information;
mod model;
mod normal_equations;
mod residual;

pub(super) use information::{At, Covariance, covariance};
pub(crate) use information::{Spread, spread};
pub(super) use model::Posterior;
pub(super) use normal_equations::{NormalEquations, PAIRS, SHAPE, cost};
pub(super) use residual::{Appearance, Line, Residual, Seen};
