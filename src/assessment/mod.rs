//! Evidence about an estimate: outlier regions of photographs, residuals, uncertainty of the maps, and the
//! gain of a further photograph.

mod contradiction;
mod outlook;
mod residuals;
mod uncertainty;

pub use outlook::Place;
pub use residuals::PhotoFit;
pub use uncertainty::Evidence;
