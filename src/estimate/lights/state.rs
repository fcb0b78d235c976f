//! Unknowns of lights and texels, and steps of them.

use crate::estimate::correction::{Correction, MAX_MIRRORED};
use crate::estimate::options::LightOptions;
use crate::estimate::prior::range;
use crate::svbrdf::CHANNELS;

/// Which lights are free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Free {
    /// Whether lights turn.
    pub turn: bool,
    /// Whether ambient light is looked for that the given views do not have.
    pub ambient: bool,
    /// Whether the surround differs from photograph to photograph where the sample mirrors it.
    pub mirror: bool,
}

/// Unknowns: nine planes of texel coordinates (see [`crate::estimate::prior`]), lights, and by how much
/// the coordinates of the estimate are off everywhere.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    pub texels: Vec<f64>,
    pub correction: Correction,
    pub offset: [f64; CHANNELS],
}

impl State {
    /// After `length` of a step of what texels share, and `texel_length` of their own.
    pub(super) fn moved(
        &self,
        step: &Self,
        length: f64,
        texel_length: f64,
        options: &LightOptions,
    ) -> Self {
        let LightOptions { max_step, max_turn: [longest_step, longest_turn], .. } = *options;
        let n = self.texels.len() / CHANNELS;
        let texel = |(i, (from, by)): (usize, (&f64, &f64))| {
            let by = (texel_length * by).clamp(-max_step, max_step);
            let (low, high) = range(i / n);
            (from + by).clamp(low, high)
        };
        let turn = |(a, d): (&[f64; 2], &[f64; 2])| {
            let longest = (longest_step / d[0].hypot(d[1]).max(longest_step)) * length;
            let to = [a[0] + longest * d[0], a[1] + longest * d[1]];
            let size = to[0].hypot(to[1]);
            to.map(|t| t * (longest_turn / size.max(longest_turn)))
        };
        let mirrored = |(m, by): (&f64, &f64)| {
            (m + (length * by).clamp(-1.0, 1.0)).clamp(-MAX_MIRRORED, MAX_MIRRORED)
        };
        let (at, by) = (&self.correction, &step.correction);
        Self {
            texels: self.texels.iter().zip(&step.texels).enumerate().map(texel).collect(),
            correction: Correction {
                turns: at.turns.iter().zip(&by.turns).map(turn).collect(),
                ambient: (at.ambient + length * by.ambient).clamp(0.0, options.max_ambient),
                mirrored: at.mirrored.iter().zip(&by.mirrored).map(mirrored).collect(),
                exposure: at.exposure.clone(),
            },
            offset: std::array::from_fn(|c| self.offset[c] + length * step.offset[c]),
        }
    }
}

/// Where a step may lead.
pub(super) struct Trial {
    /// How much of the step of what texels share was taken.
    pub(super) length: f64,
    pub(super) cost: f64,
    pub(super) state: State,
    /// Texels that took less than their whole step.
    pub(super) cut: Vec<bool>,
}

/// Damping of each texel's equations, relative to their diagonal.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Damping(pub Vec<f64>);

impl Damping {
    pub(super) fn new(texels: usize, options: &LightOptions) -> Self {
        Self(vec![options.first_damping; texels])
    }

    pub(super) fn update(&mut self, trial: &Trial, options: &LightOptions) {
        let [least, greatest] = options.damping;
        for (damping, cut) in self.0.iter_mut().zip(&trial.cut) {
            *damping *= if *cut { options.raise } else { options.ease };
            *damping = damping.clamp(least, greatest);
        }
    }

    /// More for all, as no step descends; whether that is possible.
    pub(super) fn raise(&mut self, options: &LightOptions) -> bool {
        let greatest = options.damping[1];
        let more = self.0.iter().any(|d| *d < greatest);
        self.0.iter_mut().for_each(|d| *d = (options.refuse * *d).min(greatest));
        more
    }
}
