//! Motion of the camera.

use super::options::GuideOptions;
use crate::session::Probe;

/// Longest interval between pictures for an estimate of motion, seconds.
const MEMORY: f64 = 0.5;

/// Motion according to the pictures so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Motion {
    /// Time and outline (px) of the latest picture that showed the sample.
    latest: Option<(f64, [[f32; 2]; 4])>,
    /// Start of the present steady period.
    steady_since: Option<f64>,
}

impl Motion {
    /// Adds a picture.
    pub(super) fn see(&mut self, probe: &Probe, seconds: f64, options: &GuideOptions) {
        let Some(outline) = probe.view.and_then(|view| view.sample_px) else {
            *self = Self::default();
            return;
        };
        let before = self.latest.replace((seconds, outline));
        let speed =
            before.filter(|(at, _)| *at < seconds && seconds - at < MEMORY).map(|(at, earlier)| {
                let moved = mean(|i| distance(outline[i], earlier[i]));
                let width = mean(|i| distance(outline[i], outline[(i + 1) % 4]));
                moved / width.max(1.0) / (seconds - at) as f32
            });
        match speed {
            Some(speed) if speed <= options.steady => {
                let since = before.map_or(seconds, |(at, _)| at);
                self.steady_since.get_or_insert(since);
            }
            _ => self.steady_since = None,
        }
    }

    /// Whether the camera has been steady for long enough.
    pub(super) fn is_steady(&self, seconds: f64, options: &GuideOptions) -> bool {
        let enough = f64::from(options.steady_seconds);
        self.steady_since.is_some_and(|since| seconds - since >= enough)
    }
}

fn mean(of: impl Fn(usize) -> f32) -> f32 {
    (0..4).map(of).sum::<f32>() / 4.0
}

fn distance(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
