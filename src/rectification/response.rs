//! Conversion of pixel values to radiance.

use super::mapping::Positions;
use crate::calibration::photometry::{Lobe, Radiometry};
use crate::geometry::Camera;
use crate::photo::{Photo, ToneCurve, ToneTable};

/// Radiance per pixel value, tabulated over the squared tangent to the optical axis.
pub(super) struct Response {
    pub gain: [f32; 3],
    tone: ToneCurve,
    /// Inverse of the tone curve; `None` for linear values.
    undo: Option<ToneTable>,
    /// `1 / V` of the lens and `1 / cos^n` of the flash's lobe, at equal steps of tan².
    lens: Vec<f32>,
    lobe: Vec<f32>,
    /// Deviation of the lobe from rotational symmetry.
    pattern: [f32; 2],
    per_tan2: f32,
}

impl Response {
    /// Linear interpolation over this many steps errs by less than 1e-5 for plausible lenses.
    const STEPS: usize = 1024;

    pub fn new(radiometry: &Radiometry, camera: &Camera) -> Self {
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        // Corner of the photo, with a margin for distortion and the flash offset.
        let x = camera.cx.max(w - camera.cx) / camera.fx;
        let y = camera.cy.max(h - camera.cy) / camera.fy;
        let step = 2.0 * (x * x + y * y) / Self::STEPS as f64;
        let table = |f: &dyn Fn(f64) -> f64| -> Vec<f32> {
            (0..=Self::STEPS + 1).map(|i| (1.0 / f(i as f64 * step)) as f32).collect()
        };
        Self {
            gain: radiometry.gain.map(|g| g as f32),
            tone: radiometry.tone,
            undo: ToneTable::new(&radiometry.tone),
            lens: table(&|tan2| radiometry.vignetting.at(tan2)),
            lobe: table(&|tan2| (1.0 + tan2).powf(-0.5 * radiometry.lobe.exponent)),
            pattern: radiometry.lobe.pattern.map(|p| p as f32),
            per_tan2: (1.0 / step) as f32,
        }
    }

    /// Reciprocal of vignetting times lobe.
    pub fn relative(&self, positions: &Positions, lane: usize) -> f32 {
        let read = |table: &[f32], tan2: f32| {
            let at = (tan2 * self.per_tan2).clamp(0.0, Self::STEPS as f32);
            let (low, fraction) = (at as usize, at.fract());
            table[low] + fraction * (table[low + 1] - table[low])
        };
        let [x, y] = positions.from_light.map(|lanes| lanes[lane]);
        let tan2 = x * x + y * y;
        let [along, across] = self.pattern;
        let pattern = 1.0 + (along * (x * x - y * y) + across * 2.0 * x * y) / (1.0 + tan2);
        let round = read(&self.lens, positions.tan2[lane]) * read(&self.lobe, tan2);
        round / pattern.max(Lobe::MIN_PATTERN as f32)
    }
    /// Undoes the camera's tone curve for a pixel.
    #[inline]
    pub fn linear(&self, rgb: [f32; 3]) -> [f32; 3] {
        match &self.undo {
            None => rgb,
            Some(table) => rgb.map(|v| table.undo(v)),
        }
    }

    /// Stored value from which on a photograph's channels are saturated.
    pub fn saturation(&self, photo: &Photo) -> f32 {
        match self.tone.unknown_from {
            0.0 => photo.saturation(),
            level => photo.saturation().min(level),
        }
    }

    /// Converts radiances of a channel to another response, given [`Self::relative`] of both.
    pub fn update(&self, to: &Self, channel: usize, relative: &[[f32; 2]], values: &mut [f32]) {
        let gains = [self.gain[channel], to.gain[channel]];
        let gain = gains[1] / gains[0];
        if self.tone.log_slopes == to.tone.log_slopes {
            let scaled = values.iter_mut().zip(relative);
            scaled.for_each(|(v, [old, new])| *v *= new / old * gain);
            return;
        }
        for (v, [old, new]) in values.iter_mut().zip(relative) {
            let linear = *v / (old * gains[0]);
            let stored = self.undo.as_ref().map_or(linear, |table| table.put_on(linear));
            let linear = to.undo.as_ref().map_or(stored, |table| table.undo(stored));
            *v = linear * new * gains[1];
        }
    }
}
