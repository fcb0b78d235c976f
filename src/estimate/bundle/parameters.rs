//! Unknowns that all texels or a group of them share.

use super::state::{SharedLobes, State};
use crate::estimate::correction::{Correction, MAX_MIRRORED, log_distance};
use crate::observation::View;
use crate::reflectance::TexelView;
use crate::svbrdf::lobe;

/// A shared unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::estimate) enum Parameter {
    /// Logarithm of a photograph's gain.
    Gain(usize),
    /// Exponent of exposure over distance.
    Exponent,
    /// Offset of the flash along an axis, mm.
    Flash(usize),
    /// One of two angles of a photograph's light rotation, radians.
    Rotation(usize, usize),
    /// Logarithm of a photograph's factor of reflected ambient light.
    Mirrored(usize),
    /// Ambient irradiance as a fraction of the flash's.
    Ambient,
    /// A group's contribution to one of the two numbers of anisotropy.
    Anisotropy(usize, usize),
    /// Weight or roughness of the coat.
    Coat(usize),
    /// Red, green, blue or roughness of the sheen.
    Sheen(usize),
}

/// A free parameter.
#[derive(Debug, Clone, Copy)]
pub(in crate::estimate) struct Shared {
    pub parameter: Parameter,
    /// Mean and precision of its prior.
    pub mean: f64,
    pub precision: f64,
    /// Longest step.
    pub max_step: f64,
    /// Accepted values.
    pub range: [f64; 2],
}

impl Shared {
    /// A prior round zero without bounds.
    pub fn new(parameter: Parameter, precision: f64, max_step: f64) -> Self {
        let range = [f64::NEG_INFINITY, f64::INFINITY];
        Self { parameter, mean: 0.0, precision, max_step, range }
    }

    pub fn around(self, mean: f64) -> Self {
        Self { mean, ..self }
    }

    pub fn within(self, low: f64, high: f64) -> Self {
        Self { range: [low, high], ..self }
    }
}

/// The derivative of a texel's radiance by a parameter.
pub(super) enum Derivative {
    /// The radiance times this.
    Factor(f64),
    /// That of a group's anisotropy, and of another [`lobe`].
    OfAnisotropy(usize, usize),
    OfLobe(usize),
    /// That of the view.
    OfView(Change),
}

/// Derivative of a view by a parameter.
#[derive(Debug, Clone, Copy)]
pub(super) struct Change {
    pub place: [f32; 3],
    pub power: [f32; 3],
    /// Ambient light, and reflected ambient light.
    pub ambient: [f32; 3],
    pub mirrored: [f32; 3],
}

impl Change {
    /// Central difference of two views at `-by` and `by`.
    pub fn between(before: &View, after: &View, by: f64) -> Self {
        let [before_lit, after_lit] = [before, after].map(|view| TexelView::new(view, 1, 1));
        let slope = |a: [f32; 3], b: [f32; 3]| {
            std::array::from_fn(|i| ((f64::from(b[i]) - f64::from(a[i])) / (2.0 * by)) as f32)
        };
        Self {
            place: slope(before.light_mm, after.light_mm),
            power: slope(before_lit.power, after_lit.power),
            ambient: slope(before_lit.ambient, after_lit.ambient),
            mirrored: slope(before_lit.mirrored, after_lit.mirrored),
        }
    }
}

impl Parameter {
    pub fn get(self, state: &State) -> f64 {
        let Correction { turns: rotations, ambient, mirrored, exposure } = &state.correction;
        let lobes = state.lobes.as_ref();
        match self {
            Self::Anisotropy(group, i) => lobes.map_or(0.0, |lobes| lobes.anisotropy[group][i]),
            Self::Coat(i) => lobes.map_or(0.0, |lobes| lobes.coat[i]),
            Self::Sheen(i) => lobes.and_then(|lobes| lobes.sheen).map_or(0.0, |sheen| sheen[i]),
            Self::Gain(i) => exposure.log_gains[i],
            Self::Exponent => exposure.exponent,
            Self::Flash(axis) => exposure.offset_mm[axis],
            Self::Rotation(i, axis) => rotations[i][axis],
            Self::Mirrored(i) => mirrored[i],
            Self::Ambient => *ambient,
        }
    }

    pub fn set(self, state: &mut State, value: f64) {
        let Correction { turns: rotations, ambient, mirrored, exposure } = &mut state.correction;
        let groups = state.groups.len();
        let lobes = &mut state.lobes;
        let none = || SharedLobes::none(groups);
        *match self {
            Self::Anisotropy(group, i) => &mut lobes.get_or_insert_with(none).anisotropy[group][i],
            Self::Coat(i) => &mut lobes.get_or_insert_with(none).coat[i],
            Self::Sheen(i) => &mut lobes.get_or_insert_with(none).sheen.get_or_insert_default()[i],
            Self::Gain(i) => &mut exposure.log_gains[i],
            Self::Exponent => &mut exposure.exponent,
            Self::Flash(axis) => &mut exposure.offset_mm[axis],
            Self::Rotation(i, axis) => &mut rotations[i][axis],
            Self::Mirrored(i) => &mut mirrored[i],
            Self::Ambient => ambient,
        } = value;
    }

    /// Whether photograph `index` depends on it.
    fn concerns(self, index: usize) -> bool {
        match self {
            Self::Gain(i) | Self::Rotation(i, _) | Self::Mirrored(i) => i == index,
            Self::Exponent
            | Self::Flash(_)
            | Self::Ambient
            | Self::Anisotropy(..)
            | Self::Coat(_)
            | Self::Sheen(_) => true,
        }
    }

    /// Step of the central difference.
    fn difference(self) -> f64 {
        match self {
            Self::Flash(_) => 0.5,
            Self::Mirrored(_) => 1e-2,
            _ => 1e-3,
        }
    }

    /// Derivative of photograph `index` with an uncorrected view; `None` if it is zero.
    pub(super) fn derivative(self, given: &View, index: usize, at: &State) -> Option<Derivative> {
        if !self.concerns(index) {
            return None;
        }
        Some(match self {
            Self::Gain(_) => Derivative::Factor(1.0),
            Self::Exponent => {
                Derivative::Factor(log_distance(given) - at.correction.exposure.log_distance)
            }
            Self::Anisotropy(group, i) => Derivative::OfAnisotropy(group, i),
            Self::Coat(i) => Derivative::OfLobe(lobe::COAT + i),
            Self::Sheen(i) => Derivative::OfLobe(lobe::SHEEN + i),
            _ => {
                let by = self.difference();
                let moved = |by: f64| {
                    let correction = at.correction.clone();
                    let mut state =
                        State { deviations: vec![], groups: vec![], correction, lobes: None };
                    self.set(&mut state, self.get(at) + by);
                    state.correction.apply(given, index)
                };
                Derivative::OfView(Change::between(&moved(-by), &moved(by), by))
            }
        })
    }
}

/// Range of the logarithm of the factor of reflected ambient light.
pub(in crate::estimate) const MIRRORED: [f64; 2] = [-MAX_MIRRORED, MAX_MIRRORED];
