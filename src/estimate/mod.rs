//! The estimator: maps from rectified photographs whose cameras and lights are known.
//!
//! # Model
//! Per texel, `x` are nine coordinates: two slopes, square roots of diffuse and specular albedo (three
//! each), roughness. One model, the negative logarithm of a posterior, stands behind all phases:
//!
//! ```text
//! E(x, m, Λ, v) =   Σ photographs i, colours c   w_i · huber(r_ic) / σ_c      residuals over noise
//!                 + Σ texels                     ½ (x − m)ᵀ Λ (x − m)         prior of the texels
//!                 + gloss of classes, what all texels share                   their own priors
//!
//! r_ic = ln(R(x; v_i)_c + 0.01) − ln(I_ic + 0.01)
//! ```
//!
//! with the renderer `R` ([`crate::render`]), the radiance `I` of photograph `i` and its weight `w`
//! (foreshortening, validity; one-sided where saturated), its view `v` (camera, light, ambient
//! light) and the noise `σ` of each colour. The latent code minimises the mean of `|r|` alone; the relief phase
//! holds `x` to the latent maps, with `σ` from the residuals; the joint solve and the last steps hold `x` to
//!
//! ```text
//! m = learned slopes  +  gloss of classes  +  colour of the photographs       joint/
//! ```
//!
//! with sigmas `Λ^-½` that predict photographs left out, and one `σ` for noise and the error of the lobe.
//!
//! # Files
//! `phases` has the phases and their order, [`options`] the numbers of the model, `estimation` the state of an
//! estimate. `latent` is the latent code, `solver` and `posterior` are steps of single texels, `relief` is the
//! network that completes them, `joint` is the joint solve and the choice of its prior, `bundle` its engine.
//! [`assessment`](crate::assessment) reads the result.
//!
//! Phases work on at most 256 texels along each side, the latent code on averages of at most 128, and see at most
//! twelve photographs in a step (`photographs`); the last steps see all photographs at full size (`finer`).
//!
//! `docs/method.md` has a diagram and a glossary.

mod adam;
mod baseline;
mod belief;
mod budget;
mod bundle;
mod clusters;
pub(crate) mod coordinates;
mod correction;
mod estimation;
mod finer;
mod joint;
mod latent;
mod memory;
mod noise;
pub mod options;
mod parts;
mod phases;
mod photographs;
mod posterior;
mod prior;
mod relief;
mod saved;
mod solver;
mod task;

pub use budget::Budget;
pub(crate) use budget::Meter;
pub use coordinates::coordinates;
pub use correction::{Correction, LightCorrection};
pub use estimation::Step;
pub(crate) use estimation::{Estimation, first_maps};
pub(crate) use memory::bytes_needed;
pub(crate) use noise::Noise;
pub use options::EstimateOptions;
pub(crate) use parts::Contradiction;
pub use parts::Part;
pub use phases::{Phase, PhaseReport};
pub(crate) use posterior::{Spread, spread};
pub use prior::Prior;
pub use relief::FitRecord;
pub(crate) use saved::SavedEstimate;
pub(crate) use solver::Solver;
pub use task::Method;
pub(crate) use task::Task;
