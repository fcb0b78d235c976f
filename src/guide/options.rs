//! Options of the guide.

/// Options of a [`Guide`](super::Guide).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuideOptions {
    /// Least gain of a photograph relative to the best view's, 0 to 1. High values need fewer
    /// photographs, low values less walking.
    pub worth: f32,
    /// Largest speed of a steady camera: motion of the sample in the picture, in widths of the
    /// sample per second. At 1/100 s and 1000 px, 0.1 blurs by one pixel.
    pub steady: f32,
    /// Time for which the camera must be steady, seconds.
    pub steady_seconds: f32,
    /// Capture ends when the best view would remove less of the expected squared error, 0 to 1.
    pub enough: f32,
    /// Fewest photographs before that.
    pub least: usize,
    /// Most photographs.
    pub most: usize,
    /// Largest angle of the first photograph from the normal, degrees.
    pub first_tilt_deg: f32,
    /// Time after [`Action::Shoot`](super::Action::Shoot) at which a photograph counts as missed, seconds.
    pub shot_seconds: f64,
}

impl Default for GuideOptions {
    /// Values of `docs/research/guided-capture.md`.
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
