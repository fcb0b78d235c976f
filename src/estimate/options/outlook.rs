//! Options of the choice of the next view.

use serde::{Deserialize, Serialize};

/// Options of what a further photograph would tell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutlookOptions {
    /// Texels along the longer side that are looked at, at most. Derived: a view's gain, a sum over
    /// them, moves by less than 2 % with more.
    pub texels: usize,
    /// Errors of the model are alike in views less than about this apart, degrees: the second tells
    /// little more. Tuned.
    pub apart_deg: f64,
    /// Log residual that noise and errors of the model leave. Tuned.
    pub noise: f64,
    /// Renderings that count. Converged.
    pub renderings: usize,
    /// Cameras and lights of these off the top, at most, degrees. Derived: where maps are compared.
    pub tilt_deg: f64,
}

impl Default for OutlookOptions {
    fn default() -> Self {
        Self { texels: 24, apart_deg: 10.0, noise: 0.03, renderings: 16, tilt_deg: 70.0 }
    }
}
