//! Classes of two directions of an anisotropic lobe.
//!
//! Stripes, weaves and twills turn one yarn by a quarter: both directions have one colour, and only their
//! highlights differ. A fit without optional lobes tries pairs of directions at right angles. Each texel
//! belongs to the direction that lowers its cost.

use std::f64::consts::FRAC_PI_4;

use crate::Svbrdf;
use crate::estimate::bundle::{Problem, State};
use crate::estimate::noise::Noise;
use crate::estimate::posterior::spread;
use crate::estimate::prior::Prior;
use crate::observation::Observation;
use crate::svbrdf::LOBES;

/// Anisotropy of the pairs that are tried: alphas that differ by a factor of 2.2.
const STRENGTH: f64 = 0.8;
/// Number of pairs, at equal angles.
const PAIRS: usize = 4;

/// Shares of texels in two classes of direction.
#[derive(Debug, Clone)]
pub(super) struct Directions {
    pub shares: Vec<[f32; 2]>,
    /// Anisotropy of each class, as tried.
    pub start: [[f64; 2]; 2],
}

impl Directions {
    /// The pair of directions that lowers the cost of a fit without optional lobes most.
    pub fn of(problem: &Problem, state: &State) -> Self {
        let tried = (0..PAIRS).map(|i| {
            let (sin, cos) = (i as f64 * FRAC_PI_4).sin_cos();
            let start = [1.0, -1.0].map(|sign| [sign * STRENGTH * cos, sign * STRENGTH * sin]);
            let [a, b] = start.map(|anisotropy| problem.costs_with(state, anisotropy));
            let least: f64 = a.iter().zip(&b).map(|(a, b)| a.min(*b)).sum();
            let shares = a.iter().zip(&b).map(|(a, b)| shares((a - b) as f32)).collect();
            (least, Self { shares, start })
        });
        let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, best)| best).expect("several pairs")
    }

    /// Shares of texels at full size in classes of these lobes.
    pub fn at_full_size(
        maps: &Svbrdf,
        observations: &[Observation],
        noise: Noise,
        lobes: [[f64; LOBES]; 2],
    ) -> Vec<[f32; 2]> {
        let [a, b] = lobes.map(|lobes| {
            let mut maps = maps.clone();
            let of_all = |value: &f64| std::iter::repeat_n(*value as f32, maps.texels());
            maps.set_lobes(lobes.iter().flat_map(of_all).collect()).expect("eight planes");
            spread(&maps, &Prior::default(), noise, observations).loss().to_vec()
        });
        a.iter().zip(&b).map(|(a, b)| shares(3.0 / noise.scale * (a - b))).collect()
    }
}

/// Shares of a texel whose first direction costs `more` than the second.
fn shares(more: f32) -> [f32; 2] {
    let second = 1.0 / (1.0 + (-more).exp());
    [1.0 - second, second]
}
