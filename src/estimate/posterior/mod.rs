//! The posterior of a texel: objective, quadratic model, covariances.
//!
//! The negative logarithm, apart from a constant:
//!
//! ```text
//! sum over photographs, colours of weight * huber(log residual) / noise
//! + sum over coordinates of (x - m)² / (2 sigma²)
//! ```
//!
//! Given poses and lights, texels are independent: nine unknowns against three log residuals per photograph.

mod cholesky;
mod information;
mod model;
mod normal_equations;
mod residual;

pub(super) use cholesky::{Cholesky, PAIRS, at};
pub(super) use information::{At, Covariance, covariance};
pub(crate) use information::{Spread, spread};
pub(super) use model::Posterior;
pub(super) use normal_equations::{NormalEquations, cost};
pub(super) use residual::{LinearResidual, Measurement, Residual, Shading, coordinates_of};
