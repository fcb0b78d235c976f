//! Numbers of the guide.

/// Numbers of a [`Guide`](super::Guide).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuideOptions {
    /// Gain from which on a photograph is worth taking, as a share of the best view's, 0 to 1. High:
    /// fewer photographs; low: less walking.
    pub worth: f32,
    /// The camera is steady where the sample moves less than this across the picture, in widths of the
    /// sample a second. At 1/100 s and 1000 px, 0.1 is a blur of one pixel.
    pub steady: f32,
    /// For so long, seconds.
    pub steady_seconds: f32,
    /// It is enough where the best view would take away less of the expected squared error, 0 to 1.
    pub enough: f32,
    /// But not before so many photographs.
    pub least: usize,
    /// And in any case with so many.
    pub most: usize,
    /// Steepest view of the first photograph, degrees off the top.
    pub first_tilt_deg: f32,
    /// A photograph that has not been added so long after [`Action::Shoot`](super::Action::Shoot) is not going to be, seconds.
    pub shot_seconds: f64,
}

impl Default for GuideOptions {
    /// Those of `docs/research/guided-capture.md`.
    fn default() -> Self {
        Self {
            worth: 0.8,
            steady: 0.1,
            steady_seconds: 0.15,
            enough: 0.05,
            least: 4,
            most: 20,
            first_tilt_deg: 20.0,
            shot_seconds: 3.0,
        }
    }
}
