//! Corrections of the given views: exposure, flash, directions of lights, ambient light.

use crate::observation::{Falloff, View};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Largest logarithm of the factor of reflected ambient light.
pub(super) const MAX_MIRRORED: f64 = 2.0;
/// Largest accepted logarithm of a gain, and exponent.
const MAX_LOGARITHM: f64 = 20.0;

/// Corrections of the given views.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Correction {
    /// Light rotation of each photograph about the sample's centre: two angles, radians.
    pub turns: Vec<[f64; 2]>,
    /// Ambient irradiance as a fraction of the flash's.
    pub ambient: f64,
    /// Logarithm of each photograph's [`View::mirrored`], the factor of its reflected ambient light.
    pub mirrored: Vec<f64>,
    /// Exposure of the photographs and offset of the flash.
    pub exposure: LightCorrection,
}

/// Correction of each photograph's exposure and of the flash's position.
///
/// Photograph `i` is brighter than its view by `exp(log_gains[i]) * (d[i] / d_mean)^exponent`. `d` is the
/// camera's distance from the sample's centre, `d_mean` the geometric mean of all.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LightCorrection {
    /// Logarithm of each photograph's gain.
    #[serde(rename = "gains")]
    pub log_gains: Vec<f64>,
    /// Exponent of exposure over distance.
    pub exponent: f64,
    /// Logarithm of `d_mean`, mm.
    pub log_distance: f64,
    /// Offset of every light, mm, board frame.
    pub offset_mm: [f64; 3],
}

impl LightCorrection {
    /// Limits a correction that was read to the accepted range.
    ///
    /// # Errors
    /// When a number is not finite.
    pub(crate) fn within_limits(mut self) -> Result<Self> {
        let numbers = self.log_gains.iter().chain(&self.offset_mm);
        finite(numbers.chain([&self.exponent, &self.log_distance]))?;
        for v in self.log_gains.iter_mut().chain([&mut self.exponent]) {
            *v = v.clamp(-MAX_LOGARITHM, MAX_LOGARITHM);
        }
        Ok(self)
    }

    /// No correction of photographs with these views.
    pub(super) fn as_given<'a>(views: impl ExactSizeIterator<Item = &'a View>) -> Self {
        let count = views.len();
        let sum: f64 = views.map(log_distance).sum();
        let log_distance = sum / count.max(1) as f64;
        Self { log_gains: vec![0.0; count], log_distance, ..Self::default() }
    }

    /// Factor by which a photograph is brighter than its view. Without an index, its own gain counts as 1.
    pub fn factor(&self, view: &View, index: Option<usize>) -> f64 {
        let gain = index.and_then(|i| self.log_gains.get(i)).copied().unwrap_or(0.0);
        (gain + self.exponent * (log_distance(view) - self.log_distance)).exp()
    }

    /// The corrected view of a photograph that was not fitted.
    pub fn predict(&self, given: &View) -> View {
        self.apply(given, None)
    }

    /// The view with exposure and light corrected.
    fn apply(&self, given: &View, index: Option<usize>) -> View {
        let mut view = *given;
        if *self == Self::default() {
            return view;
        }
        let factor = self.factor(given, index) as f32;
        match &mut view.falloff {
            Falloff::None { power } => power.iter_mut().for_each(|p| *p *= factor),
            Falloff::InverseSquare { power_mm2 } => power_mm2.iter_mut().for_each(|p| *p *= factor),
        }
        view.ambient.iter_mut().for_each(|a| *a *= factor);
        for (to, by) in view.light_mm.iter_mut().zip(self.offset_mm) {
            *to += by as f32;
        }
        // Keeps the flash above the sample.
        view.light_mm[2] = view.light_mm[2].max(1.0);
        view
    }
}

/// Logarithm of the camera's distance from the sample's centre, mm.
pub(super) fn log_distance(view: &View) -> f64 {
    let square: f64 = view.camera_mm.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
    0.5 * square.max(1e-6).ln()
}

fn finite<'a>(values: impl IntoIterator<Item = &'a f64>) -> Result<()> {
    if values.into_iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(Error::argument("correction", "finite numbers are expected"))
}

impl Correction {
    /// Limits a correction that was read to the accepted range.
    ///
    /// # Errors
    /// When a number is not finite.
    pub(super) fn within_limits(mut self) -> Result<Self> {
        finite(self.turns.as_flattened().iter().chain(&self.mirrored).chain([&self.ambient]))?;
        self.mirrored.iter_mut().for_each(|v| *v = v.clamp(-MAX_MIRRORED, MAX_MIRRORED));
        Ok(Self { exposure: self.exposure.within_limits()?, ..self })
    }

    /// The corrected view of photograph `index`.
    pub fn apply(&self, given: &View, index: usize) -> View {
        let view = self.exposure.apply(given, Some(index));
        corrected(&view, self.turn(index), self.ambient, self.mirrored(index))
    }

    /// The corrected view of a photograph that was not fitted.
    pub(super) fn predict(&self, given: &View) -> View {
        self.apply(given, usize::MAX)
    }

    fn turn(&self, index: usize) -> [f64; 2] {
        self.turns.get(index).copied().unwrap_or_default()
    }

    fn mirrored(&self, index: usize) -> f64 {
        self.mirrored.get(index).copied().unwrap_or_default()
    }
}

/// A view with its light rotated about the sample's centre, more ambient light, and reflected ambient light
/// times `exp(mirrored)`.
pub(super) fn corrected(given: &View, turn: [f64; 2], ambient: f64, mirrored: f64) -> View {
    let light = glam::Vec3::from(given.light_mm).as_dvec3();
    let (u, v) = light.normalize_or(glam::DVec3::Z).any_orthonormal_pair();
    let turn = glam::DQuat::from_scaled_axis(u * turn[0] + v * turn[1]);
    let white = match given.falloff {
        Falloff::None { power } => power,
        Falloff::InverseSquare { power_mm2 } => {
            power_mm2.map(|p| p / light.length_squared().max(1.0) as f32)
        }
    };
    let mut view = *given;
    view.light_mm = (turn * light).as_vec3().into();
    view.mirrored = given.mirrored * mirrored.exp() as f32;
    for (a, w) in view.ambient.iter_mut().zip(white) {
        *a += ambient as f32 * w / std::f32::consts::PI;
    }
    view
}
