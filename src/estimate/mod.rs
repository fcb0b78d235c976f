//! The estimator: maps from rectified photographs whose cameras and lights are known.
//!
//! # Model
//! Each texel has nine coordinates `x`: two slopes, square roots of diffuse and specular albedo (three each),
//! and roughness. One negative logarithm of a posterior is the model of all phases after the latent code:
//!
//! ```text
//! E(x, m, Λ, v) =   Σ photographs i, colours c   w_i · huber(r_ic) / σ      residuals over noise
//!                 + Σ texels                     ½ (x − m)ᵀ Λ (x − m)         prior of the texels
//!                 + priors of the gloss of classes and of the numbers that all texels share
//!
//! r_ic = ln(R(x; v_i)_c + 0.01) − ln(I_ic + 0.01)
//! ```
//!
//! The renderer is `R` ([`crate::render`]). Photograph `i` has radiance `I`, weight `w` (foreshortening and
//! validity; one-sided where saturated) and view `v` (camera, light, ambient light). The latent code minimises
//! the mean of `|r|`. The relief phase holds `x` to the latent maps, with the expected noise `σ`. The joint
//! solve and the last steps hold `x` to
//!
//! ```text
//! m = learned slopes  +  gloss of classes  +  colour of the photographs       joint/
//! ```
//!
//! with one `σ` for noise and error of the lobe, and with sigmas `Λ^-½` that predict photographs left out.
//!
//! # Files
//! - `phases`: the phases and their order; [`options`]: the numbers of the model; `estimation`: the state of
//!   an estimate.
//! - `latent`: the latent code; `solver`, `posterior`: steps of single texels; `relief`: the network that
//!   completes slopes.
//! - `joint`: the joint solve and the choice of its prior; `bundle`: its engine.
//! - [`assessment`](crate::assessment) evaluates the result.
//!
//! Phases work on at most 256 texels along each side; the latent code works on averages of at most 128
//! (`photographs`). Before the joint solve, a step sees at most twelve photographs. The last steps see all
//! photographs at full size (`finer`).
//!
//! `docs/method.md` has a diagram and a glossary.

mod adam;
mod baseline;
mod budget;
mod bundle;
mod clusters;
pub(crate) mod coordinates;
mod correction;
mod estimation;
mod finer;
mod joint;
mod latent;
mod map_state;
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
pub(crate) use bundle::EstimatedLobes;
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
