//! The fit of a session: an estimate, and the jobs of callers between its steps.

mod driver;
mod group;
mod shared;
mod turns;

pub(super) use driver::FitHandle;
pub(super) use group::Group;
pub(super) use turns::Fit;
