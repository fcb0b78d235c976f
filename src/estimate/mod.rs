//! The estimator: maps from rectified photographs whose cameras and lights are known.
//!
//! # Objective
//! Per texel, `x` are nine coordinates: two slopes, square roots of diffuse and specular albedo (three
//! each), roughness. All phases work on one objective, the negative logarithm of the posterior
//!
//! ```text
//! E(x, m, Λ, σ, v) =   Σ photographs i, colours c   w_i · huber(r_ic) / σ_c      residuals over noise
//!                    + Σ texels                     ½ (x − m)ᵀ Λ (x − m)         prior of the maps
//!                    + lights and hyper-parameters                               their own priors
//!
//! r_ic = ln(R(x; v_i)_c + 0.01) − ln(I_ic + 0.01)
//! ```
//!
//! with the renderer `R` ([`crate::render`]), the radiance `I` of photograph `i` and its weight `w`
//! (foreshortening, validity; one-sided where saturated), its view `v` (camera, light, ambient
//! light), the noise `σ` of each colour, and a prior whose mean `m` is
//!
//! ```text
//! m = D(z)           maps of the latent code                  latent/
//!   + offset         what all texels are off                  lights/    (with bundle/)
//!   + groups         pooled gloss, classes                   updates/pooling, classes
//!   + regression     slopes by slopes and colours             updates/slopes
//!   + network        what fits are known to leave open        updates/network
//! ```
//!
//! and whose widths `Λ^-½` are those of [`Prior`], narrower where the material shows it
//! (`updates/widths`), wider where slopes do (`solver`).
//!
//! # Phases
//! Each changes one of these, all others held, in the order of `schedule`:
//!
//! | phase | changes | by |
//! |---|---|---|
//! | latent code | `z` | Adam on the mean log-L1 through decoder and renderer (Gao et al. 2019, Section 5) |
//! | maps | `x`, and `σ`, width of slopes | Levenberg-Marquardt per texel, reweighted; `σ` from residuals; evidence (MacKay 1992) |
//! | widths | `m`, `Λ`, `v` | likelihood ratio, leave-one-out cross-validation; classes, exposure and flash as for lights |
//! | lights | `v`, offset | bundle adjustment (`bundle`): Levenberg-Marquardt, texels eliminated |
//! | pool gloss | `m` | precision-weighted means of groups of like colour (empirical Bayes) |
//! | material classes | `m`, `x` | mixture model, expectation maximisation |
//! | slopes | `m`, `x` | linear regression by marginal likelihood |
//! | learned prior | `m`, `x`, `Λ` | network; widths by evidence |
//!
//! Phases work on at most 256 texels along each side, the latent code on averages of at most 128, and see at most
//! twelve photographs in a step (`photographs`); last steps of the maps follow at full size, with all (`finer`).
//!
//! `docs/method.md` has the equations, a diagram and a glossary.
//!
//! # Files
//! [`options`] holds every tuned number, `schedule` the one table of phases, `estimation` the stages of an
//! estimate and what is known in each, `steps` one step of each phase. Phases that move the prior's mean are in
//! `updates`: each makes a belief of photographs and a belief.

mod adam;
mod baseline;
mod belief;
mod budget;
mod bundle;
mod clusters;
mod confidence;
mod contradiction;
mod correction;
mod estimation;
mod estimator;
mod finer;
mod joint;
mod latent;
mod memory;
mod noise;
pub mod options;
mod outlook;
mod parts;
mod phases;
mod photographs;
mod posterior;
mod prior;
mod relief;
mod residuals;
mod saved;
mod solver;

pub use budget::Budget;
pub(crate) use budget::Meter;
pub use confidence::Evidence;
pub use correction::{Correction, Exposure};
pub(crate) use estimation::{Addition, Estimation, Task, first_maps};
pub use estimation::{Method, Step};
pub use estimator::Estimator;
pub(crate) use memory::bytes_needed;
pub use options::EstimateOptions;
pub use outlook::Place;
pub use parts::Part;
pub use phases::{Phase, PhaseReport};
pub use prior::{Prior, coordinates};
pub use relief::FitRecord;
pub use residuals::FrameFit;
pub(crate) use saved::SavedEstimate;
